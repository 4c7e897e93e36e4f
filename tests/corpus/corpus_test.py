#!/usr/bin/env python3
"""Every bad input of this folder, and those that are made here from bytes, is refused by the program in one line that says
what is wrong, with the right exit code, and harms nothing. One test a file: corpus_test.py HANDHOLD [CASE ...]

Text files lie in meshes/, urdfs/ (read with hands/good.yaml), hands/ (with urdfs/good.urdf) and jobs/; refusals.txt has what
is said of each. A past failure is kept by adding its file and its line there.
"""
import os
import pathlib
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

import h5py
import numpy as np
import xxhash

CORPUS = pathlib.Path(__file__).resolve().parent
SOURCE = CORPUS.parents[1]
HANDHOLD = pathlib.Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else SOURCE / "build/release/bin/handhold"
SECONDS = 60  # for one program: more is a hang
NOISE = random.Random(1).randbytes(3000)


def run(*arguments, cwd=None):
    environment = {key: value for key, value in os.environ.items() if key != "HANDHOLD_DB"}
    environment["ASAN_OPTIONS"] = "detect_leaks=0"  # links of a ring own each other in urdfdom
    return subprocess.run([HANDHOLD, *map(str, arguments)], capture_output=True, text=True, errors="replace", cwd=cwd,
                          timeout=SECONDS, env=environment, stdin=subprocess.DEVNULL)


def refusals(folder):
    """{file name: part of the message} of a folder's lines in refusals.txt."""
    lines = (CORPUS / "refusals.txt").read_text().splitlines()
    pairs = [line.split(": ", 1) for line in lines if line.startswith(folder + "/")]
    return {path.removeprefix(folder + "/"): part for path, part in pairs}


def slug(name):
    return "".join(c if c.isalnum() else "_" for c in name)


def one_test_each(cases, check):
    """Adds a test for each of {name: part of the message}, which calls check(test, name, part)."""

    def decorate(group):
        for name, part in cases.items():
            method = "test_" + slug(name)
            assert not hasattr(group, method), method
            setattr(group, method, lambda test, name=name, part=part: check(test, name, part))
        return group

    return decorate


class Corpus(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="handhold_corpus_"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)

    @classmethod
    def hand(cls, name, urdf, config):
        """A hand's folder with these two texts, and meshes for its URDF."""
        folder = cls.folder / name
        folder.mkdir(parents=True)
        (folder / "good.urdf").write_bytes(urdf)
        (folder / "hand.yaml").write_bytes(config)
        for mesh in ("good.obj", "cut.stl"):
            shutil.copy(CORPUS / "meshes" / mesh, folder)
        return folder

    @classmethod
    def good_hand(cls, name="hand"):
        return cls.hand(name, (CORPUS / "urdfs/good.urdf").read_bytes(), (CORPUS / "hands/good.yaml").read_bytes())

    def assert_refused(self, result, *parts):
        """Exit 2, nothing on stdout, one line on stderr."""
        self.assertEqual(result.returncode, 2, result.stderr[:500])
        self.assertEqual(result.stdout, "")
        self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr[:2000])
        self.assertTrue(result.stderr.isprintable() or result.stderr[:-1].isprintable(), result.stderr)
        self.assertLess(len(result.stderr), 1000)
        for part in parts:
            self.assertIn(part, result.stderr)


# --- hands

URDF_BYTES = {
    "noise": (NOISE, "is no valid URDF"),
    "zero bytes": (b"\0" * 500, "is no valid URDF"),
    "utf-16": ('<robot name="good"/>'.encode("utf-16"), "is no valid URDF"),
    "deep": (b'<robot name="good">' + b"<a>" * 100000, "nests elements more than 100 deep"),
    "chain of 30000 links": (
        ('<robot name="good">' + "".join(f'<link name="l{i}"/>' for i in range(30000)) + "".join(
            f'<joint name="j{i}" type="fixed"><parent link="l{i}"/><child link="l{i + 1}"/></joint>' for i in range(29999))
         + "</robot>").encode(), "has 30000 links, want at most 1000"),
}
CONFIG_BYTES = {
    "noise": (NOISE, "hand.yaml:"),
    "zero bytes": (b"\0" * 500, "hand.yaml:"),
    "100,000 open lists": (b"urdf: good.urdf\nroot_link: " + b"[" * 100000, "is nested too deeply"),
    "key of 100,000 letters": (b"x" * 100000 + b": 1\n", "hand.yaml:"),
}


