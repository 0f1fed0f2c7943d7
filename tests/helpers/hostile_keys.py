"""Wrong content for every key of a file, made from the records of its keys."""

import math
from collections.abc import Iterator, Mapping, Sequence
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np

from floatplan.keys import Keyed, in_files, is_needed

VALUES: tuple[Any, ...] = (math.nan, math.inf, -math.inf, 10**400, True, 1.5, "no\x00 such\nword", [], {}, None)
UNKNOWN = "no_such_key"


def damaged(part: type[Keyed], content: Mapping[str, Any], place: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield tables that are wrong in one place each, and that place, from a table that is right.

    A key is unknown, one that is needed is missing, or what a key holds is of no kind that its type allows.
    """
    part = vars(part).get("kinds", {}).get(content.get("kind"), part)
    inside = f"{place}." if place else ""
    yield inside + UNKNOWN, {**content, UNKNOWN: 1}
    for each, _ in part.keyed_fields():
        key, hint = in_files(each.name), part.hints[each.name]
        if is_needed(each):
            yield inside + key, {name: value for name, value in content.items() if name != key}
        if key in content:
            for value in VALUES:
                if not is_allowed(hint, value):
                    yield inside + key, {**content, key: value}
            for where, inner in _damaged_inside(hint, content[key], inside + key):
                yield where, {**content, key: inner}


def _damaged_inside(hint: Any, value: Any, place: str) -> Iterator[tuple[str, Any]]:
    """Yield what a key holds with one place below it made wrong: in a table, or an entry of a list or a mapping."""
    origin, inner = get_origin(hint), get_args(hint)
    entries: dict[Any, tuple[Any, str]] = {}  # type and place of each
    if isinstance(hint, type) and issubclass(hint, Keyed):
        if isinstance(value, Mapping):
            yield from damaged(hint, value, place)
    elif origin in (Union, UnionType):
        for kind in inner:
            yield from _damaged_inside(kind, value, place)
    elif origin is Mapping and isinstance(value, Mapping):
        entries = {name: (inner[1], f"{place}.{name}") for name in value}
    elif origin in (Sequence, tuple) and isinstance(value, list):
        entries = {index: (inner[0], f"{place}[{index}]") for index in range(len(value))}
    for key, (kind, where) in entries.items():
        found = list(_damaged_inside(kind, value[key], where))
        if kind is float:
            found += [(where, wrong) for wrong in VALUES if wrong is not None and not is_allowed(float, wrong)]
        for below, wrong in found:
            changed = dict(value) if isinstance(value, Mapping) else list(value)
            changed[key] = wrong
            yield below, changed


def is_allowed(hint: Any, value: Any) -> bool:
    """Whether a type may allow a value, as far as its outermost kind tells."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(is_allowed(kind, value) for kind in inner)
    if origin is Literal:
        return value in inner
    if hint is float:
        return type(value) in (int, float) and abs(value) < math.inf and abs(value) < 10**300
    if origin is Mapping or (isinstance(hint, type) and issubclass(hint, Keyed)):
        return isinstance(value, dict)
    if origin in (Sequence, tuple, np.ndarray):
        return isinstance(value, list)
    if hint in (int, str, bool, NoneType):
        return type(value) is hint
    return True
