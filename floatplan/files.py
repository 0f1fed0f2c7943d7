"""Files: JSON read strictly, plain data, and files that are written whole or not at all."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from floatplan.errors import InputError


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises
    ------
    InputError
        The file is missing, is not JSON, or gives a key twice in one object.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_single_keys)
    except InputError as error:
        raise error.within(source=path) from None
    except FileNotFoundError:
        raise InputError("no such file", source=path) from None
    except IsADirectoryError:
        raise InputError("is a directory", source=path, advice="name its plan.json") from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=path) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}", source=path) from None


def check_finite(content: Any, element: str = "") -> None:
    """Refuse numbers in nested mappings and sequences that are not finite, or too large for a double.

    Raises
    ------
    InputError
        Its element is the path of the first such number.
    """
    if hasattr(content, "tolist"):
        content = content.tolist()
    if isinstance(content, Mapping):
        for key, item in content.items():
            check_finite(item, f"{element}.{key}".lstrip("."))
    elif isinstance(content, list | tuple):
        for index, item in enumerate(content):
            check_finite(item, f"{element}[{index}]")
    elif isinstance(content, int | float) and not _is_finite(content):
        raise InputError(f"is not finite: {_shown(content)}", element=element, advice="give a finite number")


def plain(value: Any) -> Any:
    """Turn arrays, tuples and mappings into what JSON holds; numbers that are not finite become ``None``."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_atomically(path: str | Path, content: str | bytes) -> Path:
    """Write to a temporary name beside ``path`` and rename, so that nobody ever sees half a file."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
        mask = os.umask(0)
        os.umask(mask)
        Path(temporary).chmod(0o666 & ~mask)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return path


def _single_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError("is given twice in one object", element=twice, advice="keep one of them")
    return content


def _is_finite(number: float) -> bool:
    try:
        return math.isfinite(number)
    except OverflowError:  # an integer beyond all doubles
        return False


def _shown(number: float) -> str:
    return json.dumps(number) if isinstance(number, float) else f"an integer of {number.bit_length()} bits"
