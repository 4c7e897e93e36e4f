#!/usr/bin/env python3
"""Asks `handhold-plan serve` for grasps. Standard library only.

    from handhold_client import Planner
    with Planner(robot="robots/puma560", db="db") as planner:
        planner.ask("scene", file="jobs/scenes/clutter_puma.yaml")
        plan = planner.ask("plan", score="reach", deadline_ms=2000)
        print(plan["status"], plan.get("grasp"), plan["rejected"])
        planner.ask("move", name="can", pose={"position": [0.6, 0.25, 0]})
        again = planner.ask("plan", score="reach", prefer=plan["grasp"])     # keeps the grasp unless another is clearly better

Run as a program it plans once: handhold_client.py PROGRAM ROBOT DB SCENE.yaml
"""
import json
import subprocess
import sys


class PlanError(Exception):
    """The server refused a request; the text is its reason."""


class Planner:
    """One server process. Not for several threads."""

    def __init__(self, robot, db, program="handhold-plan"):
        self._next_id = 0
        self._process = subprocess.Popen([program, "serve", "--robot", robot, "--db", db], text=True,
                                         stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def ask(self, op, **parameters):
        """The result of one request, as Python values. Raises PlanError when it was refused."""
        self._next_id += 1
        self._process.stdin.write(json.dumps({"id": self._next_id, "op": op, **parameters}) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise PlanError(f"the server ended with exit code {self._process.wait()}")
        answer = json.loads(line)
        if answer["id"] != self._next_id:
            raise PlanError(f"the answer is to request {answer['id']}, want {self._next_id}")
        if not answer["ok"]:
            raise PlanError(answer["error"])
        return answer["result"]

    def close(self):
        if self._process.poll() is None:
            self.ask("quit")
        self._process.stdin.close()
        self._process.stdout.close()
        return self._process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def main():
    if len(sys.argv) != 5:
        sys.exit("usage: handhold_client.py PROGRAM ROBOT DB SCENE.yaml")
    program, robot, db, scene = sys.argv[1:]
    with Planner(robot, db, program) as planner:
        planner.ask("scene", file=scene)
        plan = planner.ask("plan", score="reach")
        print(plan["status"], "after", plan["tested"], "tests; rejected:", plan["rejected"])
        if plan["status"] == "planned":
            print("hand at", plan["hand_pose"], "after", plan["trajectory"]["points"][-1]["time_from_start"], "s")


if __name__ == "__main__":
    main()
