"""Plans the problems of problems/jumps/, space/ and gallery/: prints docs/gallery.md's tables, draws its pictures.

Run it from anywhere. ``jumps``, ``jumps-in-space``, ``space`` or ``flights`` does these alone; with names only some of
them; with ``--no-picture`` the tables alone. Without ``--launch`` the column of that name is empty: it takes minutes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from make_images import SHEET_DPI, draw_scene, rendered, save, sheet
from matplotlib.figure import Figure
from PIL import Image

import floatplan as fp
from floatplan.arrays import Array
from floatplan.jumps.variables import PROGRAM
from floatplan.motion.planar.contact_rates import End
from floatplan.view.figures.snapshots import moments
from floatplan.view.outlines import picture_box, postures
from floatplan.view.style import new_figure, styled

ROOT = Path(__file__).resolve().parents[1]
WIDTH = 7.6  # [in]
PROBLEMS, JUMPS, SPACE = (ROOT / "problems" / name for name in ("gallery", "jumps", "space"))
IMAGES = ROOT / "docs" / "images"
PICTURE, STRIPS, IN_SPACE, SPACE_STRIPS = (
    IMAGES / f"{name}.png" for name in ("gallery", "jumps", "space", "jumps_in_space")
)
TITLES = {
    "double_pendulum": "double pendulum",
    "solo": "Solo, somersault",
    "solo12": "Solo12, levels out, h = 0",
    "bolt": "Bolt, leap",
    "go2": "Go2, backflip",
    "a1": "A1, over a bar",
    "borinot": "Borinot, by its arm",
    "g1": "G1, backflip",
    "talos": "Talos, onto a step",
    "human": "human, somersault",
}
SPACE_TITLES = {
    "diver_half_twist": "diver, half a twist",
    "diver_full_twist": "diver, full twist",
    "diver_past_a_bar": "diver, half a twist past a bar",
    "go2_barrel_roll": "Go2, barrel roll",
    "go2_half_twist": "Go2, backflip with half a twist",
    "go2_half_twist_clear": "Go2, legs kept apart",
    "go2_levels": "Go2, levels out, h = 0",
    "cat": "cat of Kane and Scher, h = 0",
    "free_ur5": "UR5, h = 0",
    "free_panda": "Panda, h = 0",
}
NAMES = {"b1": "B1", "go1": "Go1", "hyq": "HyQ", "anymal": "ANYmal", "talos_hop": "Talos", "high_jumper": "high jumper"}
COLUMNS = (
    "robot",
    "joints planned",
    "kg",
    "duration, s",
    "torque / limit",
    "takeoff / limit",
    "landing / limit",
    "launch",
    "out of plane, deg",
    "planned in, s",
)
JUMP_COLUMNS = (
    "robot",
    "turn",
    "in all, s",
    "in flight, s",
    "torque / limit",
    "rate / limit",
    "friction",
    "flight",
    "stances",
    "found in, s",
)
SPACE_COLUMNS = (
    "robot",
    "joints planned",
    "kg",
    "duration, s",
    "largest rate of the base, rad/s",
    "torque / limit",
    "rate / limit",
    "proved to within, rad",
    "replay off by, rad",
    "planned in, s",
)
PER_ROW = 5
SNAPSHOTS = 5


@dataclass(frozen=True)
class Entry:
    """A planned problem, the processor's seconds for it, and what stances reach its takeoff, in a word."""

    name: str
    plan: fp.Plan
    seconds: float
    launch: str = ""

    @property
    def torque_share(self) -> float | None:
        """Largest peak torque over its limit; None where the URDF gives none."""
        return largest_share(self.plan.peaks.motor_torque, self.plan.problem.motor_torque_limits)

    @property
    def out_of_plane(self) -> str:
        """By how much it lands beside the planned attitude in space, degrees."""
        turned = self.plan.out_of_plane
        return "" if turned is None else f"{np.degrees(np.linalg.norm(turned)):.3g}"

    def rate_share(self, end: End) -> str:
        """Least largest joint rate over its limit with which the frame is at rest at one end."""
        contact = {"takeoff": fp.takeoff, "landing": fp.landing}[end](self.plan.problem, self.plan.angular_momentum)
        if contact.found is None:
            return "flies"
        return "no limit" if contact.ratio is None else f"{contact.ratio:.2f}"

    def row(self) -> list[str]:
        """Cells of the table, under ``COLUMNS``."""
        robot, share = self.plan.robot, self.torque_share
        coupled = f" (+{len(robot.coupled)} coupled)" if robot.coupled else ""
        return [
            TITLES[self.name],
            f"{len(robot.joints)}{coupled}",
            f"{robot.mass:.3g}",
            f"{self.plan.duration:g}",
            "no limit" if share is None else f"{share:.2f}",
            self.rate_share("takeoff"),
            self.rate_share("landing"),
            self.launch,
            self.out_of_plane,
            f"{self.seconds:.1f}",
        ]

    def row_in_space(self) -> list[str]:
        """Cells of the table, under ``SPACE_COLUMNS``."""
        plan = self.plan
        rates = plan.at(np.linspace(0.0, plan.duration, 1000)).orientation_rate
        shares = (self.torque_share, largest_share(plan.peaks.velocity, plan.problem.velocity_limits))
        certificate = fp.certify(plan)
        return [
            SPACE_TITLES[self.name],
            str(len(plan.robot.joints)),
            f"{plan.robot.mass:.3g}",
            f"{plan.duration:g}",
            f"{np.linalg.norm(rates, axis=1).max():.3g}",
            *("not asked" if share is None else f"{share:.2f}" for share in shares),
            f"{certificate.attitude_bound:.0e}" if certificate.proved else "not proved",
            f"{fp.replay(plan).orientation_error:.0e}",
            f"{self.seconds:.1f}",
        ]


