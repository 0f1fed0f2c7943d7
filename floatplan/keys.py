"""Records of keys: what a table of a file may hold is the fields of a dataclass, each written once with its key.

Checks of the fields, reading, refusals, JSON Schema 2020-12 and the reference of keys are made from the record.
"""

from __future__ import annotations

import difflib
import math
import re
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from functools import cache
from inspect import cleandoc, get_annotations
from types import MappingProxyType, NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, TypeVar, Union, get_args, get_origin

import numpy as np

from floatplan import arguments
from floatplan.arguments import Check, Checked, either
from floatplan.errors import InputError, refuse
from floatplan.tables import RANGES, Key, Range

SHAPES: Mapping[Any, Any] = {Mapping: Mapping, Sequence: (list, tuple), Literal: str}  # by the origin of a type
NAMES = {str: "a text", (list, tuple): "a list"}
ORIGINS: Mapping[Any, Any] = {dict: Mapping, list: Sequence}  # of types, by those of values in files
STEPS: Mapping[Any, str] = {Mapping: ".*", Sequence: "[]"}  # to what is inside, by the origin of a type
PARAMETERS = "Parameters\n----------"  # the head of a docstring's section
JSON_TYPES = {float: "number", int: "integer", str: "string", bool: "boolean"}

Table = TypeVar("Table", bound="Keyed")


KIND = Key("Which kind it is")  # of a table that stands for one of several classes


def in_files(name: str) -> str:
    """The key of a field: without the underscore of a name that is a word of Python."""
    return name.rstrip("_")


class Keyed(Checked):
    """A dataclass whose annotated fields are the keys of a table in files.

    Attributes
    ----------
    keys : by the fields' names
    hints : the fields' types
    kinds : of a base class, the classes that its table may stand for, by the table's ``kind``
    kind : of such a class
    about : what the table is about, where its key does not say it
    """

    keys: ClassVar[Mapping[str, Key]]
    hints: ClassVar[Mapping[str, Any]]
    kinds: ClassVar[Mapping[str, type[Keyed]]]
    kind: ClassVar[str]
    about: ClassVar[str]

    def __init_subclass__(cls) -> None:
        """Gather the keys, and make the checks of the fields."""
        documented: dict[str, str] = {}
        for base in reversed(cls.__mro__):
            documented |= _parameters(base)
        keys: dict[str, Key] = {}
        stated: dict[str, str] = {}
        own_hints = {}
        checks_of_keys = {}
        other_checks = {}
        annotated: dict[str, Any] = {}
        for base in reversed(cls.__mro__):
            annotated |= _annotated(base)
        for name, hint in annotated.items():
            kind, note = get_args(hint)
            if isinstance(note, Key):
                keys[name] = replace(note, meaning=_meaning(note.meaning, documented.get(name, "")))
                stated[name] = note.meaning
                own_hints[name] = kind
                checks_of_keys[name] = note.check or _check(kind, note.numbers or name)
            else:
                other_checks[name] = note
        cls.keys = keys
        cls.hints = own_hints
        cls.checks = checks_of_keys | other_checks
        if cls.__doc__ and cls.keys:
            docstring = cleandoc(cls.__doc__)
            is_listed = PARAMETERS in docstring
            cls.__doc__ = _with_meanings(docstring, stated) if is_listed else _with_parameters(docstring, cls.keys)

    @classmethod
    def keyed_fields(cls) -> list[tuple[Field[Any], Key]]:
        """The fields that have a key, with it."""
        return [(row, cls.keys[row.name]) for row in fields(cls) if row.name in cls.keys]  # type: ignore[arg-type]


@cache
def _annotated(of: type) -> Mapping[str, Any]:
    """The annotations of a class itself that are ``Annotated``; those of its bases are theirs, read once for all."""
    annotations: dict[str, Any] = get_annotations(of, eval_str=True)
    return {name: hint for name, hint in annotations.items() if get_origin(hint) is Annotated}


def _meaning(stated: str, documented: str) -> str:
    """What a key's row states and a docstring goes on with; that of a base class has the former already."""
    if not stated or not documented:
        return stated or documented
    return documented if documented.startswith(stated) else f"{stated}. {documented}"


def _with_meanings(docstring: str, stated: Mapping[str, str]) -> str:
    """A docstring with what the rows of keys state, each at the head of its parameter's paragraph."""
    lines: list[str] = []
    for line in docstring.splitlines():
        lines.append(line)
        meaning = stated.get(line.partition(" : ")[0])
        if meaning:
            lines.append(f"    {meaning.replace('`', '``')}.")
    return "\n".join(lines)


