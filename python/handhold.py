"""Reads Handhold's grasp databases. Needs h5py and numpy; with python3-xxhash it also checks the files' checksums.

    import handhold
    database = handhold.Database("db")
    for grasp in database.query(object="mug", min_epsilon=0.05, top=10):
        print(grasp.hand, grasp.epsilon, grasp.pose, grasp.joints)

Units are SI and radians. The object frame O is the mesh file's own; a pose is the 4x4 matrix that turns coordinates of
the hand's root link H into O. db/FORMAT.md is the authority on the files; `handhold query` answers the same questions.
"""
import collections
import dataclasses
import fnmatch
import math
import pathlib
import re
import warnings

import h5py
import numpy as np

try:
    import xxhash
except ImportError:  # GraspSet.checksum_checked says so
    xxhash = None

BLOCK_BYTES = 512
MAGIC = "HANDHOLD GRASP SET"
FORMAT_VERSION = 1
PHYSICS_MAGIC = b"HANDHOLD PHYSICS RESULTS 1\n"
TIE = 1e-9  # m: distances that differ by less are equal to the farthest-point choice

SetFile = collections.namedtuple("SetFile", "path object hand version")
SetFile.__doc__ = "A set file as its path names it."

Selection = collections.namedtuple("Selection", "rows passed cover_radius")
Selection.__doc__ = """The answer of GraspSet.select: `rows` (k,) of /grasps, ascending, so by falling epsilon; how many
rows `passed` the filters; `cover_radius` [m]: each of these lies within it of a chosen one (NaN unless diverse)."""


# Columns of /grasps that older sets do not have.
_LATER_COLUMNS = ("epsilon_lower", "epsilon_upper", "critical_friction", "load_margin", "robustness", "robustness_lower",
                  "robustness_upper")


class BadSet(ValueError):
    """A file that is no grasp set, or no physics results of the set beside it, is damaged, or was written by a newer
    Handhold. The text names the file."""


@dataclasses.dataclass
class Grasp:
    """One stored grasp. Vectors are in the object frame."""
    object: str
    hand: str
    set_version: int
    grasp: int                    # row of /grasps: 0 is the best of the set
    trial: tuple                  # sample, roll, preshape: indices into /trials
    preshape: str
    epsilon: float                # at the friction of the set's job
    epsilon_lower: float          # bounds on the true cone; NaN where not known
    epsilon_upper: float
    critical_friction: float      # least friction at which it is force closed; NaN where not known
    load_margin: float            # N, largest load within the joints' efforts; inf where no known effort bounds it, or NaN
    robustness: float             # share of perturbed poses that end force closed; NaN where not known, as the next two
    robustness_lower: float       # its 95 % interval
    robustness_upper: float
    pose: np.ndarray              # (4, 4) of the root link
    joints: dict                  # name -> rad or m, closed
    preshape_joints: dict         # name -> rad or m, before closing
    target_point: np.ndarray      # (3,) m
    approach_direction: np.ndarray  # (3,) unit, from the palm to the object
    roll: float                   # rad
    backoff: float                # m
    approach_clear: bool
    contact_positions: np.ndarray  # (c, 3) m
    contact_normals: np.ndarray   # (c, 3) unit, into the object
    contact_links: list           # c link names


