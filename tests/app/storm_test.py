#!/usr/bin/env python3
"""Builds that are killed, run beside each other, run out of disk or meet flipped bits: nothing half made is ever visible,
and in the end the database equals an undisturbed one, dataset for dataset.

Usage: storm_test.py HANDHOLD [--kills N] [--builders N] [--seed S]     (default: 4 kills, 2 builders; nightly: 50 and 4)
"""
import argparse
import os
import pathlib
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

from compare_sets import differences

SOURCE = pathlib.Path(__file__).resolve().parents[2]
OPTIONS = argparse.ArgumentParser()
OPTIONS.add_argument("handhold", type=pathlib.Path, nargs="?", default=SOURCE / "build/release/bin/handhold")
OPTIONS.add_argument("--kills", type=int, default=4)
OPTIONS.add_argument("--builders", type=int, default=2)
OPTIONS.add_argument("--seed", type=int, default=1)


class Storm(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.random = random.Random(ARGUMENTS.seed)
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="handhold_storm_"))
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.job = cls.folder / "job.yaml"
        # Sets of several chunks of trials.
        cls.job.write_text(f"catalog:\n  - {{name: box, mesh: {SOURCE}/meshes/box.stl, unit: m}}\n"
                           f"  - {{name: t_bar, mesh: {SOURCE}/meshes/t_bar.ply, unit: m}}\n"
                           f"hands: [{SOURCE}/hands/jaw]\n"
                           "sampling: {samples: 140, rolls: 32}\n")
        start = time.monotonic()
        assert cls.build("undisturbed").returncode == 0
        cls.duration = time.monotonic() - start
        cls.wanted = cls.sets("undisturbed")
        assert len(cls.wanted) == 2

    @classmethod
    def command(cls, database):
        return [ARGUMENTS.handhold.resolve(), "build", cls.job, "--db", cls.folder / database, "--progress", "none"]

    @classmethod
    def build(cls, database, **options):
        return subprocess.run(cls.command(database), capture_output=True, text=True, timeout=1200, **options)

    @classmethod
    def start(cls, database):
        return subprocess.Popen(cls.command(database), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                start_new_session=True)

    @classmethod
    def sets(cls, database):
        return sorted(path.relative_to(cls.folder / database) for path in (cls.folder / database).glob("*/*/v*.h5"))

    def assert_whole(self, database):
        """Every visible set is complete."""
        if self.sets(database):
            checked = subprocess.run([ARGUMENTS.handhold.resolve(), "verify", "--sample", "0", "--db",
                                      self.folder / database], capture_output=True, text=True, timeout=600)
            self.assertEqual(checked.returncode, 0, checked.stdout + checked.stderr)

    def assert_equals_the_undisturbed(self, database):
        found = self.sets(database)
        self.assertEqual({path.parent for path in found}, {path.parent for path in self.wanted})
        for path in found:  # whatever its version
            wanted = self.folder / "undisturbed" / path.parent / "v0001.h5"
            self.assertEqual(differences(wanted, self.folder / database / path), [], path)
        left = [str(path) for path in (self.folder / database).glob("*/*/.chunks-*")]
        self.assertEqual(left, [])

    def kill_after_a_while(self, database):
        """Starts a build and kills it and its children. What it said, None when it was done before."""
        build = self.start(database)
        try:
            said, _ = build.communicate(timeout=self.random.uniform(0.1, 0.9) * self.duration)
        except subprocess.TimeoutExpired:
            os.killpg(build.pid, signal.SIGKILL)
            said, _ = build.communicate()
            return said
        self.assertEqual(build.returncode, 0, said)
        return None

    def test_killed_at_any_moment(self):
        kills, resumed, rounds = 0, 0, 0
        while kills < ARGUMENTS.kills:
            database = f"killed_{rounds}"
            rounds += 1
            said = ""
            while said is not None and kills < ARGUMENTS.kills:
                said = self.kill_after_a_while(database)
                kills += said is not None
                resumed += "taken over" in (said or "")
                self.assert_whole(database)
            last = self.build(database)
            self.assertEqual(last.returncode, 0, last.stderr)
            resumed += "taken over" in last.stderr
            self.assert_equals_the_undisturbed(database)
            self.assertEqual(self.sets(database), self.wanted)  # no version twice
            shutil.rmtree(self.folder / database)
        print(f"{kills} kills, {resumed} runs took over chunks")

    def test_flipped_bits(self):
        build = self.start("flipped")
        while not (chunks := self.chunks("flipped")):
            self.assertIsNone(build.poll(), "ended before it left a chunk")
            time.sleep(0.002)
        os.killpg(build.pid, signal.SIGKILL)
        build.communicate()
        for chunk in chunks:
            self.flip_a_bit(chunk)
        self.assertEqual(self.build("flipped").returncode, 0)
        self.assert_equals_the_undisturbed("flipped")
        damaged = self.folder / "flipped" / self.random.choice(self.wanted)
        self.flip_a_bit(damaged)
        checked = subprocess.run([ARGUMENTS.handhold.resolve(), "verify", "--sample", "0", "--db", self.folder / "flipped"],
                                 capture_output=True, text=True, timeout=600)
        self.assertEqual(checked.returncode, 1, checked.stdout)
        self.assertIn(str(damaged), checked.stdout + checked.stderr)
        damaged.unlink()
        self.assertEqual(self.build("flipped").returncode, 0)
        self.assert_equals_the_undisturbed("flipped")

    def chunks(self, database):
        return [path for path in (self.folder / database).glob("*/*/.chunks-*/*") if not path.name.startswith(".")]

    def flip_a_bit(self, path):
        data = bytearray(path.read_bytes())
        data[self.random.randrange(len(data))] ^= 1 << self.random.randrange(8)
        path.write_bytes(data)

    def test_builders_beside_each_other(self):
        builds = [self.start("shared") for _ in range(ARGUMENTS.builders)]
        for build in builds:
            said, _ = build.communicate(timeout=1200)
            self.assertEqual(build.returncode, 0, said)
        self.assert_whole("shared")
        self.assert_equals_the_undisturbed("shared")

    def test_no_room(self):
        largest = max((self.folder / "undisturbed" / path).stat().st_size for path in self.wanted)
        limited = self.build("full", preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (largest // 2, largest)))
        self.assertEqual(limited.returncode, 1, limited.stderr)
        self.assertIn("cannot be written", limited.stderr)
        self.assertLess(len(self.sets("full")), len(self.wanted))
        self.assert_whole("full")
        self.assertEqual(self.build("full").returncode, 0)
        self.assert_equals_the_undisturbed("full")


if __name__ == "__main__":
    ARGUMENTS = OPTIONS.parse_args()
    unittest.main(argv=sys.argv[:1])