def _with_parameters(docstring: str, keys: Mapping[str, Key]) -> str:
    """A docstring without parameters, and those that its keys describe."""
    lines: list[str] = []
    for name, key in keys.items():
        unit = f" : {key.unit}".replace(" or deg", "") if key.unit else ""
        lines.append(f"{name}{unit}\n    {key.meaning}.")
    return "\n".join([f"{docstring}\n\n{PARAMETERS}", *lines])


def _parameters(of: type) -> dict[str, str]:
    """What a docstring says of each parameter, without the full stop at the end."""
    docstring = cleandoc(vars(of).get("__doc__") or "").partition(f"{PARAMETERS}\n")[2]
    entries = re.findall(r"^(\w+) : .*\n((?: {4}.*(?:\n|$))+)", docstring.partition("\n\n")[0], re.MULTILINE)
    return {name: " ".join(text.split()).rstrip(".").replace("``", "`") for name, text in entries}


def is_needed(of: Field[Any]) -> bool:
    """Whether a field has no default."""
    return of.default is MISSING and of.default_factory is MISSING


def _check(hint: Any, numbers: str | Range) -> Check:
    """The check of what has a type, by the range of its numbers."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in (float, int):
        allowed = RANGES[numbers] if isinstance(numbers, str) else numbers
        return arguments.number(allowed) if hint is float else arguments.whole(allowed)
    if hint in (str, bool):
        return arguments.text if hint is str else arguments.flag
    if origin is Literal:
        return arguments.one_of(*inner)
    if origin is tuple and inner[-1] is not ...:
        if str in inner:
            return arguments.pair(arguments.text, "texts", len(inner))
        return arguments.pair(_check(float, numbers if numbers in RANGES else "place"), count=len(inner))
    if origin in (tuple, Sequence):
        return arguments.many(_check(entry_of(hint), numbers), "entries")
    if origin is Mapping:
        return arguments.by_name(_check(entry_of(hint), numbers))
    if origin not in (Union, UnionType):
        return arguments.made(hint)
    if NoneType in inner:
        kinds = tuple(kind for kind in inner if kind is not NoneType)
        return arguments.optional(_check(Union[kinds], numbers))  # noqa: UP007
    words: list[str] = []
    for kind in inner:
        words += get_args(kind) if get_origin(kind) is Literal else ()
    lists = [kind for kind in inner if get_origin(kind) is Sequence]
    if not (lists or float in inner) or any(map(_is_table, inner)):
        return _any_of(inner, numbers)
    entry = arguments.number(RANGES[numbers] if isinstance(numbers, str) else numbers, infinite="none" in words)
    if not lists:
        is_named = any(get_origin(kind) is Mapping for kind in inner)
        return arguments.for_all(entry) if is_named else arguments.one_of(*words, or_number=entry)
    single = float in inner
    return arguments.by_joint(entry if single else _check(entry_of(lists[0]), numbers), *words, single=single)


def _any_of(kinds: Sequence[Any], numbers: str | Range) -> Check:
    """The check of what has one of several types, distinguished by their shapes."""
    checks: dict[Any, Check] = {}
    names: list[str] = []
    for kind in kinds:
        shape = SHAPES.get(get_origin(kind), kind)
        checks[shape] = _check(kind, numbers)
        names += map(repr, get_args(kind)) if get_origin(kind) is Literal else [NAMES.get(shape, "a table")]

    def check(value: Any, element: str) -> Any:
        for shape, check in checks.items():
            if isinstance(value, shape):
                return check(value, element)
        raise InputError(f"{value!r} is not {either(names)}", element=element)

    return check


def entry_of(hint: Any) -> Any:
    """The type of what is in a table or a list: numbers there are two, as of a range."""
    entry = get_args(hint)[1 if get_origin(hint) is Mapping else 0]
    return tuple[float, float] if entry == Sequence[float] else entry


@dataclass
class Reader:
    """Makes parts of what files hold: numbers as they are in Python, tables as the parts that they describe.

    Attributes
    ----------
    degrees : whether the angles in the file are in degrees
    whole : of what the file's outermost table is, if it has one: errors about unknown keys of other tables say where
    errors : what tables lack, and what is too much in them; the fields are checked by :meth:`Checked.faults`
    """

    degrees: bool = False
    whole: type[Keyed] | None = None
    errors: list[InputError] = field(default_factory=list)

    def table(self, kind: type[Table], content: Any, path: str = "") -> Table | Any:
        """Return the dataclass that a table describes, its fields not checked; ``MISSING`` for what has to be given."""
        kinds: Mapping[str, Any] | None = vars(kind).get("kinds")
        if kinds is not None:
            name = content.get("kind") if isinstance(content, Mapping) else None
            if not isinstance(name, str) or name not in kinds:
                return self._missing(f"{content!r} is not a table with kind = {either(map(repr, kinds))}", path)
            kind = kinds[name]
            content = arguments.without(content, ("kind",))
        if not isinstance(content, Mapping):
            return self._missing(f"{content!r} is not a table", path)
        inside = f"{path}." if path else ""
        names = set()
        values = {}
        for row, about in kind.keyed_fields():
            key = in_files(row.name)
            names.add(key)
            if key in content:
                values[row.name] = self._value(kind.hints[row.name], content[key], about, inside + key)
            elif is_needed(row):
                self._missing("is missing", inside + key)
        for key in arguments.without(content, names):
            self.errors.append(InputError("unknown key", element=inside + key, advice=self._instead_of(key, names)))
        return kind.unchecked(**values)

    def _instead_of(self, key: str, names: Collection[str]) -> str:
        """Advice on an unknown key: where it belongs in the file, which key may be meant, or which there are."""
        close = difflib.get_close_matches(key, names, n=1)
        homes = [] if self.whole is None else homes_of(key, self.whole)
        belongs = f"{key} belongs {' or '.join(homes[:3])}"
        if close:
            meant = f"did you mean {close[0]!r}?"
            return f"{meant} {belongs}" if homes else meant
        return belongs if homes else f"known are {', '.join(sorted(names))}"

    def _missing(self, reason: str, path: str) -> Any:
        self.errors.append(InputError(reason, element=path))
        return MISSING

    def _value(self, hint: Any, value: Any, key: Key, path: str) -> Any:
        """What a field gets for the value of its key; ``None`` and "none" in a list are no limit."""
        origin, inner = get_origin(hint), get_args(hint)
        if origin in (Union, UnionType):
            kinds = [kind for kind in inner if kind is not NoneType]
            fitting = kinds[0] if len(kinds) == 1 else _kind_of(value, kinds)
            if fitting is not None and value is not None:
                value = self._value(fitting, value, key, path)
            if isinstance(value, list) and any("none" in get_args(kind) for kind in kinds):
                return [math.inf if entry in (None, "none") else entry for entry in value]
            return value
        if _is_table(hint):
            return self.table(hint, value, path)
        if origin is Mapping and isinstance(value, dict):
            return {name: self._value(inner[1], entry, key, f"{path}.{name}") for name, entry in value.items()}
        if origin in (Sequence, tuple) and isinstance(value, list):
            return [self._value(inner[0], entry, key, f"{path}[{index}]") for index, entry in enumerate(value)]
        if hint is not float or type(value) not in (int, float):
            return value  # as its check sees it
        if not abs(value) <= sys.float_info.max:
            self._missing(f"{value!r} is not a finite number", path)
            return value
        return math.radians(value) if self.degrees and " or deg" in key.unit else float(value)


def read_tables(kind: type[Table], content: Mapping[str, Any], wrong: list[InputError] | None = None) -> Table:
    """Return the tables of a file, whose ``angles`` say in what they are.

    Raises
    ------
    InputError
        All that is wrong with them, each with its path; where they are complete, wrong fields go into ``wrong``
        instead if there is one.
    """
    reader = Reader(degrees=content.get("angles") == "deg", whole=kind)
    tables = reader.table(kind, content)
    faults = tables.faults()
    if wrong is None or reader.errors or any(fault.element == "angles" for fault in faults):
        refuse([*reader.errors, *faults])
    else:
        wrong += faults
    return tables


def table_of(record: Keyed) -> dict[str, Any]:
    """Return the table that describes a dataclass, as data in rad: what :class:`Reader` makes the same dataclass of."""
    kind = {"kind": record.kind} if hasattr(record, "kind") else {}
    values = {in_files(name): _written(getattr(record, name)) for name in record.keys}
    return {**kind, **arguments.without_none(values)}


def _written(value: Any) -> Any:
    if isinstance(value, Keyed):
        return table_of(value)
    if isinstance(value, Mapping):  # what it leaves out has no limit
        written = {}
        for name, entry in value.items():
            if entry != math.inf:
                written[name] = _written(entry)
        return written
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return list(map(_written, value))
    return "none" if value == math.inf else value


def _kind_of(value: Any, kinds: Sequence[Any]) -> Any:
    """The first of several types that a value of a file has the shape of; None where it fits none."""
    shape = ORIGINS.get(type(value))
    for kind in kinds:
        if shape is None and kind is float:
            return kind
        if shape is not None and (get_origin(kind) is shape or (shape is Mapping and _is_table(kind))):
            return kind
    return None


def _is_table(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, Keyed)


def tables(kind: type[Keyed], path: str = "") -> dict[str, tuple[type[Keyed], str]]:
    """Return the tables inside that of a dataclass by their paths, each with what it is about.

    The entries of a table of tables are at ``*``, those of a list at ``[]``, or at ``[kind]`` where they have kinds.
    """
    inner_tables: dict[str, tuple[type[Keyed], str]] = {}
    for name, key in kind.keys.items():
        for inner, inside in _tables_in(kind.hints[name], f"{path}.{in_files(name)}".lstrip(".")):
            for name_of_kind, choice in vars(inner).get("kinds", {}).items():
                of_kind = f"{inside.removesuffix('[]')}[{name_of_kind}]"
                if of_kind in inner_tables:  # one kind may be of two classes: in a plane and in space
                    of_kind = of_kind.replace("]", " in space]")
                inner_tables[of_kind] = choice, choice.about
            if "kinds" not in vars(inner):
                inner_tables |= {inside: (inner, getattr(inner, "about", key.meaning)), **tables(inner, inside)}
    return inner_tables


def homes_of(key: str, whole: type[Keyed]) -> list[str]:
    """Where a key stands in files that hold such a table, in words for a person."""
    homes = ["at the top of the file, before every table"] if key in map(in_files, whole.keys) else []
    for path, (kind, _) in tables(whole).items():
        if "*" not in path and key in map(in_files, kind.keys):
            name = path.partition("[")[0]
            homes.append(f"in [[{name}]]" if "[" in path else f"in [{name}]")
    return list(dict.fromkeys(homes))


def _tables_in(hint: Any, path: str) -> Iterator[tuple[type[Keyed], str]]:
    """Dataclasses with keys in a type, each with its path."""
    if _is_table(hint):
        yield hint, path
    inside = path + STEPS.get(get_origin(hint), "")
    for inner in get_args(hint):
        yield from _tables_in(inner, inside)


def json_schema(kind: type[Keyed], title: str, about: str) -> dict[str, Any]:
    """Return the JSON Schema of files that hold such a table; angles have no range, since a file chooses their unit."""
    inner = reversed(tables(kind).values())  # where one occurs twice, the first says what it is
    definitions = {f"{table.__name__}Table": _table(table, meaning) for table, meaning in inner}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$defs": definitions,
        **_table(kind, about),
        "title": title,
    }


def _table(kind: type[Keyed], about: str) -> dict[str, Any]:
    properties: dict[str, Any] = {}
    if hasattr(kind, "kind"):
        properties["kind"] = {"const": kind.kind, "description": KIND.meaning}
    needed = list(properties)
    for row, key in kind.keyed_fields():
        name = in_files(row.name)
        limits = key.bounds(row.name)
        bounds: dict[str, float] = {}
        if limits is not None:
            bounds |= {"minimum": limits.low} if math.isfinite(limits.low) else {}
            bounds |= {"maximum": limits.high} if math.isfinite(limits.high) else {}
        properties[name] = {**_form(kind.hints[row.name], bounds), "description": key.about}
        if is_needed(row):
            needed.append(name)
        elif isinstance(row.default, str | float | int | tuple):
            properties[name]["default"] = list(row.default) if isinstance(row.default, tuple) else row.default
    schema = {"type": "object", "description": about, "additionalProperties": False, "properties": properties}
    return {**schema, "required": needed} if needed else schema


def _form(hint: Any, bounds: Mapping[str, float] = MappingProxyType({})) -> dict[str, Any]:
    """The JSON Schema of what has a type; ``bounds`` are those of a number."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in JSON_TYPES:
        return {"type": JSON_TYPES[hint], **(bounds if hint in (float, int) else {})}
    if _is_table(hint):
        links = [{"$ref": f"#/$defs/{table.__name__}Table"} for table in vars(hint).get("kinds", {"": hint}).values()]
        return links[0] if len(links) == 1 else {"oneOf": links}
    if origin is Literal:
        return {"const": inner[0]} if len(inner) == 1 else {"enum": list(inner)}
    if origin is tuple and inner[-1] is not ...:
        return {"type": "array", "prefixItems": list(map(_form, inner)), "minItems": len(inner), "maxItems": len(inner)}
    if origin is Mapping:
        return {"type": "object", "additionalProperties": _form(entry_of(hint))}
    if origin in (Sequence, tuple):
        return {"type": "array", "items": _form(entry_of(hint))}
    forms = [_form(kind, bounds) for kind in inner if kind is not NoneType and get_origin(kind) is not np.ndarray]
    if any("none" in form.get("enum", (form.get("const"),)) for form in forms):
        for form in forms:
            if "items" in form:
                form["items"] = {"anyOf": [form["items"], {"const": "none"}]}
    return forms[0] if len(forms) == 1 else {"anyOf": forms}
