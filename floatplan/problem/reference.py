"""Recorded motions of joints that flights are planned near to: read from a table, and between its instants."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.files import read_text
from floatplan.problem.parts import ClipReference
from floatplan.robot.robot import Robot

REFERENCE_NODES = 32  # [-] of the quadrature of differences from a recorded motion: of degree 15 it is exact


def reference_at(positions: Array, s: Array, order: int = 0) -> Array:
    """Positions (N, n), rad, of a recorded motion (K, n) at instants (N,) of [0, 1], or a derivative by s of an order.

    It is a cubic spline between its own instants, which are evenly apart; of two a line.
    """
    from scipy.interpolate import make_interp_spline  # here, since most problems do without

    own = np.linspace(0.0, 1.0, len(positions))
    spline = make_interp_spline(own, positions, k=3 if len(positions) > 3 else 1)
    return np.asarray(spline(s, order))


def distance_from(reference: Array, s: Array, weights: Array, positions: Array) -> float:
    """Root mean square, rad, over time and all joints, by which positions (N, n) at nodes are off a recorded motion.

    ``s`` and ``weights`` (N,) are those of a quadrature on [0, 1]; ``reference`` (K, n) is at instants evenly apart.
    """
    squares = ((positions - reference_at(reference, s)) ** 2).mean(axis=1)
    return float(np.sqrt(weights @ squares))


def read_reference(clip: ClipReference, folder: Path, robot: Robot) -> ClipReference:
    """Return the columns of a table that a problem names, as positions.

    Raises
    ------
    InputError
        The file cannot be read, has no such column, or does not reach from ``from`` to ``to``.
    """
    assert clip.file is not None, "the problem names a file"
    path = folder / clip.file
    lines = list(csv.reader(io.StringIO(read_text(path, 50_000_000, "a table of a motion"))))
    names = [name.strip() for name in lines[0]] if lines else []
    required = ["time", *(f"{joint}_position" for joint in robot.joints)]
    missing = [name for name in required if name not in names]
    if missing:
        raise InputError(
            f"has no column {missing[0]!r}", source=path, advice="give the table of a motion of this robot"
        )
    columns = list(map(names.index, required))
    rows = []
    try:
        for line in filter(None, lines[1:]):
            cells = [float(line[column]) for column in columns]
            rows.append(cells)
        values = np.array(rows)
    except (ValueError, IndexError):
        raise InputError("has rows that are not numbers", source=path) from None
    times = values[:, 0] if values.size else np.empty(0)
    if len(times) < 3 or not np.isfinite(values).all() or (np.diff(times) <= 0).any():
        raise InputError("has no three rows of finite numbers whose times increase", source=path)
    begin = float(times[0]) if clip.from_ is None else clip.from_
    end = float(times[-1]) if clip.to is None else clip.to
    if not times[0] - 1e-9 <= begin < end <= times[-1] + 1e-9:
        reason = f"is from {begin:g} to {end:g} s, the file from {times[0]:g} to {times[-1]:g} s"
        raise InputError(reason, element="motion.clip")
    from scipy.interpolate import CubicSpline  # here, since most problems do without

    at = np.linspace(begin, end, 101)  # 101 instants tell the flight's polynomials apart
    positions = CubicSpline(times, values[:, 1:])(np.clip(at, times[0], times[-1]))
    return clip.changed(positions=tuple(map(tuple, positions.tolist())))
