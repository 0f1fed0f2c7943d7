"""The kernel's structs, filled from Python: ``kernel.h`` is the only place that says what they hold.

cffi reads that header. The fields of a :class:`Struct` are given by keyword, every array that it points to among them,
as it is: contiguous, of the header's numbers, or None where there is none.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import IntEnum
from functools import cache
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, IntArray
from floatplan.kernel.build import DECLARATIONS, FOLDER, declarations, header_digest

Pointer: TypeAlias = Any  # of cffi, which has no types
MULTIPLE = 8  # [-] of the counts that are ``Eights`` in the header
EIGHTS = "long long"  # what ``Eights`` is defined as
DTYPES: dict[str, np.dtype[Any]] = {
    "double": np.dtype(np.float64),
    "int64_t": np.dtype(np.int64),
    "uint64_t": np.dtype(np.uint64),
    EIGHTS: np.dtype(np.int64),
}


def _declarations() -> Any:
    """Return the ``FFI`` that knows the header: as the build has kept it, else read now."""
    if (FOLDER / DECLARATIONS).is_file():
        kept = importlib.import_module(f"{__package__}.{DECLARATIONS.removesuffix('.py')}")
        if header_digest() == kept.HEADER:
            return kept.ffi
    module: dict[str, Any] = {}
    exec(declarations(), module)
    return module["ffi"]


FFI: Any = _declarations()
NULL: Pointer = FFI.NULL


def doubles(values: npt.ArrayLike) -> Array:
    """Return values as a contiguous array of doubles, themselves where they are one."""
    return np.ascontiguousarray(values, np.float64)


def integers(values: npt.ArrayLike) -> IntArray:
    """Return values as a contiguous array of 64-bit integers, themselves where they are one."""
    return np.ascontiguousarray(values, np.int64)


@dataclass(frozen=True, eq=False)
class Layout:
    """What the header says of a struct.

    Attributes
    ----------
    pointer, array : types of cffi
        Of a pointer to one, and of an array of them.
    arrays : name -> dtype, and the type of cffi of an array of these
        Of the members that are pointers.
    structs : name -> name of the struct
        Of the members that are structs themselves.
    lengths : name -> number of entries
        Of the members that are arrays themselves.
    eights : names of counts that must be multiples of 8
    required : names
        Pointers, and structs that have some; all members of a struct of numbers alone.
    record : NumPy's dtype of one, pointers as addresses
    """

    pointer: Any
    array: Any
    arrays: Mapping[str, tuple[np.dtype[Any], Any]]
    structs: Mapping[str, str]
    lengths: Mapping[str, int]
    eights: tuple[str, ...]
    required: frozenset[str]
    record: np.dtype[Any]


@cache
def layout(name: str) -> Layout:
    """Return what the header says of a struct."""
    struct = FFI.typeof(name)
    arrays: dict[str, tuple[np.dtype[Any], Any]] = {}
    structs: dict[str, str] = {}
    lengths: dict[str, int] = {}
    formats: dict[str, Any] = {}
    for member, field in struct.fields:
        kind = field.type
        if kind.kind == "pointer":
            arrays[member] = DTYPES[kind.item.cname], FFI.typeof(f"{kind.item.cname}[]")
            formats[member] = np.dtype(np.uintp)
        elif kind.kind == "struct":
            structs[member] = kind.cname
            formats[member] = layout(kind.cname).record
        elif kind.kind == "array":
            lengths[member] = kind.length
            item = layout(kind.item.cname).record if kind.item.kind == "struct" else DTYPES[kind.item.cname]
            formats[member] = item, (kind.length,)
        else:
            formats[member] = DTYPES[kind.cname]
    with_arrays = {member for member, inner in structs.items() if layout(inner).arrays}
    return Layout(
        pointer=FFI.typeof(f"{name} *"),
        array=FFI.typeof(f"{name}[]"),
        arrays=arrays,
        structs=structs,
        lengths=lengths,
        eights=tuple(member for member, field in struct.fields if field.type.cname == EIGHTS),
        required=frozenset({*arrays, *with_arrays} or formats),
        record=np.dtype(
            {
                "names": list(formats),
                "formats": list(formats.values()),
                "offsets": [field.offset for _, field in struct.fields],
                "itemsize": FFI.sizeof(struct),
            }
        ),
    )


@cache
def enumeration(name: str) -> type[IntEnum]:
    """Return an enumeration of the header."""
    members = FFI.typeof(name).relements
    return IntEnum(name, sorted(members.items(), key=lambda member: member[1]))  # type: ignore[return-value]


class Struct:
    """A struct of the header, and the arrays that it points to, which live as long as it does.

    Numbers that are left out are 0, as are those that the kernel writes; a struct of numbers alone must be given whole.
    A struct within it is a copy of the :class:`Struct` that is given, of zeros where that is None. Copies and pickles
    have arrays of their own.

    Attributes
    ----------
    name : str
    pointer : ``name *`` of cffi
        Its members are read and written through it, all but pointers; see :meth:`point_to`.

    Raises
    ------
    TypeError
        A member is unknown or missing, or an array is none, has other numbers, or is not contiguous.
    ValueError
        A count is no multiple of 8 where it must be one, or an array within the struct has another length.
    """

    __slots__ = ("_arrays", "name", "pointer")

    def __init__(self, name: str, /, **members: Any) -> None:
        of_kind = layout(name)
        if not of_kind.required <= members.keys():
            raise TypeError(f"{name} needs {', '.join(sorted(of_kind.required - members.keys()))}")
        for member in of_kind.eights:
            if members.get(member, 0) % MULTIPLE:
                raise ValueError(f"{name}.{member} is {members[member]}: it must be a multiple of {MULTIPLE}")
        for member, length in of_kind.lengths.items():
            if member in members and len(members[member]) != length:
                raise ValueError(f"{name}.{member} has {len(members[member])} entries of {length}")
        arrays = {member: members[member] for member in of_kind.arrays}
        members.update(_addresses(name, arrays))
        for member in of_kind.structs:
            part = members.pop(member, None)
            if part is not None:
                members[member] = part.pointer[0]
                arrays.update({f"{member}.{inner}": array for inner, array in part._arrays.items()})
        try:
            self.pointer: Pointer = FFI.new(of_kind.pointer, members)
        except KeyError as error:
            raise TypeError(f"{name} has no {error.args[0]}") from None
        self.name = name
        self._arrays = arrays

    @classmethod
    def of_numbers(cls, numbers: Any) -> Struct:
        """Return the struct of the name of a dataclass, whose fields are those of the struct."""
        return cls(type(numbers).__name__, **asdict(numbers))

    def point_to(self, **arrays: Array | IntArray | None) -> None:
        """Point to other arrays, which then live as long."""
        for member, address in _addresses(self.name, arrays).items():
            setattr(self.pointer, member, address)
        self._arrays.update(arrays)

    def __reduce__(self) -> tuple[Any, ...]:
        content = bytes(FFI.buffer(self.pointer))
        return _restored, (self.name, content, self._arrays)


def _restored(name: str, content: bytes, arrays: dict[str, Array | IntArray | None]) -> Struct:
    """Return a struct with its numbers, which points to arrays, those of a struct within it by its name and a dot."""
    struct = Struct.__new__(Struct)
    struct.name = name
    struct.pointer = FFI.new(layout(name).pointer)
    struct._arrays = dict(arrays)
    FFI.buffer(struct.pointer)[:] = content
    for path, array in arrays.items():
        *within, member = path.split(".")
        part, part_name = struct.pointer, name
        for outer in within:
            part, part_name = getattr(part, outer), layout(part_name).structs[outer]
        setattr(part, member, _addresses(part_name, {member: array})[member])
    return struct


def _addresses(name: str, arrays: Mapping[str, Array | IntArray | None]) -> dict[str, Pointer]:
    """Return where arrays begin in memory."""
    known = layout(name).arrays
    addresses = {}
    for member, array in arrays.items():
        if member not in known:
            raise TypeError(f"{name} points to no {member}")
        if array is None:
            addresses[member] = NULL
            continue
        dtype, array_type = known[member]
        try:
            if array.dtype != dtype:
                raise TypeError(f"{name}.{member} takes an array of {dtype}, not of {array.dtype}")
            addresses[member] = FFI.from_buffer(array_type, array)
        except (AttributeError, ValueError, BufferError):
            raise TypeError(f"{name}.{member} takes a contiguous array of {dtype}") from None
    return addresses


class StructArray:
    """Structs of one name, one after the other in memory: some as they are, or copies of one that are given more.

    Attributes
    ----------
    pointer : ``name[]`` of cffi
    numbers : (count,) record array
        The members of all of them, as they are now; pointers as addresses.
    """

    def __init__(self, structs: Sequence[Struct], copies: int = 1) -> None:
        self.name = structs[0].name
        kind = layout(self.name)
        self.pointer: Pointer = FFI.new(kind.array, len(structs) * copies)
        content = FFI.buffer(self.pointer)
        content[:] = b"".join([bytes(FFI.buffer(struct.pointer)) for struct in structs]) * copies
        self.numbers: Any = np.frombuffer(content, kind.record)
        self._kept: list[Any] = [*structs]  # with the arrays that they point to

    def give(self, **members: Any) -> None:
        """Give each of them members of its own; arrays and structs then live as long.

        A number is one of (count,), or the same for all; an array that is pointed to is a row of one (count, ..); a
        struct within is one of another :class:`StructArray`.
        """
        known = layout(self.name)
        arrays = {member: values for member, values in members.items() if member in known.arrays}
        for member, address in _addresses(self.name, arrays).items():
            rows = members.pop(member)
            self._kept.append(rows)
            if len(self.numbers) == 1:  # the way through NumPy takes a microsecond for each
                setattr(self.pointer[0], member, address)
            else:
                first = int(FFI.cast("uintptr_t", address))
                self.numbers[member] = first + np.arange(len(rows)) * rows.strides[0]
        for member, values in members.items():
            if member in known.structs:
                self._kept.append(values)
                values = values.numbers
            self.numbers[member] = values
