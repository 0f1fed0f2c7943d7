"""Checks of the arguments of public classes and functions, and how their results show themselves.

Checks return the value as it is stored, or raise: a dataclass of the user lists those of its fields, functions call
them on their arguments. Results are short text for a prompt, and tables for notebooks.
"""

import math
import os
import sys
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields
from itertools import count, islice
from numbers import Integral, Real
from pathlib import Path
from typing import Any, ClassVar, Self, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from floatplan.arrays import read_only
from floatplan.errors import InputError, refuse, single
from floatplan.tables import LEAST, RANGES, Range

MOST_NUMBERS = 8  # [-] of a list in a line
LINE = 160  # [-] characters of one
Name = TypeVar("Name")
Value = TypeVar("Value")
Check: TypeAlias = Callable[[Any, str], Any]  # a value and the element that a message names -> the value stored


class Checked:
    """A dataclass whose fields are checked when it is made, those that ``checks`` names."""

    checks: ClassVar[Mapping[str, Check]]
    _is_checked = True

    def __post_init__(self) -> None:
        """Check the fields; report all that is wrong, not only the first."""
        if errors := self.faults():
            refuse(errors)

    def faults(self, prefix: str = "") -> list[InputError]:
        """What is wrong with the fields, each with its name after ``prefix``; right values are stored as checked."""
        errors: list[InputError] = []
        for name, check in self.checks.items():
            value = getattr(self, name)
            if value is MISSING:  # in a file; who reads that says so
                continue
            try:
                stored = check(value, prefix + name.rstrip("_"))  # what is a word of Python has one in its name
            except InputError as error:
                errors += single(error)
            else:
                if stored is not value:
                    object.__setattr__(self, name, stored)
        if not errors and not any(value is MISSING for value in vars(self).values()):
            errors = [InputError(reason, element=prefix + name) for name, reason in self.contradictions()]
        if not errors:
            vars(self).pop("_is_checked", None)
        return errors

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """What cannot be, of fields that are right each: field and reason."""
        yield from ()

    def check(self, path: str) -> None:
        """Check the fields of one that was made without; ``path`` is what messages call it."""
        if not self._is_checked:
            refuse(self.faults(f"{path}."))

    def changed(self, **values: Any) -> Self:
        """Return one with other values, not checked."""
        own, made = vars(self), object.__new__(type(self))
        current = {row.name: own[row.name] for row in fields(self)}  # type: ignore[arg-type]
        vars(made).update(current, **values, _is_checked=False)
        return made

    @classmethod
    def unchecked(cls, **values: Any) -> Self:
        """Return one whose fields are checked by whoever takes it and knows their path in a file."""
        made = object.__new__(cls)
        for row in fields(made):  # type: ignore[arg-type]
            default = row.default if row.default_factory is MISSING else row.default_factory()
            object.__setattr__(made, row.name, values.get(row.name, default))
        object.__setattr__(made, "_is_checked", False)
        return made


def number(allowed: str | Range, *, infinite: bool = False, advice: str | None = None) -> Check:
    """A number in a range, or in that of a key; infinity too where it is no limit; ``advice`` is for one too low."""
    limits = RANGES[allowed] if isinstance(allowed, str) else allowed
    low, high = limits.low, limits.high

    def check(value: Any, element: str) -> Any:
        if type(value) is float and low <= value <= high:
            return value
        number = _real(value, element)
        if not (infinite and number == math.inf):
            _check_range(number, element, limits, advice)
        return number

    return check


def positive(most: float = math.inf, unit: str = "") -> Check:
    """A number above zero, at most as large; infinity too, where nothing is the most."""
    return number(Range(LEAST, most, unit), infinite=most == math.inf)


