"""Capsules around a mesh, kept on disk: reading and fitting a humanoid's meshes takes seconds."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from pathlib import Path

import numpy as np

from floatplan.robot.capsule_fit import Outline, PlaneCapsule, fit_capsules
from floatplan.robot.mesh_files import load_mesh
from floatplan.robot.outlines import MeshUse

VERSION = 2  # of the fit; a change of its results makes the old ones unfindable


def mesh_capsules(use: MeshUse) -> list[PlaneCapsule]:
    """Return the capsules around a mesh in the plane, from the cache where it has them.

    Raises
    ------
    InputError
        If the file is not a mesh.
    """
    entry = cache_folder() / f"{_key(use)}.json"
    capsules = _recall(entry)
    if capsules is None:
        corners, edges = load_mesh(use.path, use.element)
        capsules = fit_capsules(Outline((corners * use.scale) @ use.projection.row, edges))
        _keep(entry, capsules)
    shift = use.projection.shift
    return [PlaneCapsule(capsule.start + shift, capsule.end + shift, capsule.radius) for capsule in capsules]


def cache_folder() -> Path:
    """Folder of the cache: below ``XDG_CACHE_HOME``, or ``.cache`` in the home folder."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "floatplan" / "capsules"


def _key(use: MeshUse) -> str:
    """Digest of all that the capsules depend on; the shift is left out, as they move with it."""
    digest = hashlib.sha256(use.path.read_bytes())
    digest.update(f"{VERSION} {use.path.suffix.lower()}".encode())
    digest.update(np.ascontiguousarray(use.scale).tobytes())
    digest.update((np.round(use.projection.row, 12) + 0.0).tobytes())
    return digest.hexdigest()


def _recall(entry: Path) -> list[PlaneCapsule] | None:
    """The capsules of a cache entry; None where it is missing or damaged."""
    try:
        rows = np.array(json.loads(entry.read_text()), dtype=np.float64)
    except (OSError, ValueError, TypeError):
        return None
    if rows.ndim != 2 or rows.shape[1] != 5 or not np.isfinite(rows).all() or (rows[:, 4] < 0.0).any():
        return None
    return [PlaneCapsule(complex(a, b), complex(c, d), radius) for a, b, c, d, radius in rows.tolist()]


def _keep(entry: Path, capsules: list[PlaneCapsule]) -> None:
    """Write a cache entry in one step; a folder that cannot be written to is no error, only slower."""
    rows = [[c.start.real, c.start.imag, c.end.real, c.end.imag, c.radius] for c in capsules]
    with contextlib.suppress(OSError):
        entry.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=entry.parent, suffix=".part", delete=False) as file:
            file.write(json.dumps(rows))
        Path(file.name).replace(entry)
