"""Names for the array types that pass between the rooms, and the one place where arrays become read-only."""

from collections.abc import Sequence
from functools import cache
from typing import Any, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

# Of numpy.ndarray itself, since fields of parts are told apart by it: from NumPy 2.5 on numpy.typing has a name for it.
Array: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.float64]]
ComplexArray: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.complex128]]
BoolArray: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.bool_]]
IntArray: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.int64]]
N = TypeVar("N", bound=np.generic)


def read_only(values: npt.ArrayLike) -> Array:
    """Return a float64 copy of ``values`` that refuses to be written to."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@cache
def identity(size: int) -> Array:
    """Return the identity matrix, which refuses to be written to."""
    return read_only(np.eye(size))


def distinct(values: npt.NDArray[N]) -> npt.NDArray[N]:
    """Return the values (N,) that differ, rising: as numpy.unique, which loads numpy.ma for it."""
    rising = np.sort(values)
    return rising[np.append(True, rising[1:] != rising[:-1])] if len(rising) else rising


def indices_of(item: object, items: Sequence[object]) -> list[int]:
    """Return where an item is among others."""
    return [index for index, other in enumerate(items) if other == item]
