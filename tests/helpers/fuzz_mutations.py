"""Input files spoiled at random: problem, plan and URDF files, by the seed alone."""

import copy
import json
import random
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import tomli_w

MOST_MUTATIONS = 3
LARGEST_DOUBLE = 10**308  # whole numbers beyond it cannot be multiplied by a fraction

NUMBERS: tuple[Any, ...] = (
    *(0, -0.0, -1, 1, 3, 5e-324, 1e-300, 1e-12, 1e-3, 1e3, 1e6, 1e12, 1e15, 1e100, 1e300, -1e300, 1e308),
    *(float("inf"), float("-inf"), float("nan"), 2**63, 10**400),
)
TEXTS = (
    *("", " ", "urdf", "none", "free", "auto", "../../../../etc/passwd", "/dev/zero"),
    *("example-robot-data:../../etc/passwd", "example-robot-data:no_such_robot", "\x1b[31mred\x1b[0m"),
    *("a\x00b", "line\nbreak", "=cmd|' /C calc'!A0", "{[<&\"'", "\u202e\U0001f938", "x" * 5000),
    "/" + "n" * 300,
)


def _value(rng: random.Random, old: Any) -> Any:
    """Something to stand in the place of an old value."""
    kind = rng.random()
    if isinstance(old, bool) or kind < 0.1:
        return rng.choice([True, False, None, [], {}, [[]], {"": {}}, *TEXTS])
    if isinstance(old, int | float) and kind < 0.4:
        factor = rng.choice([-1, 0, 0.5, 2, 10, 1000, 1e6, 1e12])
        return old * (int(factor) if abs(old) > LARGEST_DOUBLE else factor)
    if isinstance(old, str) and kind < 0.7:
        return rng.choice([*TEXTS, old + rng.choice(TEXTS), old[: len(old) // 2]])
    if isinstance(old, list) and kind < 0.7:
        return rng.choice([old * 2, old[:-1], old[::-1], [old], old * 300])
    return rng.choice(NUMBERS)


def _places(content: Any) -> list[tuple[Any, Any]]:
    """Every key of every table and list: (container, key)."""
    if isinstance(content, dict):
        keys: list[Any] = list(content)
    elif isinstance(content, list):
        keys = list(range(len(content)))
    else:
        return []
    return [place for key in keys for place in ((content, key), *_places(content[key]))]


def _spoil(rng: random.Random, content: dict[str, Any]) -> None:
    """Change one place of nested tables and lists."""
    places = _places(content)
    if not places:
        return
    container, key = rng.choice(places)
    old = container[key]
    action = rng.random()
    if action < 0.65:
        container[key] = _value(rng, old)
    elif action < 0.75:
        del container[key]
    elif action < 0.85 and isinstance(container, dict):
        container[rng.choice(["", "x", "kind", "n" * 400, "\x1b]0;", str(key) + "s"])] = copy.deepcopy(old)
    else:
        other, its_key = rng.choice(places)
        container[key] = copy.deepcopy(other[its_key])


def spoiled_bytes(rng: random.Random, content: bytes) -> bytes:
    """Change some bytes."""
    action, at = rng.random(), rng.randrange(len(content) + 1)
    if action < 0.2:
        return content[:at]
    if action < 0.4:
        return content[:at] + rng.randbytes(rng.choice([1, 3, 50])) + content[at:]
    if action < 0.6:
        return content[:at] + bytes([rng.randrange(256)]) + content[at + 1 :]
    if action < 0.7:
        return b"\xef\xbb\xbf" + content
    if action < 0.8:
        return content.decode("utf-8", "replace").encode("utf-16")
    if action < 0.9:
        return content[:at] + content[at : at + 200] * rng.choice([2, 50]) + content[at:]
    return rng.choice([b"", b"\n", b"[" * 100_000, b"{" * 100_000, b"<a>" * 100_000, rng.randbytes(500)])


def _toml(rng: random.Random, content: bytes) -> bytes:
    tables = tomllib.loads(content.decode("utf-8"))
    for _ in range(rng.randint(1, MOST_MUTATIONS)):
        _spoil(rng, tables)
    try:
        return tomli_w.dumps(tables).encode("utf-8")
    except (TypeError, ValueError):  # what TOML cannot say
        return spoiled_bytes(rng, content)


def _json(rng: random.Random, content: bytes) -> bytes:
    tables = json.loads(content)
    for _ in range(rng.randint(1, MOST_MUTATIONS)):
        _spoil(rng, tables)
    return json.dumps(tables).encode("utf-8")


def _xml(rng: random.Random, content: bytes) -> bytes:
    tree = ElementTree.fromstring(content)
    for _ in range(rng.randint(1, MOST_MUTATIONS)):
        elements = list(tree.iter())
        element = rng.choice(elements)
        action = rng.random()
        if action < 0.6 and element.attrib:
            key = rng.choice(sorted(element.attrib))
            words = element.attrib[key].split() or [""]
            words[rng.randrange(len(words))] = str(rng.choice([*NUMBERS[:-1], *TEXTS]))
            element.attrib[key] = " ".join(words)
        elif action < 0.7 and element.attrib:
            del element.attrib[rng.choice(sorted(element.attrib))]
        elif action < 0.8 and len(element):
            element.remove(rng.choice(list(element)))
        elif action < 0.9 and len(element):
            element.append(copy.deepcopy(rng.choice(list(element))))
        elif action < 0.95:
            element.tag = rng.choice(["link", "joint", "mesh", "box", "robot", "x"])
        else:
            element.append(copy.deepcopy(rng.choice(elements)))
    return ElementTree.tostring(tree).replace(b"\x00", b"").replace(b"\x1b", b"")


_SPOILERS: dict[str, Callable[[random.Random, bytes], bytes]] = {
    ".toml": _toml,
    ".json": _json,
    ".urdf": _xml,
    ".srdf": _xml,
}


def spoiled(rng: random.Random, path: Path) -> bytes:
    """Content of a file of a known kind, spoiled: mostly in its structure, sometimes in its bytes."""
    content = path.read_bytes()
    if rng.random() < 0.15:
        return spoiled_bytes(rng, content)
    return _SPOILERS[path.suffix](rng, content)
