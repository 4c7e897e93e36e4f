#!/usr/bin/env python3
"""Brings what package-lock.json names to a folder, once. Usage: install_packages.py FOLDER"""
import pathlib
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
FILES = ("package.json", "package-lock.json")


def is_installed(folder):
    return (folder / "node_modules/.package-lock.json").exists() and all(
        (folder / name).exists() and (folder / name).read_bytes() == (HERE / name).read_bytes() for name in FILES)


def main():
    folder = pathlib.Path(sys.argv[1])
    if is_installed(folder):
        print(f"browser tests: {folder}/node_modules is as package-lock.json says")
        return 0
    npm = shutil.which("npm")
    if npm is None:
        print("browser tests: npm is missing, want the packages of scripts/setup", file=sys.stderr)
        return 1
    folder.mkdir(parents=True, exist_ok=True)
    command = [npm, "ci", "--no-audit", "--no-fund", "--prefer-offline", "--fetch-retries=1", "--fetch-timeout=20000"]
    for name in FILES:
        shutil.copy(HERE / name, folder / name)
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    if done.returncode != 0:
        (folder / FILES[0]).unlink()  # not installed
        print(f"browser tests: npm could not fetch what {HERE / FILES[1]} names: without a network, run once with one, "
              f"or copy {folder}/node_modules from a machine that has it. npm said:\n{done.stderr.strip()}", file=sys.stderr)
        return 1
    print(f"browser tests: installed into {folder}/node_modules")
    return 0


if __name__ == "__main__":
    sys.exit(main())
