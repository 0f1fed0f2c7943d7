"""Local minima of rows that are watched over a whole flight, compiled."""

from __future__ import annotations

from ctypes import Structure, byref, c_double, c_int64, c_void_p
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.library import address
from floatplan.kernel.watch import Watch
from floatplan.kernel.watched import Instants
from floatplan.motion.dynamics import Flown
from floatplan.motion.planar.flight import PlanarFlown
from floatplan.motion.sine_polynomial import SinePolynomials, basis


class CourseStructure(Structure):
    """Of ``watch_kernel.hpp``."""

    _fields_ = (
        ("terms", c_int64),
        ("turned_terms", c_int64),
        ("duration", c_double),
        *(
            (name, c_void_p)
            for name in (
                *("p", "p_rate", "p_curvature", "turned", "centre", "amplitude"),
                *("positions", "velocities", "accelerations", "cosines", "times", "attitude"),
            )
        ),
    )


class MinimaStructure(Structure):
    """Of ``watch_kernel.hpp``."""

    _fields_ = (
        ("near", c_double),
        ("span", c_double),
        *((name, c_void_p) for name in ("grid", "low", "high", "values", "single")),
        ("found", c_int64),
        *((name, c_void_p) for name in ("row", "s", "least")),
    )


@dataclass(frozen=True, eq=False)
class Look:
    """Where to look first: a ``grid`` (K,) of [0, 1], and between which instants each row (rows,) applies."""

    grid: Array
    low: Array
    high: Array


def minima(
    watch: Watch, flown: Flown, polynomials: SinePolynomials, look: Look, near: float, span: float
) -> tuple[IntArray, Array, Array]:
    """Local minima below ``near`` over a flight, narrowed down from a look by ``span`` to both sides.

    Returned are row, s and value (L,). The flight is of a motion of the class ``polynomials``, on any grid.
    """
    assert isinstance(flown, PlanarFlown), "what is watched is in a plane"
    series = basis(polynomials.form).series @ flown.joints.coefficients
    turned = flown.turned
    instants = _instants(watch, look)
    structure, room = instants.fresh()
    structure.momentum = flown.angular_momentum[0, 0]
    count, n = len(look.grid), watch.joints
    arrays = np.empty(4 * count * n + 2 * count)
    begin = address(arrays)
    step = 8 * count * n
    places = {name: begin + index * step for index, name in enumerate(("positions", "velocities", "accelerations"))}
    places["times"] = begin + 4 * step
    places["attitude"] = places["times"] + 8 * count
    for name, place in places.items():
        setattr(structure, name, place)
    terms = series.shape[1]
    p = address(series)
    followed = CourseStructure(
        terms=terms,
        turned_terms=len(turned),
        duration=watch.flight.duration,
        p=p,
        p_rate=p + 8 * terms * n,
        p_curvature=p + 16 * terms * n,
        turned=address(turned),
        centre=address(polynomials.centre),
        amplitude=address(polynomials.amplitude),
        cosines=begin + 3 * step,
        **places,
    )
    values = np.empty((3, count * watch.rows))
    rows = np.empty(count * watch.rows + watch.rows, dtype=np.int64)
    found = MinimaStructure(
        near=near,
        span=span,
        grid=address(look.grid),
        low=address(look.low),
        high=address(look.high),
        values=address(values[0]),
        single=address(rows),
        row=address(rows) + 8 * watch.rows,
        s=address(values[1]),
        least=address(values[2]),
    )
    kernel = watch.kernel
    kernel.minima(watch.reference, byref(structure), byref(followed), byref(found), kernel.instructions)
    kept = slice(0, found.found)
    del room  # until here
    return rows[watch.rows :][kept], values[1][kept], values[2][kept]


@lru_cache(maxsize=16)
def _instants(watch: Watch, look: Look) -> Instants:
    return Instants.everywhere(watch, look.grid)