def whole(allowed: Range, advice: str | None = None) -> Check:
    """A whole number in a range."""
    low, high = allowed.low, allowed.high

    def check(value: Any, element: str) -> int:
        if type(value) is int and low <= value <= high:
            return value
        if isinstance(value, bool) or not isinstance(value, Integral):
            raise InputError(f"{value!r} is not a whole number", element=element)
        _check_range(int(value), element, allowed, advice)
        return int(value)

    return check


FINITE = number(Range(-math.inf, math.inf, ""))
SEED = whole(RANGES["seed"])
TRIES = whole(RANGES["starts"])


def optional(check: Check) -> Check:
    """None, or what a check lets through."""
    return lambda value, element: None if value is None else check(value, element)


def either(words: Iterable[str]) -> str:
    """Words as a message says that it may be any of them."""
    *first, last = words
    return f"{', '.join(first)} or {last}" if first else last


def flag(value: Any, element: str) -> bool:
    """Check that something is true or false."""
    if value is True or value is False:
        return bool(value)
    if not isinstance(value, np.bool_):
        raise InputError(f"{value!r} is not True or False", element=element)
    return bool(value)


def text(value: Any, element: str) -> str:
    """Check a text."""
    if not isinstance(value, str):
        raise InputError(f"{value!r} is not a text", element=element)
    return value


def function(value: Any, element: str) -> Any:
    """Check what is to be called."""
    if not callable(value):
        raise InputError(f"{value!r} cannot be called", element=element, advice="give a function")
    return value


def path(value: Any, element: str) -> Path:
    """Check the path of a file or a folder."""
    name = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(name, str) or "\0" in name:
        raise InputError(f"{value!r} is not a path", element=element)
    return Path(name)


def one_of(*words: str, or_number: Check | None = None) -> Check:
    """One of some words, or a number that a check lets through."""
    choices = either([*(["a number"] if or_number else []), *map(repr, words)])

    def check(value: Any, element: str) -> Any:
        if isinstance(value, str) and value in words:
            return value
        if or_number is None or isinstance(value, str | list | tuple | Mapping):
            raise InputError(f"must be {choices}, not {value!r}", element=element)
        return or_number(value, element)

    return check


def in_short(value: object) -> str:
    """The representation of anything, its first line where it has several."""
    return repr(value).partition("\n")[0]


def made(*kinds: type, advice: str | None = None) -> Check:
    """An object of one of some classes; also says what is wrong with one that was not checked."""
    names = either([kind.__name__ for kind in kinds])

    def check(value: Any, element: str) -> Any:
        if value is MISSING:
            return value
        if not isinstance(value, kinds):
            raise InputError(f"{in_short(value)} is not a {names}", element=element, advice=advice)
        if isinstance(value, Checked):
            value.check(element)
        return value

    return check


def many(check: Check, of: str, count: int | None = None) -> Check:
    """A sequence, as a tuple, of what a check lets through; of so many where a count is given."""

    def sequence(value: Any, element: str) -> tuple[Any, ...]:
        items = _items(value)
        if items is None:
            raise InputError(f"{value!r} is not a sequence of {of}", element=element, advice="give a list or a tuple")
        if count not in (None, len(items)):
            raise InputError(f"must have {count} entries, not {len(items)}", element=element)
        return tuple(_checked(items, check, _numbered(element)))

    return sequence


def pair(check: Check, of: str = "numbers", count: int = 2) -> Check:
    """Two of what a check lets through, or three or four, as a tuple."""

    def numbers(value: Any, element: str) -> tuple[Any, ...]:
        items = _items(value)
        if items is None or len(items) != count:
            raise InputError(f"{value!r} is not {('two', 'three', 'four')[count - 2]} {of}", element=element)
        return tuple(check(item, f"{element}[{index}]") for index, item in enumerate(items))

    return numbers


def by_name(check: Check) -> Check:
    """A mapping from names to what a check lets through, as a copy."""

    def mapping(value: Any, element: str) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise InputError(f"{value!r} is not a mapping by joint", element=element)
        names = [text(name, element) for name in value]
        return dict(zip(names, _checked(value.values(), check, (f"{element}.{name}" for name in names)), strict=True))

    return mapping