class GraspSet:
    """One set, open for reading; a context manager. Raises BadSet for what is no undamaged set.

    Attributes: path, object, hand, version, friction, torque_scale [m], joint_names, link_names, preshape_names, `file`
    (the open h5py.File), and checksum_checked: False when python3-xxhash is missing, so that only the file's length was
    checked.
    """

    def __init__(self, path):
        self.path = pathlib.Path(path)
        self.checksum_checked = _check_file(self.path)
        self.file = h5py.File(self.path, "r", locking=False)
        attributes = self.file.attrs
        self.object, self.hand = attributes["object"], attributes["hand"]
        self.version = int(attributes["set_version"])
        self.friction = float(attributes["friction"])
        self.torque_scale = float(attributes["torque_scale"])
        self.joint_names = list(self.file["hand/joint_names"].asstr()[:])
        self.link_names = list(self.file["hand/link_names"].asstr()[:])
        self.preshape_names = list(self.file["hand/preshape_names"].asstr()[:])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self.file.close()

    def __len__(self):
        """The number of stored grasps."""
        return self.file["grasps/epsilon"].shape[0]

    def column(self, name):
        """All rows of /grasps/NAME; NaN in each for the columns that older sets do not have."""
        if name in _LATER_COLUMNS and name not in self.file["grasps"]:
            return np.full(len(self), np.nan)
        return self.file["grasps"][name][:]

    def poses(self, rows=slice(None)):
        """(k, 4, 4) poses of the root link in the object frame, of all rows or of those given."""
        return _matrices(self.column("hand_pose")[rows])

    def physics(self):
        """(n,) the share of the six directions of `handhold physics --test pull` in which each grasp was held, NaN where
        it was not simulated. Raises BadSet for results that are damaged or another set's."""
        path = self.path.with_name("physics-" + self.path.name)
        shares = np.full(len(self), np.nan)
        if not path.exists():
            return shares
        _check_physics(path)
        with h5py.File(path, "r", locking=False) as results:
            found = results.attrs["input_hash"], int(results.attrs["set_version"])
            wanted = self.file.attrs["input_hash"], self.version
            if found != wanted:
                raise BadSet(f"{path}: belongs to version {found[1]} with input hash {found[0]}, "
                             f"want {wanted[1]} with {wanted[0]}")
            directions = results["load"].attrs["directions"]
            pull = np.array([str(name).startswith("pull ") for name in directions], bool)
            if pull.any():
                shares[results["grasp"][:]] = (results["load/outcome"][:, pull] == 0).mean(axis=1)
        return shares

    def select(self, min_epsilon=None, friction=None, approach=None, within_deg=None, near=None, radius=None,
               preshape="*", min_physics=None, top=None, diverse=False):
        """The rows that pass every filter that is given, as a Selection.

        min_epsilon: of the epsilon as stored. friction: at most the set's own; keeps critical_friction <= friction and
        leaves out rows where that is not known. approach (3,) with within_deg: the approach direction, from the palm to
        the object, is at most so many degrees from it. near (3,) [m] with radius [m]: of the target point. preshape:
        shell pattern. min_physics: 0 to 1, keeps what was held in at least that share of the directions of physics();
        grasps that were not simulated are left out. top: at most so many, the best, or with diverse spread by farthest points over all that pass.
        """
        keep = np.ones(len(self), bool)
        if min_epsilon is not None:
            keep &= self.column("epsilon") >= _number("min_epsilon", min_epsilon)
        if friction is not None:
            if _number("friction", friction, 0) > self.friction:
                raise ValueError(
                    f"friction is {friction}, want at most {self.friction}: {self.path} was built with that")
            keep &= self.column("critical_friction") <= np.float32(friction)  # False for NaN
        if (approach is None) != (within_deg is None) or (near is None) != (radius is None):
            raise ValueError("approach goes with within_deg, near with radius")
        if approach is not None:
            axis, direction = _vector("approach", approach), self.column("approach_direction").astype(float)
            if not axis.any():
                raise ValueError("approach is 0, 0, 0, want a direction")
            angle = np.arctan2(np.linalg.norm(np.cross(direction, axis), axis=1), direction @ axis)
            keep &= angle <= math.radians(_number("within_deg", within_deg, 0, 180))
        if near is not None:
            away = self.column("target_point").astype(float) - _vector("near", near)
            keep &= np.linalg.norm(away, axis=1) <= _number("radius", radius, 0)
        if min_physics is not None:
            keep &= self.physics() >= _number("min_physics", min_physics, 0, 1)  # False for NaN
        wanted = np.array([fnmatch.fnmatchcase(name, preshape) for name in self.preshape_names], bool)
        keep &= wanted[self.column("trial")[:, 2]]
        rows = np.flatnonzero(keep)
        if top is not None and (top != int(top) or top < 1):
            raise ValueError(f"top is {top}, want a whole number from 1")
        if not diverse:
            return Selection(rows[:top], len(rows), math.nan)
        if top is None:
            raise ValueError("diverse is asked for without top, want how many to keep")
        chosen, cover_radius = _farthest_poses(self.column("hand_pose")[rows], int(top), self.torque_scale)
        return Selection(rows[chosen], len(rows), cover_radius)

    def grasps(self, rows):
        """The Grasp of each row, in their order. For many rows: each column is read once."""
        columns = {name: self.column(name) for name in (
            "trial", "epsilon", "epsilon_lower", "epsilon_upper", "critical_friction", "load_margin", "robustness",
            "robustness_lower", "robustness_upper", "hand_pose", "joint_position", "preshape_joint_position", "target_point", "approach_direction", "roll", "backoff", "approach_clear",
            "contact_begin")}
        contacts = self.file["contacts"]
        result = []
        for row in map(int, rows):
            value = {name: column[row] for name, column in columns.items()}
            touched = slice(*map(int, columns["contact_begin"][row:row + 2]))
            result.append(Grasp(
                object=self.object, hand=self.hand, set_version=self.version, grasp=row,
                trial=tuple(map(int, value["trial"])), preshape=self.preshape_names[value["trial"][2]],
                epsilon=float(value["epsilon"]), epsilon_lower=float(value["epsilon_lower"]),
                epsilon_upper=float(value["epsilon_upper"]), critical_friction=float(value["critical_friction"]),
                load_margin=float(value["load_margin"]), robustness=float(value["robustness"]),
                robustness_lower=float(value["robustness_lower"]), robustness_upper=float(value["robustness_upper"]),
                pose=_matrices(value["hand_pose"][None])[0],
                joints=dict(zip(self.joint_names, value["joint_position"].tolist())),
                preshape_joints=dict(zip(self.joint_names, value["preshape_joint_position"].tolist())),
                target_point=value["target_point"].astype(float),
                approach_direction=value["approach_direction"].astype(float), roll=float(value["roll"]),
                backoff=float(value["backoff"]), approach_clear=bool(value["approach_clear"]),
                contact_positions=contacts["position"][touched].astype(float),
                contact_normals=contacts["normal"][touched].astype(float),
                contact_links=[self.link_names[i] for i in contacts["link"][touched]]))
        return result

    def object_mesh(self):
        """(vertices (V, 3) f4 [m] in the object frame, triangles (F, 3) u4 counter-clockwise from outside)."""
        return self.file["object/vertices"][:], self.file["object/triangles"][:]

    def link_mesh(self, link):
        """As object_mesh, the collision geometry of a link in the link's frame; no vertices for a link without any."""
        if link not in self.link_names:
            raise ValueError(f"link is {link!r}, want one of {', '.join(self.link_names)}")
        group = self.file["hand/links/" + ("%2E" if link == "." else link.replace("%", "%25").replace("/", "%2F"))]
        return group["vertices"][:], group["triangles"][:]


