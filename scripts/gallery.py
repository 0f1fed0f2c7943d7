"""Plans every problem in problems/gallery/, prints the table of docs/gallery.md, and draws docs/images/gallery.png.

Run it from anywhere. With names, only these problems; with ``--no-picture``, only the table.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from make_images import draw_scene, rendered, save
from matplotlib.figure import Figure

import floatplan as fp
from floatplan.arrays import Array
from floatplan.motion.planar.contact_rates import End
from floatplan.view.outlines import picture_box, postures
from floatplan.view.style import new_figure, styled

ROOT = Path(__file__).resolve().parents[1]
PROBLEMS = ROOT / "problems" / "gallery"
PICTURE = ROOT / "docs" / "images" / "gallery.png"
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
COLUMNS = (
    "robot",
    "joints planned",
    "kg",
    "duration, s",
    "torque / limit",
    "takeoff / limit",
    "landing / limit",
    "leak",
    "planned in, s",
)
WIDTH = 7.6  # inches
PER_ROW = 5
SNAPSHOTS = 5


@dataclass(frozen=True)
class Entry:
    """A planned problem and the clock's seconds for it."""

    name: str
    plan: fp.Plan
    seconds: float

    @property
    def torque_share(self) -> float | None:
        """Largest peak torque over its limit; None where the URDF gives none."""
        limits = self.plan.problem.motor_torque_limits
        shares = (self.plan.peaks.motor_torque / limits)[np.isfinite(limits)]
        return float(shares.max()) if len(shares) else None

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
            f"{self.plan.out_of_plane_leak:.1g}",
            f"{self.seconds:.1f}",
        ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=list(TITLES))
    parser.add_argument("--no-picture", action="store_true")
    arguments = parser.parse_args()
    entries = [planned(name) for name in arguments.names]
    print(table(entries))
    if not arguments.no_picture:
        with styled():
            save(rendered(picture(entries)), PICTURE)


def planned(name: str) -> Entry:
    began = time.perf_counter()
    plan = fp.plan(fp.load_problem(PROBLEMS / f"{name}.toml"))
    seconds = time.perf_counter() - began
    if not plan.ok:
        raise SystemExit(f"{name}: {plan.explanation}")
    return Entry(name, plan, seconds)


def table(entries: Sequence[Entry]) -> str:
    """The table in Markdown."""
    rows = [list(COLUMNS), ["---", *["---:"] * (len(COLUMNS) - 1)], *(entry.row() for entry in entries)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


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
            axes.set_title(TITLES[entries[index].name], fontsize=6.5)
    return figure


def times(plan: fp.Plan) -> Array:
    """Instants of the snapshots, so few that postures stand apart."""
    return np.linspace(0.0, plan.duration, SNAPSHOTS)


if __name__ == "__main__":
    main()
