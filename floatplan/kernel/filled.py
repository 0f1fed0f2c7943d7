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
        self._arrays: dict[str, np.ndarray[Any, Any]] = {}
        self.structure: Any = kind()
        integers = _integers(kind)
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                self.point_to(**{name: np.ascontiguousarray(value, np.int64 if name in integers else np.float64)})
            else:
                setattr(self.structure, name, value)

    def point_to(self, **arrays: np.ndarray[Any, Any]) -> None:
        """Point to other arrays, as they are: contiguous, of the right numbers."""
        self._arrays.update(arrays)
        for name, array in arrays.items():
            setattr(self.structure, name, library.address(array))

    def __getstate__(self) -> tuple[type[ctypes.Structure], bytes, dict[str, np.ndarray[Any, Any]]]:
        """Its numbers and arrays: a copy has its own."""
        return type(self.structure), bytes(self.structure), self._arrays

    def __setstate__(self, state: tuple[type[ctypes.Structure], bytes, dict[str, np.ndarray[Any, Any]]]) -> None:
        kind, content, self._arrays = state
        self.structure = kind.from_buffer_copy(content)
        self.point_to(**self._arrays)


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
