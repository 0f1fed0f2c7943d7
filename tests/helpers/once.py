"""What takes long to make, made once in all processes of the tests."""

from __future__ import annotations

import io
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filelock import FileLock

if TYPE_CHECKING:
    from floatplan import Robot

folder: Path | None = None  # of all processes; set when tests begin, without them nothing is left for others
_made: dict[str, Any] = {}
_robots: dict[tuple[Any, ...], Robot] = {}  # of this process, by what loads them
_asked: dict[int, tuple[Any, ...]] = {}  # what loads them, by their identity


def same_robot(load: Callable[..., Robot], path: Path, source: str, kind: Any, choices: dict[str, Any]) -> Robot:
    """Return what ``load`` returns; where it has loaded the same before, at the same path, that robot once more."""
    asked = (source, kind, pickle.dumps(sorted(choices.items())))
    if (path, *asked) not in _robots:
        robot = load(source, kind, **choices)
        _robots[path, *asked] = robot
        _asked[id(robot)] = asked
    return _robots[path, *asked]


class _Pickler(pickle.Pickler):
    """Leaves such robots out: whoever reads it has his own, or loads it."""

    def persistent_id(self, content: Any) -> tuple[Any, ...] | None:
        return _asked.get(id(content))


class _Unpickler(pickle.Unpickler):
    def persistent_load(self, asked: tuple[Any, ...]) -> Robot:
        from floatplan import Robot

        source, kind, choices = asked
        return Robot.from_file(source, kind, **dict(pickle.loads(choices)))


def made_once(name: str, make: Callable[[], Any]) -> Any:
    """Return what ``make`` returns: from memory, or as another process left it, or made now and left for the others."""
    if name not in _made:
        _made[name] = make() if folder is None else _made_in(folder, name, make)
    return _made[name]


def _made_in(shared: Path, name: str, make: Callable[[], Any]) -> Any:
    path = shared / "made" / f"{name}.pickle"
    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path.with_suffix(".lock")):  # who comes while it is made waits for it
        if path.is_file():
            return _Unpickler(io.BytesIO(path.read_bytes())).load()
        made = make()
        new = path.with_suffix(".new")
        with new.open("wb") as stream:
            _Pickler(stream).dump(made)
        os.rename(new, path)  # noqa: PTH104 - not as floatplan does it, which tests spoil
        return made
