#!/usr/bin/env python
"""Drag everything in the studio at random, for some time: no error, memory flat, and how long a plan takes.

    python scripts/studio_drags.py problems/gallery/go2.toml --seconds 600 --seed 1

The page is served, without a browser; it is called as sliders, grips and buttons do. First come gentle drags, whose
time from the drag to the drawn plan is told, then wild ones. Exit code 1 where the program went wrong, or memory grew.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from studio_insides import logged_errors, process_ids

import floatplan as fp
from floatplan.problem.parts import OBSTACLE_KINDS
from floatplan.studio import edits
from floatplan.studio.page import Studio
from floatplan.studio.session import Document
from floatplan.studio.tasks import COLUMNS, ROWS
from floatplan.tables import OBJECTIVES

GENTLY = np.radians(4.0)  # [rad] that they turn a joint by, at most
PATIENCE = 60.0  # [s]
WARM = 0.3  # [-] of the time, after which memory must not grow by more than
GROWTH = 60.0  # [MB]
PAGE = os.sysconf("SC_PAGE_SIZE")
TICKS = os.sysconf("SC_CLK_TCK")


class Drags:
    """What a user does at random."""

    def __init__(self, studio: Studio, seed: int, folder: str) -> None:
        self.studio, self.session, self.stage = studio, studio.session, studio.stage
        self.rng = np.random.default_rng(seed)
        self.base = studio.session.view.problem
        self.folder = folder
        self.refused = 0

    def gentle(self, number: int) -> tuple[float, float, bool]:
        """Turn a joint at the goal a little, or change the duration.

        Returns seconds by the clock, and of processors, until the answer is drawn; and whether it is a plan.
        """
        joints = self.base.robot.joints
        joint = number % (len(joints) + 1)
        if joint == len(joints):
            path, value = "flight.duration", self.base.flight.duration * float(self.rng.uniform(0.97, 1.05))
        else:
            turned = self.base.final.positions[joint] + self.rng.uniform(-GENTLY, GENTLY)
            path, value = f"goal.positions.{joints[joint]}", float(np.clip(turned, *self.base.position_limits[joint]))
        self.session.edit(lambda _: self.base)
        self.session.wait(lambda view: view.is_current, PATIENCE)
        self.studio.painter.wait(PATIENCE)
        spent, begin = processor_seconds(self.studio), time.perf_counter()
        self.studio.actions.do(path, lambda: self.session.set(path, value))
        self.studio.actions.wait(PATIENCE)
        self.session.wait(lambda view: view.is_current, PATIENCE)
        self.studio.painter.wait(PATIENCE)
        flown = self.session.view.result
        found = flown is not None and flown.plan.ok
        return time.perf_counter() - begin, processor_seconds(self.studio) - spent, found

    def wild(self) -> None:
        """Do something."""
        acts: list[tuple[float, Callable[[], Any]]] = [
            (8, self.turn),
            (6, self.slide),
            (2, self.carry),
            (1, self.obstacle),
            (2, self.choose),
            (1, self.session.undo),
            (0.5, self.session.redo),
            (0.5, lambda: self.session.jump(int(self.rng.integers(ROWS)), int(self.rng.integers(COLUMNS)))),
            (0.3, lambda: self.session.keep(bool(self.rng.integers(2)))),
            (0.2, self.save),
            (0.7, lambda: self.session.edit(lambda _: self.base)),
        ]
        weights = np.array([weight for weight, _ in acts])
        act = acts[int(self.rng.choice(len(acts), p=weights / weights.sum()))][1]
        self.studio.actions.do(f"act {self.rng.integers(3)}", act)

    def turn(self) -> None:
        """Turn a part of a posture, by any angle and from anywhere."""
        end, part = str(self.rng.choice(["start", "goal"])), int(self.rng.integers(len(self.base.robot.joints) + 1))
        for step in range(int(self.rng.integers(2, 12))):
            place = complex(*self.rng.normal(0.0, 10.0 ** self.rng.uniform(-3, 1), 2))
            self.stage.rotate(end, part, place, begins=step == 0)

    def slide(self) -> None:
        """Move a slider, also to where nothing can be."""
        joint = str(self.rng.choice(self.base.robot.joints))
        wide = 10.0 ** self.rng.uniform(-2, 2)
        path, low, high = [
            ("flight.duration", -0.1, 3.0),
            ("flight.angular_momentum", -wide, wide),
            ("flight.horizontal_velocity", -5.0, 5.0),
            ("goal.orientation", -9.0, 9.0),
            (f"goal.positions.{joint}", -4.0, 4.0),
            (f"start.positions.{joint}", -4.0, 4.0),
            (f"limits.torque.{joint}", -1.0, 60.0),
            (f"limits.velocity.{joint}", -1.0, 60.0),
            ("obstacles.0.margin", -0.1, 0.5),
            ("obstacles.0.radius", -0.1, 0.5),
        ][int(self.rng.integers(10))]
        for value in np.linspace(self.rng.uniform(low, high), self.rng.uniform(low, high), 5):
            self.refused += not self.session.set(path, float(value))

    def carry(self) -> None:
        """Carry an obstacle."""
        for step in range(6):
            self.stage.carry(int(self.rng.integers(2)), complex(*self.rng.normal(0.0, 2.0, 2)), begins=step == 0)

    def obstacle(self) -> None:
        """Add an obstacle, or take one away."""
        count = len(self.session.view.problem.obstacles)
        if count and (count > 3 or self.rng.integers(2)):
            self.session.edit(edits.put_obstacle(int(self.rng.integers(count))))
        else:
            make = list(OBSTACLE_KINDS.values())[int(self.rng.integers(len(OBSTACLE_KINDS)))].example
            self.session.edit(edits.with_obstacle(make(complex(*self.rng.normal(0.0, 2.0, 2)), 1.0)))

    def choose(self) -> None:
        """Choose a word."""
        degrees: list[Any] = ["auto", 7, 9, 13]
        needed = dict.fromkeys(self.base.robot.motors, float(self.rng.uniform(0.1, 50.0)))
        choices = [
            edits.change("flight", angular_momentum=str(self.rng.choice(["free", "midpoint"]))),
            edits.change("motion", objective=str(self.rng.choice(list(OBJECTIVES)))),
            edits.change("motion", degree=degrees[int(self.rng.integers(4))]),
            edits.ground(bool(self.rng.integers(2))),
            edits.limit("torque", str(self.rng.choice(["none", "urdf", edits.BY_HAND])), needed),
            edits.limit("velocity", str(self.rng.choice(["none", "urdf", edits.BY_HAND])), needed),
        ]
        self.refused += not self.session.edit(choices[int(self.rng.integers(len(choices)))])

    def save(self) -> None:
        """Save problem and plan."""
        parts: tuple[Document, ...] = ("problem", "plan")
        for part in parts:
            self.session.save(part, self.folder)


def megabytes(studio: Studio) -> tuple[float, float]:
    """Memory of the page's process, and of those that plan."""

    def resident(process: int) -> float:
        try:
            return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * PAGE / 1e6
        except OSError:
            return 0.0

    return resident(os.getpid()), max(map(resident, process_ids(studio.session)), default=0.0)


