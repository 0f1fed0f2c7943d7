"""The kernel's structures with the arrays that they point to."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np

from floatplan.kernel import library
from floatplan.kernel.bodies import Bodies
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.sine_polynomial import Form, basis


class Filled:
    """A structure with what it points to."""

    def __init__(self, kind: type[ctypes.Structure], **values: Any) -> None:
        self._kept: list[Any] = []
        self.structure: Any = kind()
        integers = _integers(kind)
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                array = np.ascontiguousarray(value, dtype=np.int64 if name in integers else np.float64)
                self._kept.append(array)
                value = library.address(array)
            setattr(self.structure, name, value)

    def point_to(self, **arrays: np.ndarray[Any, Any]) -> None:
        """Point to other arrays, as they are: contiguous, of the right numbers."""
        self._pointed = arrays
        for name, array in arrays.items():
            setattr(self.structure, name, library.address(array))


@cache
def _integers(kind: type[ctypes.Structure]) -> frozenset[str]:
    """Names of the arrays of integers."""
    return frozenset(field[0] for field in kind._fields_ if field[1] is library.Integers)


def filled_robot(bodies: Bodies, free: Sequence[int]) -> Filled:
    """Return a robot whose joints have so many free polynomials."""
    return Filled(
        library.Robot,
        joints=len(free),
        bodies=len(bodies.real),
        width=max(free),
        free=np.array(free, dtype=np.int64),
        real=bodies.real,
        imaginary=bodies.imaginary,
        is_real=bodies.is_real,
        from_=bodies.from_,
        first=bodies.first,
        joint=bodies.joint,
        ratio=bodies.ratio,
    )


@lru_cache(maxsize=64)
def filled_grid(width: int, count: int) -> Filled:
    """Return the basis at so many nodes."""
    quadrature = gauss_legendre(count)
    value, slope, _ = basis(Form(width)).values(quadrature.nodes)
    return Filled(
        library.Grid,
        nodes=count,
        weights=quadrature.weights,
        value=value.T,
        slope=slope.T,
        tail=quadrature.transform[-3:],
    )
