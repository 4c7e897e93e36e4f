#!/usr/bin/env python3
"""Builds on a machine that fails them: the database's folder vanishes, is read-only or full, or no file can be opened. Each
ends by itself with a clear line and exit 1, and leaves nothing half made. And what a machine must have: a mesh of a million
triangles is built within the memory that README.md states. Usage: environment_test.py HANDHOLD"""
import os
import pathlib
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import numpy as np

SOURCE = pathlib.Path(__file__).resolve().parents[2]
HANDHOLD = pathlib.Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else SOURCE / "build/release/bin/handhold"
# A file system of one's own, gone with the process that made it. Works for root, and where users may have name spaces.
OWN_MOUNTS = ["unshare", "--user", "--map-root-user", "--mount"]
MAY_MOUNT = subprocess.run([*OWN_MOUNTS, "sh", "-c", "mount -t tmpfs none /mnt"], capture_output=True).returncode == 0


class Environment(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="handhold_environment_"))
        self.addCleanup(shutil.rmtree, self.folder)
        self.db = self.folder / "db"
        self.job = self.folder / "job.yaml"
        self.write_job("{samples: 20, rolls: 4}")

    def write_job(self, sampling):
        self.job.write_text(f"catalog: [{{name: box, mesh: {SOURCE}/meshes/box.stl, unit: m}}]\n"
                            f"hands: [{SOURCE}/hands/jaw]\nsampling: {sampling}\n")

    def command(self, *options):
        return [str(HANDHOLD), "build", str(self.job), "--db", str(self.db), "--progress", "none", *options]

    def build(self, *options, **how):
        return subprocess.run(self.command(*options), capture_output=True, text=True, timeout=300, **how)

    def build_on_mount(self, options):
        """Builds in a file system mounted on the database's folder; the result, and the files that are there at the end."""
        if not MAY_MOUNT:
            self.skipTest("no file system may be mounted here")
        self.db.mkdir()
        listing = self.folder / "files"
        script = f'mount -t tmpfs -o {options} none {self.db}; "$@"; code=$?; find {self.db} -type f > {listing}; exit $code'
        result = subprocess.run([*OWN_MOUNTS, "sh", "-c", script, "sh", *self.command()], capture_output=True, text=True, timeout=300)
        return result, listing.read_text().split()

    def assert_failed(self, result, reason):
        """One set failed, in one line, and the program says how to repeat it."""
        self.assertEqual(result.returncode, 1, result.stdout + result.stderr)
        errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
        self.assertEqual(len(errors), 1, result.stderr)
        self.assertRegex(errors[0], "^error: box x jaw: .*" + reason)
        self.assertIn("1 failed", result.stdout)
        self.assertIn("repeat with: handhold build", result.stdout)

    def assert_nothing_half_made(self, files):
        self.assertEqual([f for f in files if "/v" in str(f) or "/.tmp-" in str(f)], [])

    def test_full_disk(self):
        result, files = self.build_on_mount("size=64k")
        self.assert_failed(result, "cannot be written: No space left on device")
        self.assert_nothing_half_made(files)

    def test_read_only_folder(self):
        result, files = self.build_on_mount("ro")
        self.assert_failed(result, "cannot be created: Read-only file system")
        self.assertEqual(files, [])

    def test_folder_that_cannot_be_made(self):
        self.db = self.job / "db"
        self.assert_failed(self.build(), "Not a directory")

    def test_too_few_open_files(self):
        """Whatever it is that cannot be opened first: an error in words, or a whole set."""
        reasons = set()
        for files in range(3, 11):
            result = self.build(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (files, files)))
            if result.returncode == 0:
                self.assertEqual(len(list(self.db.glob("*/*/v*.h5"))), 1)
                break
            self.assertIn(result.returncode, (1, 2, 127), (files, result))  # 127: not even its libraries could be
            self.assertIn("open", result.stderr)
            reasons.add(result.stderr)
            self.assert_nothing_half_made(self.db.rglob("*"))
        self.assertEqual(result.returncode, 0)
        self.assertTrue(any("box x jaw: " in reason and "Too many open files" in reason for reason in reasons), reasons)

    def build_without_folder(self, replace):
        """A build whose database is removed while it runs; `replace` is called before it goes on."""
        self.write_job("{samples: 640, rolls: 32}")  # the first of ten chunks is long before the end
        process = subprocess.Popen(self.command(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(process.kill)
        while not list(self.db.glob("*/*/.chunks-*/*")):
            self.assertIsNone(process.poll(), "ended before it left a chunk")
            time.sleep(0.002)
        process.send_signal(signal.SIGSTOP)
        shutil.rmtree(self.db)
        replace()
        process.send_signal(signal.SIGCONT)
        output, errors = process.communicate(timeout=300)
        return subprocess.CompletedProcess(process.args, process.returncode, output, errors)

    def test_folder_that_vanishes(self):
        """It is not begun anew where it was: that may be the place where it was mounted."""
        result = self.build_without_folder(lambda: None)
        self.assert_failed(result, "is not the folder that the build began with")
        self.assertIn("finished trials cannot be written there", result.stderr)
        self.assert_nothing_half_made(self.db.rglob("*"))
        self.assertEqual(list(self.db.glob("*/*/.chunks-*")), [])
        again = self.build()
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertEqual(len(list(self.db.glob("*/*/v*.h5"))), 1)

    def test_folder_that_vanishes_for_good(self):
        self.assert_failed(self.build_without_folder(self.db.touch), "is not the folder that the build began with")
        self.assertEqual(self.db.read_bytes(), b"")

    def test_a_million_triangles(self):
        mesh = self.folder / "ball.stl"
        corners = million_triangles()
        facets = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
        facets["corners"] = corners
        mesh.write_bytes(b"\0" * 80 + np.uint32(len(facets)).tobytes() + facets.tobytes())
        self.job.write_text(f"catalog: [{{name: ball, mesh: {mesh}, unit: m}}]\nhands: [{SOURCE}/hands/jaw]\n"
                            "sampling: {samples: 2, rolls: 1}\n")
        process = subprocess.Popen(self.command(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        self.assertEqual(status, 0)
        self.assertLess(usage.ru_maxrss * 1024, 1.5e9)


def million_triangles(radius=0.02, around=1000, bands=501):
    """A ball's triangles, (1000000, 3, 3) in metres."""
    polar, azimuth = np.meshgrid(np.pi * np.arange(bands + 1) / bands, 2 * np.pi * np.arange(around + 1) / around, indexing="ij")
    azimuth[:, -1] = 0  # the seam closes
    points = radius * np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)
    points[0], points[-1] = [0, 0, radius], [0, 0, -radius]
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    lower = np.stack([a, b, c], axis=2)[:-1].reshape(-1, 3, 3)  # at a pole one of the two has no area
    upper = np.stack([a, c, d], axis=2)[1:].reshape(-1, 3, 3)
    return np.concatenate([lower, upper])


if __name__ == "__main__":
    print(f"testing {HANDHOLD}")
    unittest.main(argv=sys.argv[:1])
