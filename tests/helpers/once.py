"""What takes long to make, made once in all processes of the tests."""

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

from filelock import FileLock

folder = Path()  # of all processes; set when they begin
_made: dict[str, Any] = {}


def made_once(name: str, make: Callable[[], Any]) -> Any:
    """Return what ``make`` returns: from memory, or as another process left it, or made now and left for the others."""
    if name not in _made:
        path = folder / "made" / f"{name}.pickle"
        path.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(path.with_suffix(".lock")):  # who comes while it is made waits for it
            if path.is_file():
                _made[name] = pickle.loads(path.read_bytes())
            else:
                _made[name] = make()
                new = path.with_suffix(".new")
                new.write_bytes(pickle.dumps(_made[name]))
                os.rename(new, path)  # noqa: PTH104 - not as floatplan does it, which tests spoil
    return _made[name]
