"""Recorded motions spoiled at random, in every format, and the command that meets them."""

import io
import pickle
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import clip_samples as samples
import numpy as np
from fuzz_mutations import MOST_MUTATIONS, NUMBERS, TEXTS, spoiled_bytes

FPS = 50.0
SHAPES: tuple[tuple[int, ...], ...] = ((), (0,), (1,), (0, 0), (1, 4), (3, 3, 3), (100, 1), (2, 0, 5))
TYPES = ("float32", "int8", "uint64", "complex128", "bool", "datetime64[s]", "U3", "S2")


def prepare_clip(rng: random.Random, folder: Path) -> list[str]:
    """Write a robot and a spoiled motion of it, and return the arguments of a command that reads both."""
    (folder / "hopper.urdf").write_text(samples.robot_text(), encoding="utf-8")
    motion = samples.hops(FPS, (0.3,), gravity=rng.choice([9.81, 7.0]))
    files = samples.write_all(motion, folder)
    path = files[rng.choice(sorted(files))]
    path.write_bytes(_spoiled(rng, path))
    command = rng.choice(("check", "check", "repair"))
    arguments = ["clip", command, str(path), "--model", str(folder / "hopper.urdf")]
    arguments += rng.choice(([], ["--json"], ["--fps", "50"], ["--ground", "0"], ["--feet", "l_shank,r_shank"]))
    return arguments


def _spoiled(rng: random.Random, path: Path) -> bytes:
    content = path.read_bytes()
    if rng.random() < 0.3:
        return spoiled_bytes(rng, content)
    return _SPOILERS[path.suffix](rng, content)


def _csv(rng: random.Random, content: bytes) -> bytes:
    """Change some numbers of the table, or whole rows and columns of it."""
    rows = [line.split(",") for line in content.decode().splitlines()]
    for _ in range(rng.randint(1, MOST_MUTATIONS)):
        row = rng.randrange(len(rows))
        action = rng.random()
        if action < 0.6:
            column = rng.randrange(len(rows[row]) or 1)
            rows[row][column : column + 1] = [str(rng.choice([*NUMBERS, *TEXTS]))]
        elif action < 0.7:
            rows = [each[:-1] for each in rows]
        elif action < 0.8:
            rows = [[*each, "0"] for each in rows]
        elif action < 0.9:
            rows[row] = []
        else:
            rows = rows[: max(row, 1)]
    return "\n".join(",".join(row) for row in rows).encode("utf-8", "replace")


def _mapping(rng: random.Random, data: dict[str, Any]) -> dict[str, Any]:
    """Change some values of a file's mapping of names to arrays, or the names."""
    for _ in range(rng.randint(1, MOST_MUTATIONS)):
        if not data:
            return data
        key = rng.choice(sorted(data))
        action = rng.random()
        if action < 0.15:
            del data[key]
        elif action < 0.25:
            data[rng.choice(["", "x", key + "s", "n" * 400])] = data.pop(key)
        elif action < 0.35:
            data[key] = rng.choice([*NUMBERS[:-1], *TEXTS])
        else:
            data[key] = _array(rng, np.array(data[key]))
    return data


def _array(rng: random.Random, old: np.ndarray[Any, Any]) -> Any:
    """An array in place of another: of another shape or type, or with another number in it."""
    action = rng.random()
    if action < 0.2:
        return np.zeros(rng.choice(SHAPES))
    if action < 0.35:
        return np.zeros(old.shape, rng.choice(TYPES))
    if action < 0.5 and old.ndim:
        return old[: rng.randrange(len(old) + 1)]
    if action < 0.6 and old.ndim > 1:
        return old[..., :-1]
    if action < 0.7 and old.dtype.kind == "f":
        with np.errstate(all="ignore"):
            return old * rng.choice([0.0, -1.0, 57.3, 1e6, 1e200])
    changed = np.array(old, np.float64) if old.dtype.kind in "fiub" else np.array(old)
    if changed.size and changed.dtype.kind == "f":
        changed.flat[rng.randrange(changed.size)] = rng.choice(NUMBERS[:-1])
    return changed


def _archive(rng: random.Random, content: bytes) -> bytes:
    with np.load(io.BytesIO(content)) as archive:
        data = _mapping(rng, {key: archive[key] for key in archive.files})
    stream = io.BytesIO()
    np.savez(stream, **{key or "none": value for key, value in data.items()})
    return stream.getvalue()


def _pickle(rng: random.Random, content: bytes) -> bytes:
    return pickle.dumps(_mapping(rng, pickle.loads(content)), protocol=rng.randint(0, pickle.HIGHEST_PROTOCOL))


_SPOILERS: dict[str, Callable[[random.Random, bytes], bytes]] = {".csv": _csv, ".npz": _archive, ".pkl": _pickle}
