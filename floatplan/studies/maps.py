"""Maps of a study: its rows put into cells, for the figure and for the page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError
from floatplan.plans.plans import SOLVED
from floatplan.studies.file import StudyFile, coloured
from floatplan.studies.rows import STATUSES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from floatplan.view.map import HeatMap

MOST_BINS = 160  # along an axis of a study that is not a grid
ROWS_IN_A_BIN = 2.5
LARGER_IS_BETTER = ("clearance",)
RANK = {"not_found": 0, "impossible": 1, "error": 2}  # which a cell without a plan shows: impossible only where all are


def edges_of(asked: StudyFile, path: str) -> Array:
    """Edges of a key's cells: around the values of a grid, even ones elsewhere."""
    axis = next(axis for axis in asked.samples.axes if axis.path == path)
    if asked.samples.kind != "grid":
        bins = int(np.clip(np.sqrt(len(asked) / ROWS_IN_A_BIN), 1, MOST_BINS))
        low, high = float(axis.values[0]), float(axis.values[-1])
        return np.linspace(low, high if high > low else low + 1, bins + 1)
    values = np.unique(axis.values)
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middles = (values[:-1] + values[1:]) / 2
    return np.concatenate(([2 * values[0] - middles[0]], middles, [2 * values[-1] - middles[-1]]))


def cells_of(edges: Array, values: Array) -> IntArray:
    """Cell (N,) of each value."""
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def drawn_map(asked: StudyFile, table: Any, x: str, y: str, z: str) -> HeatMap:
    """Return the map of column z over keys x and y: each cell shows its best row."""
    from floatplan.view.map import HeatMap, MapAxis

    for key in (x, y):
        if key not in asked.paths:
            raise InputError(f"{key!r} does not vary", element="map", advice=f"known: {', '.join(asked.paths)}")
    if x == y:
        raise InputError("both axes are the same key", element="map")
    known = [*asked.paths, *coloured(asked.base), "status"]
    if z not in known:
        raise InputError(f"{z!r} is no column of numbers", element="map", advice=f"known: {', '.join(known)}")
    edges = [edges_of(asked, key) for key in (x, y)]
    columns, rows = (cells_of(each, table[key].to_numpy()) for each, key in zip(edges, (x, y), strict=True))
    shape = (len(edges[1]) - 1, len(edges[0]) - 1)
    names, status = words(table, "status")
    status = np.array([STATUSES.index(name) for name in names])[status]
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
    others = [path for path in asked.paths if path not in (x, y)]
    title = f"best over {', '.join(others)}" if others else ""
    axes = [MapAxis(_label(key, units), each) for key, each in zip((x, y), edges, strict=True)]
    return HeatMap(axes[0], axes[1], colour, shown, _label(z, units), title)


def words(table: Any, column: str) -> tuple[list[str], IntArray]:
    """Words of a column of a table, in the order in which they appear, and which (N,) each row has."""
    encoded = table[column].combine_chunks().dictionary_encode()
    return encoded.dictionary.to_pylist(), encoded.indices.to_numpy()


def units_of(table: Any) -> dict[str, str]:
    """Unit of each column as it is shown; empty where it has none."""
    return {field.name: shown_unit((field.metadata or {}).get(b"unit", b"").decode()) for field in table.schema}


def shown_unit(unit: str) -> str:
    """A unit with its exponents raised; a sum of unlike quantities has none."""
    return "" if unit == "mixed" else unit.replace("^2", "²").replace("^3", "³")


def _label(key: str, units: dict[str, str]) -> str:
    unit = units.get(key, "")
    return f"{key} ({unit})" if unit else key


def draw(shown: HeatMap) -> Figure:
    """Draw a map as a figure."""
    from floatplan.view.map import heatmap

    return heatmap(shown)
