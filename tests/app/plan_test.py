#!/usr/bin/env python3
"""The online program as a person uses it, on sets that the offline one builds. Usage: plan_test.py HANDHOLD_PLAN HANDHOLD EXAMPLE"""
import collections
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
PLAN, HANDHOLD, EXAMPLE = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
ROBOTS = SOURCE / "robots"


def run(program, *arguments, **options):
    environment = {key: value for key, value in os.environ.items() if key != "HANDHOLD_DB"}
    return subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=600,
                          env=environment, **options)


class OnlineProgram(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="handhold_plan_"))
        cls.db = cls.folder / "db"
        job = cls.folder / "job.yaml"
        job.write_text(f"catalog:\n  - {{name: t_bar, mesh: {SOURCE}/meshes/t_bar.ply, unit: m}}\n"
                       f"  - {{name: mug, mesh: {SOURCE}/meshes/mug.obj, unit: m}}\n"
                       f"hands: [{SOURCE}/hands/jaw, {SOURCE}/hands/hrp2]\nsampling: {{samples: 40, rolls: 8}}\n")
        done = run(HANDHOLD, "build", job, "--db", cls.db, "--progress", "none")
        assert done.returncode == 0, done.stderr
        cls.scene = cls.folder / "scene.yaml"
        cls.scene.write_text("robot: {joints: home}\n"
                             "target: {object: t_bar, pose: {position: [0.5, 0.1, 0]}}\n"
                             "obstacles:\n"
                             "  - {name: table, box: [0.9, 1.2, 0.04], pose: {position: [0.75, 0, -0.02]}}\n"
                             "  - {name: can, cylinder: {radius: 0.03, length: 0.12}, pose: {position: [0.5, -0.1, 0.06]}}\n"
                             "  - {name: cup, object: mug, pose: {position: [0.65, 0.2, 0]}}\n")

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def with_panda(self, *arguments, scene=None):
        return run(PLAN, *arguments, "--robot", ROBOTS / "panda", "--scene", scene or self.scene, "--db", self.db)

    def changed(self, old, new):
        path = self.folder / "changed.yaml"
        text = self.scene.read_text()
        self.assertIn(old, text)
        path.write_text(text.replace(old, new))
        return path

    def assert_refused(self, result, *parts):
        self.assertEqual(result.returncode, 2, result.stdout + result.stderr)
        self.assertEqual(result.stdout, "")
        self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
        for part in parts:
            self.assertIn(part, result.stderr)

    def test_rank(self):
        for score in "paper", "reach":
            result = self.with_panda("rank", "--score", score, "--format", "json", "--top", "0")
            self.assertEqual(result.returncode, 0, result.stderr)
            rows = json.loads(result.stdout)
            self.assertEqual([row["rank"] for row in rows], list(range(1, len(rows) + 1)))
            self.assertEqual(sorted(row["grasp"] for row in rows), list(range(len(rows))))
            self.assertTrue(all(a["score"] >= b["score"] for a, b in zip(rows, rows[1:])))
            for key in "trial", "gq", "gb", "ge", "hand_pose", "arm":
                self.assertIn(key, rows[0])
        table = self.with_panda("rank", "--top", "3").stdout.splitlines()
        self.assertEqual(len(table), 9, table)
        self.assertEqual([line.split()[0] for line in table[4:8]], ["trial", "gq", "gb", "ge"], table)

    def test_plan(self):
        out = self.folder / "plan.json"
        result = self.with_panda("plan", "--score", "reach", "--out", out)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertEqual(len(result.stdout.strip().splitlines()), 5, result.stdout)
        self.assertIn("by panda, arm, hand", result.stdout)
        plan = json.loads(out.read_text())
        for key in ("status", "object", "hand", "arm", "set_version", "grasp", "trial", "rank", "tested", "terms",
                    "rejected", "hand_pose", "trajectory", "timing_ms"):
            self.assertIn(key, plan)
        trajectory = plan["trajectory"]
        self.assertEqual([s["name"] for s in trajectory["segments"]], ["transit", "approach", "close", "lift"])
        self.assertEqual(trajectory["segments"][-1]["end"], len(trajectory["points"]) - 1)
        self.assertEqual(trajectory["joint_names"], [f"joint_{i}" for i in range(1, 8)] + ["finger_1"])
        times = [p["time_from_start"] for p in trajectory["points"]]
        self.assertEqual(times, sorted(set(times)))
        again = json.loads(self.with_panda("plan", "--score", "reach").stdout)
        for key in plan:
            if key != "timing_ms":
                self.assertEqual(plan[key], again[key], key)

    def test_calibration(self):
        folder = self.folder / "calibration"
        done = run(HANDHOLD, "physics", "--db", self.db, "--hand", "jaw", "--draw", 9, "--calibrate", folder)
        if "was built without MuJoCo" in done.stderr:
            self.skipTest("without MuJoCo")
        self.assertEqual(done.returncode, 0, done.stderr)
        file = folder / "calibration-jaw.yaml"
        rows = {}
        for name, options in [("epsilon", []), ("calibrated", ["--calibration", file])]:
            result = self.with_panda("rank", "--format", "json", "--top", 0, *options)
            self.assertEqual(result.returncode, 0, result.stderr)
            rows[name] = {row["grasp"]: row for row in json.loads(result.stdout)}
        self.assertEqual(rows["epsilon"].keys(), rows["calibrated"].keys())
        for grasp, row in rows["calibrated"].items():
            self.assertTrue(0 < row["gq"] < 1)
            self.assertEqual((row["gb"], row["ge"]), (rows["epsilon"][grasp]["gb"], rows["epsilon"][grasp]["ge"]))
        self.assertEqual(rows["epsilon"][0]["gq"], 1)
        self.assertIn(f"gq by {file}", self.with_panda("rank", "--calibration", file).stdout)
        # A plan says what it was made with, and its report makes it again with that.
        out, page = self.folder / "calibrated.json", self.folder / "calibrated.html"
        self.assertEqual(self.with_panda("plan", "--calibration", file, "--out", out).returncode, 0)
        plan = json.loads(out.read_text())
        self.assertEqual(plan["source"]["calibrations"], [str(file)])
        self.assertAlmostEqual(plan["terms"]["gq"], rows["calibrated"][plan["grasp"]]["gq"], places=6)
        self.assertEqual(run(PLAN, "report", out, "--out", page).returncode, 0)
        self.assertIn("calibrated probability that the grasp holds", page.read_text())
        # For another hand, damaged, or none: refused.
        scene = self.folder / "other_hand.yaml"
        scene.write_text("robot: {base: {position: [0, 0, 0.649]}, joints: home}\n"
                         "target: {object: t_bar, pose: {position: [0.35, -0.2, 0.65]}}\n")
        self.assert_refused(run(PLAN, "rank", "--robot", ROBOTS / "hrp2", "--scene", scene, "--db", self.db,
                                "--calibration", file), "is for the hand jaw, want a calibration for hrp2 too")
        self.assert_refused(self.with_panda("rank", "--calibration", file, "--calibration", file), "want one")
        file.write_text(file.read_text().replace("coefficient: ", "coefficient: 1", 1))
        self.assert_refused(self.with_panda("rank", "--calibration", file), "calibration-jaw.yaml: is damaged")
        self.assert_refused(self.with_panda("rank", "--calibration", self.scene), "scene.yaml: is no calibration")
        self.assert_refused(self.with_panda("rank", "--calibration", folder / "none"), "none: cannot be read")

    def test_report(self):
        out, page = self.folder / "reported.json", self.folder / "plan.html"
        scene = self.folder / "crowded.yaml"
        scene.write_text(self.scene.read_text().replace("[0.5, -0.1, 0.06]", "[0.46, 0.05, 0.06]"))
        self.assertEqual(self.with_panda("plan", "--out", out, scene=scene).returncode, 0)
        source = json.loads(out.read_text())["source"]
        self.assertEqual(source, {"robot": str(ROBOTS / "panda"), "scene": str(scene), "db": str(self.db), "score": "paper"})
        result = run(PLAN, "report", out, "--out", page)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("planned", result.stdout)
        verdicts = json.loads(re.search(r'id="plan">(.*?)</script>', page.read_text(), re.S).group(1))["ranking"]["verdict"]
        plan = json.loads(out.read_text())
        self.assertGreater(plan["rank"], 1, "this scene rejects no grasp")
        self.assertEqual(verdicts.index("planned") + 1, plan["rank"])
        self.assertEqual(collections.Counter(verdicts[:plan["rank"] - 1]), plan["rejected"])
        # A plan without a source, as the server answers, is told what it was made from.
        del plan["source"]
        bare = self.folder / "bare.json"
        bare.write_text(json.dumps(plan))
        self.assert_refused(run(PLAN, "report", bare, "--out", page), "bare.json", "--robot")
        result = run(PLAN, "report", bare, "--out", page, "--robot", ROBOTS / "panda", "--scene", scene, "--db", self.db)
        self.assertEqual(result.returncode, 0, result.stderr)
        # What is not as it was when it was planned is no picture of the plan.
        moved = self.changed("[0.5, 0.1, 0]", "[0.5, 0.12, 0]")
        self.assert_refused(run(PLAN, "report", out, "--out", page, "--scene", moved), "reported.json", "another plan")
        self.assert_refused(run(PLAN, "report", out, "--out", page, "--robot", ROBOTS / "hrp2"), "reported.json")
        self.assert_refused(run(PLAN, "report", self.scene, "--out", page), "scene.yaml", "want a file that handhold-plan")
        # Infeasible scenes have a report too: it says why.
        far, infeasible = self.changed("[0.5, 0.1, 0]", "[5.5, 0.1, 0]"), self.folder / "infeasible.json"
        self.assertEqual(self.with_panda("plan", "--out", infeasible, scene=far).returncode, 1)
        result = run(PLAN, "report", infeasible, "--out", page)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("infeasible", result.stdout)

    def test_two_arms(self):
        scene = self.folder / "hrp2.yaml"
        scene.write_text("robot: {base: {position: [0, 0, 0.649]}, joints: home}\n"
                         "target: {object: t_bar, pose: {position: [0.35, -0.2, 0.65]}}\n"
                         "obstacles:\n  - {name: table, box: [0.8, 1.4, 0.04], pose: {position: [0.6, 0, 0.63]}}\n")
        result = run(PLAN, "rank", "--robot", ROBOTS / "hrp2", "--scene", scene, "--db", self.db, "--format", "json",
                     "--top", "0")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual({row["arm"] for row in json.loads(result.stdout)}, {"right", "left"})
        result = run(PLAN, "plan", "--robot", ROBOTS / "hrp2/chest.yaml", "--scene", scene, "--db", self.db, "--score",
                     "reach", "--out", self.folder / "hrp2.json")
        self.assertEqual(result.returncode, 0, result.stdout)

    def test_impossible_scenes_end_with_reasons(self):
        far = self.changed("[0.5, 0.1, 0]", "[5.5, 0.1, 0]")
        result = self.with_panda("plan", "--trace", scene=far)
        self.assertEqual(result.returncode, 1)
        plan = json.loads(result.stdout)
        self.assertEqual(plan["status"], "infeasible")
        self.assertEqual(sum(plan["rejected"].values()), plan["tested"])
        self.assertEqual(len(plan["trace"]), plan["tested"])
        self.assertIn("unreachable", plan["rejected"])

    def test_refusals(self):
        self.assert_refused(self.with_panda("rank", scene=self.changed("object: t_bar", "object: teapot")), "teapot",
                            "changed.yaml")
        self.assert_refused(self.with_panda("rank", scene=self.changed("joints: home", "joints: {elbow: 1}")),
                            "changed.yaml", "robot.joints.elbow")
        self.assert_refused(self.with_panda("rank", scene=self.changed("[0.5, 0.1, 0]}", "[0.5, 0.1, 0], orientation: [0, 0, 0, 2]}")),
                            "changed.yaml:2", "orientation")
        self.assert_refused(self.with_panda("rank", scene=self.changed("object: mug", "mesh: none.stl, unit: m")),
                            "none.stl")
        self.assert_refused(self.with_panda("plan", scene=self.changed("robot: {joints: home}", "robot: {}")),
                            "changed.yaml", "robot.joints is missing")
        self.assert_refused(self.with_panda("rank", scene=self.changed("obstacles:", "obstacle:")), "changed.yaml:3",
                            "obstacle")
        self.assert_refused(self.with_panda("rank", scene=self.folder / "nowhere.yaml"), "nowhere.yaml")
        self.assert_refused(run(PLAN, "rank", "--robot", self.folder, "--scene", self.scene), "robot.yaml")
        self.assert_refused(run(PLAN, "rank", "--scene", self.scene), "--robot")
        self.assert_refused(run(PLAN, "dance"), "dance", "rank")
        self.assert_refused(self.with_panda("rank", "--top", "-1"), "--top", "-1")
        empty = self.folder / "empty_db"
        empty.mkdir()
        self.assert_refused(run(PLAN, "rank", "--robot", ROBOTS / "panda", "--scene", self.scene, "--db", empty), "t_bar",
                            "it holds no set")
        self.assert_refused(run(PLAN, "rank", "--robot", ROBOTS / "panda", "--scene", self.scene, "--db",
                                self.folder / "no_db"), "no_db")

    def test_serve_record_and_replay(self):
        record = self.folder / "record.jsonl"
        requests = [{"id": 1, "op": "scene", "file": str(self.scene)}, {"id": 2, "op": "rank", "top": 2},
                    {"id": 3, "op": "plan", "score": "reach"}, {"id": 4, "op": "quit"}]
        text = "\n".join(map(json.dumps, requests)) + "\n"
        serve = run(PLAN, "serve", "--robot", ROBOTS / "panda", "--db", self.db, "--record", record, input=text)
        self.assertEqual(serve.returncode, 0, serve.stderr)
        answers = [json.loads(line) for line in serve.stdout.splitlines()]
        self.assertEqual([answer["id"] for answer in answers], [1, 2, 3, 4])
        self.assertTrue(all(answer["ok"] for answer in answers))
        self.assertEqual(answers[2]["result"]["status"], "planned")
        replay = run(PLAN, "serve", "--robot", ROBOTS / "panda", "--db", self.db, "--replay", record)
        self.assertEqual(replay.returncode, 0, replay.stdout)
        self.assertIn("replayed 4 requests, 0 answers differ", replay.stdout)

    def test_client_in_python(self):
        client = run(sys.executable, SOURCE / "python/handhold_client.py", PLAN, ROBOTS / "panda", self.db, self.scene)
        self.assertEqual(client.returncode, 0, client.stderr)
        self.assertTrue(client.stdout.startswith("planned after"), client.stdout)

    def test_library_example(self):
        result = run(EXAMPLE, ROBOTS / "panda", self.db, self.scene, "can")
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        lines = result.stdout.splitlines()
        self.assertEqual(lines[1].split(",")[0], lines[2], "the grasp is kept")

    def test_bench(self):
        out = self.folder / "bench"
        arguments = ("bench", "--robot", ROBOTS / "panda", "--object", "t_bar", "--db", self.db, "--scenes", "3",
                     "--seed", "5", "--format", "json")
        result = run(PLAN, *arguments, "--out", out, "--threads", "2")
        self.assertEqual(result.returncode, 0, result.stderr)
        cells = json.loads(result.stdout)["cells"]
        self.assertEqual([cell["score"] for cell in cells], ["paper", "reach"])
        for key in ("robot", "object", "scenes", "feasible_scenes", "mean_ratio", "mean_ratio_ci", "share_won",
                    "mean_tested", "median_tested", "naive_mean_tested"):
            self.assertIn(key, cells[0])
        self.assertEqual(run(PLAN, *arguments, "--threads", "1").stdout, result.stdout)
        scenes = sorted((out / "scenes").iterdir())
        self.assertEqual(len(scenes), 3)
        # A scene that was written is a scene; an order from outside is tested like the others.
        self.assertEqual(self.with_panda("rank", scene=scenes[0]).returncode, 0)
        order = self.folder / "order.json"
        ranked = {}
        for scene in scenes:
            rows = json.loads(self.with_panda("rank", "--score", "reach", "--format", "json", "--top", "0", scene=scene).stdout)
            ranked[scene.stem] = [row["grasp"] for row in rows]
        order.write_text(json.dumps(ranked))
        cells = json.loads(run(PLAN, *arguments, "--order", order).stdout)["cells"]
        self.assertEqual(cells[1]["mean_tested"], cells[2]["mean_tested"], "reach, and reach from outside")
        for name in "ablation.json", "sweep.json", "scenes.json", "cells.json":
            json.loads((out / name).read_text())
        self.assertIn("</svg>", (out / "tests.svg").read_text())

    def test_robot(self):
        result = run(PLAN, "robot", ROBOTS / "hrp2")
        self.assertEqual(result.returncode, 0)
        self.assertIn("arm right: 6 joints", result.stdout)
        first = run(PLAN, "robot", ROBOTS / "puma560/puma560.urdf", "--init")
        self.assertEqual(first.returncode, 0, first.stderr)
        self.assertIn("tip_link", first.stdout)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]], verbosity=1)
