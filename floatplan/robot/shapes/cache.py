"""Cache on disk of the capsules around meshes: fitting them takes longer than checking that they fit.

Entries are not trusted: one is used only where its capsules hold the mesh as it is now.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.errors import InputError
from floatplan.files import read_text, write_atomically
from floatplan.robot.shapes.capsules import MOST_SPLITS, Cut, Fit, Outline, PlaneCapsule, fit
from floatplan.robot.shapes.meshes import Mesh
from floatplan.robot.shapes.outlines import MeshUse

VERSION = 3  # [-] of the fit: raised with a change of its results, so that older entries are not used
LARGEST_ENTRY = 10_000  # [bytes] of a file
LARGEST_NUMBER = 1e4  # [m] coordinate or radius
UNIT = 1e-14  # [-] by which the length of a direction may be off one


def mesh_capsules(use: MeshUse, mesh: Mesh) -> list[PlaneCapsule]:
    """Return the capsules around a mesh in the plane, from the cache where it has some that fit the mesh."""
    outline = Outline(mesh.corners @ use.projection.row, mesh.edges)
    entry = cache_folder() / f"{_key(use, mesh)}.json"
    fitted = None
    with contextlib.suppress(ValueError, TypeError, KeyError, RecursionError):  # missing, damaged or forged
        fitted = _fit(json.loads(read_text(entry, LARGEST_ENTRY, "a cache entry")), MOST_SPLITS)
    if fitted is None or not fitted.is_of(outline):
        fitted = fit(outline)
        with contextlib.suppress(OSError, InputError):  # where it cannot be written, fitting is repeated the next time
            write_atomically(entry, json.dumps(_content(fitted)))
    shift = use.projection.shift
    return [PlaneCapsule(capsule.start + shift, capsule.end + shift, capsule.radius) for capsule in fitted.capsules]


def cache_folder() -> Path:
    """Folder of the cache: below ``XDG_CACHE_HOME``, or ``.cache`` in the home folder."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "floatplan" / "capsules"


def _key(use: MeshUse, mesh: Mesh) -> str:
    """Digest of all that the capsules depend on; the shift is left out, as they move with it."""
    digest = hashlib.sha256(f"{VERSION} {mesh.sha256} {use.path.suffix.lower()}".encode())
    digest.update(np.ascontiguousarray(use.scale).tobytes())
    digest.update((np.round(use.projection.row, 12) + 0.0).tobytes())
    return digest.hexdigest()


def _fit(content: Any, splits: int) -> Fit:
    """What :func:`_content` made, with no more splits than these."""
    if isinstance(content, list):
        a, b, c, d, radius = _numbers(content, 5)
        if radius < 0.0:
            raise ValueError("a radius is negative")
        return Fit(PlaneCapsule(complex(a, b), complex(c, d), radius))
    x, y, level = _numbers(content["line"], 3)
    if splits == 0 or abs(math.hypot(x, y) - 1.0) > UNIT:
        raise ValueError("a line has no direction, or there are too many of them")
    return Fit(None, Cut(complex(x, y), level), tuple(_fit(part, splits - 1) for part in content["parts"]))


def _numbers(content: Any, count: int) -> list[float]:
    numbers = [float(number) for number in content]
    if len(numbers) != count or not all(abs(number) <= LARGEST_NUMBER for number in numbers):
        raise ValueError("a number is missing, or no coordinate of a robot's")
    return numbers


def _content(fitted: Fit) -> Any:
    if fitted.line is not None:
        direction, level = fitted.line.direction, fitted.line.level
        parts = [_content(part) for part in fitted.parts]
        return {"line": [direction.real, direction.imag, level], "parts": parts}
    return [n for c in fitted.capsules for n in (c.start.real, c.start.imag, c.end.real, c.end.imag, c.radius)]