def for_all(check: Check) -> Check:
    """What a check lets through: one for all, or by name."""
    named = by_name(check)
    return lambda value, element: (named if isinstance(value, Mapping) else check)(value, element)


def by_joint(check: Check, *words: str, single: bool = True, mapping: bool = True) -> Check:
    """What a check lets through: by name, in joint order, or one for all; or one of some words."""
    named = by_name(check)
    shapes = ["a number"] * single + ["a sequence in joint order"] + ["a mapping by joint"] * mapping
    choices = either([*map(repr, words), *shapes])

    def shaped(value: Any, element: str) -> Any:
        if single and type(value) is float:
            return check(value, element)
        if isinstance(value, str):
            if value not in words:
                raise InputError(f"must be {choices}, not {value!r}", element=element)
            return value
        if mapping and isinstance(value, Mapping):
            return named(value, element)
        items = _items(value)
        if items is not None:
            checked = _checked(items, check, _numbered(element))
            return read_only(checked) if isinstance(value, np.ndarray) and value.dtype.kind == "f" else tuple(checked)
        if not single or isinstance(value, Mapping):
            raise InputError(f"must be {choices}, not {value!r}", element=element)
        return check(value, element)

    return shaped


def numbers(value: npt.ArrayLike, element: str) -> npt.NDArray[Any]:
    """Return real numbers of any shape as an array, the same one where it is one; NaN and infinity are numbers."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, OverflowError):
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in "iuf":
        raise InputError("must be a number or an array of numbers", element=element)
    return array


def _items(value: Any) -> tuple[Any, ...] | list[Any] | None:
    """Items of what is a sequence, or can be iterated over once; None where it is neither, or has no order."""
    if isinstance(value, tuple | list):
        return value
    if isinstance(value, np.ndarray):
        return None if value.ndim == 0 else list(value) if value.ndim > 1 else value.tolist()
    if isinstance(value, str | bytes | Mapping | set | frozenset) or not isinstance(value, Iterable):
        return None
    return tuple(value)


def _numbered(element: str) -> Iterator[str]:
    return (f"{element}[{index}]" for index in count())


def _checked(items: Iterable[Any], check: Check, elements: Iterator[str]) -> list[Any]:
    """The checked items, or all that is wrong with them, as far as anybody reads on."""
    checked: list[Any] = []
    errors: list[InputError] = []
    for item, element in zip(items, elements, strict=False):
        try:
            checked.append(check(item, element))
        except InputError as error:
            errors.append(error)
            if len(errors) == 1000:  # nobody reads more
                break
    refuse(errors)
    return checked


def _real(value: Any, element: str) -> float:
    """A number as Python's own: from NumPy's, and from an array of no dimension."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{value!r} is not a number", element=element)
    try:
        return int(value) if isinstance(value, int) else float(value)
    except OverflowError:
        return math.inf


def _check_range(value: float, element: str, allowed: Range, advice: str | None) -> None:
    """Refuse a number that is not finite or out of a range; ``advice`` is for one below it."""
    if not abs(value) <= sys.float_info.max:  # NaN, infinite, or an integer beyond all doubles
        raise InputError(f"{value!r} is not a finite number", element=element)
    if allowed.low >= 0 and (value < 0 or value == 0 < allowed.low):
        fault = "is not positive" if allowed.low > 0 else "is negative"
        raise InputError(" ".join(filter(None, (str(value), allowed.unit, fault))), element=element, advice=advice)
    if not allowed.low <= value <= allowed.high:
        degrees = ""
        if allowed.unit.startswith("rad"):
            turned = allowed.unit.replace("rad", "degrees", 1)
            degrees = f" ({math.degrees(allowed.low):.4g} to {math.degrees(allowed.high):.4g} {turned})"
        advice = advice if value < allowed.low else None
        raise InputError(f"{value!r} is outside {allowed}{degrees}", element=element, advice=advice)


