#!/usr/bin/env python3
"""Builds on a Slurm cluster of four nodes on this machine. Usage: slurm_test.py HANDHOLD   (ends with 77 without Slurm)"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

from compare_sets import differences

SOURCE = pathlib.Path(__file__).resolve().parents[2]
HANDHOLD = pathlib.Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else SOURCE / "build/release/bin/handhold"
CLUSTER = SOURCE / "scripts/slurm_cluster"
# A stuck cluster fails here, and is stopped, before the time limit that tests/CMakeLists.txt sets.
DEADLINE = time.monotonic() + 240


def output(*command):
    result = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=60)
    if result.returncode != 0:
        raise AssertionError(f"{command} ended with {result.returncode}:\n{result.stdout}{result.stderr}")
    return result.stdout


def wait_for(what, condition):
    while not (result := condition()):
        if time.monotonic() > DEADLINE:
            raise AssertionError(f"{what}: waited in vain\n{output('squeue')}{output('sinfo')}")
        time.sleep(0.1)
    return result


def task_fields(job):
    """What scontrol knows of a job or of every task of an array: a dict each."""
    return [dict(word.split("=", 1) for word in line.split() if "=" in word)
            for line in output("scontrol", "--oneliner", "show", "job", job).splitlines()]


def is_in(link, folder):
    try:
        return folder in pathlib.Path(os.readlink(link).removesuffix(" (deleted)")).parents
    except OSError:  # the process has ended, or is somebody else's
        return False


class Slurm(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="handhold_slurm_"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.addClassCleanup(cls.stop)
        exported = output(CLUSTER, "start", cls.folder)
        os.environ["SLURM_CONF"] = re.fullmatch(r"export SLURM_CONF=(.*)\n", exported)[1]

    @classmethod
    def stop(cls):
        output(CLUSTER, "stop", cls.folder)
        assert not (cls.folder / "slurm").exists()
        mine = [link for link in pathlib.Path("/proc").glob("[0-9]*/cwd") if is_in(link, cls.folder)]
        assert not mine, f"processes are left: {mine}"

    def write_job(self, name, meshes):
        lines = [f"  - {{name: {mesh.stem}, mesh: {mesh}, unit: m}}\n" for mesh in meshes]
        path = self.folder / name
        path.write_text(f"catalog:\n{''.join(lines)}hands: [{SOURCE}/hands/jaw, {SOURCE}/hands/barrett]\n"
                        "sampling: {samples: 10, rolls: 3}\n")
        return path

    def submit(self, job, *arguments, database="db"):
        return subprocess.run([HANDHOLD, "submit", job, "--slurm", "--db", self.folder / database, *arguments],
                              capture_output=True, text=True, timeout=60)

    def submitted(self, job, *arguments):
        """The ids of the array and its summary, and what submit printed."""
        result = self.submit(job, *arguments)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        array, summary = (re.search(rf"^{what} (\d+):", result.stdout, re.M)[1] for what in ("array", "summary"))
        return array, summary, result.stdout

    def ended(self, job):
        """Waits for a job. Tasks that Slurm has put back into the queue start now, not in two minutes."""
        def is_over():
            states = [(task["JobId"], task["JobState"], task.get("Reason")) for task in task_fields(job)]
            for task, state, reason in states:
                if state == "PENDING" and reason == "BeginTime":
                    output("scontrol", "update", f"JobId={task}", "StartTime=now")
            return all(state in ("COMPLETED", "FAILED") for _, state, _ in states)
        wait_for(f"end of job {job}", is_over)
        return task_fields(job)

    def take_down_a_node_at_work(self, array):
        """A node goes down while a task of the array runs on it, so that Slurm starts the task again elsewhere."""
        def is_restarted():
            running = [task for task in task_fields(array) if task["JobState"] == "RUNNING"]
            if not running:
                return None
            node, task = running[0]["NodeList"], running[0]["JobId"]
            output("scontrol", "update", f"NodeName={node}", "State=DOWN", "Reason=test")
            if any(int(t["Restarts"]) > 0 for t in task_fields(task)):
                return node
            output("scontrol", "update", f"NodeName={node}", "State=RESUME")  # the task had just ended: another one
        return wait_for("a node taken down at work", is_restarted)

    def report_path(self):
        return next((self.folder / "db/submit").glob("job-*/summary.txt"))

    def sets(self, database):
        return {path.relative_to(database) for path in database.rglob("*.h5")}

    def test_array_survives_a_lost_node_and_a_bad_mesh(self):
        shutil.copytree(SOURCE / "meshes", self.folder / "meshes")
        meshes = [self.folder / "meshes" / name for name in ("box.stl", "can.ply", "mug.obj", "t_bar.ply")]
        job = self.write_job("job.yaml", meshes)
        local = self.folder / "local"
        output(HANDHOLD, "build", job, "--db", local, "--progress", "none")
        self.assertEqual(len(self.sets(local)), 8)

        good = meshes[3].read_bytes()
        meshes[3].write_bytes(b"ply\nformat ascii 1.0\n")
        array, summary, said = self.submitted(job, "--shards", "8", "--", "--mem=500", "--time=10")
        self.assertIn("8 sets: 0 done, 8 to build in 8 of 8 shards", said)
        down = self.take_down_a_node_at_work(array)
        # Once more while the first runs: waits for it, and finds its sets.
        second, second_summary, _ = self.submitted(job, "--shards", "8", "--", "--mem=500")
        self.assertEqual({task["Dependency"] for task in task_fields(second)}, {"singleton(unfulfilled)"})

        tasks = self.ended(array)
        self.assertIn(f"{down} down", output(CLUSTER, "nodes", self.folder))
        self.assertEqual(len(tasks), 8)
        self.assertEqual({task["TimeLimit"] for task in tasks}, {"00:10:00"})
        failed = [task for task in tasks if task["JobState"] == "FAILED"]
        self.assertEqual([task["ExitCode"] for task in failed], ["1:0", "1:0"])
        report = self.ended(summary)[0]
        self.assertEqual((report["JobState"], report["ExitCode"], report["TimeLimit"]), ("FAILED", "1:0", "00:10:00"))
        self.ended(second)
        self.ended(second_summary)
        text = self.report_path().read_text()
        self.assertIn("8 sets: 6 done, 0 to build in 0 of 8 shards, 2 failed and left alone", text)
        for hand in ("jaw", "barrett"):
            self.assertRegex(text, rf"(?m)^failed +t_bar x {hand}  shard \d  .*t_bar.ply")
        self.assertEqual(len(self.sets(self.folder / "db")), 6)

        meshes[3].write_bytes(good)
        array, summary, said = self.submitted(job, "--shards", "8")
        self.assertIn("8 sets: 6 done, 2 to build in 2 of 8 shards", said)
        self.assertEqual([task["ExitCode"] for task in self.ended(array)], ["0:0", "0:0"])
        self.assertEqual(self.ended(summary)[0]["ExitCode"], "0:0")
        self.assertIn("8 sets: 8 done, 0 to build", self.report_path().read_text())
        again = self.submit(job, "--shards", "8")
        self.assertEqual((again.returncode, again.stdout), (0, "8 sets: 8 done, 0 to build in 0 of 8 shards\n"))

        self.assertEqual(self.sets(self.folder / "db"), self.sets(local))  # each once: version 1
        for path in sorted(self.sets(local)):
            self.assertEqual(differences(local / path, self.folder / "db" / path), [], path)

    def test_what_sbatch_refuses_is_told(self):
        job = self.write_job("refused.yaml", [SOURCE / "meshes/box.stl"])
        result = self.submit(job, "--", "--partition=nowhere", database="refused")
        self.assertEqual(result.returncode, 1, result.stdout + result.stderr)
        self.assertIn("invalid partition specified: nowhere", result.stderr)
        self.assertIn("sbatch refused", result.stderr)
        self.assertNotIn("array", result.stdout)

    def test_the_cluster_is_started_once(self):
        before = output("scontrol", "ping")
        self.assertEqual(output(CLUSTER, "start", self.folder), f"export SLURM_CONF={os.environ['SLURM_CONF']}\n")
        self.assertEqual(output("scontrol", "ping"), before)
        self.assertEqual(len(output(CLUSTER, "nodes", self.folder).splitlines()), 4)


if __name__ == "__main__":
    os.environ["PATH"] += ":/usr/sbin:/sbin"
    missing = [program for program in ("munged", "slurmctld", "slurmd", "sbatch") if shutil.which(program) is None]
    if missing:
        print(f"skipped: {', '.join(missing)} not installed (scripts/setup)")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
