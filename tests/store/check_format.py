"""Holds grasp sets against the table in db/FORMAT.md: check_format.py [--format FORMAT.md] SET.h5 ...

Everything in the table must be in the file under that name, with that type, shape and unit (where a unit can be checked), and
nothing else may be in the file. Prints one line for each good set, else a line for each defect, and exits with 1.
"""

import argparse
import pathlib
import re
import sys

import h5py
import numpy as np

LENGTH_TOLERANCE = 1e-4  # of directions, quaternions and weights: several roundings to 32 bits


def read_table(path):
    """The rows (path, shape, type, unit) of the table, in its order."""
    rows = []
    for line in pathlib.Path(path).read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if len(cells) == 6 and re.fullmatch(r"`/.*`", cells[0]):
            shape = [part.strip() for part in cells[1].strip("()").split(",") if part.strip()]
            rows.append((cells[0].strip("`"), shape, cells[2], cells[3]))
    return rows


def encoded(link):
    return "%2E" if link == "." else link.replace("%", "%25").replace("/", "%2F")


def expanded(rows, links):
    """The rows with `<link>` replaced by each link."""
    for path, shape, kind, unit in rows:
        for link in links if "<link>" in path else [""]:
            yield path.replace("<link>", encoded(link)), shape, kind, unit


def contents(file):
    """Paths of all datasets and attributes, and of the groups without any of both."""
    found, groups = set(), set()

    def visit(name, item):
        path = "/" + name.strip("/")
        found.update(f"{path}@{key}" for key in item.attrs)
        (found if isinstance(item, h5py.Dataset) else groups).add(path)

    visit("/", file)
    file.visititems(visit)
    empty = {g for g in groups if g != "/" and not any(re.match(re.escape(g) + "[/@]", path) for path in found)}
    return found, empty - {"/hand/links"}


def item_of(file, path):
    """Type, shape and value of a dataset or attribute, or None."""
    owner, _, name = path.partition("@")
    if owner not in file or (name and name not in file[owner].attrs):
        return None
    if name:
        low = file[owner].attrs.get_id(name)
        return low.dtype, low.shape, file[owner].attrs[name]
    if not isinstance(file[owner], h5py.Dataset):
        return None
    return file[owner].dtype, file[owner].shape, file[owner][()]


def type_name(dtype):
    text = h5py.check_string_dtype(dtype)
    if text is not None:
        return "text" if text.encoding == "utf-8" and text.length is None else "text of another kind"
    order = "" if dtype.newbyteorder("<") == dtype else " big-endian"
    return f"{dtype.kind}{dtype.itemsize}{order}"


def shape_defect(path, shape, wanted, sizes):
    """What is wrong with a shape; symbols seen for the first time are learned from it."""
    if len(shape) != len(wanted):
        return f"{path} has shape {shape}, want {len(wanted)} dimensions"
    for length, part in zip(shape, wanted):
        symbol, _, more = part.partition("+")
        key = (path.rsplit("/", 1)[0], symbol) if symbol in ("V", "F") else symbol
        known = int(symbol) if symbol.isdigit() else sizes.setdefault(key, length - int(more or 0))
        if length != known + int(more or 0):
            return f"{path} has shape {shape}, want {part} = {known + int(more or 0)}"
    return None


def unit_defect(path, value, unit):
    if unit in ("direction", "pose") and len(value):
        vectors = np.asarray(value, float)[:, 3 if unit == "pose" else 0:]
        worst = np.abs(np.linalg.norm(vectors, axis=-1) - 1).max()
        if not worst <= LENGTH_TOLERANCE:
            return f"{path} has a {'quaternion' if unit == 'pose' else 'direction'} whose length is off by {worst:g}, want 1"
    if unit == "share" and len(value):
        worst = np.abs(np.asarray(value, float).sum(axis=1) - 1).max()
        if not worst <= LENGTH_TOLERANCE:
            return f"{path} has a row whose sum is off by {worst:g}, want 1"
    return None


