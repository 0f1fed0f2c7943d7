"""The page of a map: works without a network, and carries all rows of its study and the robot that flies them."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.colors import to_hex

from floatplan.arrays import Array
from floatplan.files import plain
from floatplan.motion.planar.momentum import centroidal_coupling
from floatplan.plans.plan import Plan
from floatplan.problem.file import problem_to_dict
from floatplan.view.figures.heatmap import STATUS_COLOURS, STATUS_NAMES
from floatplan.view.report.data import robot_data, rounded
from floatplan.view.report.report import asset, escaped_json, filled, policy
from floatplan.view.style import SEQUENCE

SHARED_SCRIPTS = ("theme.js", "motion.js", "stage.js", "player.js")
SCRIPTS = ("flight.js", "heatmap.js", "page.js")
COLOURS = 64


class PackedNumbers:
    """Arrays as the page reads them, one after the other in one block of bytes; what is given twice is in it once."""

    def __init__(self) -> None:
        self._places: dict[bytes, int] = {}
        self._size = 0

    def add(self, values: npt.ArrayLike, kind: str) -> list[int]:
        """Append an array as numbers of a NumPy kind such as "<f4"; return where it begins and how many it has."""
        array = np.ascontiguousarray(values, dtype=kind)
        content = array.tobytes()
        if content not in self._places:
            self._size += -self._size % array.itemsize
            self._places[content] = self._size
            self._size += len(content)
        return [self._places[content], array.size]

    def in_base64(self) -> bytes:
        """All of them."""
        block = bytearray(self._size)
        for content, first in self._places.items():
            block[first : first + len(content)] = content
        return base64.b64encode(block)


def map_page(title: str, data: Mapping[str, Any], numbers: PackedNumbers) -> bytes:
    """Return the page, as HTML."""
    scripts = [*map(asset, SHARED_SCRIPTS), *map(_own, SCRIPTS)]
    parts = {
        "title": html.escape(title),
        "policy": policy(scripts),
        "style": f"{asset('report.css')}\n{_own('map.css')}",
        "data": escaped_json(plain(data)),
        "scripts": "\n".join(f"<script>{script}</script>" for script in scripts),
    }
    before, after = (filled(part, parts).encode() for part in _own("map.html").split("{{numbers}}"))
    return b"".join((before, numbers.in_base64(), after))


def flight_data(plan: Plan) -> dict[str, Any]:
    """What the page needs to fly any row: the robot's links and inertia, and the problem whose numbers vary."""
    tree, problem = plan.robot.tree, plan.problem
    coupling = centroidal_coupling(tree)
    return {
        "robot": {
            **robot_data(plan),
            "coupling": [[[entry.real, entry.imag] for entry in row] for row in coupling.tolist()],
            "inertia": rounded(tree.inertia),
        },
        "frames": {
            role: {"name": end.frame, "weights": _weights(plan, end.frame)}
            for role, end in (("takeoff", problem.takeoff), ("landing", problem.landing))
        },
        "ranges": rounded(problem.position_limits),
        "problem": problem_to_dict(problem),
    }


def _weights(plan: Plan, name: str) -> list[list[float]]:
    frame = plan.robot.frames[name]
    row = plan.robot.tree.point_weights(np.array([frame.body]), np.array([frame.local]))[0]
    return [[weight.real, weight.imag] for weight in row.tolist()]


def colours() -> dict[str, Any]:
    """Colours of the scale and of the statuses, with the words for these."""
    scale: Array = matplotlib.colormaps[SEQUENCE](np.linspace(0, 1, COLOURS))[:, :3]
    return {
        "scale": [to_hex(colour) for colour in scale],
        "statuses": [
            {"name": name, "colour": colour, "words": STATUS_NAMES[name]} for name, colour in STATUS_COLOURS.items()
        ],
    }


def _own(name: str) -> str:
    return files("floatplan.view.map").joinpath("assets", name).read_text(encoding="utf-8")
