"""Maps of a study: a number over two others, and the reason where there is none; as a figure, and as a page.

Rows are put into the cells of a map, each of which shows its best one. The page works without a network, and carries
all rows of its study and the robot that flies them.
"""

import base64
import math
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
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
from floatplan.files import json_value, write_atomically
from floatplan.plans.plans import SOLVED
from floatplan.plans.presentation import raised
from floatplan.problem.file import problem_to_dict
from floatplan.problem.problem import Problem
from floatplan.studies.file import LARGER_IS_BETTER, Axis, StudyFile, check_map, coloured, versions
from floatplan.studies.folder import words
from floatplan.studies.rows import STATUSES
from floatplan.view.outlines import pairs
from floatplan.view.report.data import rounded, scene_data
from floatplan.view.report.report import page
from floatplan.view.style import PALETTE, new_figure, rendered, styled

LOGARITHMIC = 30.0  # [-] times the least colour: where the largest is more, the scale is logarithmic
STATUS_LOOKS = {  # colour and words
    "optimal": ("#0072B2", "optimal"),
    "feasible": ("#56B4E9", "feasible"),
    "not_found": ("#d9d9d9", "not found: none may exist, or none was hit upon"),
    "impossible": ("#555555", "impossible: proved that none exists"),
    "error": (PALETTE.alarm, "error: the problem is wrong there"),
}


@dataclass(frozen=True, eq=False)
class HeatMap:
    """The cells of a map.

    Attributes
    ----------
    x, y : of each axis its label, and the edges (cells + 1,) of its cells
    colour : (Y, X), NaN where there is no plan or no value
    status : (Y, X), index into the keys of ``STATUS_LOOKS``; -1 where there is no row
    label : of the colour; "status" where the map shows that
    values : (X,), (Y,) of a grid's cells; None on axes that are not of a grid
    """

    x: tuple[str, Array]
    y: tuple[str, Array]
    colour: Array
    status: IntArray
    label: str
    title: str = ""
    values: tuple[Array | None, Array | None] = (None, None)


def heatmap(shown: HeatMap) -> Figure:
    """Draw a map."""
    with styled():
        figure = new_figure(4.4, 3.4)  # [in]
        axes = figure.add_subplot()
        axes.grid(visible=False)
        of_status = shown.label == "status"
        present = []
        for index, (colour, description) in enumerate(STATUS_LOOKS.values()):
            if (of_status or index >= len(SOLVED)) and (shown.status == index).any():
                present.append((index, colour, description))
        cells = np.zeros((*shown.status.shape, 4), dtype=np.uint8)  # RGBA
        for index, colour, _ in present:
            cells[shown.status == index] = to_rgba_array(colour)[0] * 255
        finite = np.isfinite(shown.colour)
        if finite.any() and not of_status:
            low = float(shown.colour[finite].min())
            high = float(shown.colour[finite].max())
            spreads = low > 0 and high > LOGARITHMIC * low
            norm = LogNorm(low, high) if spreads else Normalize(low, high if high > low else low + 1)
            scale = ScalarMappable(norm, PALETTE.sequence)
            cells[finite] = scale.to_rgba(shown.colour[finite], bytes=True)
            ticks = figure.colorbar(scale, ax=axes, label=shown.label).ax.yaxis
            if spreads:
                # of many decades only powers of ten have a number
                subs = (1.0, 2.0, 5.0) if high < 3000.0 * low else (1.0,)
                ticks.set_major_locator(LogLocator(subs=subs))
                ticks.set_major_formatter(StrMethodFormatter("{x:g}"))
                ticks.set_minor_locator(NullLocator())
        # one image: it is painted many times faster than as many rectangles
        image = axes.pcolorfast(shown.x[1], shown.y[1], cells)
        image.set(interpolation="none")
        axes.set(xlabel=shown.x[0], ylabel=shown.y[0])
        for axis, values in zip((axes.xaxis, axes.yaxis), shown.values, strict=True):
            if values is not None and len(values) <= 8:  # so few that each can be written next to its cells
                axis.set_ticks(values, list(map("{:.4g}".format, values)))
        if shown.title:
            axes.set_title(fill(shown.title, 70), fontsize=8)
        patches = [Patch(color=colour, label=description) for _, colour, description in present]
        if (shown.status < 0).any():
            patches.append(Patch(facecolor="white", edgecolor=PALETTE.pale, linewidth=0.5, label="no row"))
        if patches:
            figure.legend(handles=patches, loc="outside lower left", ncols=1)
        return figure