def largest_share(peaks: Array, limits: Array) -> float | None:
    """Largest peak over its limit; None where there is none."""
    shares = (peaks / limits)[np.isfinite(limits)]
    return float(shares.max()) if len(shares) else None


@dataclass(frozen=True)
class JumpEntry:
    """A jump, proved and checked, and the processor's seconds for it."""

    name: str
    jump: fp.Jump
    seconds: float

    @property
    def turn(self) -> float:
        """Of the base from start to goal, rad, in its plane."""
        return self.jump.problem.final.orientation - self.jump.problem.initial.orientation

    @property
    def title(self) -> str:
        """The robot's name, in space with what it does."""
        if self.jump.problem.robot.base == "free-flyer":
            return f"{title_of(self.name.partition('_')[0])}, {self.stunt}"
        return title_of(self.name)

    @property
    def stunt(self) -> str:
        """What it does, in a word; in space the name of its file tells."""
        robot = self.jump.problem.robot
        if robot.base == "free-flyer":
            return self.name.partition("_")[2].replace("_", " ")
        if not self.turn:
            return "none"
        return "back" if self.turn * robot.plane.turn > 0 else "forwards"

    def row(self) -> list[str]:
        """Cells of the table, under ``JUMP_COLUMNS``."""
        jump, figures = self.jump, self.jump.check.figures
        assert jump.flight is not None
        proved = jump.flight.certificate is not None and jump.flight.certificate.proved
        return [
            self.title.partition(",")[0],
            self.stunt,
            f"{jump.duration:.2f}",
            f"{jump.flight.duration:.2f}",
            *(f"{figures[name]:.2f}" if figures[name] else "no limit" for name in ("torque", "velocity", "friction")),
            "proved" if proved else "not proved",
            "checked" if jump.check.ok else "not within limits",
            f"{self.seconds:.1f}",
        ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "kind", nargs="?", choices=("all", "jumps", "jumps-in-space", "space", "flights"), default="all"
    )
    parser.add_argument("names", nargs="*")
    parser.add_argument("--no-picture", action="store_true")
    parser.add_argument("--launch", action="store_true")
    arguments = parser.parse_args()
    if arguments.kind in ("all", "jumps"):
        jumps = [jumped(JUMPS / f"{name}.toml") for name in arguments.names or names_in(JUMPS)]
        print(table(JUMP_COLUMNS, [entry.row() for entry in jumps]))
        if not arguments.no_picture:
            with styled():
                save(strips([jump for jump in jumps if jump.turn]), STRIPS)
    if arguments.kind in ("all", "jumps-in-space"):
        folder = JUMPS / "space"
        stunts = [jumped(folder / f"{name}.toml") for name in arguments.names or names_in(folder)]
        print(table(JUMP_COLUMNS, [entry.row() for entry in stunts]))
        if not arguments.no_picture:
            with styled():
                shown = [entry for entry in stunts if entry.name.startswith("go2") and entry.jump.step is None]
                save(strips(shown), SPACE_STRIPS)
    if arguments.kind in ("all", "space"):
        entries = [planned(SPACE / f"{name}.toml") for name in arguments.names or SPACE_TITLES]
        print(table(SPACE_COLUMNS, [entry.row_in_space() for entry in entries]))
        if not arguments.no_picture:
            with styled():
                save(rendered(picture(entries)), IN_SPACE)
    if arguments.kind in ("all", "flights"):
        entries = [planned(PROBLEMS / f"{name}.toml", arguments.launch) for name in arguments.names or TITLES]
        print(table(COLUMNS, [entry.row() for entry in entries]))
        if not arguments.no_picture:
            with styled():
                save(rendered(picture(entries)), PICTURE)


