#!/usr/bin/env python3
"""python/handhold.py against `handhold query`, on a database that the program builds; the examples of docs/query.md.

Usage: handhold_test.py HANDHOLD QUERY_EXAMPLE
"""
import csv
import io
import json
import math
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import unittest.mock
import warnings

import h5py
import numpy as np
import xxhash

SOURCE = pathlib.Path(__file__).resolve().parents[2]
HANDHOLD, EXAMPLE = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
sys.path.insert(0, str(SOURCE / "python"))
import handhold  # noqa: E402

# The same filters as options of the program and as arguments in Python.
QUERIES = [
    ([], {}),
    (["--top", 3], {"top": 3}),
    (["--object", "t_*", "--hand", "jaw"], {"object": "t_*", "hand": "jaw"}),
    (["--set-version", 1, "--top", 2], {"set_version": 1, "top": 2}),
    (["--min-epsilon", 0.05], {"min_epsilon": 0.05}),
    (["--friction", 0.03], {"friction": 0.03}),
    (["--friction", 0.4], {"friction": 0.4}),
    (["--approach", "-1,0,0.2", "--within", 40], {"approach": (-1, 0, 0.2), "within_deg": 40}),
    (["--near", "0.03,0,0.12", "--radius", 0.05], {"near": (0.03, 0, 0.12), "radius": 0.05}),
    (["--preshape", "*_[5-9]0"], {"preshape": "*_[5-9]0"}),
    (["--top", 7, "--diverse"], {"top": 7, "diverse": True}),
    (["--top", 5, "--diverse", "--friction", 0.2, "--approach", "1,0,0", "--within", 90],
     {"top": 5, "diverse": True, "friction": 0.2, "approach": (1, 0, 0), "within_deg": 90}),
]


def run(*arguments):
    return subprocess.run(list(map(str, arguments)), capture_output=True, text=True, timeout=600)


def query(*arguments):
    """The rows of the program."""
    result = run(HANDHOLD, "query", "--format", "json", *arguments)
    if result.returncode != 0:
        raise AssertionError(result.stderr)
    return json.loads(result.stdout)