def _grid_values(study: StudyFile, axis: Axis) -> Array | None:
    """Return the values of a grid's axis, ascending; None where samples are not on a grid."""
    return np.unique(axis.values) if study.samples.kind == "grid" else None


def _edges(study: StudyFile, axis: Axis) -> Array:
    """Edges of a key's cells: around the values of a grid, even ones elsewhere."""
    values = _grid_values(study, axis)
    if values is None:
        bins = int(np.clip(np.sqrt(len(study) / 2.5), 1, 160))  # 2.5 rows in a cell, on average
        low = float(axis.values[0])
        high = float(axis.values[-1])
        return np.linspace(low, high if high > low else low + 1, bins + 1)
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middles = (values[:-1] + values[1:]) / 2
    return np.concatenate(([2 * values[0] - middles[0]], middles, [2 * values[-1] - middles[-1]]))


def _statuses(table: Any) -> IntArray:
    """Index (N,) into :data:`STATUSES` of each row's status."""
    names, status = words(table, "status")
    return np.array(list(map(STATUSES.index, names)))[status]


def study_map(study: StudyFile, table: Any, x: str, y: str, z: str) -> HeatMap:
    """Return the map of column z over keys x and y: each cell shows its best row."""
    check_map((x, y, z), study.paths, [*coloured(study.base, study.plan), "status"], "map")
    axes = {axis.path: axis for axis in study.samples.axes}
    edges_x = _edges(study, axes[x])
    edges_y = _edges(study, axes[y])
    columns = _cells(edges_x, table[x].to_numpy())
    rows = _cells(edges_y, table[y].to_numpy())
    shape = (len(edges_y) - 1, len(edges_x) - 1)
    status = _statuses(table)
    values = np.zeros(len(table)) if z == "status" else table[z].to_numpy().astype(np.float64)
    solved = status < len(SOLVED)
    colour = np.full(shape, np.nan)
    shown = np.full(shape, -1, dtype=np.int64)
    rank = np.where(solved, 0, status)  # of a cell without a plan: impossible only where all are
    sign = -1.0 if z in LARGER_IS_BETTER else 1.0
    order = np.lexsort((sign * values, rank))[::-1]  # the best last: it stays
    shown[rows[order], columns[order]] = status[order]
    colour[rows[order], columns[order]] = np.where(solved, values, np.nan)[order]
    units = units_of(table)
    others = [path for path in study.paths if path not in (x, y)]
    title = f"best over {', '.join(others)}" if others else ""
    across = (_label(x, units), edges_x)
    up = (_label(y, units), edges_y)
    of_cells = (_grid_values(study, axes[x]), _grid_values(study, axes[y]))
    return HeatMap(across, up, colour, shown, _label(z, units), title, of_cells)


def _cells(edges: Array, values: Array) -> IntArray:
    """The cell (N,) of each value between edges."""
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def units_of(table: Any) -> dict[str, str]:
    """Unit of each column for readers, exponents raised; empty where it has none, as a sum of different quantities."""
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in table.schema}
    for name, unit in units.items():
        units[name] = "" if unit == "mixed" else raised(unit)
    return units


def _label(key: str, units: dict[str, str]) -> str:
    unit = units.get(key, "")
    return f"{key} ({unit})" if unit else key


class PackedNumbers:
    """Arrays as the page reads them, one after the other in one block of bytes; equal ones are in it once."""

    def __init__(self) -> None:
        self._offsets: dict[bytes, int] = {}
        self.block = bytearray()

    def add(self, values: npt.ArrayLike, kind: str) -> list[int]:
        """Append an array as numbers of a NumPy kind such as "<f4"; return its offset and how many it has."""
        array = np.ascontiguousarray(values, dtype=kind)
        content = array.tobytes()
        if content not in self._offsets:
            self.block += bytes(-len(self.block) % array.itemsize)
            self._offsets[content] = len(self.block)
            self.block += content
        return [self._offsets[content], array.size]


def write_maps(study: StudyFile, table: Any, folder: Path) -> list[Path]:
    """Write the map of the study, PNG and SVG, and its page."""
    assert study.map is not None, "maps are written where the study has one"
    with styled():
        figure = heatmap(study_map(study, table, *study.map))
        forms = {folder / f"map.{form}": rendered(figure, form, 200) for form in ("png", "svg")}  # at 200 dots an inch
    written = [write_atomically(path, content) for path, content in forms.items()]
    if len(study) <= 200_000:  # a page of more rows would be too large for a browser
        numbers = PackedNumbers()
        data = json_value(page_data(study, table, numbers))
        styles = ("uplot/uPlot.min.css", "report.css", "map.css")
        scripts = ["uplot/uPlot.iife.min.js", "theme.js", "motion.js", "camera.js", "stage.js", "player.js"]
        scripts += ["flight.js", "heatmap.js", "map.js"]
        content = page("map.html", f"{study.name}: map", styles, scripts, data, numbers=base64.b64encode(numbers.block))
        written.append(write_atomically(folder / "map.html", content))
    return written