def title_of(name: str) -> str:
    """What a robot is called whose problem file has that name."""
    return {**TITLES, **NAMES}.get(name, name).partition(",")[0]


def names_in(folder: Path) -> list[str]:
    """Names of the problem files of a folder, in order."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def jumped(path: Path) -> JumpEntry:
    began = time.process_time()
    jump = fp.jump(path)
    if not jump.ok or jump.flight is None:
        raise SystemExit(f"{path.stem}: {jump.explanation}")
    jump = jump.with_certificate(fp.certify(jump.flight))
    return JumpEntry(path.stem, jump, time.process_time() - began)


def planned(path: Path, launching: bool = False) -> Entry:
    began, name = time.process_time(), path.stem
    plan = fp.plan(fp.load_problem(path))
    seconds = time.process_time() - began
    if not plan.ok:
        raise SystemExit(f"{name}: {plan.explanation}")
    return Entry(name, plan, seconds, launch_of(plan) if launching else "")


def launch_of(plan: fp.Plan) -> str:
    """The least share of torque and rate limits with which a stance reaches its takeoff."""
    if "takeoff" not in [contact.end for contact in plan.contacts]:
        return "flies"
    try:
        found = fp.launch(plan)
    except fp.InputError:
        return "does not stand"
    least = f" ({found.ratio:.2f})" if 1 < found.ratio < PROGRAM.largest_factor else ""
    return f"{found.ratio:.2f}" if found.ok else f"not found{least}"


def strips(entries: Sequence[JumpEntry]) -> Image.Image:
    """Moments of jumps, a strip for each."""
    drawn = [moments(entry.jump, flying=3, title=entry.title) for entry in entries]
    return sheet([[rendered(each, SHEET_DPI) for each in drawn]])


def table(titles: Sequence[str], cells: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    rows = [titles, ["---", *["---:"] * (len(titles) - 1)], *cells]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def picture(entries: Sequence[Entry]) -> Figure:
    """Flights in rows, each at its own scale, all of a row equally high."""
    shapes = []
    for entry in entries:
        low, high = picture_box(entry.plan, postures(entry.plan, times(entry.plan)))
        shapes.append((high - low).real / (high - low).imag)
    rows = [range(first, min(first + PER_ROW, len(entries))) for first in range(0, len(entries), PER_ROW)]
    heights = [(WIDTH - 0.3) / sum(shapes[index] for index in row) for row in rows]
    figure = new_figure(WIDTH, sum(heights) + 0.25 * len(rows))
    bands = figure.subfigures(len(rows), 1, height_ratios=heights, squeeze=False)[:, 0]
    for band, row in zip(bands, rows, strict=True):
        grid = band.add_gridspec(1, len(row), width_ratios=[shapes[index] for index in row], wspace=0.03)
        for column, index in enumerate(row):
            axes = band.add_subplot(grid[0, column])
            draw_scene(axes, entries[index].plan, times(entries[index].plan))
            axes.set_title((TITLES | SPACE_TITLES)[entries[index].name], fontsize=6.5)
    return figure


def times(plan: fp.Plan) -> Array:
    """Instants of the snapshots, so few that postures stand apart."""
    return np.linspace(0.0, plan.duration, SNAPSHOTS)


if __name__ == "__main__":
    main()
