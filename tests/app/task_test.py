#!/usr/bin/env python3
"""The regrasp that ships, from the build of its grasps to the plan. Usage: task_test.py HANDHOLD HANDHOLD-PLAN"""
import base64
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import numpy

SOURCE = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = [pathlib.Path(p).resolve() for p in sys.argv[1:3]]
TASK = SOURCE / "jobs/tasks/regrasp.yaml"


def run(program, *arguments):
    return subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=600)


class Tasks(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="handhold_task_")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.db = pathlib.Path(cls.folder.name) / "db"
        built = run(PROGRAMS[0], "build", SOURCE / "jobs/tasks/sets.yaml", "--object", "t_bar", "--db", cls.db)
        assert built.returncode == 0, built.stderr

    def task(self, robot, *arguments):
        return run(PROGRAMS[1], "task", "--robot", SOURCE / "robots" / robot, "--db", self.db, *arguments)

    def test_regrasp(self):
        out = pathlib.Path(self.folder.name) / "plan.json"
        result = self.task("hrp2", TASK, "--out", out)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertIn("planned by hrp2: 3 steps", result.stdout)
        plan = json.loads(out.read_text())
        self.assertEqual(plan["status"], "planned")
        self.assertEqual([step["step"] for step in plan["steps"]], ["pick", "hand_over", "place"])
        self.assertEqual([step["arm"] for step in plan["steps"]], ["right", "left", "left"])
        motions = [motion for step in plan["steps"] for motion in step["motions"]]
        self.assertEqual([motion["arm"] for motion in motions], ["right", "right", "left", "right", "left"])
        # Each motion takes the object and its arm from where the one before left them.
        last = {}
        for before, motion in zip([None] + motions, motions):
            names, points = motion["trajectory"]["joint_names"], motion["trajectory"]["points"]
            if before:
                self.assertEqual(before["object_pose_after"], motion["object_pose"])
            for name, position in zip(names, points[0]["positions"]):
                self.assertAlmostEqual(last.get(name, position), position, places=6)
            last.update(zip(names, points[-1]["positions"]))
        x, y, z, qx, qy, qz, qw = motions[-1]["object_pose_after"]
        self.assertGreater(y, 0.16)                              # on the left
        self.assertAlmostEqual(z, 0.79)                          # 14 cm tall, on a table at 0.65 m
        self.assertAlmostEqual(1 - 2 * (qx * qx + qy * qy), -1)  # upside down
        self.check_report(out, motions)

    def check_report(self, plan, motions):
        """The report plays the object from hand to hand, without a jump, to where the plan leaves it."""
        page = pathlib.Path(self.folder.name) / "plan.html"
        result = run(PROGRAMS[1], "report", plan, "--out", page)
        self.assertEqual(result.returncode, 0, result.stderr)
        data = json.loads(re.search(r'id="plan">(.*?)</script>', page.read_text(), re.S).group(1))
        poses = numpy.frombuffer(base64.b64decode(data["bodies"][0]["poses"][3:]), "<f4").reshape(-1, 7)
        times = numpy.frombuffer(base64.b64decode(data["time"][3:]), "<f4")
        self.assertEqual(len(poses), len(times))
        speeds = numpy.linalg.norm(numpy.diff(poses[:, :3], axis=0), axis=1) / numpy.diff(times)
        self.assertGreater(speeds.max(), 0.05)
        self.assertLess(speeds.max(), 2, "m/s: the object jumps")
        numpy.testing.assert_allclose(poses[-1, :3], motions[-1]["object_pose_after"][:3], atol=1e-4)
        self.assertEqual([s["name"] for s in data["segments"]],
                         [s["name"] for motion in motions for s in motion["trajectory"]["segments"]])

    def test_what_cannot_be_done_is_counted(self):
        text = TASK.read_text().replace("position: [0.36, -0.25, 0.65]", "position: [2.36, -0.25, 0.65]")
        path = pathlib.Path(self.folder.name) / "far.yaml"
        path.write_text(text)
        result = self.task("hrp2", path)
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertRegex(result.stdout, r"infeasible by hrp2: t_bar: no stored grasp does it here\n"
                                        r"  pick t_bar +rejected: \d+ unreachable\n")

    def test_refusals(self):
        result = self.task("hrp2/chest.yaml", TASK)
        self.assertEqual(result.returncode, 2)
        self.assertIn("shares CHEST_JOINT0 with right, want arms that share no joint", result.stderr)
        path = pathlib.Path(self.folder.name) / "wrong.yaml"
        path.write_text(TASK.read_text().replace("arm: right}", "arm: right, speed: 3}"))
        result = self.task("hrp2", path)
        self.assertEqual(result.returncode, 2)
        self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
        self.assertRegex(result.stderr, r"wrong.yaml:\d+: steps\[0\].speed is not a known key, want one of: pick, arm")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
