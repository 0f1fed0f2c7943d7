"""What a study shows: its rows put into the cells of a map, as a picture and as a page."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, IntArray
from floatplan.files import write_atomically
from floatplan.plans.plans import SOLVED
from floatplan.plans.presentation import raised
from floatplan.studies.file import LARGER_IS_BETTER, Axis, StudyFile, check_map, coloured, versions
from floatplan.studies.folder import words
from floatplan.studies.rows import STATUSES
from floatplan.view.map import HeatMap, PackedNumbers, colours, flight_data, heatmap, map_page
from floatplan.view.style import rendered, styled

DPI_OF_MAPS = 200  # [1/in]
MOST_PAGE_ROWS = 200_000  # of a page
MOST_BINS = 160  # along an axis of a study that is not a grid
ROWS_IN_A_BIN = 2.5
RANK = {"not_found": 0, "impossible": 1, "error": 2}  # which a cell without a plan shows: impossible only where all are


def _edges(study: StudyFile, axis: Axis) -> Array:
    """Edges of a key's cells: around the values of a grid, even ones elsewhere."""
    if study.samples.kind != "grid":
        bins = int(np.clip(np.sqrt(len(study) / ROWS_IN_A_BIN), 1, MOST_BINS))
        low, high = float(axis.values[0]), float(axis.values[-1])
        return np.linspace(low, high if high > low else low + 1, bins + 1)
    values = np.unique(axis.values)
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middles = (values[:-1] + values[1:]) / 2
    return np.concatenate(([2 * values[0] - middles[0]], middles, [2 * values[-1] - middles[-1]]))


def _statuses(table: Any) -> IntArray:
    """Place (N,) in :data:`STATUSES` of each row's status."""
    names, status = words(table, "status")
    return np.array([STATUSES.index(name) for name in names])[status]


def drawn_map(study: StudyFile, table: Any, x: str, y: str, z: str) -> HeatMap:
    """Return the map of column z over keys x and y: each cell shows its best row."""
    check_map((x, y, z), study.paths, [*coloured(study.base, study.plan), "status"], "map")
    axes = {axis.path: axis for axis in study.samples.axes}
    edges = {key: _edges(study, axes[key]) for key in (x, y)}
    columns, rows = (
        np.clip(np.searchsorted(each, table[key].to_numpy(), side="right") - 1, 0, len(each) - 2)
        for key, each in edges.items()
    )
    shape = (len(edges[y]) - 1, len(edges[x]) - 1)
    status = _statuses(table)
    values = np.zeros(len(table)) if z == "status" else table[z].to_numpy().astype(np.float64)
    solved = status < len(SOLVED)
    colour = np.full(shape, np.nan)
    shown = np.full(shape, -1, dtype=np.int64)
    rank = np.where(solved, 0, 1 + np.array([RANK.get(name, 0) for name in STATUSES])[status])
    sign = -1.0 if z in LARGER_IS_BETTER else 1.0
    order = np.lexsort((sign * values, rank))[::-1]  # the best last: it stays
    shown[rows[order], columns[order]] = status[order]
    colour[rows[order], columns[order]] = np.where(solved, values, np.nan)[order]
    units = units_of(table)
    others = [path for path in study.paths if path not in (x, y)]
    title = f"best over {', '.join(others)}" if others else ""
    across, up = ((_label(key, units), each) for key, each in edges.items())
    return HeatMap(across, up, colour, shown, _label(z, units), title)


def units_of(table: Any) -> dict[str, str]:
    """Unit of each column as it is shown, exponents raised; empty where it has none, as a sum of unlike quantities."""
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in table.schema}
    return {name: "" if unit == "mixed" else raised(unit) for name, unit in units.items()}


def _label(key: str, units: dict[str, str]) -> str:
    unit = units.get(key, "")
    return f"{key} ({unit})" if unit else key


def write_maps(study: StudyFile, table: Any, folder: Path) -> list[Path]:
    """Write the map that the study asks for, PNG and SVG, and the page."""
    assert study.map is not None, "maps are written where the study has one"
    with styled():
        figure = heatmap(drawn_map(study, table, *study.map))
        forms = {folder / f"map.{form}": rendered(figure, form, DPI_OF_MAPS) for form in ("png", "svg")}
    written = [write_atomically(path, content) for path, content in forms.items()]
    if len(study) <= MOST_PAGE_ROWS:
        numbers = PackedNumbers()
        data = page_data(study, table, numbers)
        written.append(write_atomically(folder / "map.html", map_page(f"{study.name}: map", data, numbers)))
    return written


def page_data(study: StudyFile, table: Any, numbers: PackedNumbers) -> dict[str, Any]:
    """Return all that the page shows; what it shows of each row goes into ``numbers``."""
    assert study.map is not None, "maps are written where the study has one"
    units = units_of(table)
    measured = [
        name for name in coloured(study.base, study.plan) if name == study.map[2] or table[name].null_count < len(table)
    ]
    explanations, explanation = words(table, "explanation")
    coefficients = _in_fractions(study, table)
    places = {name: numbers.add(table[name].to_numpy(), "<f4") for name in (*study.paths, *measured)}
    return {
        "name": study.name,
        "question": f"{study.base.name}, {study.base.robot.name}: {len(table)} rows",
        "version": versions()["floatplan"],
        "count": len(table),
        "map": study.map,
        "axes": [_axis(study, axis) for axis in study.samples.axes],
        "columns": {
            name: {"unit": units.get(name, ""), "label": _label(name, units), "values": place}
            for name, place in places.items()
        },
        "status": numbers.add(_statuses(table), "<u1"),
        "explanation": {"texts": explanations, "index": numbers.add(explanation, "<u4")},
        "coefficients": {"size": coefficients.shape[1], "values": numbers.add(coefficients, "<f4")},
        "colours": colours(),
        "flight": flight_data(study.base),
    }


def _axis(study: StudyFile, axis: Axis) -> dict[str, Any]:
    edges = _edges(study, axis)
    middles = np.unique(axis.values) if study.samples.kind == "grid" else (edges[:-1] + edges[1:]) / 2
    return {"key": axis.path, "factor": axis.number.factor, "edges": edges.tolist(), "values": middles.tolist()}


def _in_fractions(study: StudyFile, table: Any) -> npt.NDArray[np.float32]:
    """Coefficients (N, n (k+1)) of powers of s = t / T, NaN where a row has no motion."""
    sizes, joints = _unfolded(table["coefficients"].combine_chunks())
    there, n = sizes > 0, len(study.base.robot.joints)
    sizes, values = _unfolded(joints)
    sizes = sizes.reshape(-1, n)
    size = int(sizes.max(initial=0))
    shape = len(table), n, size
    found = values.to_numpy()
    if found.size < math.prod(shape):
        inside = np.zeros(shape, dtype=np.bool_)
        inside[there] = np.arange(size) < sizes[..., None]
        found = np.full(shape, np.nan)
        found[inside] = values.to_numpy()
    varied = "flight.duration" in study.paths
    duration = table["flight.duration"].to_numpy() if varied else np.full(len(table), study.base.flight.duration)
    powers = np.vander(duration, size, increasing=True)
    fractions = np.empty(shape, dtype="<f4")
    np.multiply(found.reshape(shape), powers[:, None], out=fractions, casting="same_kind")
    return fractions.reshape(len(table), n * size)


def _unfolded(lists: Any) -> tuple[IntArray, Any]:
    """Lengths of the lists in an array, none where there is no list, and what they hold, one after the other."""
    offsets = lists.offsets.to_numpy()
    return np.diff(offsets), lists.values[offsets[0] : offsets[-1]]