def check_urdf(test, name, part):
    text = URDF_BYTES[name][0] if name in URDF_BYTES else (CORPUS / "urdfs" / name).read_bytes()
    folder = test.hand(slug(name), text, (CORPUS / "hands/good.yaml").read_bytes())
    test.assert_refused(run("hand", folder), str(folder), part)


def check_config(test, name, part):
    text = CONFIG_BYTES[name][0] if name in CONFIG_BYTES else (CORPUS / "hands" / name).read_bytes()
    folder = test.hand(slug(name), (CORPUS / "urdfs/good.urdf").read_bytes(), text)
    test.assert_refused(run("hand", folder), str(folder), part)


@one_test_each(refusals("urdfs") | {name: part for name, (_, part) in URDF_BYTES.items()}, check_urdf)
class Urdfs(Corpus):
    pass


@one_test_each(refusals("hands") | {name: part for name, (_, part) in CONFIG_BYTES.items()}, check_config)
class Hands(Corpus):
    def test_the_good_one(self):
        self.assertEqual(run("hand", self.good_hand()).returncode, 0)

    def test_pipe(self):
        folder = self.good_hand("pipe")
        (folder / "hand.yaml").unlink()
        os.mkfifo(folder / "hand.yaml")
        self.assert_refused(run("hand", folder), "hand.yaml: cannot be read: is not a regular file")


# --- jobs

def check_job(test, name, part):
    test.assert_refused(run("build", name, "--db", "db", cwd=test.folder), part)
    test.assertFalse((test.folder / "db").exists())


@one_test_each(refusals("jobs"), check_job)
class Jobs(Corpus):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        shutil.copytree(CORPUS / "jobs", cls.folder, dirs_exist_ok=True)
        shutil.copy(CORPUS / "meshes/good.obj", cls.folder)
        cls.good_hand()
        os.mkfifo(cls.folder / "pipe")

    def test_the_good_one(self):
        self.assertEqual(run("build", "good.yaml", "--dry-run", "--db", "db", cwd=self.folder).returncode, 0)

    def test_what_is_no_file(self):
        for path, found in ("pipe", "not a regular file"), ("/dev/zero", "not a regular file"), ("hand", "a folder"):
            self.assert_refused(run("build", path, cwd=self.folder), f"{path}: cannot be read: is {found}")

    def test_noise(self):
        for name, content in ("noise", NOISE), ("zeros", b"\0" * 500), ("open", b"seed: " + b"[" * 100000):
            (self.folder / name).write_bytes(content)
            self.assert_refused(run("build", name, cwd=self.folder), f"{name}:")


# --- meshes: one job with all of them, each fails alone

