"""Pickles read as data only: numbers, strings, lists, dictionaries and arrays of numbers; nothing in them is run.

A pickle is a program, which may call any function that can be imported. Of all of these the reader knows those that
make arrays of NumPy, and it makes them itself: whatever else a file names is refused by that name.
"""

from __future__ import annotations

import io
import math
import pickle
import pickletools
from typing import Any

import numpy as np

from floatplan.errors import InputError

NUMBERS = "biuf"  # kinds of NumPy's types that are numbers


class _NumberType:
    """The type of an array's numbers, as a pickle builds it: its name first, then its byte order."""

    def __init__(self, name: Any, *_: Any) -> None:
        self.dtype = np.dtype(str(name))
        if self.dtype.kind not in NUMBERS:
            raise InputError(f"holds an array of {self.dtype}, not of numbers")

    def __setstate__(self, state: Any) -> None:
        byte_order = state[1]
        if byte_order in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(byte_order)


class _Array:
    """An array as a pickle builds it: empty first, then with its state."""

    def __init__(self, *_: Any) -> None:
        self.values = np.empty(0)

    def __setstate__(self, state: Any) -> None:
        _, shape, number_type, is_fortran, content = state
        self.values = _array(content, number_type, shape, "F" if is_fortran else "C")


def _array(content: Any, number_type: Any, shape: Any, order: str) -> Any:
    """Return an array of numbers from the bytes of a pickle."""
    if not isinstance(number_type, _NumberType):
        raise InputError("holds an array whose numbers have no type")
    lengths = [int(length) for length in shape]
    size = math.prod(lengths) * number_type.dtype.itemsize
    largest = 200_000_000  # [bytes] of one array
    if min(lengths, default=0) < 0 or size > largest or size != len(content):
        raise InputError(f"holds an array whose shape {tuple(lengths)} is not that of its bytes")
    return np.frombuffer(bytes(content), number_type.dtype).reshape(lengths, order="F" if order == "F" else "C")


def _scalar(number_type: Any, content: Any) -> Any:
    """Return one number."""
    return _array(content, number_type, (1,), "C")[0].item()


MAKERS: dict[tuple[str, str], Any] = {("numpy", "ndarray"): _Array, ("numpy", "dtype"): _NumberType}
for _module in ("numpy.core", "numpy._core"):  # before NumPy 2, and since
    MAKERS[f"{_module}.multiarray", "_reconstruct"] = _Array
    MAKERS[f"{_module}.multiarray", "scalar"] = _scalar
    MAKERS[f"{_module}.numeric", "_frombuffer"] = _array


class _Reader(pickle.Unpickler):
    """An unpickler that finds nothing but what makes arrays."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in MAKERS:
            reason = f"names {module}.{name}, which is not plain data: a pickle that names functions can run them"
            raise InputError(reason, advice="where you trust it, write it again as lists and arrays of numbers")
        return MAKERS[module, name]

    def persistent_load(self, pid: Any) -> Any:
        raise InputError("refers to something outside of it", advice="write it again as lists and arrays of numbers")


def read_pickle(content: bytes) -> Any:
    """Return the data of a pickle: dictionaries, lists, strings, numbers, arrays.

    Raises
    ------
    InputError
        It is no pickle, is cut off, or names anything but arrays of numbers.
    """
    try:
        _check_memo(content)
        return _DataReader().of(_Reader(io.BytesIO(content)).load(), 0)
    except InputError:
        raise
    except MemoryError:
        raise InputError("asks for more memory than there is") from None
    except Exception as error:  # a malformed program of this kind may lead to any
        raise InputError(f"cannot be read as a pickle: {type(error).__name__}") from None


def _check_memo(content: bytes) -> None:
    """Refuse numbers of remembered values that no file of this length can have: memory is reserved for as many."""
    for opcode, argument, _ in pickletools.genops(content):
        if opcode.name == "LONG_BINPUT" and isinstance(argument, int) and argument > len(content):
            raise InputError("remembers more values than it holds")


class _DataReader:
    """Reads the lists and arrays of numbers that a pickle holds, and counts the values."""

    def __init__(self) -> None:
        self.count = 0

    def of(self, value: Any, depth: int) -> Any:
        """Return data without functions or objects; refuse anything else."""
        self.count += 1
        deepest = 20  # [-] lists within lists; files of motions have two levels
        most = 20_000_000  # [-] numbers and strings outside of arrays: a list may hold another many times over
        if depth > deepest or self.count > most:
            raise InputError("holds lists within lists without end")
        if isinstance(value, _Array):
            return value.values
        if isinstance(value, dict):
            return {str(key): self.of(member, depth + 1) for key, member in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.of(member, depth + 1) for member in value]
        if value is None or isinstance(value, (bool, int, float, str, np.ndarray)):
            return value
        raise InputError(f"holds a {type(value).__name__}, which is not plain data")
