"""The compiled kernel, loaded, and what crosses to it.

Structures, enumerations and functions are written in the kernel's own header, which is read here.
"""

import ctypes
import re
from collections.abc import Mapping, Sequence
from enum import IntEnum
from functools import cache
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError
from floatplan.kernel.build import FOLDER, LIBRARY, is_cut_off, sources_digest

HEADER = "kernel.hpp"
EXPORTS = "dispatch.cpp"
NUMBERS: dict[str, Any] = {"double": ctypes.c_double, "Index": ctypes.c_int64, "std::uint64_t": ctypes.c_uint64}
ARRAYS = {"double": np.dtype(np.float64), "Index": np.dtype(np.int64)}
MULTIPLES = {"Eights": 8}  # kinds of counts
HEAD = object.__basicsize__  # bytes
RETURNED: dict[str, Any] = {"void": None, "Index": ctypes.c_int64, "const char *": ctypes.c_char_p}


_begins = ctypes.c_void_p.from_address
INSTRUCTIONS = ("baseline instructions", "AVX2", "AVX-512")


class Structure(ctypes.Structure):
    """A structure of the headers: names that it does not have raise, and so do numbers that it cannot hold.

    Attributes
    ----------
    arrays : of each pointer, the type of the numbers it points to, and whether they are only read
    lengths : of members that are arrays themselves
    multiples : of counts, what they must be a multiple of
    """

    __slots__ = ()
    arrays: ClassVar[dict[str, tuple[np.dtype[Any], bool]]]
    lengths: ClassVar[dict[str, int]]
    multiples: ClassVar[dict[str, int]]

    def __init__(self, *members: Any, **values: Any) -> None:
        super().__init__(*members, **values)
        for name, multiple in self.multiples.items():
            if values.get(name, 0) % multiple:
                raise ValueError(f"{type(self).__name__}.{name} is {values[name]}: it must be a multiple of {multiple}")
        for name, length in self.lengths.items():
            if name in values and len(values[name]) != length:
                raise ValueError(f"{type(self).__name__}.{name} has {len(values[name])} entries of {length}")

    def point_to(self, **arrays: Array | IntArray) -> None:
        """Point to arrays as they are, which must be kept as long."""
        known = self.arrays
        for name, array in arrays.items():
            if array.dtype != known[name][0] or not array.flags.c_contiguous:
                raise TypeError(f"{type(self).__name__}.{name} takes a contiguous array of {known[name][0]}")
            setattr(self, name, _begins(id(array) + HEAD).value)  # address() without the time of a call


def address(values: np.ndarray[Any, Any]) -> int:
    """Where an array begins in memory: NumPy's ``PyArrayObject`` holds it after the head of every object.

    ``values.ctypes.data`` says the same in seven times the time, which a plan of 0.1 ms notices.
    """
    return _begins(id(values) + HEAD).value or 0


def _read(name: str) -> str:
    """Text of a source, without comments."""
    return re.sub("//.*", "", (FOLDER / name).read_text(encoding="utf-8"))


def structures(text: str) -> dict[str, type[Structure]]:
    """Read the structures of C++: numbers, arrays of them of a given length, pointers, and structures before them."""
    found: dict[str, type[Structure]] = {}
    for structure, body in re.findall(r"struct (\w+) \{(.*?)\n\};", text, re.DOTALL):
        fields: list[tuple[str, Any]] = []
        arrays, lengths, multiples = {}, {}, {}
        for constant, kind, members in re.findall(r"\s*(const )?([\w:]+) ([^;]*);", body):
            known = {**NUMBERS, **dict.fromkeys(MULTIPLES, ctypes.c_int64), **found}
            for star, name, length in re.findall(r"(\*?)(\w+)(?:\[(\d+)\])?(?:,|$)", re.sub(r"\s", "", members)):
                if star:
                    arrays[name] = ARRAYS[kind], bool(constant)
                if kind in MULTIPLES:
                    multiples[name] = MULTIPLES[kind]
                if length:
                    lengths[name] = int(length)
                number = ctypes.c_void_p if star else known[kind]
                fields.append((name, number * int(length) if length else number))
        members = {"_fields_": fields, "arrays": arrays, "lengths": lengths, "multiples": multiples}
        found[structure] = type(structure, (Structure,), {"__slots__": (), **members})
    return found


def enumerations(text: str) -> dict[str, type[IntEnum]]:
    """Read the enumerations of C++, numbered from 0."""
    listed = re.findall(r"enum (?:class )?(\w+) : Index \{(.*?)\};", text, re.DOTALL)
    return {name: IntEnum(name, re.findall(r"\w+", members), start=0) for name, members in listed}  # type: ignore[misc]