def processor_seconds(studio: Studio) -> float:
    """Time that processors have spent on the page and the quick plans."""
    total = time.process_time()
    for process in process_ids(studio.session)[:1]:
        try:
            fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        total += (int(fields[11]) + int(fields[12])) / TICKS
    return total


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problem", nargs="?", default="problems/new_configuration.toml")
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--gentle", type=int, default=40, help="drags that are timed")
    parser.add_argument("--port", type=int, default=0)
    options = parser.parse_args()
    logging.basicConfig(level=logging.ERROR)
    problem = fp.load_problem(options.problem)
    with (
        tempfile.TemporaryDirectory() as folder,
        logged_errors() as logged,
        closing(Studio(problem, folder=folder, port=options.port)) as studio,
    ):
        drags = Drags(studio, options.seed, folder)
        times = np.array([drags.gentle(number) for number in range(options.gentle)])
        found = times[times[:, 2] > 0]
        clock, processors, _ = 1e3 * np.median(found, axis=0)
        print(
            f"{len(found)} of {len(times)} gentle drags found a plan: median {clock:.0f} ms until it was drawn,"
            f" {processors:.0f} ms of processors",
            flush=True,
        )
        begin, done, memory = time.monotonic(), 0, []
        told: dict[str, int] = {}
        while time.monotonic() - begin < options.seconds:
            drags.wild()
            done += 1
            time.sleep(float(drags.rng.choice([0.005, 0.03, 0.1, 1.5], p=[0.5, 0.3, 0.17, 0.03])))
            verdict = studio.session.view.verdict
            told[verdict] = told.get(verdict, 0) + 1
            memory.append((time.monotonic() - begin, *megabytes(studio)))
        studio.actions.wait(PATIENCE)
        errors = [repr(error) for error in logged]
        recovers = drags.session.edit(lambda _: problem) and drags.session.wait(
            lambda view: view.is_current and view.verdict == "proved", PATIENCE
        )
    table = np.array(memory)
    warm = table[:, 0] > WARM * options.seconds
    early, late = np.array_split(table[warm], 2)
    growth = float(np.median(late[-len(late) // 2 :, 1]) - np.median(early[: len(early) // 2 + 1, 1]))
    print(f"{done} wild drags in {options.seconds:.0f} s, {drags.refused} refused; verdicts seen: {json.dumps(told)}")
    print(
        f"page: {table[warm][0, 1]:.0f} MB warm, {table[-1, 1]:.0f} MB at the end, grown by {growth:.1f} MB;", end=" "
    )
    print(f"planners: at most {table[:, 2].max():.0f} MB")
    print(f"errors: {errors or 'none'}; the first problem is {'proved again' if recovers else 'NOT proved again'}")
    return 0 if not errors and recovers and growth < GROWTH else 1


if __name__ == "__main__":
    sys.exit(main())
