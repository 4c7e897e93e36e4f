#!/usr/bin/env python3
"""Exported files as others read them: h5py, PyYAML, csv, assimp; and files of others, imported.

Usage: exchange_test.py HANDHOLD HANDHOLD_IMPORT
"""
import csv
import json
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

import h5py
import numpy as np
import yaml

SOURCE = pathlib.Path(__file__).resolve().parents[2]
HANDHOLD, IMPORT_HELPER = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
TCP = np.array([0.01, 0.02, 0.1034])


def run(*arguments):
    return subprocess.run([HANDHOLD, *map(str, arguments)], capture_output=True, text=True, timeout=600)


def matrix(position, w, xyz):
    """4x4 of a position and a quaternion, by the textbook's formula."""
    x, y, z = xyz
    result = np.eye(4)
    result[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                      [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                      [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    result[:3, 3] = position
    return result


class Exchange(unittest.TestCase):
    """A mug and a jaw whose palm frame is turned by 90 degrees in the root link, its tcp beside the axis: no frame can
    pass for another."""

    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="handhold_exchange_"))
        cls.db = cls.folder / "db"
        hand = cls.folder / "turned"
        hand.mkdir()
        shutil.copy(SOURCE / "hands/jaw/jaw.urdf", hand)
        config = (SOURCE / "hands/jaw/hand.yaml").read_text()
        turned = config.replace("closing: [1, 0, 0]", "closing: [0, 1, 0]").replace("[0, 0, 0.1034]", "[0.01, 0.02, 0.1034]")
        assert turned.count("[0, 1, 0]") == 1 and turned.count("0.02,") == 1
        (hand / "hand.yaml").write_text(turned)
        cls.hand, cls.mesh = hand, SOURCE / "meshes/mug.obj"
        job = cls.folder / "job.yaml"
        job.write_text(f"catalog: [{{name: mug, mesh: {cls.mesh}, unit: m}}]\nhands: [{hand}]\n"
                       "sampling: {samples: 60, rolls: 4, preshapes: [open_80]}\nquality: {load_margin: {grasps: 3}}\n")
        result = run("build", job, "--db", cls.db, "--progress", "none")
        assert result.returncode == 0, result.stderr
        with h5py.File(cls.db / "mug/turned/v0001.h5") as file:
            cls.set = {name: file["grasps"][name][:] for name in file["grasps"]}
            cls.vertices = file["object/vertices"][:]
            cls.links = {name: file["hand/links"][name]["vertices"][:] for name in file["hand/links"]}
        cls.poses = np.array([matrix(p[:3], p[6], p[3:6]) for p in cls.set["hand_pose"]])
        assert len(cls.poses) > 20

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def export(self, to, *arguments):
        folder = self.folder / f"out_{self._testMethodName}"
        result = run("export", "--db", self.db, "--to", to, "--out", folder, *arguments)
        self.assertEqual(result.returncode, 0, result.stderr)
        for line in result.stdout.splitlines():
            self.assertTrue(pathlib.Path(line.split(": ")[0]).is_file(), line)
        self.assertEqual([path for path in folder.iterdir() if path.name.startswith(".")], [])  # nothing half written
        return folder

    def import_(self, *arguments, hand=None):
        return run("import", "--db", self.db, "--mesh", self.mesh, "--hand", hand or self.hand, *arguments)

    def in_palm_axes(self, origin):
        """The poses of the frame with that origin in the root link and the palm's axes: +z approach, +x closing = +y."""
        X = np.eye(4)
        X[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
        X[:3, 3] = origin
        return self.poses @ X

    def test_acronym(self):
        for frame, wanted in (("root", self.in_palm_axes([0, 0, 0])), ("tcp", self.in_palm_axes(TCP))):
            folder = self.export("acronym", "--frame", frame)  # the second replaces the first
            with h5py.File(folder / "mug_turned.h5") as file:
                np.testing.assert_allclose(file["grasps/transforms"][:], wanted, atol=1e-9)
                verdict = file["grasps/qualities/flex/object_in_gripper"]
                self.assertEqual((verdict.dtype, verdict[:].tolist()), (np.int64, [1] * len(wanted)))
                for name in ("epsilon", "critical_friction", "load_margin", "joint_position"):
                    np.testing.assert_array_equal(file["grasps/qualities/handhold"][name][:], self.set[name])
                self.assertEqual(file["gripper/type"][()].decode(), "turned")
                self.assertAlmostEqual(file["gripper/configuration"][:].tolist()[0], 0.04)
                self.assertEqual(file["object/scale"][()], 1)
                mesh = folder / file["object/file"][()].decode()
            lines = [line.split() for line in mesh.read_text().splitlines()]
            vertices = np.array([line[1:] for line in lines if line[0] == "v"], np.float32)
            np.testing.assert_array_equal(vertices, self.vertices)
            self.assertTrue(all(1 <= int(i) <= len(vertices) for line in lines if line[0] == "f" for i in line[1:]))

    def test_isaac(self):
        for frame, wanted in (("root", self.poses), ("tcp", self.in_palm_axes(TCP))):
            file = yaml.safe_load((self.export("isaac", "--frame", frame) / "mug_turned.yaml").read_text())
            self.assertEqual((file["format"], file["format_version"], file["object_frame"]), ("isaac_grasp", 1.0, "mug"))
            self.assertEqual(file["gripper_frame"], "tcp" if frame == "tcp" else "hand_base")
            self.assertEqual(list(file["grasps"]), [f"grasp_{i}" for i in range(len(wanted))])
            grasps = list(file["grasps"].values())
            poses = [matrix(g["position"], g["orientation"]["w"], g["orientation"]["xyz"]) for g in grasps]
            np.testing.assert_allclose(poses, wanted, atol=1e-9)
            for grasp, closed, opened in zip(grasps, self.set["joint_position"], self.set["preshape_joint_position"]):
                self.assertEqual(grasp["cspace_position"], {"finger_1": float(closed[0])})  # finger_2 mimics it
                self.assertEqual(grasp["pregrasp_cspace_position"], {"finger_1": float(opened[0])})
            np.testing.assert_allclose([g["confidence"] for g in grasps], self.set["epsilon"] / self.set["epsilon"][0])

    def test_moveit(self):
        file = yaml.safe_load((self.export("moveit") / "mug_turned.yaml").read_text())
        self.assertEqual((file["object"], file["hand"], file["frame"]), ("mug", "turned", "hand_base"))
        poses = []
        for grasp, pose, closed in zip(file["grasps"], self.poses, self.set["joint_position"]):
            p, q = grasp["grasp_pose"]["pose"]["position"], grasp["grasp_pose"]["pose"]["orientation"]
            poses.append(matrix([p["x"], p["y"], p["z"]], q["w"], [q["x"], q["y"], q["z"]]))
            self.assertEqual(grasp["grasp_pose"]["header"]["frame_id"], "mug")
            posture = grasp["grasp_posture"]
            self.assertEqual((posture["joint_names"], posture["points"][0]["positions"]), (["finger_1"], [float(closed[0])]))
            self.assertAlmostEqual(grasp["pre_grasp_posture"]["points"][0]["positions"][0], 0.04)
            for key, sign in (("pre_grasp_approach", 1), ("post_grasp_retreat", -1), ("post_place_retreat", -1)):
                direction = grasp[key]["direction"]
                self.assertEqual(direction["header"]["frame_id"], "hand_base")
                vector = [direction["vector"][axis] for axis in "xyz"]
                np.testing.assert_allclose(vector, [0, 0, sign], atol=1e-6)
                self.assertLess(grasp[key]["min_distance"], grasp[key]["desired_distance"])
            self.assertEqual((grasp["max_contact_force"], grasp["allowed_touch_objects"]), (0, ["mug"]))
        np.testing.assert_allclose(poses, self.poses, atol=1e-9)
        np.testing.assert_array_equal([g["grasp_quality"] for g in file["grasps"]], self.set["epsilon"])

    def test_csv_and_filters(self):
        for frame, prefix, wanted in (("root", "", self.poses), ("tcp", "tcp_", self.in_palm_axes(TCP))):
            folder = self.export("csv", "--frame", frame, "--top", 5, "--object", "m*")
            rows = list(csv.DictReader((folder / "mug_turned.csv").read_text().splitlines()))
            number = lambda row, *names: [float(row[prefix + name]) for name in names]  # noqa: E731
            poses = [matrix(number(r, "x", "y", "z"), *number(r, "qw"), number(r, "qx", "qy", "qz")) for r in rows]
            np.testing.assert_allclose(poses, wanted[:5], atol=1e-9)
            np.testing.assert_array_equal([float(r["joint.finger_2"]) for r in rows], self.set["joint_position"][:5, 1])
        result = run("export", "--db", self.db, "--to", "csv", "--out", self.folder / "none", "--min-epsilon", 9)
        self.assertEqual((result.returncode, result.stdout), (0, ""))
        self.assertIn("left out", result.stderr)

    def test_gltf(self):
        path = self.export("gltf", "--frame", "tcp") / "mug_turned.glb"
        glb = path.read_bytes()
        magic, version, length, json_length = struct.unpack("<4sIII", glb[:16])
        self.assertEqual((magic, version, length), (b"glTF", 2, len(glb)))
        nodes = {node["name"]: node for node in json.loads(glb[20:20 + json_length])["nodes"]}
        hand = matrix(nodes["turned"]["translation"], nodes["turned"]["rotation"][3], nodes["turned"]["rotation"][:3])
        np.testing.assert_allclose(hand, self.poses[0], atol=1e-9)
        np.testing.assert_allclose(nodes["tcp"]["translation"], TCP, atol=1e-12)
        # assimp reads it and applies the scene graph: every vertex is where object and hand have it.
        out = subprocess.run([IMPORT_HELPER, path, "60", str(4 << 30), "1000000"], capture_output=True, timeout=60, check=True).stdout
        _, count, triangles, _ = struct.unpack("<4Q", out[:32])
        read = np.frombuffer(out, np.float64, 3 * count, 32).reshape(-1, 3)
        corners = np.frombuffer(out, np.uint32, 3 * triangles, 32 + 24 * count)
        q = self.set["joint_position"][0]
        X_HL = {"hand_base": np.eye(4), "finger_1_link": np.eye(4), "finger_2_link": np.eye(4)}
        X_HL["finger_1_link"][:3, 3] = [q[0], 0, 0.0584]
        X_HL["finger_2_link"] = matrix([-q[1], 0, 0.0584], 0, [0, 0, 1])  # turned about z by half a turn
        wanted = [self.vertices]
        for name, vertices in self.links.items():
            X = self.poses[0] @ X_HL[name]
            wanted.append(vertices @ X[:3, :3].T + X[:3, 3])
        found = {tuple(v) for v in np.round(read[np.unique(corners)] * 1e5).astype(int)}
        for v in np.concatenate(wanted):
            near = np.round(v * 1e5).astype(int)
            self.assertTrue(any(tuple(near + np.array([i, j, k])) in found for i in (0, -1, 1) for j in (0, -1, 1)
                                for k in (0, -1, 1)), v)
        self.assertLessEqual(len(found), sum(map(len, wanted)))
        several = self.export("gltf", "--top", 3)
        self.assertEqual(sorted(p.name for p in several.glob("mug_turned_*")), [f"mug_turned_{i}.glb" for i in range(3)])

    def test_round_trip(self):
        """Our own files, imported: the same poses and joints, for each row the trial says which."""
        for name, to, file, options in (("a", "acronym", "mug_turned.h5", ["--frame", "tcp"]),
                                        ("i", "isaac", "mug_turned.yaml", [])):
            folder = self.export(to, *options)
            arguments = [folder / file, "--name", name, *options]
            result = self.import_(*arguments)
            self.assertEqual(result.returncode, 0, result.stderr)
            with h5py.File(self.db / name / "turned/v0001.h5") as imported:
                rows = imported["grasps/trial"][:, 0]
                self.assertGreater(len(rows), 0.9 * len(self.poses))
                for column, tolerance in (("hand_pose", 2e-5), ("joint_position", 2e-5), ("approach_direction", 1e-6)):
                    np.testing.assert_allclose(imported["grasps"][column][:], self.set[column][rows], atol=tolerance)
                self.assertEqual(imported.attrs["policy"], "imported")
                self.assertRegex(imported.attrs["generator"], r"imported from mug_turned\.\w+ \(\w+, XXH3-128 [0-9a-f]{32}\)")
                self.assertIn("imported from", imported.attrs["job"])
            self.assertIn("unchanged", self.import_(*arguments).stdout)
        listed = json.loads(run("list", "--db", self.db, "--format", "json").stdout)
        self.assertTrue({"a", "i"} <= {row["object"] for row in listed})
        verified = run("verify", "--db", self.db, "--object", "a").stdout
        self.assertIn("its grasps were imported", verified)
        self.assertEqual(len(json.loads(run("query", "--db", self.db, "--object", "i", "--top", 2, "--format", "json").stdout)), 2)

    def test_files_of_others(self):
        """As they are found: compressed, 32-bit, with a scale and failed grasps; nothing of ours in them."""
        count = 8
        transforms = self.in_palm_axes([0, 0, 0])[:count].astype(np.float32)
        with h5py.File(self.folder / "foreign.h5", "w") as file:
            file.create_dataset("grasps/transforms", data=transforms, compression="gzip")
            file.create_dataset("grasps/qualities/flex/object_in_gripper", data=[1, 0] * (count // 2), compression="gzip")
            file["object/scale"] = 1.0
        result = self.import_(self.folder / "foreign.h5", "--name", "foreign")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("4 of 4 grasps are force closed", result.stdout)
        self.assertIn("4 grasps that it marks as failed", result.stderr)
        (self.folder / "foreign.json").write_text(json.dumps({
            "object": {"file": "mug.obj", "scale": 1.0},
            "grasps": {"transforms": transforms.astype(float).tolist(), "object_in_gripper": [True] * count}}))
        result = self.import_(self.folder / "foreign.json", "--name", "generated")
        self.assertIn("8 of 8 grasps are force closed", result.stdout, result.stderr)
        # The scale of the file is that of its mesh. One that does not fit, and no unit, is a wrong mesh.
        scaled = "".join(f"v {' '.join(str(1000 * float(x)) for x in line.split()[1:4])}\n" if line.startswith("v ") else
                         line + "\n" for line in self.mesh.read_text().splitlines() if line.startswith(("v ", "f ")))
        (self.folder / "mug_mm.obj").write_text(scaled)
        for scale, code, text in ((0.001, 0, "8 of 8 grasps are force closed"), (1.0, 2, "mug_mm.obj: the diagonal is")):
            (self.folder / "mm.json").write_text(json.dumps({
                "object": {"scale": scale}, "grasps": {"transforms": transforms.astype(float).tolist()}}))
            result = run("import", self.folder / "mm.json", "--db", self.db, "--mesh", self.folder / "mug_mm.obj", "--hand",
                         self.hand)
            self.assertEqual(result.returncode, code, result.stderr)
            self.assertIn(text, result.stdout + result.stderr)
        # The unit that is asked for goes before the file's scale: a mug of 3 mm has no grasp there.
        self.assertEqual(self.import_(self.folder / "foreign.json", "--name", "wrong", "--unit", "in").returncode, 0)
        with h5py.File(self.db / "wrong/turned/v0001.h5") as file:
            self.assertEqual(len(file["grasps/epsilon"]), 0)
            self.assertEqual(file["trials/outcome"].shape, (count, 1, 1))

    def test_refusals(self):
        bad = self.folder / "bad.yaml"
        bad.write_text("format: isaac_grasp\nformat_version: 1.0\ngrasps:\n  g: {position: [0, 0], orientation: {w: 1, xyz: [0, 0, 0]}}\n")
        for arguments, part in ((["import", bad, "--mesh", self.mesh, "--hand", self.hand], "position is a list of 2, want three"),
                                (["import", self.mesh, "--mesh", self.mesh, "--hand", self.hand], 'ends with ".obj", want'),
                                (["import", self.folder / "no.h5", "--mesh", self.mesh, "--hand", self.hand], "no.h5"),
                                (["export", "--to", "stl", "--out", "x"], "--to"),
                                (["export", "--to", "csv", "--out", self.folder / "x", "--object", "nothing"], "picks no set")):
            result = run(*arguments, "--db", self.db)
            self.assertEqual((result.returncode, result.stdout), (2, ""), result.stderr)
            self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
            self.assertIn(part, result.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