def functions(text: str, known: dict[str, type[Structure]]) -> dict[str, tuple[Any, list[Any]]]:
    """Read the functions that the library exports: what each returns, and its arguments."""

    def passed(argument: str) -> Any:
        kind, pointer = argument.replace("const ", "").split()[0], "*" in argument
        if pointer:
            return ctypes.POINTER(known[kind]) if kind in known else ctypes.c_void_p
        return NUMBERS[kind]

    exported = re.findall(r"^EXPORT ([^()]*?)\s?floatplan_(\w+)\((.*?)\) \{", text, re.DOTALL | re.MULTILINE)
    return {
        name: (RETURNED[returned], [passed(argument) for argument in arguments.split(",") if argument])
        for returned, name, arguments in exported
    }


STRUCTURES = structures(_read(HEADER))
ENUMERATIONS = enumerations(_read(HEADER))
FUNCTIONS = functions(_read(EXPORTS), STRUCTURES)


def constants(name: str, *modules: Mapping[str, Any], **others: Any) -> Structure:
    """Return a structure: each number is that given, or the constant of its name in the last module that has it."""
    known = {key.lower(): value for module in modules for key, value in module.items() if key.isupper()} | others
    kind = STRUCTURES[name]
    return kind(**{field: known[field] for field, *_ in kind._fields_})


class Filled:
    """A structure of the headers with what it points to: each of its arrays, or None where there is none.

    An array that is not given is that of its name of the first of the ``sources`` that has one. A structure within it
    is a copy of the one that is given.
    """

    def __init__(self, name: str, *sources: object, **values: Any) -> None:
        kind = STRUCTURES[name]
        arrays: dict[str, Array | IntArray] = {}
        written: dict[str, Array | IntArray] = {}
        missing: list[str] = []
        for field, (dtype, is_read) in kind.arrays.items():
            value = values.pop(field, missing)
            for source in sources if value is missing else ():
                if (value := getattr(source, field, missing)) is not missing:
                    break
            if value is missing:
                missing.append(field)
            elif is_read and value is not None:
                arrays[field] = value = np.ascontiguousarray(value, dtype)
                values[field] = _begins(id(value) + HEAD).value  # address() without the time of a call
            elif value is not None:
                written[field] = value
        if missing:
            raise TypeError(f"{name} needs {', '.join(sorted(missing))}")
        parts = {name: value for name, value in values.items() if isinstance(value, Filled)}
        self.structure: Any = kind(**values | {name: part.structure for name, part in parts.items()})
        self.structure.point_to(**written)
        self._kept, self._parts = arrays | written, parts

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


class FilledRows:
    """So many copies of a structure, which differ in numbers (count,) and in what they point to, arrays (count, ..).

    A structure within it may be many, too. ``numbers`` are its members, as arrays.
    """

    def __init__(self, like: Filled, copies: int, /, **values: Any) -> None:
        kind = type(like.structure)
        self.structures: Any = (kind * copies)()
        self.numbers: Any = np.frombuffer(self.structures, np.dtype(kind))
        self.numbers[:] = np.frombuffer(bytes(like.structure), np.dtype(kind))
        self._kept: list[Any] = [like]
        for name, value in values.items():
            if isinstance(value, FilledRows):
                self._kept.append(value)
                self.numbers[name] = value.numbers
            elif name in kind.arrays:
                array = np.ascontiguousarray(value, kind.arrays[name][0])
                self._kept.append(array)
                self.numbers[name] = address(array) + np.arange(copies) * array.strides[0]
            else:
                self.numbers[name] = value


def structure_array(name: str, filled: Sequence[Filled | None]) -> Any:
    """Return an array of structures of one name that keeps what they point to; empty where there is None."""
    array: Any = (STRUCTURES[name] * len(filled))(*(each.structure if each else STRUCTURES[name]() for each in filled))
    array.kept = filled
    return array


class Kernel(SimpleNamespace):
    """The library, loaded: its functions as ``dispatch.cpp`` exports them."""

    instructions: Any

    def __init__(self, library: ctypes.CDLL) -> None:
        super().__init__()
        for name, (returned, arguments) in FUNCTIONS.items():
            exported = getattr(library, f"floatplan_{name}")
            exported.restype, exported.argtypes = returned, arguments
            setattr(self, name, exported)
        self.instructions = int(self.instructions())


@cache
def kernel() -> Kernel:
    """Return the compiled kernel.

    Raises
    ------
    InputError
        It is not there or cannot be loaded: the installation is not complete.
    """
    path, reason = FOLDER / LIBRARY, "not compiled"
    try:
        if path.is_file():
            reason = "damaged: python -m floatplan.kernel.build"
            if not is_cut_off(path):
                loaded = Kernel(ctypes.CDLL(str(path)))
                if loaded.sources().decode() == sources_digest():
                    return loaded
                reason = "compiled from other sources: python -m floatplan.kernel.build"
    except (OSError, AttributeError) as error:
        reason = f"cannot be loaded: {error}"
    raise InputError(f"the kernel cannot be used: {reason}", advice="install floatplan again")


def description() -> str:
    """Say in a few words what makes plans without inequalities."""
    return f"compiled kernel ({INSTRUCTIONS[kernel().instructions]})"
