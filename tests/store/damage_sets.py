"""Copies a grasp set and contradicts db/FORMAT.md once in each copy: damage_sets.py SET.h5 FOLDER

Prints a line for each copy: its file name, a tab, the beginning of the refusal that the reader must give.
The copies' checksums are left wrong; whoever reads them seals them first.
"""

import os
import shutil
import sys

import h5py
import numpy as np

OPTIONAL = {("/trials", "by_reference"), ("/", "torsion_radius"), ("/", "method_version"), ("/", "robustness_trials"),
            ("/", "robustness_position"), ("/", "robustness_rotation")}  # older sets do not have them
OPTIONAL_DATASETS = {"/grasps/epsilon_lower", "/grasps/epsilon_upper", "/grasps/critical_friction",
                     "/grasps/load_margin", "/grasps/robustness", "/grasps/robustness_lower", "/grasps/robustness_upper"}

good, folder = sys.argv[1:3]
count = 0


def damage(change, wanted):
    global count
    name = f"bad-{count:03}.h5"
    path = os.path.join(folder, name)
    shutil.copyfile(good, path)
    with h5py.File(path, "r+", locking=False) as file:
        change(file)
    print(f"{name}\t{wanted}")
    count += 1


def replaced(path, data):
    """A change that puts `data` in the place of a dataset and keeps its attributes."""

    def change(file):
        attributes = dict(file[path].attrs)
        del file[path]
        file[path] = data
        for key, value in attributes.items():
            file[path].attrs[key] = value

    return change


def edited(path, index, value):
    def change(file):
        file[path][index] = value

    return change


def without(path):
    def change(file):
        del file[path]

    return change


def without_attribute(path, name):
    def change(file):
        del file[path].attrs[name]

    return change


def with_attribute(path, name, value):
    def change(file):
        file[path].attrs[name] = value

    return change


datasets, attributes = {}, []
with h5py.File(good, "r", locking=False) as file:
    def collect(path, item):
        path = "/" + path.strip("/")
        for key in item.attrs:
            attributes.append((path, key))
        if isinstance(item, h5py.Dataset):
            datasets[path] = np.asarray(item[()])

    collect("/", file)
    file.visititems(collect)

for path, data in datasets.items():
    if path not in OPTIONAL_DATASETS:
        damage(without(path), f"{path} is missing")
    if data.dtype.kind in "OS":  # text
        damage(replaced(path, 1.5), f"{path} is of type f8, want text")
        continue
    kind, size = data.dtype.kind, data.dtype.itemsize
    other = "<f8" if (kind, size) != ("f", 8) else "<f4"
    damage(replaced(path, data.astype(other)), f"{path} is of type {other[1:]}, want {kind}{size}")
    damage(replaced(path, data.astype(data.dtype.newbyteorder(">"))) if size > 1 else replaced(path, data.astype("i1")),
           f"{path} is of type ")
    damage(replaced(path, data[None]), f"{path} has shape ")
    if not path.endswith(("/vertices", "/triangles")):  # a mesh may have any number of both
        damage(replaced(path, np.concatenate([data, data])[: len(data) + 1]), "/")
for path, name in attributes:
    if (path, name) not in OPTIONAL:
        damage(without_attribute(path, name), f"{path}@{name} is missing")
    damage(with_attribute(path, name, np.zeros((2, 2), "f2")), f"{path}@{name} is ")

damage(replaced("/object", np.zeros(3)), "/object")
damage(with_attribute("/", "format_version", np.int32(2)), "/@format_version is 2, want 1")
damage(with_attribute("/object", "watertight", np.uint8(2)), "/object@watertight is 2, want 0 or 1")
damage(with_attribute("/", "friction", np.nan), "/@friction is nan")
damage(edited("/object/triangles", (0, 0), 4), "/object/triangles row 0 has vertex 4, want below 4")
damage(edited("/hand/links/hand_base/triangles", (1, 1), 9), "/hand/links/hand_base/triangles row 1 has vertex 9")
damage(edited("/object/vertices", (0, 0), np.inf), "/object/vertices row 0 has inf")
damage(edited("/hand/link_names", 1, "hand_base"), '/hand/link_names has "hand_base"')
damage(edited("/hand/link_names", 1, "elbow"), "/hand/links/elbow/vertices is missing")
damage(edited("/trials/outcome", (0, 1, 1), 9), "/trials/outcome is 9 at element 3, want below ")
damage(edited("/grasps/trial", (2, 2), 2), "/grasps/trial row 2 is (")
damage(edited("/grasps/epsilon", 4, 5.0), "/grasps/epsilon row 4 is 5 after ")
damage(edited("/grasps/epsilon", 4, np.nan), "/grasps/epsilon is nan at element 4")
damage(edited("/grasps/epsilon_lower", 3, 5.0), "/grasps/epsilon_lower row 3 is 5, want at most epsilon_upper")
damage(edited("/grasps/epsilon_upper", 3, np.inf), "/grasps/epsilon_upper is inf at element 3")
damage(edited("/grasps/robustness", 2, 1.5), "/grasps/robustness row 2 is 1.5 in")
damage(edited("/grasps/load_margin", 2, -0.5), "/grasps/load_margin row 2 is -0.5, want at least 0")
damage(edited("/grasps/load_margin", 2, -np.inf), "/grasps/load_margin is -inf at element 2")
damage(edited("/grasps/contact_begin", 0, 1), "/grasps/contact_begin starts with 1, want 0")
damage(edited("/grasps/contact_begin", 3, 1), "/grasps/contact_begin row 3 is 1 after ")
damage(edited("/grasps/contact_begin", -1, 10**6), "/grasps/contact_begin ends with 1000000, want")
damage(edited("/contacts/link", 1, 5), "/contacts/link row 1 is 5, want below 5")
damage(edited("/distance_map/neighbor", (1, 0), 20), "/distance_map/neighbor is 20 at element 5, want below 20")
