"""The kernel's structures with the arrays that they point to."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.bodies import Bodies
from floatplan.kernel.layout import STRUCTURES
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.sine_polynomial import Form, basis


class Filled:
    """A structure of the headers with what it points to: each of its arrays, or None where there is none."""

    def __init__(self, name: str, **values: Any) -> None:
        kind = STRUCTURES[name]
        numbers: dict[str, Any] = {}
        arrays: dict[str, Array | IntArray] = {}
        for field, value in values.items():
            if isinstance(value, np.ndarray):
                dtype, is_read = kind.arrays[field]
                arrays[field] = np.ascontiguousarray(value, dtype=dtype) if is_read else value
            else:
                numbers[field] = value
        if not kind.arrays.keys() <= values.keys():
            raise TypeError(f"{name} needs {', '.join(sorted(kind.arrays.keys() - values.keys()))}")
        self.structure: Any = kind(**numbers)
        self.structure.point_to(**arrays)
        self._kept = arrays

    def point_to(self, **arrays: Array | IntArray) -> None:
        """Point to other arrays, as they are."""
        self.structure.point_to(**arrays)
        self._kept.update(arrays)

    def __getstate__(self) -> tuple[str, bytes, dict[str, Array | IntArray]]:
        """Its numbers and arrays: a copy has its own."""
        return type(self.structure).__name__, bytes(self.structure), self._kept

    def __setstate__(self, state: tuple[str, bytes, dict[str, Array | IntArray]]) -> None:
        name, content, self._kept = state
        self.structure = STRUCTURES[name].from_buffer_copy(content)
        self.structure.point_to(**self._kept)


class FilledArray:
    """An array of structures of one name with what they point to; empty where there is None."""

    def __init__(self, name: str, filled: Sequence[Filled | None]) -> None:
        self._kept = filled
        self.structures: Any = (STRUCTURES[name] * len(filled))()
        for index, each in enumerate(filled):
            if each:
                self.structures[index] = each.structure


def filled_robot(bodies: Bodies, free: Sequence[int]) -> Filled:
    """Return a robot whose joints have so many free polynomials."""
    return Filled(
        "Robot",
        joints=len(free),
        bodies=len(bodies.real),
        width=max(free),
        free=np.array(free, dtype=np.int64),
        real=bodies.real,
        imaginary=bodies.imaginary,
        is_real=bodies.is_real,
        parent=bodies.parent,
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
        "Grid",
        nodes=count,
        weights=quadrature.weights,
        value=value.T,
        slope=slope.T,
        tail=quadrature.transform[-3:],
    )