def true_cone_defect(file):
    """The bounds hold each other, and both are known or none."""
    names = ("grasps/epsilon_lower", "grasps/epsilon_upper", "grasps/critical_friction")
    if any(name not in file for name in names):
        return None  # told already
    lower, upper, friction = (np.asarray(file[name][()], float) for name in names)
    if lower.shape != upper.shape or np.any(np.isnan(lower) != np.isnan(upper)):
        return "/grasps/epsilon_lower and epsilon_upper are not NaN in the same rows"
    if np.any(lower <= 0) or np.any(lower > upper) or np.any(upper - lower > 1.0001e-4 * upper + 1e-9):
        return "/grasps/epsilon_lower and epsilon_upper are no bounds within 1e-4 of each other"
    if np.any(friction <= 0) or np.any(friction > np.float32(file.attrs["friction"])):
        return f"/grasps/critical_friction is not in (0, {file.attrs['friction']:g}]"
    return None


def robustness_defect(file):
    """A probability within its interval, each in [0, 1]; NaN in all three or none."""
    names = ("grasps/robustness_lower", "grasps/robustness", "grasps/robustness_upper")
    if any(name not in file for name in names):
        return None  # told already
    lower, share, upper = (np.asarray(file[name][()], float) for name in names)
    known = ~np.isnan(share)
    if np.any(np.isnan(lower) == known) or np.any(np.isnan(upper) == known):
        return "/grasps/robustness and its interval are not NaN in the same rows"
    ordered = (0 <= lower) & (lower <= share) & (share <= upper) & (upper <= 1)
    if not np.all(ordered[known]):
        return "/grasps/robustness lies outside its interval, or that outside [0, 1]"
    return None


def load_margin_defect(file):
    """Loads are not negative; NaN and infinity are allowed."""
    if "grasps/load_margin" not in file:
        return None  # told already
    margin = np.asarray(file["grasps/load_margin"][()], float)
    if np.any(margin < 0):
        return f"/grasps/load_margin is {np.nanmin(margin):g} in a row, want at least 0 or NaN"
    return None


def defects(path, rows):
    found = []
    with h5py.File(path, "r", locking=False) as file:
        if file.userblock_size != 512:
            found.append(f"user block has {file.userblock_size} bytes, want 512")
        links = file["hand/link_names"].asstr()[:] if "hand/link_names" in file else []
        sizes, named = {}, set()
        for name, shape, kind, unit in expanded(rows, links):
            named.add(name)
            item = item_of(file, name)
            if item is None:
                found.append(f"{name} is missing")
            elif "@" not in name and h5py.h5g.get_objinfo(file[name].id).mtime:
                found.append(f"{name} has a time stamp, want none")
            elif type_name(item[0]) != kind:
                found.append(f"{name} is of type {type_name(item[0])}, want {kind}")
            else:
                found.append(shape_defect(name, item[1], shape, sizes) or unit_defect(name, item[2], unit))
        found.append(true_cone_defect(file))
        found.append(load_margin_defect(file))
        found.append(robustness_defect(file))
        present, empty_groups = contents(file)
        found += [f"{name} is not in the table" for name in sorted((present | empty_groups) - named)]
    return [defect for defect in found if defect], len(named), sizes


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--format", default=pathlib.Path(__file__).resolve().parents[2] / "db" / "FORMAT.md")
    parser.add_argument("sets", nargs="+", metavar="SET.h5")
    arguments = parser.parse_args()
    rows = read_table(arguments.format)
    if not rows:
        sys.exit(f"{arguments.format}: has no table of datasets")
    failed = False
    for path in arguments.sets:
        try:
            found, count, sizes = defects(path, rows)
        except OSError as error:
            found, count, sizes = [f"cannot be read: {error}"], 0, {}
        for defect in found:
            print(f"{path}: {defect}")
        if not found:
            lengths = ", ".join(f"{key}={value}" for key, value in sizes.items() if isinstance(key, str))
            print(f"{path}: {count} datasets and attributes as in the table ({lengths})")
        failed = failed or bool(found)
    sys.exit(1 if failed else 0)


main()
