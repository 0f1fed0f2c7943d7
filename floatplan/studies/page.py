"""What a study shows: its map as a picture, and its rows as the page reads them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from floatplan.arrays import IntArray
from floatplan.files import write_atomically
from floatplan.studies.file import StudyFile, coloured, versions
from floatplan.studies.maps import draw, drawn_map, edges_of, units_of, words
from floatplan.studies.rows import STATUSES
from floatplan.view.map import PackedNumbers, colours, flight_data, map_page
from floatplan.view.style import rendered, styled

DPI_OF_MAPS = 200  # [1/in]
MOST_PAGE_ROWS = 200_000  # of a page


def write_maps(asked: StudyFile, table: Any, folder: Path) -> list[Path]:
    """Write the map that the study asks for, PNG and SVG, and the page."""
    assert asked.map is not None, "asked for"
    with styled():
        figure = draw(drawn_map(asked, table, *asked.map))
        forms = {folder / f"map.{form}": rendered(figure, form, DPI_OF_MAPS) for form in ("png", "svg")}
    written = [write_atomically(path, content) for path, content in forms.items()]
    if len(asked) <= MOST_PAGE_ROWS:
        written.append(write_page(asked, table, folder / "map.html"))
    return written


def write_page(asked: StudyFile, table: Any, path: Path) -> Path:
    """Write the page, whole or not at all."""
    numbers = PackedNumbers()
    data = page_data(asked, table, numbers)
    return write_atomically(path, map_page(f"{asked.name}: map", data, numbers))


def page_data(asked: StudyFile, table: Any, numbers: PackedNumbers) -> dict[str, Any]:
    """Return all that the page shows; what it shows of each row goes into ``numbers``."""
    units = units_of(table)
    names = [*asked.paths, *(name for name in coloured(asked.base) if _is_shown(asked, table, name))]
    explanations, explanation = words(table, "explanation")
    statuses, status = words(table, "status")
    coefficients = _in_fractions(asked, table)
    return {
        "name": asked.name,
        "question": f"{asked.base.name}, {asked.base.robot.name}: {len(table)} rows",
        "version": versions()["floatplan"],
        "count": len(table),
        "map": asked.map,
        "axes": [_axis(asked, path) for path in asked.paths],
        "columns": {
            name: {"unit": units.get(name, ""), "values": numbers.add(table[name].to_numpy(), "<f4")} for name in names
        },
        "status": numbers.add(np.array([STATUSES.index(name) for name in statuses])[status], "<u1"),
        "explanation": {"texts": explanations, "index": numbers.add(explanation, "<u4")},
        "coefficients": {"size": coefficients.shape[1], "values": numbers.add(coefficients, "<f4")},
        "colours": colours(),
        "flight": flight_data(asked.base),
    }


def _is_shown(asked: StudyFile, table: Any, name: str) -> bool:
    """Whether a column has anything to show, or is asked for."""
    assert asked.map is not None, "asked for"
    return name == asked.map[2] or table[name].null_count < len(table)


def _axis(asked: StudyFile, path: str) -> dict[str, Any]:
    edges = edges_of(asked, path)
    values = np.unique(next(axis.values for axis in asked.samples.axes if axis.path == path))
    middles = values if asked.samples.kind == "grid" else (edges[:-1] + edges[1:]) / 2
    return {"key": path, "factor": asked.factors[path], "edges": edges.tolist(), "values": middles.tolist()}


def _in_fractions(asked: StudyFile, table: Any) -> npt.NDArray[np.float32]:
    """Coefficients (N, n (k+1)) of powers of s = t / T, NaN where a row has no motion."""
    column = table["coefficients"].combine_chunks()
    sizes, joints = _unfolded(column)
    there = sizes > 0
    n = len(asked.base.robot.joints)
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
    varied = "flight.duration" in asked.paths
    duration = table["flight.duration"].to_numpy() if varied else np.full(len(table), asked.base.flight.duration)
    powers = np.vander(duration, size, increasing=True)
    fractions = np.empty(shape, dtype="<f4")
    np.multiply(found.reshape(shape), powers[:, None], out=fractions, casting="same_kind")
    return fractions.reshape(len(table), n * size)


def _unfolded(lists: Any) -> tuple[IntArray, Any]:
    """Lengths of the lists in an array, none where there is no list, and what they hold, one after the other."""
    offsets = lists.offsets.to_numpy()
    return np.diff(offsets), lists.values[offsets[0] : offsets[-1]]
