#!/usr/bin/env python3
"""scripts/check_layers accepts the repository, and refuses copies of src/ that were broken on purpose."""
import pathlib
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent

# What is done to a copy: file, include line, and what the answer says after "FILE:LINE: ". The line goes to the top.
BROKEN = [
    ("core/error.h", '#include "mesh/object.h"', "core includes mesh/object.h, but may use only nothing"),
    ("mesh/repair.cpp", '#include "hand/hand.h"', "mesh includes hand/hand.h, but may use only core"),
    ("quality/wrench.cpp", '#include "mesh/object.h"', "quality includes mesh/object.h, but may use only core"),
    ("store/database.cpp", '  #  include "build/job.h"', "store includes build/job.h"),
    ("core/yaml.h", "#include <yaml-cpp/yaml.h>", "<yaml-cpp/yaml.h> is included in a header, want it in a .cpp file"),
    ("mesh/ray_scene.h", "#include <embree3/rtcore.h>", "<embree3/rtcore.h> is included in a header"),
    ("hand/hand.h", "#include <fmt/format.h>", "<fmt/format.h> is included in a header"),
    ("sample/surface_samples.cpp", "#include <embree3/rtcore.h>", "sample includes <embree3/rtcore.h>, allowed in mesh"),
    ("build/job.cpp", "#include <yaml-cpp/yaml.h>", "build includes <yaml-cpp/yaml.h>, allowed in core"),
    ("simulate/contacts.cpp", "#include <hdf5.h>", "simulate includes <hdf5.h>, allowed in store"),
    ("app/query_command.cpp", "#include <sqlite3.h>", "app includes <sqlite3.h>, allowed in store"),
    ("exchange/export_set.cpp", '#include "build/job.h"', "exchange includes build/job.h, but may use only core, mesh, hand, store"),
    ("core/file.cpp", "#include <boost/filesystem.hpp>", "<boost/filesystem.hpp> is of no library"),
    ("app/handhold.cpp", "#include <tbb/parallel_for.h>", "<tbb/parallel_for.h> is of no library"),
    ("hand/kinematics.cpp", '#include "hand.h"', '"hand.h" names no module of src/'),
    ("hand/kinematics.cpp", '#include "../core/error.h"', '"../core/error.h" names no module of src/'),
    ("sample/surface_samples.cpp", '#include "magic/world.h"', '"magic/world.h" names no module of src/'),
]


def check(root):
    result = subprocess.run([sys.executable, ROOT / "scripts/check_layers", root], capture_output=True, text=True, check=False)
    return result.returncode, result.stdout, result.stderr


def require(condition, what, answer):
    if not condition:
        sys.exit(f"layers_test: {what}\n{answer}")


def test_repository():
    code, out, err = check(ROOT)
    require(code == 0 and ", 0 violations" in out and not err, "the repository breaks its layers", out + err)
    files = sum(1 for path in (ROOT / "src").rglob("*") if path.suffix in (".h", ".cpp"))
    require(out.startswith(f"layers: {files} files"), f"not all of {files} files were read", out)


def test_broken(copy):
    for name, line, message in BROKEN:
        path = copy / "src" / name
        before = path.read_text(encoding="utf-8")
        path.write_text("// a line\n" + line + "\n" + before, encoding="utf-8")
        code, out, _ = check(copy)
        path.write_text(before, encoding="utf-8")
        require(code == 1, f"{name} with {line} was accepted", out)
        require(f"{path}:2: {message}" in out and ", 1 violations" in out, f"{name} with {line}: want {path}:2: {message}", out)


def test_unknown_folder(copy):
    folder = copy / "src/magic"
    folder.mkdir()
    (folder / "world.cpp").write_text("int x;\n", encoding="utf-8")
    code, out, _ = check(copy)
    shutil.rmtree(folder)
    require(code == 1 and f"{folder}: is no module" in out, "an unknown folder was accepted", out)


def test_all_are_reported(copy):
    for name in ("core/error.h", "mesh/object.h"):
        path = copy / "src" / name
        path.write_text('#include "app/commands.h"\n' + path.read_text(encoding="utf-8"), encoding="utf-8")
    code, out, _ = check(copy)
    require(code == 1 and "error.h:1: " in out and "object.h:1: " in out and ", 2 violations" in out, "want both of two", out)


def main():
    test_repository()
    with tempfile.TemporaryDirectory() as folder:
        copy = pathlib.Path(folder)
        shutil.copytree(ROOT / "src", copy / "src")
        code, out, _ = check(copy)
        require(code == 0, "an unchanged copy was refused", out)
        test_broken(copy)
        test_unknown_folder(copy)
        test_all_are_reported(copy)
    print(f"layers: the repository passes, {len(BROKEN) + 2} broken copies are refused")


if __name__ == "__main__":
    main()
