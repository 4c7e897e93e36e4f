#!/usr/bin/env python3
"""An installed Handhold as another project uses it: find_package, link, plan. Usage: install_test.py BUILD_FOLDER HANDHOLD"""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BUILD, HANDHOLD = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()

PROJECT = """cmake_minimum_required(VERSION 3.25)
project(consumer LANGUAGES C CXX)
find_package(handhold 0.1 REQUIRED)
add_executable(plan_once planner_example.cpp)
target_link_libraries(plan_once PRIVATE handhold::plan)
"""


def run(*arguments, **options):
    done = subprocess.run([*map(str, arguments)], capture_output=True, text=True, timeout=300, **options)
    assert done.returncode == 0, f"{arguments}\n{done.stdout}\n{done.stderr}"
    return done.stdout


class Installed(unittest.TestCase):
    def test_another_project_plans(self):
        folder = pathlib.Path(tempfile.mkdtemp(prefix="handhold_install_"))
        self.addCleanup(shutil.rmtree, folder)
        prefix, project, db = folder / "prefix", folder / "project", folder / "db"
        run("cmake", "--install", BUILD, "--prefix", prefix)
        project.mkdir()
        (project / "CMakeLists.txt").write_text(PROJECT)
        shutil.copy(SOURCE / "tests/plan/planner_example.cpp", project)
        run("cmake", "-S", project, "-B", folder / "build", f"-DCMAKE_PREFIX_PATH={prefix}")
        run("cmake", "--build", folder / "build")

        share = prefix / "share/handhold"
        job = folder / "job.yaml"
        job.write_text(f"catalog:\n  - {{name: t_bar, mesh: {share}/meshes/t_bar.ply, unit: m}}\n"
                       f"hands: [{share}/hands/jaw]\nsampling: {{samples: 30, rolls: 8}}\n")
        run(prefix / "bin/handhold", "build", job, "--db", db, "--progress", "none")
        scene = folder / "scene.yaml"
        scene.write_text("robot: {joints: home}\ntarget: {object: t_bar, pose: {position: [0.5, 0.1, 0]}}\nobstacles:\n"
                         "  - {name: table, box: [0.9, 1.2, 0.04], pose: {position: [0.75, 0, -0.02]}}\n"
                         f"  - {{name: can, mesh: {share}/meshes/can.ply, unit: m, pose: {{position: [0.5, -0.15, 0]}}}}\n")
        environment = {**os.environ, "HANDHOLD_LIBEXEC": str(prefix / "libexec/handhold")}
        lines = run(folder / "build/plan_once", share / "robots/panda", db, scene, "can", env=environment).splitlines()
        self.assertEqual(len(lines), 3)
        self.assertEqual(lines[1].split(",")[0], lines[2], "the grasp is kept")


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]], verbosity=1)