def shortened(values: Iterable[float], digits: int = 4) -> str:
    """Numbers in a line, so many at most."""
    numbers = [f"{float(value):z.{digits}g}" for value in values]
    more = len(numbers) - MOST_NUMBERS
    return ", ".join(numbers if more <= 0 else [*numbers[:MOST_NUMBERS], f"... ({more} more)"])


def in_line(value: float | Iterable[float], digits: int = 4) -> str:
    """A number, or the numbers of a vector in brackets."""
    return f"({shortened(value, digits)})" if isinstance(value, Iterable) else f"{float(value):z.{digits}g}"


class Outlined:
    """A dataclass that shows its fields, or what ``shown`` names, one a line; arrays by their shapes and ranges."""

    shown: ClassVar[Sequence[str]] = ()

    def __repr__(self) -> str:
        names = self.shown or [row.name for row in fields(self)]  # type: ignore[arg-type]
        rows = ((name, _brief(getattr(self, name))) for name in names)
        return outline(type(self).__name__, ((name, text) for name, text in rows if text))


def outline(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """A title, and a line for each row below it."""
    lines = (f"  {name}: {text}" for name, text in rows)
    return "\n".join([title, *(line if len(line) <= LINE else f"{line[: LINE - 4]} ..." for line in lines)])


def _brief(value: object) -> str:
    """A value in at most about a line."""
    if isinstance(value, np.ndarray):
        return _brief_array(value)
    if isinstance(value, Mapping):
        first = [f"{key} {_brief(item)}" for key, item in islice(value.items(), MOST_NUMBERS)]
        return "; ".join([*first, *([f"... ({len(value)})"] if len(value) > MOST_NUMBERS else [])])
    if isinstance(value, list | tuple) and not all(isinstance(item, str | int | float) for item in value):
        return f"{len(value)} of {type(value[0]).__name__}"
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else in_short(value)


def _brief_array(array: npt.NDArray[Any]) -> str:
    if array.dtype.kind == "U":
        words, counts = np.unique(array, return_counts=True)
        return ", ".join(f"{count} {word or repr('')}" for word, count in zip(words, counts, strict=True))
    if array.size <= MOST_NUMBERS and array.ndim == 1:
        return shortened(array)
    finite = array[np.isfinite(array)]
    return f"{array.shape}" + (f" from {finite.min():.4g} to {finite.max():.4g}" if finite.size else "")


def short(value: float | None, digits: int = 4) -> str:
    """A number as tables show it; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{float(value):z.{digits}g}"


def percent(share: float | None) -> str:
    """A share of 1 in percent, without the sign; a dash where there is none."""
    return "-" if share is None else f"{100 * share:z.0f}"


def html_table(title: str, rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    """A table as HTML; everything in it is text."""
    import html

    def cells(texts: Sequence[str], tag: str) -> str:
        return "".join(f'<{tag} style="text-align: left">{html.escape(text)}</{tag}>' for text in texts)

    above = f"<thead><tr>{cells(head, 'th')}</tr></thead>" if head else ""
    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    return f"<table><caption><b>{html.escape(title)}</b></caption>{above}<tbody>{body}</tbody></table>"


def attributes(instance: object, names: Iterable[str]) -> dict[str, Any]:
    """Return attributes by their names."""
    return {name: getattr(instance, name) for name in names}


def without(mapping: Mapping[Name, Value], names: Container[Any]) -> dict[Name, Value]:
    """Return a mapping without some of its keys."""
    return {name: value for name, value in mapping.items() if name not in names}


def without_none(mapping: Mapping[Name, Value | None]) -> dict[Name, Value]:
    """Return a mapping without keys whose value is None."""
    return {name: value for name, value in mapping.items() if value is not None}