def page_data(study: StudyFile, table: Any, numbers: PackedNumbers) -> dict[str, Any]:
    """Return all that the page shows; the numbers of rows go into ``numbers``."""
    assert study.map is not None, "maps are written where the study has one"
    units = units_of(table)
    measured = coloured(study.base, study.plan)
    shown = [name for name in measured if name == study.map[2] or table[name].null_count < len(table)]
    explanations, explanation = words(table, "explanation")
    coefficients = _in_fractions(study, table)
    columns = {}
    for name in dict.fromkeys([*study.paths, *shown]):
        offset = numbers.add(table[name].to_numpy(), "<f4")
        columns[name] = {"unit": units.get(name, ""), "label": _label(name, units), "values": offset}
    scale = matplotlib.colormaps[PALETTE.sequence](np.linspace(0, 1, 64))
    statuses = []
    for name, (colour, description) in STATUS_LOOKS.items():
        statuses.append({"name": name, "colour": colour, "words": description})
    return {
        "name": study.name,
        "question": f"{study.base.name}, {study.base.robot.name}: {len(table)} rows",
        "version": versions()["floatplan"],
        "count": len(table),
        "map": study.map,
        "axes": [_axis(study, axis) for axis in study.samples.axes],
        "columns": columns,
        "status": numbers.add(_statuses(table), "<u1"),
        "explanation": {"texts": explanations, "index": numbers.add(explanation, "<u4")},
        "coefficients": {"size": coefficients.shape[1], "values": numbers.add(coefficients, "<f4")},
        "colours": {"scale": list(map(to_hex, scale)), "logarithmic": LOGARITHMIC, "statuses": statuses},
        "flight": None if study.base.robot.base == "free-flyer" else _flight_data(study.base),
    }


def _flight_data(problem: Problem) -> dict[str, Any]:
    """The data by which the page flies any row: links and inertia, and the problem whose numbers vary."""
    data = scene_data(problem)
    tree = problem.robot.tree
    data["robot"] |= {"coupling": rounded(pairs(tree.coupling)), "inertia": rounded(tree.inertia)}
    return data | {"ranges": rounded(problem.position_limits), "problem": problem_to_dict(problem)}


def _axis(study: StudyFile, axis: Axis) -> dict[str, Any]:
    edges = _edges(study, axis)
    middles = np.unique(axis.values) if study.samples.kind == "grid" else (edges[:-1] + edges[1:]) / 2
    return {"key": axis.path, "factor": axis.number.factor, "edges": edges.tolist(), "values": middles.tolist()}


def _in_fractions(study: StudyFile, table: Any) -> npt.NDArray[np.float32]:
    """Coefficients (N, n (k+1)) of powers of s = t / T, NaN where a row has no motion."""
    sizes, joints = _unfolded(table["coefficients"].combine_chunks())
    has_motion = sizes > 0
    n = len(study.base.robot.joints)
    sizes, values = _unfolded(joints)
    sizes = sizes.reshape(-1, n)
    size = int(sizes.max(initial=0))
    shape = len(table), n, size
    powers_of_seconds = values.to_numpy()
    if powers_of_seconds.size < math.prod(shape):
        inside = np.zeros(shape, dtype=np.bool_)
        inside[has_motion] = np.arange(size) < sizes[..., None]
        powers_of_seconds = np.full(shape, np.nan)
        powers_of_seconds[inside] = values.to_numpy()
    varied = "flight.duration" in study.paths
    duration = table["flight.duration"].to_numpy() if varied else np.full(len(table), study.base.flight.duration)
    powers = np.vander(duration, size, increasing=True)
    fractions = np.empty(shape, dtype="<f4")
    np.multiply(powers_of_seconds.reshape(shape), powers[:, None], out=fractions, casting="same_kind")
    return fractions.reshape(len(table), n * size)


def _unfolded(lists: Any) -> tuple[IntArray, Any]:
    """Lengths of the lists in an array, none where there is no list, and their items, one after the other."""
    offsets = lists.offsets.to_numpy()
    return np.diff(offsets), lists.values[offsets[0] : offsets[-1]]
