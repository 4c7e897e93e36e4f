#!/usr/bin/env python3
"""The programs as a person uses them: output, files, exit codes, refusals, Ctrl-C. Usage: programs_test.py HANDHOLD"""
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import xml.etree.ElementTree

SOURCE = pathlib.Path(__file__).resolve().parents[2]
HANDHOLD = pathlib.Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else SOURCE / "build/release/bin/handhold"


def run(*arguments, **options):
    """The finished program with its text."""
    environment = {key: value for key, value in os.environ.items() if key != "HANDHOLD_DB"}
    environment.update(options.pop("env", {}))
    return subprocess.run([HANDHOLD, *map(str, arguments)], capture_output=True, text=True, timeout=600,
                          env=environment, **options)


class Programs(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="handhold_app_"))
        self.addCleanup(shutil.rmtree, self.folder)
        self.db = self.folder / "db"

    def job(self, objects=("box.stl",), hand="jaw", sampling="{samples: 12, rolls: 3}", extra="", name="job.yaml"):
        lines = [f"  - {{name: {pathlib.Path(o).stem}, mesh: {SOURCE / 'meshes' / o}, unit: m}}" for o in objects]
        path = self.folder / name
        path.write_text("catalog:\n" + "\n".join(lines) + f"\nhands: [{SOURCE}/hands/{hand}]\nsampling: {sampling}\n{extra}")
        return path

    def build(self, *arguments, **job):
        return run("build", self.job(**job), "--db", self.db, "--progress", "none", *arguments)

    def assert_refused(self, result, *parts):
        """Wrong input: exit 2, nothing on stdout, one line on stderr that names what is wrong."""
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertEqual(result.stdout, "")
        self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
        for part in parts:
            self.assertIn(part, result.stderr)

    def fake_sbatch(self, *lines):
        """A PATH whose sbatch writes down its arguments and then does what the lines say."""
        program = self.folder / "bin/sbatch"
        program.parent.mkdir(exist_ok=True)
        program.write_text("\n".join(["#!/bin/sh", f"printf '%s\\n' \"$@\" --end-- >> {self.folder}/calls", *lines]) + "\n")
        program.chmod(0o755)
        return {"PATH": f"{program.parent}:{os.environ['PATH']}"}

    # --- what works

    def test_help_and_version(self):
        for arguments in (["--help"], ["build", "--help"], ["list", "--help"], ["info", "--help"], ["query", "--help"],
                          ["index", "--help"], ["hand", "--help"], ["verify", "--help"], ["diff", "--help"],
                          ["prune", "--help"], ["submit", "--help"], ["export", "--help"], ["import", "--help"]):
            result = run(*arguments)
            self.assertEqual(result.returncode, 0)
            self.assertIn("--help", result.stdout)
        self.assertRegex(run("--version").stdout, r"^handhold \d+\.\d+\.\d+ \(.+\)")

    def test_build_list_info(self):
        result = self.build(objects=("box.stl", "t_bar.ply"))
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("2 sets built, 0 unchanged, 0 failed", result.stdout)
        for word in ("object", "hand", "N", "R", "M", "trials", "FC %", "grasps", "best eps", "core s"):
            self.assertIn(word, result.stdout.splitlines()[0])
        for word in ("N, R, M", "FC %", "grasps", "best eps", "core s"):
            self.assertRegex(result.stdout, rf"(?m)^  {word} +[a-z]")  # each heading has its row below
        again = self.build(objects=("box.stl", "t_bar.ply"))
        self.assertIn("0 sets built, 2 unchanged, 0 failed", again.stdout)

        listed = json.loads(run("list", "--db", self.db, "--format", "json").stdout)
        self.assertEqual([(s["object"], s["hand"], s["set_version"]) for s in listed], [("box", "jaw", 1), ("t_bar", "jaw", 1)])
        table = run("list", env={"HANDHOLD_DB": str(self.db)}).stdout
        self.assertIn("t_bar", table)
        info = json.loads(run("info", self.db / "t_bar/jaw/v0001.h5", "--format", "json").stdout)
        for key in ("object", "hand", "set_version", "samples", "rolls", "preshapes", "trials", "outcomes", "grasps",
                    "best_epsilon", "best_epsilon_lower", "best_epsilon_upper", "least_critical_friction", "best_load_margin",
                    "largest_load_margin", "load_margins", "seconds", "trials_by_reference"):
            self.assertIn(key, info)
        self.assertLessEqual(info["best_epsilon"], info["best_epsilon_upper"] + 1e-9)
        self.assertLessEqual(info["best_epsilon_lower"], info["best_epsilon_upper"])
        self.assertLessEqual(info["least_critical_friction"], info["friction"] + 1e-6)
        self.assertIn("bounds", info["seconds"])
        shown = run("info", self.db / "t_bar/jaw/v0001.h5").stdout
        self.assertRegex(shown, r"(?m)^    bounds +\d")
        self.assertNotIn("robustness", shown)  # the job does not ask for it
        self.assertRegex(shown, r"(?m)^    force_closed +\d")
        self.assertNotIn("not_run", shown)  # there are none
        self.assertGreater(info["best_load_margin"], 0)
        self.assertLessEqual(info["best_load_margin"], info["largest_load_margin"])
        self.assertEqual(info["load_margins"], min(200, info["grasps"]))
        self.assertIn("load_margin", info["seconds"])
        self.assertRegex(run("info", self.db / "t_bar").stdout, r"load margin of the same grasp \d+\.\d+ N")
        self.assertRegex(run("info", self.db / "t_bar").stdout, r"true cone   epsilon of the same grasp 0\.\d+ to 0\.\d+")
        self.assertEqual(info["trials"], info["samples"] * info["rolls"] * info["preshapes"])
        self.assertEqual(sum(info["outcomes"].values()), info["trials"])
        self.assertEqual(info["outcomes"]["force_closed"], info["grasps"])
        self.assertIn("force_closed", run("info", self.db / "t_bar").stdout)
        self.assertRegex(run("info", self.db / "t_bar").stdout, r"reference   ran \d+ of them")

    def test_format_of_built_sets(self):
        self.assertEqual(self.build(objects=("t_bar.ply",)).returncode, 0)
        self.assertEqual(self.build(objects=("can.ply",), sampling="{samples: 1, rolls: 1}").returncode, 0)  # no grasp
        files = sorted(self.db.rglob("v*.h5"))
        check = subprocess.run(["/usr/bin/python3", SOURCE / "tests/store/check_format.py", *files], capture_output=True, text=True)
        self.assertEqual(check.returncode, 0, check.stdout + check.stderr)

    def test_shards_are_parts_of_the_whole(self):
        objects = ("box.stl", "t_bar.ply")
        self.assertIn("1 set built", self.build("--shard", "0/3", objects=objects).stdout)
        self.assertIn("1 set built", self.build("--shard", "1/3", objects=objects).stdout)
        empty = self.build("--shard", "2/3", objects=objects)
        self.assertEqual((empty.returncode, empty.stdout.splitlines()[-1]),
                         (0, "0 sets built, 0 unchanged, 0 failed, 0 stopped before they were done"))
        self.assertIn("0 sets built, 2 unchanged", self.build(objects=objects).stdout)
        self.assert_refused(self.build("--shard", "2/3", "--object", "none", objects=objects), "--object none", "picks no set")

    def test_submission_is_shown_without_slurm(self):
        job = self.job(objects=("box.stl", "can.ply", "t_bar.ply"))
        db = self.folder / "it's a db%"
        shown = run("submit", job, "--slurm", "--db", db, "--print", "--shards", "2", "--object", "*", "--", "--account=lab",
                    "--partition", "long jobs", env={"PATH": "/nowhere"})
        self.assertEqual(shown.returncode, 0, shown.stderr)
        self.assertIn("3 sets: 0 done, 3 to build in 2 of 2 shards", shown.stdout)
        for part in ("export HDF5_USE_FILE_LOCKING=FALSE", f"{HANDHOLD} build {job}", '--shard "$SLURM_ARRAY_TASK_ID/2"',
                     "--object '*'", "--array=0-1", "--dependency=afterany:", "it'\\''s a db%%/submit/job-"):
            self.assertIn(part, shown.stdout)
        commands = [line for line in shown.stdout.splitlines() if line.startswith("sbatch ")]
        self.assertEqual(len(commands), 2)
        for command in commands:
            self.assertIn("--account=lab --partition 'long jobs'", command)
        self.assertFalse(db.exists())

    def test_submission_calls_sbatch_twice_and_again_for_what_is_missing(self):
        job = self.job(objects=("box.stl", "can.ply", "t_bar.ply"))
        submit = ("submit", job, "--slurm", "--db", self.db)
        sbatch = self.fake_sbatch("echo '41;cluster'")
        first = run(*submit, "--", "--time=5", env=sbatch)
        self.assertEqual(first.returncode, 0, first.stderr)
        array, summary = [call.split() for call in (self.folder / "calls").read_text().split("--end--")[:2]]
        for call in (array, summary):
            self.assertIn("--time=5", call)
        self.assertIn("--array=0-2", array)
        self.assertIn("--dependency=afterany:41", summary)
        self.assertEqual(summary[-1], "41")
        # What Slurm would do.
        for task in range(2):
            done = subprocess.run(["bash", array[-1]], env={**os.environ, "SLURM_ARRAY_TASK_ID": str(task), "SLURM_CPUS_ON_NODE": "1"},
                                  capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)
        report = subprocess.run(["bash", *summary[-2:]], capture_output=True, text=True)
        self.assertEqual(report.returncode, 1, report.stderr)
        self.assertRegex(report.stdout, r"(?m)^missing +\w+ x jaw  shard 2$")
        self.assertIn("3 sets: 2 done, 1 to build", report.stdout)
        (self.folder / "calls").unlink()
        self.assertIn("1 to build in 1 of 3 shards", run(*submit, env=sbatch).stdout)
        self.assertIn("--array=2\n", (self.folder / "calls").read_text())
        self.assertEqual(self.build(objects=("box.stl", "can.ply", "t_bar.ply")).returncode, 0)
        (self.folder / "calls").unlink()
        finished = run(*submit, env=sbatch)
        self.assertEqual((finished.returncode, finished.stdout), (0, "3 sets: 3 done, 0 to build in 0 of 3 shards\n"))
        self.assertFalse((self.folder / "calls").exists())
        self.assertEqual(subprocess.run(["bash", *summary[-2:]], capture_output=True).returncode, 0)

    def test_submission_is_refused(self):
        job = self.job()
        submit = ("submit", job, "--slurm", "--db", self.db)
        self.assert_refused(run(*submit, env={"PATH": "/nowhere"}), "sbatch is not in PATH", "slurm-client", "--print")
        sbatch = self.fake_sbatch("echo 'no such account' >&2; exit 3")
        failed = run(*submit, env=sbatch)
        self.assertEqual(failed.returncode, 1)
        self.assertIn("no such account", failed.stderr)
        self.assertIn("sbatch refused with exit code 3: sbatch --parsable", failed.stderr)
        silent = run(*submit, env=self.fake_sbatch("echo welcome"))
        self.assertEqual(silent.returncode, 1)
        self.assertIn('printed "welcome', silent.stderr)
        (self.folder / "calls").unlink()
        for arguments, parts in (((*submit, "--", "--array=1-4"), ("--array=1-4", "--shards")),
                                 ((*submit, "--", "-olog"), ("-olog", "-o is not passed on")),
                                 ((*submit, "--", "--wait"), ("--wait is not passed on",)),
                                 ((*submit, "stray"), ('"stray"', "after --")),
                                 ((*submit, "--account=lab"), ("--account=lab",)),
                                 ((*submit, "--shards", "0"), ("--shards",)),
                                 ((*submit, "--hand", "none"), ("--hand none", "picks no set")),
                                 (("submit", job, "--db", self.db), ("--slurm",)),
                                 (("submit", self.folder / "none.yaml", "--slurm"), ("none.yaml",)),
                                 (("submit", self.job(sampling="{samples: 0}", name="wrong.yaml"), "--slurm"), ("wrong.yaml:4", "samples"))):
            self.assert_refused(run(*arguments, env=sbatch), *parts)
        self.assertFalse((self.folder / "calls").exists())

    def test_trial_is_explained_and_nothing_written(self):
        self.assertEqual(self.build(objects=("t_bar.ply",)).returncode, 0)
        shutil.move(self.db, self.folder / "built")
        from_set = self.first_closed_trial(self.folder / "built/t_bar/jaw/v0001.h5")
        result = self.build("--object", "t_bar", "--hand", "jaw", "--trial", from_set["trial"], objects=("t_bar.ply",))
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("outcome force_closed", result.stdout)
        self.assertIn(f"epsilon {from_set['epsilon']:.6f}", result.stdout)
        self.assertRegex(result.stdout, r"on the true cone epsilon is 0\.\d+ to 0\.\d+, and force closure needs friction 0\.\d+")
        self.assertIn("backed off by", result.stdout)
        self.assertFalse(self.db.exists())
        self.assertRegex(result.stdout, r"load margin \d+\.\d+ N over 14 tasks")
        beyond = self.build("--object", "t_bar", "--hand", "jaw", "--trial", 10**6, objects=("t_bar.ply",))
        self.assert_refused(beyond, "--trial 1000000", "want 0 to")

    def first_closed_trial(self, path):
        code = ("import h5py, sys, json; f = h5py.File(sys.argv[1]); _, r, m = f['trials/outcome'].shape; "
                "t = f['grasps/trial'][0]; "
                "print(json.dumps({'trial': int((t[0] * r + t[1]) * m + t[2]), 'epsilon': float(f['grasps/epsilon'][0])}))")
        return json.loads(subprocess.run(["/usr/bin/python3", "-c", code, path], capture_output=True, text=True, check=True).stdout)

    def test_thread_count_changes_nothing(self):
        for threads in (1, 2):
            self.assertEqual(run("build", self.job(objects=("t_bar.ply",)), "--db", self.folder / f"db{threads}", "--threads", threads,
                                 "--progress", "none").returncode, 0)
        code = ("import h5py, sys, numpy as np\na, b = (h5py.File(p) for p in sys.argv[1:])\nnames = []\n"
                "a.visititems(lambda n, o: names.append(n) if isinstance(o, h5py.Dataset) and not n.startswith('timings') else None)\n"
                "assert len(names) > 30\n"
                "for n in names:\n"
                "  x, y = a[n][()], b[n][()]\n"
                "  assert np.array_equal(x, y, equal_nan=x.dtype.kind == 'f') if hasattr(x, 'dtype') else x == y, n\n")
        check = subprocess.run(["/usr/bin/python3", "-c", code, *(self.folder / f"db{t}/t_bar/jaw/v0001.h5" for t in (1, 2))],
                               capture_output=True, text=True)
        self.assertEqual(check.returncode, 0, check.stderr)

    def test_dry_run_writes_nothing(self):
        result = self.build("--dry-run")
        self.assertEqual(result.returncode, 0)
        self.assertIn("1 sets missing", result.stdout)
        self.assertIn("core-hours", result.stdout)
        self.assertFalse(self.db.exists())

    def test_dry_run_learns_from_sets(self):
        self.assertEqual(self.build(objects=("t_bar.ply",)).returncode, 0)
        plan = json.loads(self.build("--dry-run", "--format", "json", objects=("box.stl", "t_bar.ply")).stdout)
        self.assertEqual([s["state"] for s in plan["sets"]], ["missing", "done"])
        self.assertEqual(plan["hands"][0]["rates"]["sets"], 1)
        self.assertGreater(plan["total"]["core_hours"], 0)
        size = (self.db / "t_bar/jaw/v0001.h5").stat().st_size / 1e9
        self.assertAlmostEqual(plan["total"]["gigabytes"] / size, 1, delta=0.05)  # a set like the one that is there
        self.assert_refused(self.build("--format", "json"), "--format json is given without --dry-run")

    def test_verify(self):
        self.assertEqual(self.build(objects=("box.stl", "t_bar.ply")).returncode, 0)
        result = run("verify", "--db", self.db, "--sample", "5")
        self.assertEqual(result.returncode, 0, result.stdout)
        self.assertIn("t_bar x jaw v0001: 5 grasps and 5 trials recomputed", result.stdout)
        self.assertIn("2 sets: 2 good", result.stdout)
        report = json.loads(run("verify", "--db", self.db, "--object", "t*", "--sample", "0", "--format", "json").stdout)
        self.assertEqual([(r["state"], r["grasps"]) for r in report], [("good", 0)])
        self.assert_refused(run("verify", "--db", self.db, "--set-version", "2"), "--set-version 2 picks no set")
        self.assert_refused(run("verify", "--db", self.db, "--sample", "-1"), "--sample")
        path = self.db / "t_bar/jaw/v0001.h5"
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
        result = run("verify", "--db", self.db)
        self.assertEqual(result.returncode, 1)
        self.assertIn("damaged        t_bar x jaw v0001: ", result.stdout)
        self.assertIn("good           box x jaw v0001: ", result.stdout)  # the rest is done

    def test_diff(self):
        self.assertEqual(self.build(objects=("t_bar.ply",)).returncode, 0)
        self.assertEqual(self.build("--force", objects=("t_bar.ply",)).returncode, 0)
        first, second = (self.db / f"t_bar/jaw/v000{v}.h5" for v in (1, 2))
        equal = run("diff", first, second)
        self.assertEqual(equal.returncode, 0, equal.stdout)
        self.assertIn("equal", equal.stdout)
        self.assertEqual(self.build(objects=("t_bar.ply",), extra="quality: {friction: 0.6}\n").returncode, 0)
        result = run("diff", "t_bar/jaw/v1", "t_bar/jaw", "--db", self.db)
        self.assertEqual(result.returncode, 1)
        for text in ("job quality.friction: (not given) -> 0.6", "friction: 0.4 -> 0.6", "force_closed", "median_epsilon",
                     "epsilon differs in", "v0003.h5"):
            self.assertIn(text, result.stdout)
        report = json.loads(run("diff", first, "t_bar/jaw/v0003", "--db", self.db, "--format", "json").stdout)
        self.assertFalse(report["equal"])
        self.assertIn("/@friction", report["datasets"])
        self.assertEqual(report["grasps"]["pose_changed"], 0)  # friction moves no finger
        self.assertGreater(report["grasps"]["common"], 0)
        self.assert_refused(run("diff", first, "t_bar/claw", "--db", self.db), "has no set of t_bar x claw")
        self.assert_refused(run("diff", first, "nowhere.h5"), "nowhere.h5: is no file")

    def test_prune(self):
        for _ in range(3):
            self.assertEqual(self.build("--force", objects=("t_bar.ply",)).returncode, 0)
        folder = self.db / "t_bar/jaw"
        (folder / "physics-v0001.h5").write_text("x")
        dry = run("prune", "--db", self.db, "--keep", "1", "--dry-run")
        self.assertIn("would remove", dry.stdout)
        self.assertEqual(len(list(folder.iterdir())), 4)
        result = run("prune", "--db", self.db, "--keep", "1")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn(f"removed {folder}/v0001.h5 (", result.stdout)
        self.assertIn("3 files, ", result.stdout)
        self.assertEqual([p.name for p in folder.iterdir()], ["v0003.h5"])
        self.assertEqual(self.build("--force", objects=("t_bar.ply",)).returncode, 0)
        self.assertTrue((folder / "v0004.h5").exists())
        self.assert_refused(run("prune", "--db", self.db, "--keep", "0"), "--keep")
        self.assert_refused(run("prune", "--db", self.db), "--keep")
        self.assert_refused(run("prune", "--db", self.folder / "none", "--keep", "1"), "is no folder")

    def test_progress_as_json_lines(self):
        result = run("build", self.job(), "--db", self.db, "--progress", "json")
        events = [json.loads(line) for line in result.stderr.splitlines() if line.startswith("{")]
        self.assertEqual({event["event"] for event in events}, {"progress"})
        last = events[-1]
        self.assertEqual((last["sets_done"], last["sets"], last["current"]), (last["sets"], last["sets"], ""))
        self.assertEqual(last["trials"], last["trials_expected"])

    def test_render(self):
        self.assertEqual(self.build(objects=("t_bar.ply",)).returncode, 0)
        picture = self.folder / "grasp.png"
        result = run("render", self.db / "t_bar/jaw/v0001.h5", "--out", picture)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual(picture.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
        self.assert_refused(run("render", f"{self.db / 't_bar/jaw/v0001.h5'}:100000", "--out", picture), "100000")
        self.assert_refused(run("render", self.db / "t_bar/jaw/v0001.h5", "--out", self.folder / "a.jpg"), "a.jpg", ".png")

    def test_report(self):
        self.assertEqual(self.build(objects=("box.stl", "t_bar.ply")).returncode, 0)
        page = self.folder / "report.html"
        result = run("report", "--db", self.db, "--out", page, "--top", "3")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertRegex(result.stdout, r"report.html: 2 sets, \d+ grasps, [0-9.]+ MB\n")
        self.assertIn('"shown":3', page.read_text())
        self.assert_refused(run("report", "--db", self.db, "--out", page, "--object", "teapot"), "teapot")
        self.assert_refused(run("report", "--db", self.db), "--out")
        self.assert_refused(run("report", "--db", self.db, "--out", page, "--top", "0"), "--top")
        # A damaged set is told on the page and by the exit code; the others are shown.
        broken = self.db / "box/jaw/v0001.h5"
        broken.chmod(0o644)
        broken.write_bytes(broken.read_bytes()[:-1])
        result = run("report", "--db", self.db, "--out", page)
        self.assertEqual(result.returncode, 1)
        self.assertIn("1 sets", result.stdout)
        self.assertIn(str(broken), result.stderr)
        self.assertIn(str(broken), page.read_text())
        # An older version is not shown beside the newest.
        self.assertEqual(run("build", self.job(objects=("t_bar.ply",)), "--db", self.db, "--force", "--progress", "none").returncode, 0)
        result = run("report", "--db", self.db, "--object", "t_bar", "--out", page)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("1 sets", result.stdout)
        self.assertIn("t_bar/jaw/v0002.h5", page.read_text())
        result = run("report", "--db", self.db, "--object", "t_bar", "--out", self.folder / "none/report.html")
        self.assertEqual(result.returncode, 1)
        self.assertIn("none", result.stderr)

    def test_query(self):
        self.assertEqual(self.build(objects=("box.stl", "t_bar.ply")).returncode, 0)
        table = run("query", "--db", self.db, "--top", 2)
        self.assertEqual(table.returncode, 0, table.stderr)
        lines = table.stdout.splitlines()
        for word in ("object", "hand", "grasp", "preshape", "epsilon", "mu", "approach", "contacts"):
            self.assertIn(word, lines[0])
        self.assertEqual([line.split()[0] for line in lines[1:5]], ["box", "box", "t_bar", "t_bar"])
        self.assertIn("4 grasps from 2 of 2 sets", lines)
        self.assertIn("at the friction that the set was built with (0.4)", table.stdout)
        rows = json.loads(run("query", "--db", self.db, "--object", "t_bar", "--format", "json").stdout)
        self.assertGreater(len(rows), 4)
        self.assertEqual(list(rows[0])[:5], ["object", "hand", "set_version", "grasp", "trial"])
        self.assertEqual([row["grasp"] for row in rows], list(range(len(rows))))
        self.assertEqual((len(rows[0]["hand_pose"]), len(rows[0]["joint_position"])), (7, len(rows[0]["joint_names"])))
        diverse = run("query", "--db", self.db, "--object", "t_bar", "--top", 3, "--diverse", "--format", "csv")
        self.assertEqual(len(diverse.stdout.splitlines()), 4)
        self.assertRegex(diverse.stderr, rf"t_bar x jaw v1: cover radius 0\.\d+ m: each of the {len(rows)} grasps that pass lies")
        self.assertIn("cover radius", run("query", "--db", self.db, "--top", 3, "--diverse").stdout)

    def test_an_empty_answer_is_no_failure_and_says_why(self):
        self.assertEqual(self.build(objects=("t_bar.ply",)).returncode, 0)
        for arguments, why in [(("--min-epsilon", 0.04, "--near", "9,9,9", "--radius", 1), r"\d+ by --min-epsilon, \d+ by --near"),
                               (("--friction", 0), r"\d+ by --friction"), (("--preshape", "x*"), r"\d+ by --preshape"),
                               (("--approach", "-.0,0,1e-9", "--within", 0.001, "--near", "9,9,9", "--radius", 0), "left out"),
                               (("--min-physics", 0), "not simulated")]:
            result = run("query", "--db", self.db, "--format", "json", *arguments)
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertEqual(json.loads(result.stdout), [])
            self.assertRegex(result.stderr, r"(\d+) of \1 grasps left out: ")
            self.assertRegex(result.stderr, why)
        self.assertIn("no physics results beside them", result.stderr)

    def test_physics(self):
        self.assertEqual(self.build(objects=("t_bar.ply",)).returncode, 0)
        path = self.db / "t_bar/jaw/v0001.h5"
        result = run("physics", "--db", self.db, "--top", 2, "--progress", "none")
        if "was built without MuJoCo" in result.stderr:
            self.assertEqual(result.returncode, 2)
            return
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertRegex(result.stdout, r"t_bar x jaw: held: pull \d of 2 \(")
        self.assertTrue((path.parent / "physics-v0001.h5").exists())
        self.assertIn("unchanged", run("physics", "--db", self.db, "--top", 2, "--progress", "none").stdout)
        found = json.loads(run("query", "--db", self.db, "--min-physics", 0, "--format", "json").stdout)
        self.assertEqual([grasp["grasp"] for grasp in found], [0, 1])
        self.assertIn("physics     2 grasps simulated at friction 0.6", run("info", path).stdout)
        replay = run("physics", "--replay", f"{path}:1")
        self.assertEqual(replay.returncode, 0, replay.stderr)
        self.assertIn("equal to the stored results, bit for bit", replay.stdout)
        self.assert_refused(run("physics", "--replay", f"{path}:100000"), "grasp 100000 does not exist, the set holds")
        self.assert_refused(run("physics", "--replay", f"{path}:0", "--test", "lift"), "gives the object no mass")
        self.assert_refused(run("physics", "--db", self.db, "--object", "none"), "picks no set")
        self.assert_refused(run("physics", "--db", self.db, "--test", "push"), "--test")

    def test_physics_calibrate(self):
        self.assertEqual(self.build(objects=("t_bar.ply", "banana.obj"), sampling="{samples: 24, rolls: 6}").returncode, 0)

        def calibrate(name, *arguments):
            return run("physics", "--db", self.db, "--calibrate", self.folder / name, *arguments)
        result = calibrate("one", "--draw", 12, "--threads", 1)
        if "was built without MuJoCo" in result.stderr:
            self.skipTest("without MuJoCo")
        self.assertEqual(result.returncode, 0, result.stderr)
        for word in ("| t_bar | jaw | ", "| rank | all | ", "| settled | stored | ", "calibration-jaw.yaml"):
            self.assertIn(word, result.stdout)
        again = calibrate("three", "--draw", 12, "--threads", 3)
        self.assertEqual(again.stdout.replace("/three/", "/one/"), result.stdout)
        names = {"calibration-jaw.yaml", "reliability-jaw.svg", "roc-jaw.svg"}
        self.assertEqual({path.name for path in (self.folder / "one").iterdir()}, names)
        for name in names:
            self.assertEqual((self.folder / "one" / name).read_bytes(), (self.folder / "three" / name).read_bytes(), name)
        for name in names - {"calibration-jaw.yaml"}:
            picture = xml.etree.ElementTree.parse(self.folder / "one" / name)
            self.assertIn("jaw", "".join(picture.getroot().itertext()))
        # One object cannot be judged by others.
        result = calibrate("none", "--object", "banana", "--draw", 2)
        self.assertEqual(result.returncode, 1)
        self.assertRegex(result.stderr, r"^error: jaw: nothing to tell apart: .*; no model is written\n$")
        self.assertEqual(list((self.folder / "none").iterdir()), [])
        self.assert_refused(calibrate("no_sets", "--object", "none"), "picks no set")
        self.assertFalse((self.folder / "no_sets").exists())
        self.assert_refused(calibrate("none", "--groups", 2), "--calibrate")
        self.assert_refused(run("physics", "--db", self.db, "--draw", 2), "--draw")

    def test_query_is_refused_in_words(self):
        self.assertEqual(self.build(objects=("t_bar.ply",)).returncode, 0)
        for arguments, parts in [(("--friction", 0.5), ("friction is 0.5, want at most 0.4", "t_bar/jaw/v0001.h5")),
                                 (("--approach", "1,0,0"), ("--approach requires --within",)),
                                 (("--within", 3), ("--within requires --approach",)),
                                 (("--near", "1,0,0"), ("--near requires --radius",)),
                                 (("--radius", 3), ("--radius requires --near",)),
                                 (("--approach", "1,0", "--within", 3), ('--approach is "1,0", want three numbers',)),
                                 (("--near", "1,0,0,", "--radius", 3), ('--near is "1,0,0,"',)),
                                 (("--top", 0), ("--top",)), (("--top", -1), ("--top",)), (("--top", "many"), ("--top",)),
                                 (("--diverse",), ("--diverse requires --top",)),
                                 (("--set-version", 2), ("version 2 picks no set",)),
                                 (("--object", "cup"), ('object "cup"', "picks no set")),
                                 (("--format", "xml"), ("--format",)), (("--min-epsilon", "nan"), ("min-epsilon is nan",))]:
            self.assert_refused(run("query", "--db", self.db, *arguments), *parts)
        self.assert_refused(run("query", "--db", self.folder / "none"), "none: is no folder")
        self.assert_refused(run("index", "--db", self.folder / "none"), "none: is no folder")

    def test_index_changes_no_answer(self):
        self.assertEqual(self.build(objects=("box.stl", "t_bar.ply")).returncode, 0)
        asked = [("list",), ("list", "--format", "json"), ("query", "--min-epsilon", 0.04), ("query", "--friction", 0.3)]
        answers = [run(*arguments, "--db", self.db) for arguments in asked]
        result = run("index", "--db", self.db)
        self.assertEqual((result.returncode, result.stdout), (0, f"2 sets in the index of {self.db}\n"))
        self.assertTrue((self.db / "index.sqlite").exists())

        def assert_same():
            for arguments, before in zip(asked, answers):
                after = run(*arguments, "--db", self.db)
                self.assertEqual((after.returncode, after.stdout), (before.returncode, before.stdout))
                self.assertEqual(after.stderr.replace(warning, ""), before.stderr)
        warning = "none"
        assert_same()
        (self.db / "index.sqlite").write_bytes(b"no index" * 1000)
        warning = run("list", "--db", self.db).stderr
        self.assertEqual(warning.count("\n"), 1)
        self.assertIn("index.sqlite: is not used", warning)
        assert_same()

    def test_hand_is_checked(self):
        for hand in ("barrett", "hrp2", "jaw"):
            result = run("hand", SOURCE / "hands" / hand)
            self.assertEqual(result.returncode, 0, result.stderr)
            for word in ("joints:", "palm in link", "closed on nothing", "closed on a sphere", "the hand is ready",
                         "contacts are points"):
                self.assertIn(word, result.stdout)
        template = run("hand", SOURCE / "hands/jaw/jaw.urdf", "--init")
        self.assertIn("urdf: jaw.urdf", template.stdout)
        self.assertIn("# contact: {model: soft_finger, torsion_radius: METRES}", template.stdout)
        folder = self.folder / "mine"
        folder.mkdir()
        shutil.copy(SOURCE / "hands/jaw/jaw.urdf", folder)
        (folder / "hand.yaml").write_text(template.stdout)
        pictures = self.folder / "pictures"
        result = run("hand", folder, "--out", pictures)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("the hand is ready", result.stdout)
        self.assertEqual(sorted(path.name for path in pictures.iterdir()), ["half.png", "open.png"])
        for path in pictures.iterdir():
            self.assertIn(str(path), result.stdout)
            self.assertEqual(path.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
        # What was guessed grasps.
        job = self.job(objects=("t_bar.ply",))
        job.write_text(job.read_text().replace(f"{SOURCE}/hands/jaw", str(folder)))
        self.assertEqual(run("build", job, "--db", self.db, "--progress", "none").returncode, 0)
        self.assertGreater(json.loads(run("info", self.db / "t_bar/mine/v0001.h5", "--format", "json").stdout)["grasps"], 0)

    def test_soft_fingers(self):
        hand = self.folder / "soft"
        shutil.copytree(SOURCE / "hands/jaw", hand)
        config = (hand / "hand.yaml").read_text()
        (hand / "hand.yaml").write_text(config + "contact: {model: soft_finger, torsion_radius: 0.005}\n")
        said = "soft fingers, torsion radius 0.005 m"
        self.assertIn(f"contacts are {said}", run("hand", hand).stdout)
        job = self.job(objects=("t_bar.ply",))
        job.write_text(job.read_text().replace(f"{SOURCE}/hands/jaw", str(hand)))
        self.assertEqual(run("build", job, "--db", self.db, "--progress", "none").returncode, 0)
        path = self.db / "t_bar/soft/v0001.h5"
        self.assertRegex(run("info", path).stdout, rf"contacts +{said}")
        info = json.loads(run("info", path, "--format", "json").stdout)
        self.assertEqual((info["contact_model"], info["torsion_radius"]), ("soft_finger", 0.005))
        check = subprocess.run(["/usr/bin/python3", SOURCE / "tests/store/check_format.py", path], capture_output=True, text=True)
        self.assertEqual(check.returncode, 0, check.stdout + check.stderr)
        best = self.first_closed_trial(path)
        trial = run("build", job, "--db", self.db, "--object", "t_bar", "--hand", "soft", "--trial", best["trial"])
        self.assertIn(f"epsilon {best['epsilon']:.6f} (contacts are {said};", trial.stdout)
        (hand / "hand.yaml").write_text(config + "contact: {model: soft_finger, torsion_radius: 5}\n")
        self.assert_refused(run("hand", hand), "hand.yaml:", "contact.torsion_radius is \"5\"", "at most 0.1")

    def test_same_object_in_three_formats_has_one_frame(self):
        subprocess.run(["/usr/bin/python3", SOURCE / "scripts/generate_meshes", "--out", self.folder / "all", "--frame-test", self.folder],
                       check=True, capture_output=True)
        entries = {"obj": self.folder / "all/mug.obj", "glb": self.folder / "mug.glb", "dae": self.folder / "mug.dae"}
        job = self.folder / "frames.yaml"
        job.write_text("catalog:\n" + "".join(f"  - {{name: {k}, mesh: {v}, unit: m}}\n" for k, v in entries.items()) +
                       f"hands: [{SOURCE}/hands/jaw]\nsampling: {{samples: 6, rolls: 2}}\n")
        self.assertEqual(run("build", job, "--db", self.db, "--progress", "none").returncode, 0)
        code = ("import h5py, sys, numpy as np\nsets = [h5py.File(p) for p in sys.argv[1:]]\n"
                "v = [np.array(sorted(map(tuple, s['object/vertices'][()]))) for s in sets]\n"
                "assert v[0].shape == v[1].shape == v[2].shape\n"
                "assert max(abs(v[0] - v[1]).max(), abs(v[0] - v[2]).max()) < 1e-6\n"
                "c = [s['object/center_of_mass'][()] for s in sets]\nassert max(abs(c[0] - c[1]).max(), abs(c[0] - c[2]).max()) < 1e-6\n")
        check = subprocess.run(["/usr/bin/python3", "-c", code, *(self.db / k / "jaw/v0001.h5" for k in entries)], capture_output=True, text=True)
        self.assertEqual(check.returncode, 0, check.stderr)

    def test_installed_programs_work(self):
        build = HANDHOLD.parent.parent
        subprocess.run(["cmake", "--install", build, "--prefix", self.folder / "usr"], check=True, capture_output=True)
        share = self.folder / "usr/share/handhold"
        result = subprocess.run([self.folder / "usr/bin/handhold", "build", share / "jobs/demo.yaml", "--object", "t_bar", "--hand", "jaw",
                                 "--dry-run", "--db", self.db], capture_output=True, text=True)
        self.assertIn("1 sets missing", result.stdout, result.stderr)
        job = self.job(objects=("t_bar.ply",))
        result = subprocess.run([self.folder / "usr/bin/handhold", "build", job, "--db", self.db], capture_output=True, text=True)
        self.assertEqual(result.returncode, 0, result.stderr)  # the importer is found in libexec

    # --- real meshes and hands

    @unittest.skipUnless(os.environ.get("HANDHOLD_DATA"), "HANDHOLD_DATA names no folder with real meshes and hands")
    def test_shared_hands_are_checked(self):
        for hand in ("barrett_bh280", "robotiq_2f85", "franka_hand", "allegro_right", "panda_hand"):
            result = run("hand", SOURCE / "tests/data/hands" / hand)
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertIn("the hand is ready", result.stdout, hand)

    @unittest.skipUnless(os.environ.get("HANDHOLD_DATA"), "HANDHOLD_DATA names no folder with real meshes and hands")
    def test_ycb_objects_with_the_barrett_hand(self):
        ycb = pathlib.Path(os.environ["HANDHOLD_DATA"]) / "meshes/ycb"
        files = {"mug": "025_mug.ply", "mustard": "006_mustard_bottle.stl", "drill": "035_power_drill.ply", "hammer": "048_hammer.obj"}
        job = self.folder / "ycb.yaml"
        job.write_text("catalog:\n" + "".join(f"  - {{name: {k}, mesh: {ycb / v}, unit: m}}\n" for k, v in files.items()) +
                       f"hands: [{SOURCE}/hands/barrett]\nsampling: {{samples: 16, rolls: 4}}\nquality: {{friction: 0.4}}\n")
        result = run("build", job, "--db", self.db, "--progress", "none")
        self.assertEqual(result.returncode, 0, result.stderr)
        for info in json.loads(run("list", "--db", self.db, "--format", "json").stdout):
            share = info["grasps"] / info["trials"]
            self.assertGreater(share, 0.05 if info["object"] in ("mug", "mustard") else 0, info["object"])

    # --- what fails, and how

    def test_one_bad_object_builds_the_others(self):
        job = self.job(objects=("box.stl",))
        (self.folder / "bad.stl").write_bytes(b"\0" * 90)
        job.write_text(job.read_text().replace("catalog:\n", "catalog:\n  - {name: bad, mesh: bad.stl, unit: m}\n"))
        result = run("build", job, "--db", self.db, "--progress", "none")
        self.assertEqual(result.returncode, 1)
        self.assertIn("1 set built, 0 unchanged, 1 failed", result.stdout)
        self.assertIn("repeat with: handhold build", result.stdout)
        record = self.db / "bad/jaw/failed.json"
        failure = json.loads(record.read_text())
        self.assertEqual((failure["object"], failure["hand"], failure["known_bad"]), ("bad", "jaw", True))
        self.assertTrue((self.db / "box/jaw/v0001.h5").exists())
        plan = run("build", job, "--db", self.db, "--dry-run").stdout
        self.assertIn("failed     bad x jaw", plan)
        self.assertIn("done       box x jaw", plan)
        self.assertIn("1 failed and left alone", plan)
        plan = json.loads(run("build", job, "--db", self.db, "--dry-run", "--format", "json").stdout)
        self.assertEqual([(s["object"], s["state"]) for s in plan["sets"]], [("bad", "failed"), ("box", "done")])
        self.assertEqual(plan["sets"][0]["error"], failure["error"])
        self.assertEqual((plan["total"]["done"], plan["total"]["failed"], plan["total"]["trials"]), (1, 1, 0))
        record.write_text("[{}, 3, {\"object\": 1}]")  # nonsense in it stops nobody
        self.assertIn("missing    bad x jaw", run("build", job, "--db", self.db, "--dry-run").stdout)

    def test_known_failure_is_left_alone_and_its_command_repeats_it(self):
        bad = self.folder / "bad.stl"
        bad.write_bytes(b"\0" * 90)
        job = self.folder / "job.yaml"
        job.write_text(f"catalog: [{{name: bad, mesh: bad.stl, unit: m}}]\nhands: [{SOURCE}/hands/jaw]\nsampling: {{samples: 4, rolls: 2}}\n")
        first = run("build", job, "--db", self.db, "--progress", "none")
        self.assertIn("error: bad x jaw", first.stderr)
        again = run("build", job, "--db", self.db, "--progress", "none")
        self.assertEqual(again.returncode, 1)
        self.assertIn("1 failed (1 known)", again.stdout)
        self.assertIn("failed (known; --retry-failed tries again): bad x jaw: ", again.stdout)
        self.assertEqual(again.stderr, "")
        command = [line.split("repeat with: handhold ")[1] for line in again.stdout.splitlines() if "repeat with" in line][0]
        tried = run(*command.split(), cwd="/")  # from anywhere
        self.assertEqual(tried.returncode, 1)
        self.assertIn("error: bad x jaw", tried.stderr)
        shutil.copy(SOURCE / "meshes/box.stl", bad)
        mended = run("build", job, "--db", self.db, "--progress", "none")
        self.assertEqual(mended.returncode, 0, mended.stderr)
        self.assertFalse((self.db / "bad/jaw/failed.json").exists())

    def test_timeout_fails_its_item_alone(self):
        job = self.job(objects=("box.stl",), hand="barrett", sampling="{samples: 3000, rolls: 16}",
                       extra="simulation: reference\ntimeout: 2\n")
        start = time.monotonic()
        result = run("build", job, "--db", self.db, "--progress", "none")
        self.assertLess(time.monotonic() - start, 30)
        self.assertEqual(result.returncode, 1)
        self.assertIn("box x barrett: took longer than the job's timeout of 2 s", result.stdout)
        self.assertIn("1 failed (1 known)", run("build", job, "--db", self.db, "--progress", "none").stdout)
        self.assert_refused(self.build(extra="timeout: -1\n"), "job.yaml:5: timeout is \"-1\", want a number > 0")

    def test_wrong_usage(self):
        self.assert_refused(run(), "subcommand")
        self.assert_refused(run("bild"), "bild")
        self.assert_refused(run("build"), "job")
        self.assert_refused(run("build", self.folder / "missing.yaml"), "missing.yaml: cannot be read")
        self.assert_refused(self.build("--threads", "0"), "--threads")
        self.assert_refused(self.build("--shard", "3/3"), "--shard is \"3/3\"")
        self.assert_refused(self.build("--object", "nothing"), "picks no set")
        self.assert_refused(self.build("--trial", "1", objects=("box.stl", "can.ply")), "pick one of each")
        self.assert_refused(self.build(extra="colour: red\n"), "job.yaml:5: colour is not a known key")
        self.assert_refused(self.build(hand="nowhere"), "nowhere")
        self.assert_refused(run("info", self.folder / "none.h5"), "none.h5")
        self.assert_refused(run("info", self.folder), "holds no grasp set")
        self.assert_refused(run("list", "--db", self.folder / "none"), "none: is no folder")
        self.assert_refused(run("render", self.folder / "none.h5", "--out", self.folder / "x.png"), "none.h5")
        for option in ("build", "job.yaml", "--trial"), ("verify", "--sample"), ("hand", "jaw", "--sphere"):
            refused = run(*option, "-1")
            self.assert_refused(refused, option[-1], "-1")
            self.assertLess(len(refused.stderr), 120)  # the range in digits that can be read
        self.assertFalse(self.db.exists())
        self.db.write_text("")
        self.assert_refused(self.build(), f"{self.db}: is no folder")

    def test_hands_are_refused_in_words(self):
        xacro = self.folder / "hand.urdf.xacro"
        xacro.write_text("<robot xmlns:xacro='http://www.ros.org/wiki/xacro' name='x'/>")
        self.assert_refused(run("hand", xacro), "is a xacro file", "xacro hand.urdf.xacro > hand.urdf")
        self.assert_refused(run("hand", SOURCE / "hands/jaw/jaw.urdf"), "--init")
        self.assert_refused(run("hand", SOURCE / "hands/jaw/jaw.urdf", "--init", "--root", "elbow"), "has no link elbow")
        self.assert_refused(run("hand", SOURCE / "hands/jaw", "--root", "palm"), "--init")
        self.assert_refused(run("hand", SOURCE / "hands/jaw/jaw.urdf", "--init", "--out", self.folder), "--out")
        self.assert_refused(run("hand", self.folder / "none"), "none", "does not exist")

    def test_damaged_set_is_told(self):
        self.assertEqual(self.build(objects=("t_bar.ply",)).returncode, 0)
        path = self.db / "t_bar/jaw/v0001.h5"
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.unlink()
        path.write_bytes(data)
        self.assert_refused(run("info", path), "v0001.h5")
        listed = run("list", "--db", self.db)
        self.assertEqual(listed.returncode, 1)
        self.assertIn("v0001.h5", listed.stderr)

    def test_interrupt_stops_within_a_second_and_keeps_finished_sets(self):
        job = self.job(objects=("box.stl", "t_bar.ply"), hand="barrett", sampling="{samples: 3000, rolls: 16}")
        quick = self.job(objects=("box.stl",), sampling="{samples: 4, rolls: 2}", name="quick.yaml")
        self.assertEqual(run("build", quick, "--db", self.db, "--progress", "none").returncode, 0)
        before = self.files_beside_chunks()
        process = subprocess.Popen([HANDHOLD, "build", job, "--db", self.db], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        time.sleep(2)
        start = time.monotonic()
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=30)
        self.assertLess(time.monotonic() - start, 1.0 if "asan" not in str(HANDHOLD) else 10.0)
        self.assertEqual(process.returncode, 1, errors)
        self.assertIn("2 stopped before they were done", output)
        self.assertEqual(self.files_beside_chunks(), before)

    def files_beside_chunks(self):
        """All but what the next run goes on from."""
        files = [path for path in self.db.rglob("*") if path.is_file()]
        return sorted(path for path in files if not path.parent.name.startswith(".chunks-"))


if __name__ == "__main__":
    print(f"testing {HANDHOLD}")
    unittest.main(argv=sys.argv[:1]+sys.argv[2:])
