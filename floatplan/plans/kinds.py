"""What values in plan files may be: checks of their kinds, each called with a value and its place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any, TypeAlias

from floatplan.errors import InputError

Check: TypeAlias = Callable[[Any, str], None]


def number(value: Any, element: str) -> None:
    """A number; whether it is finite is checked where the record is read."""
    if type(value) is not float and (not isinstance(value, Real) or isinstance(value, bool)):
        raise InputError(f"must be a number, not {_shown(value)}", element=element)


def positive(value: Any, element: str) -> None:
    """A number above zero."""
    number(value, element)
    if not value > 0:
        raise InputError(f"must be positive, not {value}", element=element)


def non_negative(value: Any, element: str) -> None:
    """A number not below zero."""
    number(value, element)
    if not value >= 0:
        raise InputError(f"must not be negative: {value}", element=element)


def whole(value: Any, element: str) -> None:
    """A whole number."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise InputError(f"must be a whole number, not {_shown(value)}", element=element)


def boolean(value: Any, element: str) -> None:
    """True or false."""
    if not isinstance(value, bool):
        raise InputError(f"must be true or false, not {_shown(value)}", element=element)


def text(value: Any, element: str) -> None:
    """A text."""
    if not isinstance(value, str):
        raise InputError(f"must be a text, not {_shown(value)}", element=element)


@dataclass(frozen=True)
class OneOf:
    """One of some words."""

    words: tuple[str, ...]

    def __call__(self, value: Any, element: str) -> None:
        """Refuse everything else."""
        if not isinstance(value, str) or value not in self.words:
            raise InputError(f"must be {' or '.join(map(repr, self.words))}, not {_shown(value)}", element=element)


@dataclass(frozen=True)
class ListOf:
    """A list, of a certain length where one is given."""

    entry: Check
    length: int | None = None

    def __call__(self, value: Any, element: str) -> None:
        """Refuse everything else."""
        if not isinstance(value, list | tuple):
            raise InputError(f"must be a list, not {_shown(value)}", element=element)
        if self.length is not None and len(value) != self.length:
            raise InputError(f"must have {self.length} entries, not {len(value)}", element=element)
        for index, item in enumerate(value):
            self.entry(item, f"{element}[{index}]")


@dataclass(frozen=True)
class OrNull:
    """Something, or nothing."""

    entry: Check

    def __call__(self, value: Any, element: str) -> None:
        """Refuse what is neither."""
        if value is not None:
            self.entry(value, element)


@dataclass(frozen=True)
class Each:
    """A table of any keys, each of which holds the same."""

    entry: Check

    def __call__(self, value: Any, element: str) -> None:
        """Refuse everything else."""
        check_table(value, element)
        for name, item in value.items():
            self.entry(item, f"{element}.{name}")


@dataclass(frozen=True)
class Table:
    """A table with these keys and no others, unless ``unknown``, what is said of others, is left empty."""

    keys: Mapping[str, Check]
    optional: Mapping[str, Check] = field(default_factory=dict)
    unknown: str = "is not known, and so cannot be proved"

    def __call__(self, value: Any, element: str) -> None:
        """Refuse everything else."""
        check_table(value, element)
        for name, item in value.items():
            check = self.keys.get(name) or self.optional.get(name)
            if check is not None:
                check(item, f"{element}.{name}".lstrip("."))
            elif self.unknown:
                raise InputError(self.unknown, element=f"{element}.{name}".lstrip("."))
        for name in self.keys:
            if name not in value:
                raise InputError("is missing", element=f"{element}.{name}".lstrip("."))


POINT = ListOf(number, 2)


def direction(value: Any, element: str) -> None:
    """Two numbers that are not both zero."""
    POINT(value, element)
    if not any(value):
        raise InputError("has length zero", element=element)


def check_table(value: Any, element: str) -> None:
    """A table."""
    if not isinstance(value, dict | Mapping):
        raise InputError(f"must be a table, not {_shown(value)}", element=element)


def _shown(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else f"{shown[:56]} ..."
