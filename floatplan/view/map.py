"""Maps of a study: a number over two others, and where there is none, why; as a figure, and as a page.

The page works without a network, and carries all rows of its study and the robot that flies them.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_hex, to_rgba_array
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from floatplan.arrays import Array, IntArray
from floatplan.files import plain
from floatplan.problem.file import problem_to_dict
from floatplan.problem.problem import Problem
from floatplan.view.outlines import pairs
from floatplan.view.report.data import rounded, scene_data
from floatplan.view.report.report import page
from floatplan.view.style import ALARM, PALE, SEQUENCE, new_figure, styled

STYLES = ("uplot/uPlot.min.css", "report.css", "map.css")
PLOTTED = ("uplot/uPlot.iife.min.js", "theme.js", "motion.js", "stage.js", "player.js")
SCRIPTS = (*PLOTTED, "flight.js", "heatmap.js", "map.js")
COLOURS = 64  # [-] of the page's scale
WIDTH, HEIGHT = 4.4, 3.4  # [in]
LOGARITHMIC = 30.0  # times the least colour: where the largest is more, the scale is logarithmic
MANY_DECADES = 3000.0  # times the least colour: where the largest is more, powers of ten alone are told
STATUS_LOOKS = {  # colour and words
    "optimal": ("#0072B2", "optimal"),
    "feasible": ("#56B4E9", "feasible"),
    "not_found": ("#d9d9d9", "not found: none may exist, or none was hit upon"),
    "impossible": ("#555555", "impossible: proved that none exists"),
    "error": (ALARM, "error: the problem is wrong there"),
}
WITHOUT = ("not_found", "impossible", "error")  # a plan


@dataclass(frozen=True, eq=False)
class HeatMap:
    """What is drawn.

    Attributes
    ----------
    x, y : of each axis its label, and the edges (cells + 1,) of its cells
    colour : (Y, X), NaN where there is no plan or no value
    status : (Y, X), index into the keys of ``STATUS_LOOKS``; -1 where there is no row
    label : of the colour; "status" where that is what is drawn
    """

    x: tuple[str, Array]
    y: tuple[str, Array]
    colour: Array
    status: IntArray
    label: str
    title: str = ""


def heatmap(shown: HeatMap) -> Figure:
    """Draw a map."""
    with styled():
        figure = new_figure(WIDTH, HEIGHT)
        axes = figure.add_subplot()
        axes.grid(visible=False)
        of_status = shown.label == "status"
        present = [
            (index, *look)
            for index, (name, look) in enumerate(STATUS_LOOKS.items())
            if (of_status or name in WITHOUT) and (shown.status == index).any()
        ]
        cells = np.zeros((*shown.status.shape, 4), dtype=np.uint8)  # RGBA
        for index, colour, _ in present:
            cells[shown.status == index] = to_rgba_array(colour)[0] * 255
        finite = np.isfinite(shown.colour)
        if finite.any() and not of_status:
            low, high = float(shown.colour[finite].min()), float(shown.colour[finite].max())
            spreads = low > 0 and high > LOGARITHMIC * low
            norm = LogNorm(low, high) if spreads else Normalize(low, high if high > low else low + 1)
            scale = ScalarMappable(norm, SEQUENCE)
            cells[finite] = scale.to_rgba(shown.colour[finite], bytes=True)
            ticks = figure.colorbar(scale, ax=axes, label=shown.label).ax.yaxis
            if spreads:
                ticks.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < MANY_DECADES * low else (1.0,)))
                ticks.set_major_formatter(StrMethodFormatter("{x:g}"))
                ticks.set_minor_locator(NullLocator())
        # one image: it is drawn many times faster than as many rectangles
        image = axes.pcolorfast(shown.x[1], shown.y[1], cells)
        image.set(interpolation="none")
        axes.set(xlabel=shown.x[0], ylabel=shown.y[0])
        if shown.title:
            axes.set_title(shown.title, fontsize=8)
        patches = [Patch(color=colour, label=words) for _, colour, words in present]
        if (shown.status < 0).any():
            patches.append(Patch(facecolor="white", edgecolor=PALE, linewidth=0.5, label="no row"))
        if patches:
            figure.legend(handles=patches, loc="outside lower left", ncols=1)
        return figure


class PackedNumbers:
    """Arrays as the page reads them, one after the other in one block of bytes; what is given twice is in it once."""

    def __init__(self) -> None:
        self._places: dict[bytes, int] = {}
        self.block = bytearray()

    def add(self, values: npt.ArrayLike, kind: str) -> list[int]:
        """Append an array as numbers of a NumPy kind such as "<f4"; return where it begins and how many it has."""
        array = np.ascontiguousarray(values, dtype=kind)
        content = array.tobytes()
        if content not in self._places:
            self.block += bytes(-len(self.block) % array.itemsize)
            self._places[content] = len(self.block)
            self.block += content
        return [self._places[content], array.size]


def map_page(title: str, data: Mapping[str, Any], numbers: PackedNumbers) -> bytes:
    """Return the page, as HTML."""
    return page("map.html", title, STYLES, SCRIPTS, plain(data), numbers=base64.b64encode(numbers.block))


def flight_data(problem: Problem) -> dict[str, Any]:
    """Return what the page needs to fly any row: links and inertia, and the problem whose numbers vary."""
    scene, tree = scene_data(problem), problem.robot.tree
    inertia = {"coupling": rounded(pairs(tree.coupling)), "inertia": rounded(tree.inertia)}
    return {
        **scene,
        "robot": {**scene["robot"], **inertia},
        "ranges": rounded(problem.position_limits),
        "problem": problem_to_dict(problem),
    }


def colours() -> dict[str, Any]:
    """Colours of the scale and of the statuses, with the words for these."""
    scale: Array = matplotlib.colormaps[SEQUENCE](np.linspace(0, 1, COLOURS))[:, :3]
    return {
        "scale": [to_hex(colour) for colour in scale],
        "logarithmic": LOGARITHMIC,
        "statuses": [
            {"name": name, "colour": colour, "words": words} for name, (colour, words) in STATUS_LOOKS.items()
        ],
    }