class Reader(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="handhold_python_"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.db = cls.folder / "db"
        for samples in (4, 16):  # two versions
            job = cls.folder / "job.yaml"
            job.write_text(f"catalog:\n  - {{name: t_bar, mesh: {SOURCE}/meshes/t_bar.ply, unit: m}}\n"
                           f"  - {{name: mug, mesh: {SOURCE}/meshes/mug.obj, unit: m}}\n"
                           f"hands: [{SOURCE}/hands/jaw, {SOURCE}/hands/hrp2]\n"
                           f"sampling: {{samples: {samples}, rolls: 4}}\n"
                           "quality: {robustness: {position: 0.002, rotation_deg: 2, trials: 4, grasps: 3}}\n"
                           "simulation: reference\n")  # prepares nothing: faster for so few trials
            built = run(HANDHOLD, "build", job, "--db", cls.db, "--progress", "none")
            assert built.returncode == 0, built.stderr
        cls.database = handhold.Database(cls.db)

    def assert_same(self, grasp, row):
        for key in ("object", "hand", "set_version", "grasp", "preshape", "roll", "backoff", "approach_clear"):
            self.assertEqual(getattr(grasp, key), row[key], key)
        for key in ("epsilon", "epsilon_lower", "epsilon_upper", "critical_friction", "load_margin", "robustness",
                    "robustness_lower", "robustness_upper"):
            np.testing.assert_equal(getattr(grasp, key), math.nan if row[key] is None else row[key], key)
        self.assertEqual(list(grasp.trial), row["trial"])
        self.assertEqual(grasp.joints, dict(zip(row["joint_names"], row["joint_position"])))
        self.assertEqual(grasp.preshape_joints, dict(zip(row["joint_names"], row["preshape_joint_position"])))
        self.assertEqual(grasp.target_point.tolist(), row["target_point"])
        self.assertEqual(grasp.approach_direction.tolist(), row["approach_direction"])
        self.assertEqual(len(grasp.contact_links), row["contacts"])
        self.assertEqual(len(grasp.contact_positions), row["contacts"])
        x, y, z, qx, qy, qz, qw = row["hand_pose"]
        np.testing.assert_allclose(grasp.pose[:3, 3], (x, y, z))
        np.testing.assert_array_equal(grasp.pose[3], (0, 0, 0, 1))
        # Turning a vector by the quaternion: v + 2 q x (q x v + w v)
        for v in np.eye(3):
            q = np.array((qx, qy, qz))
            np.testing.assert_allclose(grasp.pose[:3, :3] @ v, v + 2 * np.cross(q, np.cross(q, v) + qw * v), atol=1e-12)

    def test_answers_as_the_program_does(self):
        found = 0
        for options, arguments in QUERIES:
            with self.subTest(options):
                rows, grasps = query("--db", self.db, *options), self.database.query(**arguments)
                self.assertEqual(len(grasps), len(rows))
                for grasp, row in zip(grasps, rows):
                    self.assert_same(grasp, row)
                found += bool(rows)
        self.assertEqual(found, len(QUERIES))  # none of the filters is so strict that nothing was compared

    def test_min_physics(self):
        copy = self.folder / "simulated"
        shutil.copytree(self.db, copy)
        simulated = run(HANDHOLD, "physics", "--db", copy, "--object", "t_bar", "--hand", "jaw", "--top", 6,
                        "--progress", "none")
        if "was built without MuJoCo" in simulated.stderr:
            self.skipTest("without MuJoCo")
        self.assertEqual(simulated.returncode, 0, simulated.stderr)
        path = copy / "t_bar/jaw/physics-v0002.h5"
        with h5py.File(path, "r+") as results:  # grasp i held in i of the six directions
            for i, outcome in enumerate(results["load/outcome"]):
                results["load/outcome"][i] = np.arange(len(outcome)) >= i
        head, data = path.read_bytes()[:512], path.read_bytes()[512:]
        magic = head[:head.index(b"\n") + 1]
        path.write_bytes((magic + xxhash.xxh3_128(data).hexdigest().encode()).ljust(512, b"\0") + data)
        database = handhold.Database(copy)
        for share, count in [(0, 6), (0.4, 3), (1, 0)]:
            rows, grasps = query("--db", copy, "--min-physics", share), database.query(min_physics=share)
            self.assertEqual([g.grasp for g in grasps], [row["grasp"] for row in rows])
            self.assertEqual(len(grasps), count)
        with database.open("t_bar", "jaw") as grasp_set:
            np.testing.assert_allclose(grasp_set.physics()[:6], np.arange(6) / 6)
            self.assertTrue(np.isnan(grasp_set.physics()[6:]).all())
            with self.assertRaisesRegex(ValueError, "min_physics is 1.1"):
                grasp_set.select(min_physics=1.1)
        with database.open("mug", "jaw") as grasp_set:  # not simulated
            self.assertEqual(grasp_set.select(min_physics=0).passed, 0)
        damaged = path.read_bytes()
        for content, message in [(damaged[:-1] + b"?", "is damaged"), (b"x", "holds no physics results")]:
            path.write_bytes(content)
            with database.open("t_bar", "jaw") as grasp_set:
                self.assertRaisesRegex(handhold.BadSet, f"physics-v0002.h5: {message}", grasp_set.physics)
        path.write_bytes(damaged)
        shutil.copy(path, copy / "mug/jaw/physics-v0002.h5")
        with database.open("mug", "jaw") as grasp_set:
            self.assertRaisesRegex(handhold.BadSet, "belongs to version 2 with input hash", grasp_set.physics)

    def test_cover_radius(self):
        printed = run(HANDHOLD, "query", "--db", self.db, "--object", "t_bar", "--hand", "jaw", "--top", 4,
                      "--diverse").stdout
        with self.database.open("t_bar", "jaw") as grasp_set:
            selection = grasp_set.select(top=4, diverse=True)
        self.assertIn(f"cover radius {selection.cover_radius:.4g} m: each of the {selection.passed} grasps", printed)
        self.assertGreater(selection.cover_radius, 0)

    def test_sets(self):
        names = [(s.object, s.hand, s.version) for s in self.database.sets()]
        listed = json.loads(run(HANDHOLD, "list", "--db", self.db, "--format", "json").stdout)
        self.assertEqual(names, [(s["object"], s["hand"], s["set_version"]) for s in listed])
        self.assertEqual(len(names), 8)
        self.assertEqual([s.version for s in self.database.newest()], [2] * 4)
        self.assertEqual([s.version for s in self.database.newest(version=1)], [1] * 4)
        self.assertEqual(self.database.newest(version=3), [])
        (self.db / "t_bar/jaw/physics-v0002.h5").write_text("x")
        (self.db / "t_bar/jaw/.tmp-v0003.h5").write_text("x")
        self.addCleanup((self.db / "t_bar/jaw/physics-v0002.h5").unlink)
        self.addCleanup((self.db / "t_bar/jaw/.tmp-v0003.h5").unlink)
        self.assertEqual(len(self.database.sets()), 8)
        with self.assertRaisesRegex(ValueError, "has no set of mug and barrett"):
            self.database.open("mug", "barrett")
        with self.assertRaisesRegex(ValueError, "picks no set"):
            self.database.query(object="nothing")
        with self.assertRaisesRegex(ValueError, "is no folder"):
            handhold.Database(self.folder / "none")

    def test_a_set(self):
        with self.database.open("t_bar", "jaw", version=1) as grasp_set:
            self.assertEqual((grasp_set.object, grasp_set.hand, grasp_set.version), ("t_bar", "jaw", 1))
            self.assertEqual(grasp_set.friction, 0.4)
            self.assertTrue(grasp_set.checksum_checked)
            self.assertEqual(grasp_set.poses().shape, (len(grasp_set), 4, 4))
            np.testing.assert_allclose(np.linalg.det(grasp_set.poses()), 1)
            vertices, triangles = grasp_set.object_mesh()
            self.assertLess(triangles.max(), len(vertices))
            inside = grasp_set.grasps([0])[0].contact_positions
            self.assertTrue((inside >= vertices.min(0) - 1e-4).all() and (inside <= vertices.max(0) + 1e-4).all())
            meshes = [grasp_set.link_mesh(name) for name in grasp_set.link_names]
            self.assertTrue(any(len(mesh[0]) for mesh in meshes))
            with self.assertRaisesRegex(ValueError, "link is 'thumb'"):
                grasp_set.link_mesh("thumb")

    def test_refuses_nonsense(self):
        with self.database.open("t_bar", "jaw") as grasp_set:
            for arguments, message in [({"friction": 0.41}, "friction is 0.41, want at most 0.4: .*v0002.h5"),
                                       ({"friction": -1}, "friction is -1"),
                                       ({"min_epsilon": math.nan}, "min_epsilon is nan"),
                                       ({"approach": (1, 0, 0)}, "approach goes with within_deg"),
                                       ({"radius": 1}, "near with radius"),
                                       ({"approach": (0, 0, 0), "within_deg": 1}, "want a direction"),
                                       ({"approach": (1, 0, 0), "within_deg": 181}, "within_deg is 181"),
                                       ({"near": (1, 0), "radius": 1}, "near is .* want three numbers"),
                                       ({"near": (1, 0, 0), "radius": -1}, "radius is -1"),
                                       ({"top": 0}, "top is 0"), ({"top": 1.5}, "top is 1.5"),
                                       ({"diverse": True}, "without top")]:
                with self.assertRaisesRegex(ValueError, message):
                    grasp_set.select(**arguments)

    def test_refuses_damage(self):
        good = (self.db / "t_bar/jaw/v0001.h5").read_bytes()
        path = self.folder / "v0001.h5"

        def flipped(i):
            return good[:i] + bytes([good[i] ^ 1]) + good[i + 1:]
        newer = good.replace(b"format_version 1\n", b"format_version 2\n", 1)
        for data, message in [(good[:-1], "is damaged"), (flipped(len(good) // 2), "the checksum of its data"),
                              (flipped(good.index(b"input_hash") + 12), "do not match the checksum"),
                              (b"", "is no grasp set"), (b"\x89HDF\r\n", "is no grasp set"),
                              (newer, "format version 2, want at most 1")]:
            path.write_bytes(data)
            with self.assertRaisesRegex(handhold.BadSet, message):
                handhold.GraspSet(path)
        # Without the library the length is all that is checked, and said to be.
        with unittest.mock.patch.object(handhold, "xxhash", None):
            path.write_bytes(good)
            with handhold.GraspSet(path) as grasp_set:
                self.assertFalse(grasp_set.checksum_checked)
            path.write_bytes(good[:-1])
            self.assertRaises(handhold.BadSet, handhold.GraspSet, path)

    def test_a_damaged_set_is_named_and_the_others_answer(self):
        copy = self.folder / "copy"
        shutil.copytree(self.db, copy)
        damaged = copy / "mug/jaw/v0002.h5"
        data = bytearray(damaged.read_bytes())
        data[len(data) // 2] ^= 1
        damaged.unlink()
        damaged.write_bytes(data)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            grasps = handhold.Database(copy).query()
        self.assertEqual(len(caught), 1)
        self.assertIn("mug/jaw/v0002.h5", str(caught[0].message))
        result = run(HANDHOLD, "query", "--db", copy, "--format", "json")
        self.assertEqual(result.returncode, 1)
        self.assertIn("mug/jaw/v0002.h5: is damaged", result.stderr)
        self.assertEqual(len(grasps), len(json.loads(result.stdout)))
        self.assertGreater(len(grasps), 0)

    def test_csv_has_the_numbers_of_json(self):
        result = run(HANDHOLD, "query", "--db", self.db, "--top", 5, "--format", "csv")
        table, rows = list(csv.DictReader(io.StringIO(result.stdout))), query("--db", self.db, "--top", 5)
        self.assertEqual(len(table), len(rows))
        for line, row in zip(table, rows):
            self.assertEqual((line["object"], line["preshape"]), (row["object"], row["preshape"]))
            self.assertEqual([float(line[k]) for k in ("x", "y", "z", "qx", "qy", "qz", "qw")], row["hand_pose"])
            self.assertEqual([float(line[k]) for k in ("epsilon", "epsilon_lower", "critical_friction")],
                             [row["epsilon"], row["epsilon_lower"], row["critical_friction"]])
            joints = {k[len("joint."):]: float(v) for k, v in line.items() if k.startswith("joint.") and v}
            self.assertEqual(joints, dict(zip(row["joint_names"], row["joint_position"])))

    def test_examples_of_the_docs(self):
        page = (SOURCE / "docs/query.md").read_text()
        example = (SOURCE / "tests/store/query_example.cpp").read_text()
        self.assertIn("```cpp\n" + example + "```", page)
        result = run(EXAMPLE, self.db)
        self.assertEqual(result.returncode, 0, result.stderr)
        printed = re.findall(r"mug (\w+) grasp (\d+) epsilon", result.stdout)
        rows = query("--db", self.db, "--object", "mug*", "--approach", "1,0,0", "--within", 75, "--near", "0,0,0.08",
                     "--radius", 0.05, "--top", 3)
        self.assertTrue(rows)
        self.assertEqual(printed, [(row["hand"], str(row["grasp"])) for row in rows])
        self.assertEqual(run(EXAMPLE, self.folder / "none").returncode, 2)
        code = re.search(r"```python\n(.*?)```", page, re.S)[1].replace('"db"', repr(str(self.db)))
        result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=SOURCE / "python")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("mug", result.stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