class Database:
    """A folder of grasp sets, DIR/<object>/<hand>/v<NNNN>.h5."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        if not self.folder.is_dir():
            raise ValueError(f"{folder}: is no folder, want a database")

    def sets(self, object="*", hand="*"):
        """Every SetFile whose names match the shell patterns, by object, hand and version."""
        found = []
        for path in self.folder.glob("*/*/v*.h5"):
            number = re.fullmatch(r"v(\d{4,})\.h5", path.name)
            names = path.parent.parent.name, path.parent.name
            hidden = any(name.startswith(".") for name in names)
            if number and int(number[1]) > 0 and not hidden and all(map(fnmatch.fnmatchcase, names, (object, hand))):
                found.append(SetFile(path, *names, int(number[1])))
        return sorted(found, key=lambda s: s[1:])

    def newest(self, object="*", hand="*", version=None):
        """Of each object and hand the newest SetFile, or the one of that version."""
        newest = {(s.object, s.hand): s for s in self.sets(object, hand) if version in (None, s.version)}
        return list(newest.values())

    def open(self, object, hand, version=None):
        """The newest GraspSet of an object and a hand, or the one of that version."""
        found = [s for s in self.sets() if (s.object, s.hand) == (object, hand) and version in (None, s.version)]
        if not found:
            which = f", version {version}" if version else ""
            raise ValueError(f"{self.folder}: has no set of {object} and {hand}{which}")
        return GraspSet(found[-1].path)

    def query(self, object="*", hand="*", set_version=None, **filters):
        """The Grasps that pass the filters of GraspSet.select, set by set, each by falling epsilon; `top` is per set.

        A set that cannot be read is warned about and passed over.
        """
        files = self.newest(object, hand, set_version)
        if not files:
            which = f"object {object!r}, hand {hand!r}, version {set_version or 'newest'}"
            raise ValueError(f"{which} picks no set of {self.folder}")
        found = []
        for file in files:
            try:
                with GraspSet(file.path) as grasp_set:
                    found += grasp_set.grasps(grasp_set.select(**filters).rows)
            except BadSet as error:
                warnings.warn(str(error))
        return found


def _check_file(path):
    """Refuses what the first 512 bytes, the length and the checksum refuse, before HDF5 sees it. Returns whether the
    checksum was checked."""
    with open(path, "rb") as file:
        block = file.read(BLOCK_BYTES)
        text = block.rstrip(b"\0").decode("utf-8", "replace")
        lines = text.split("\n")
        if lines[0] != MAGIC:
            raise BadSet(f'{path}: is no grasp set: it does not start with "{MAGIC}"')
        fields = dict(line.partition(" ")[::2] for line in lines[1:])
        if fields.get("format_version", "").isdigit() and int(fields["format_version"]) > FORMAT_VERSION:
            raise BadSet(f"{path}: has format version {fields['format_version']}, want at most {FORMAT_VERSION}")
        found, wanted = path.stat().st_size - BLOCK_BYTES, fields.get("bytes", "")
        if str(found) != wanted:
            raise BadSet(f"{path}: is damaged: {found} bytes follow the first {BLOCK_BYTES}, want {wanted or None}")
        if xxhash is None:
            return False
        head = text[:text.find("block_xxh3_128")]
        if xxhash.xxh3_128(head.encode()).hexdigest() != fields.get("block_xxh3_128"):
            raise BadSet(f"{path}: is damaged: its first {BLOCK_BYTES} bytes do not match the checksum in them")
        checksum = xxhash.xxh3_128()
        for part in iter(lambda: file.read(1 << 20), b""):
            checksum.update(part)
        if checksum.hexdigest() != fields.get("xxh3_128"):
            raise BadSet(f"{path}: is damaged: the checksum of its data is {checksum.hexdigest()}, "
                         f"want {fields.get('xxh3_128')}")
        return True


def _check_physics(path):
    """Refuses physics results by their first 512 bytes and, with xxhash, their checksum."""
    data = path.read_bytes()
    if not data.startswith(PHYSICS_MAGIC) or len(data) < BLOCK_BYTES:
        raise BadSet(f'{path}: holds no physics results: it does not start with "{PHYSICS_MAGIC.decode().strip()}"')
    wanted = data[len(PHYSICS_MAGIC):len(PHYSICS_MAGIC) + 32].decode("ascii", "replace")
    if xxhash is not None and xxhash.xxh3_128(data[BLOCK_BYTES:]).hexdigest() != wanted:
        raise BadSet(f"{path}: is damaged: the checksum of its data is not {wanted}")


def _number(name, value, least=-math.inf, most=math.inf):
    if not (math.isfinite(value) and least <= value <= most):
        raise ValueError(f"{name} is {value}, want a number from {least} to {most}")
    return value


def _vector(name, value):
    vector = np.asarray(value, float)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{name} is {value}, want three numbers")
    return vector


def _matrices(hand_pose):
    """(k, 7) x y z qx qy qz qw -> (k, 4, 4)."""
    x, y, z, w = (hand_pose[:, 3:] / np.linalg.norm(hand_pose[:, 3:], axis=1, keepdims=True)).T
    matrices = np.zeros((len(hand_pose), 4, 4))
    matrices[:, :3, 3] = hand_pose[:, :3]
    matrices[:, 3, 3] = 1
    matrices[:, :3, :3] = np.moveaxis(np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]), 2, 0)
    return matrices


def _farthest_poses(hand_pose, count, scale):
    """Indices, ascending, and cover radius [m]: the first pose, then again and again the one farthest from the chosen,
    at the distance |p - p'| + scale * angle(R, R'). See src/core/farthest_poses.h."""
    if len(hand_pose) <= count:
        return np.arange(len(hand_pose)), 0.0
    position = hand_pose[:, :3]
    turn = hand_pose[:, 3:] / np.linalg.norm(hand_pose[:, 3:], axis=1, keepdims=True)
    distance, chosen = np.full(len(hand_pose), np.inf), [0]
    while True:
        last = chosen[-1]
        w = np.abs(turn @ turn[last])
        v = (turn[last, 3] * turn[:, :3] - turn[:, 3:] * turn[last, :3] - np.cross(turn[:, :3], turn[last, :3]))
        angle = 2 * np.arctan2(np.linalg.norm(v, axis=1), w)
        distance = np.minimum(distance, np.linalg.norm(position - position[last], axis=1) + scale * angle)
        distance[chosen] = -1
        if len(chosen) == count:
            return np.sort(chosen), float(distance.max())
        chosen.append(int(np.argmax(distance >= distance.max() - TIE)))
