"""Single values of a URDF: an element of which there is one, a finite number, three numbers."""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError

LARGEST = 1e9  # [SI] above every mass, inertia, length or angle; larger numbers overflow when squared twice


def only(place: str, element: Element, tag: str) -> Element | None:
    """The child of ``element`` called ``tag``, None where there is none, an error where there are several."""
    children = element.findall(tag)
    if len(children) > 1:
        raise InputError(f"has {len(children)} <{tag}> elements, where one is allowed", element=place)
    return children[0] if children else None


def number(place: str, element: Element, key: str, default: float | None) -> float:
    """A finite number from attribute ``key``; ``default`` where it is left out, an error if that is None."""
    text = element.get(key)
    if text is None:
        if default is None:
            raise InputError(f"has no {key}", element=place)
        return default
    return _finite(f"{place}: {key}", text)


def limit(place: str, element: Element, key: str) -> float:
    """A limit from attribute ``key``, 0 where it is left out; it may be infinite."""
    return _number(f"{place}: {key}", element.get(key, "0"))


def triple(place: str, element: Element | None, key: str, default: tuple[float, float, float]) -> Array:
    """Three finite numbers from attribute ``key``; ``default`` where it or the element is left out."""
    text = None if element is None else element.get(key)
    if text is None:
        return read_only(default)
    parts = text.split()
    if len(parts) != 3:
        raise InputError(f'must be three numbers, not "{text}"', element=place)
    return read_only([_finite(place, part) for part in parts])


def _finite(place: str, text: str) -> float:
    value = _number(place, text)
    if math.isinf(value):
        raise InputError(f'must be a finite number, not "{text.strip()}"', element=place)
    if abs(value) > LARGEST:
        raise InputError(f'is larger than any robot\'s: "{text.strip()}"', element=place)
    return value


def _number(place: str, text: str) -> float:
    try:
        value = math.nan if "_" in text else float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise InputError(f'must be a number, not "{text}"', element=place)
    return value
