"""Local minima of rows that are watched over a whole flight, compiled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.filled import Filled
from floatplan.kernel.watch import Watch
from floatplan.motion.dynamics import BaseMotion
from floatplan.motion.planar.flight import PlanarBaseMotion
from floatplan.motion.sine_polynomial import SinePolynomials, basis


@dataclass(frozen=True, eq=False)
class Look:
    """Where to look first: a ``grid`` (K,) of [0, 1], and between which instants each row (rows,) applies."""

    grid: Array
    low: Array
    high: Array


def minima(
    watch: Watch, flown: BaseMotion, polynomials: SinePolynomials, look: Look, near: float, span: float
) -> tuple[IntArray, Array, Array, int]:
    """Local minima below ``near`` over a flight, narrowed down from a look by ``span`` to both sides.

    Returned are row, s and value (L,), and at how many instants it looked closer. The flight, on any grid, is of a
    motion of the class ``polynomials``.
    """
    assert isinstance(flown, PlanarBaseMotion), "what is watched is in a plane"
    series = basis(polynomials.form).series @ flown.joints.coefficients
    kernel, most = watch.kernel, len(look.grid) * watch.rows
    course = Filled(
        "Course",
        terms=series.shape[1],
        turned_terms=len(flown.turned),
        duration=watch.flight.duration,
        momentum=flown.angular_momentum[0, 0],
        **dict(zip(("p", "p_rate", "p_curvature"), series, strict=True)),
        turned=flown.turned,
        centre=polynomials.centre,
        amplitude=polynomials.amplitude,
    )
    row, s, least = np.empty(most, dtype=np.int64), np.empty(most), np.empty(most)
    found = Filled(
        "Minima",
        instants=len(look.grid),
        near=near,
        span=span,
        grid=look.grid,
        low=look.low,
        high=look.high,
        row=row,
        s=s,
        least=least,
    )
    if kernel.minima(watch.reference, course.structure, found.structure, kernel.instructions):
        raise MemoryError("no memory to look between the nodes")
    kept = slice(0, found.structure.found)
    return row[kept], s[kept], least[kept], found.structure.looked
