"""Names for the array types that pass between the rooms, and the one place where arrays become read-only."""

from typing import TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]
ComplexArray: TypeAlias = npt.NDArray[np.complex128]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
IntArray: TypeAlias = npt.NDArray[np.int64]
N = TypeVar("N", bound=np.generic)


def read_only(values: npt.ArrayLike) -> Array:
    """Return a float64 copy of ``values`` that refuses to be written to."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def distinct(values: npt.NDArray[N]) -> npt.NDArray[N]:
    """Return the values (N,) that differ, rising: as numpy.unique, which loads numpy.ma for it."""
    rising = np.sort(values)
    return rising[np.append(True, rising[1:] != rising[:-1])] if len(rising) else rising