CORNERS = [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def stl(corners=CORNERS, count=None):
    facets = [struct.pack("<3f", 0, 0, 0) + b"".join(struct.pack("<3f", *corners[i]) for i in face) + b"\0\0" for face in FACES]
    return b"\0" * 80 + struct.pack("<I", len(FACES) if count is None else count) + b"".join(facets)


def ply(faces=FACES, order="little", lengths=3):
    head = (f"ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
            "element face 4\nproperty list uint int vertex_indices\nend_header\n")
    sign = "<" if order == "little" else ">"
    return (head.encode() + b"".join(struct.pack(sign + "3f", *corner) for corner in CORNERS)
            + b"".join(struct.pack(sign + "I3i", lengths, *face) for face in faces))


def glb(json=None, indices=FACES, count=12, nodes='[{"mesh":0}]'):
    data = b"".join(struct.pack("<3f", *corner) for corner in CORNERS) + b"".join(struct.pack("<3I", *face) for face in indices)
    text = json or ('{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":' + nodes + ',"buffers":[{"byteLength":96}],'
                    '"bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":48}],'
                    '"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"},'
                    '{"bufferView":1,"componentType":5125,"count":' + str(count) + ',"type":"SCALAR"}],'
                    '"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}]}')
    text = text.encode().ljust((len(text) + 3) // 4 * 4)
    return (b"glTF" + struct.pack("<IIII", 2, 28 + len(text) + len(data), len(text), 0x4e4f534a) + text
            + struct.pack("<II", len(data), 0x004e4942) + data)


def chunk(kind, content, extra=0):
    return struct.pack("<HI", kind, 6 + len(content) + extra) + content


def max3ds(faces=FACES, extra=0):
    vertices = struct.pack("<H", 4) + b"".join(struct.pack("<3f", *corner) for corner in CORNERS)
    polygons = struct.pack("<H", len(faces)) + b"".join(struct.pack("<4H", *face, 0) for face in faces)
    body = chunk(0x4100, chunk(0x4110, vertices) + chunk(0x4120, polygons, extra))
    return chunk(0x4d4d, chunk(0x3d3d, chunk(0x4000, b"thing\0" + body)))


BEYOND = FACES[:3] + [(1, 2, 4)]
NAN = float("nan")
MESH_BYTES = {
    "no_bytes.stl": (b"", "is empty"),
    "count_huge.stl": (stl(count=2**32 - 1), "is truncated: 284 bytes, want 214748364834 for the 4294967295 triangles"),
    "cut_binary.stl": (stl()[:250], "is truncated: 250 bytes, want 284 for the 4 triangles of its header"),
    "longer.stl": (stl() + b"more", "is damaged: 288 bytes, want 284"),
    "nan_binary.stl": (stl([(0, NAN, 0)] + CORNERS[1:]), "vertex 0 is (nan, nan, nan), want finite numbers"),
    "infinite_binary.stl": (stl([(0, 0, float("inf"))] + CORNERS[1:]), "inf), want finite numbers"),
    "no_area.stl": (stl([(0, 0, 0)] * 4), "has no triangle with an area"),
    "denormal.stl": (stl([(0, 0, 0), (1e-40, 0, 0), (0, 1e-40, 0), (0, 0, 1e-40)]), "the diagonal is 1.73e-40 m"),
    "noise.stl": (NOISE, "is truncated"),
    "noise.obj": (NOISE, "has no triangles"),
    "noise.ply": (NOISE, 'does not begin with "ply"'),
    "noise.off": (NOISE, "its header"),
    "noise.dae": (NOISE, "is not a readable dae file"),
    "noise.glb": (NOISE, "does not begin with the 12 bytes of a GLB header"),
    "noise.3ds": (NOISE, "does not begin with the main chunk of a 3DS"),
    "noise.fbx": (NOISE, "is not a readable fbx file"),
    "cut_binary.ply": (ply()[:-7], 'is truncated: its header promises 4 of element "face", 3 are there'),
    "cut_big.ply": (ply(order="big")[:-7], 'is truncated: its header promises 4 of element "face", 3 are there'),
    "index_beyond_binary.ply": (ply(BEYOND), "has vertex index 4 in face 3, want 0 to 3"),
    "list_huge_binary.ply": (ply(lengths=2**32 - 1), "has vertex index"),
    "other_order.ply": (ply().replace(b"little", b"big"), "has vertex index 33554432 in face 0, want 0 to 3"),
    "cut.glb": (glb()[:300], "is truncated: 300 bytes, its header promises"),
    "cut_header.glb": (b"glTF", "does not begin with the 12 bytes of a GLB header"),
    "chunk_beyond.glb": (glb()[:12] + struct.pack("<I", 5000) + glb()[16:], "is truncated: a chunk ends at byte 5020"),
    "not_json.glb": (glb(json='{"asset": '), "is not a readable glb file"),
    "empty_json.glb": (glb(json="{}"), "is not a readable glb file"),
    "index_beyond.glb": (glb(indices=BEYOND), "has a face with a vertex index out of range"),
    "accessor_beyond.glb": (glb(count=12000), "is not a readable glb file"),
    "accessor_huge.glb": (glb(count=4000000000), "is not a readable glb file"),
    "node_in_itself.glb": (glb(nodes='[{"mesh":0,"children":[0]}]'), "has recursive reference to itself"),
    "cut.3ds": (max3ds()[:60], "is truncated: 60 bytes, its main chunk has"),
    "chunk_beyond.3ds": (max3ds(extra=2**31), "Chunk is too large"),
    "index_beyond.3ds": (max3ds(BEYOND), "has a face with a vertex index out of range"),
    "unknown.step": (b"ISO-10303-21;", 'is of unknown format ".step", want one of obj, stl'),
    "without_extension": (stl(), 'is of unknown format ""'),
}
NO_FILES = {
    "folder.stl": "cannot be read: is a folder",
    "pipe.stl": "cannot be read: is not a regular file",
    "device.stl": "cannot be read: is not a regular file",
    "nowhere.stl": "cannot be read: No such file or directory",
    "link_to_nowhere.stl": "cannot be read: No such file or directory",
    "link_to_itself.stl": "cannot be read: Too many levels of symbolic links",
}


def check_mesh(test, name, part):
    lines = [line for line in test.result.stderr.splitlines() if line.startswith(f"error: {name} x hand: ")]
    test.assertEqual(len(lines), 1, test.result.stderr)
    test.assertIn(f"/{name}: ", lines[0])
    test.assertIn(part, lines[0])
    test.assertLess(len(lines[0]), 1000)
    test.assertEqual(list((test.folder / "db" / name).glob("*/*.h5")), [])


@one_test_each(refusals("meshes") | {name: part for name, (_, part) in MESH_BYTES.items()} | NO_FILES, check_mesh)
class Meshes(Corpus):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.good_hand()
        made = cls.folder / "made"
        made.mkdir()
        for name, (content, _) in MESH_BYTES.items():
            (made / name).write_bytes(content)
        (made / "folder.stl").mkdir()
        os.mkfifo(made / "pipe.stl")
        (made / "device.stl").symlink_to("/dev/zero")
        (made / "link_to_nowhere.stl").symlink_to("nowhere.stl")
        (made / "link_to_itself.stl").symlink_to("link_to_itself.stl")
        paths = [*(CORPUS / "meshes").iterdir(), *made.iterdir(), made / "nowhere.stl"]
        job = cls.folder / "job.yaml"
        job.write_text("catalog:\n" + "".join(f"  - {{name: {path.name}, mesh: {path}}}\n" for path in paths)
                       + "hands: [hand]\nsampling: {samples: 4, rolls: 1}\n")
        cls.result = run("build", job, "--db", cls.folder / "db", "--progress", "none")

    def test_the_good_ones_are_built_beside_them(self):
        self.assertEqual(self.result.returncode, 1)
        built = {path.parts[-3] for path in (self.folder / "db").glob("*/*/v*.h5")}
        self.assertEqual(built, {"good.obj", "good.dae"})


# --- grasp sets

BLOCK = 512


def sealed(image, lines):
    """A file whose checksums are right, as db/FORMAT.md says."""
    text = b"HANDHOLD GRASP SET\n" + "".join(f"{key} {value}\n" for key, value in lines.items()).encode()
    text += f"bytes {len(image)}\nxxh3_128 {xxhash.xxh3_128_hexdigest(image)}\n".encode()
    return (text + f"block_xxh3_128 {xxhash.xxh3_128_hexdigest(text)}\n".encode()).ljust(BLOCK, b"\0") + image


def lines_of(content):
    pairs = [line.split(" ", 1) for line in content[:BLOCK].rstrip(b"\0").decode().splitlines()[1:]]
    return {key: value for key, value in pairs if key not in ("bytes", "xxh3_128", "block_xxh3_128")}


def flipped(content, at):
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1:]


def edited(path, index, value):
    def change(file):
        file[path][index] = value
    return change


def replaced(path, **dataset):
    def change(file):
        del file[path]
        file.create_dataset(path, **dataset)
    return change


def attribute(path, name, value):
    def change(file):
        file[path].attrs[name] = value
    return change


SET_BYTES = {
    "no bytes": (lambda good: b"", "is empty, want a grasp set"),
    "noise": (lambda good: NOISE, "is no grasp set"),
    "other magic": (lambda good: good.replace(b"GRASP SET", b"GRASP BAG", 1), "is no grasp set"),
    "without its block": (lambda good: good[BLOCK:], "is no grasp set"),
    "newer format": (lambda good: good.replace(b"format_version 1", b"format_version 2", 1), "has format version 2, want at most 1"),
    "cut in its block": (lambda good: good[:200], "is damaged: its first 512 bytes"),
    "cut after its block": (lambda good: good[:BLOCK], "is damaged: it has 512 bytes"),
    "cut in the middle": (lambda good: good[:len(good) // 2], "is damaged: it has"),
    "longer": (lambda good: good + b"\0", "is damaged: it has"),
    "flipped bit in its block": (lambda good: flipped(good, 60), "is damaged: its first 512 bytes"),
    "flipped bit in its data": (lambda good: flipped(good, len(good) // 2), "is damaged: the checksum of its data"),
    "sealed noise": (lambda good: sealed(NOISE, lines_of(good)), "cannot be opened by HDF5"),
    "sealed nothing": (lambda good: sealed(b"", lines_of(good)), "cannot be opened by HDF5"),
    "sealed half": (lambda good: sealed(good[BLOCK:len(good) // 2], lines_of(good)), "cannot be opened by HDF5"),
    "sealed as another object": (lambda good: sealed(good[BLOCK:], lines_of(good) | {"object": "cup"}), "/@object is t_bar, want cup"),
    "sealed as another version": (lambda good: sealed(good[BLOCK:], lines_of(good) | {"set_version": 7}), "/@set_version is 1, want 7"),
}
SET_CHANGES = {
    "forged: no samples": (lambda file: file.__delitem__("samples"), "/samples/point is missing"),
    "forged: dataset is a group": (lambda file: (file.__delitem__("grasps/roll"), file.create_group("grasps/roll")), "/grasps/roll is missing"),
    "forged: link to itself": (lambda file: (file.__delitem__("grasps/roll"), file.__setitem__("grasps/roll", h5py.SoftLink("/grasps/roll"))),
                               "/grasps/roll is missing"),
    "forged: data in another file": (replaced("grasps/roll", shape=(3,), dtype="<f4", external=[("/etc/passwd", 0, 12)]),
                                     "/grasps/roll is in pieces or elsewhere"),
    "forged: data in chunks": (replaced("grasps/roll", shape=(3,), dtype="<f4", chunks=(1,)), "/grasps/roll is in pieces or elsewhere"),
    "forged: shape of a terabyte": (replaced("grasps/roll", shape=(10**12,), dtype="<f4"), "want a smaller one"),
    "forged: texts of a terabyte": (replaced("object/notes", shape=(10**12,), dtype=h5py.string_dtype()), "/object/notes has 1000000000000"),
    "forged: doubles for floats": (replaced("grasps/roll", data=np.zeros(3)), "/grasps/roll is of type f8, want f4"),
    "forged: outcome without a name": (edited("trials/outcome", (0, 0, 0), 200), "/trials/outcome is 200 at element 0"),
    "forged: vertex that is not there": (edited("object/triangles", (0, 0), 10**6), "/object/triangles row 0 has vertex 1000000"),
    "forged: vertex at infinity": (edited("object/vertices", (0, 0), np.inf), "/object/vertices row 0 has inf"),
    "forged: grasp of a trial that is not there": (edited("grasps/trial", (0, 0), 10**6), "/grasps/trial row 0 is ("),
    "forged: rows out of order": (edited("grasps/epsilon", -1, 5.0), "/grasps/epsilon row "),
    "forged: epsilon nan": (edited("grasps/epsilon", 0, np.nan), "/grasps/epsilon is nan at element 0"),
    "forged: contacts beyond the end": (edited("grasps/contact_begin", -1, 10**6), "/grasps/contact_begin ends with 1000000"),
    "forged: contact of no link": (edited("contacts/link", 0, 999), "/contacts/link row 0 is 999"),
    "forged: friction nan": (attribute("/", "friction", np.nan), "/@friction is nan"),
    "forged: another format inside": (attribute("/", "format_version", np.int32(9)), "/@format_version is 9, want 1"),
}


def check_set(test, name, part):
    path = test.folder / f"{slug(name)}.h5"
    if name in SET_BYTES:
        path.write_bytes(SET_BYTES[name][0](test.good))
    else:
        path.write_bytes(test.good)
        with h5py.File(path, "r+", locking=False) as file:
            SET_CHANGES[name][0](file)
        path.write_bytes(sealed(path.read_bytes()[BLOCK:], lines_of(test.good)))
    database = test.folder / slug(name)
    shutil.copytree(test.folder / "db", database)
    shutil.move(path, database / "t_bar/jaw/v0002.h5")
    verified = run("verify", "--sample", "0", "--db", database)
    test.assertEqual(verified.returncode, 1, verified.stderr)
    test.assertEqual(verified.stdout.count("v0002.h5") + verified.stderr.count("v0002.h5"), 1, verified.stdout + verified.stderr)
    test.assertIn(part, verified.stdout + verified.stderr)


@one_test_each({name: part for name, (_, part) in (SET_BYTES | SET_CHANGES).items()}, check_set)
class Sets(Corpus):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        job = cls.folder / "job.yaml"
        job.write_text(f"catalog: [{{name: t_bar, mesh: {SOURCE}/meshes/t_bar.ply, unit: m}}]\nhands: [{SOURCE}/hands/jaw]\n"
                       "sampling: {samples: 12, rolls: 3}\n")
        assert run("build", job, "--db", cls.folder / "db", "--progress", "none").returncode == 0
        cls.good = (cls.folder / "db/t_bar/jaw/v0001.h5").read_bytes()

    def test_the_good_one_sealed_here(self):
        self.assertEqual(sealed(self.good[BLOCK:], lines_of(self.good)), self.good)

    def test_pipe(self):
        os.mkfifo(self.folder / "pipe.h5")
        self.assert_refused(run("info", self.folder / "pipe.h5"), "pipe.h5: is a folder or a device, want a file")


class Files(unittest.TestCase):
    def test_every_file_has_its_line(self):
        for folder in ("meshes", "urdfs", "hands", "jobs"):
            files = {path.name for path in (CORPUS / folder).iterdir() if path.suffix != ".csv" and path.stem != "good"}
            self.assertEqual(files, set(refusals(folder)))


if __name__ == "__main__":
    print(f"testing {HANDHOLD}")
    unittest.main(argv=[sys.argv[0], *sys.argv[2:]])
