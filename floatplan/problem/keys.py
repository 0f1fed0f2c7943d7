"""What the keys of problem files are: each a field of a part of a problem, recorded once.

Checks of parts, tables of files, their JSON Schema and the reference of keys are made from the record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin, get_type_hints

from floatplan.arguments import Check, Checked, by_joint, by_name, made, number, one_of, optional, pair, text
from floatplan.tables import RANGES

ANGLE = "rad or deg"
RATE = "rad/s or deg/s"
ACCELERATION = "rad/s^2 or deg/s^2"


@dataclass(frozen=True)
class Key:
    """A key, as metadata of its field's type.

    Attributes
    ----------
    meaning : for a person
    unit : empty where it has none; angles are in the file's unit
    numbers : range of its numbers, by its key in :data:`floatplan.tables.RANGES`; that of its own name if left out, and
        of a pair without one that of a place
    check : of the field of a part, where its type and its numbers do not say all
    """

    meaning: str
    unit: str = ""
    numbers: str = ""
    check: Check | None = None


class Keyed(Checked):
    """A part of a problem, whose annotated fields are the keys of its table in problem files."""

    keys: ClassVar[Mapping[str, Key]]

    def __init_subclass__(cls) -> None:
        """Gather the keys, and make the checks of the fields."""
        hints = get_type_hints(cls, include_extras=True)
        noted = {name: get_args(hint) for name, hint in hints.items() if get_origin(hint) is Annotated}
        cls.keys = {name: key for name, (_, key) in noted.items() if isinstance(key, Key)}
        made_of = {name: key.check or _check(noted[name][0], key.numbers or name) for name, key in cls.keys.items()}
        cls.checks = made_of | {name: check for name, (_, check) in noted.items() if name not in made_of}


def _check(hint: Any, numbers: str) -> Check:
    """The check of what has a type, by the range of its numbers."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint is float:
        return number(numbers)
    if hint is str:
        return text
    if origin is Literal:
        return one_of(*inner)
    if origin in (tuple, Sequence):
        return pair(_check(inner[0], numbers if numbers in RANGES else "place"))
    if origin is Mapping:
        return by_name(_check(inner[1], numbers))
    if origin not in (Union, UnionType):
        return made(hint)
    if NoneType in inner:
        return optional(_check(inner[0], numbers))
    words = [word for kind in inner if get_origin(kind) is Literal for word in get_args(kind)]
    entry = number(numbers, infinite="none" in words)
    lists = [kind for kind in inner if get_origin(kind) is Sequence]
    if not lists:
        return one_of(*words, or_number=entry)
    single = float in inner
    return by_joint(entry if single else _check(get_args(lists[0])[0], numbers), *words, single=single)
