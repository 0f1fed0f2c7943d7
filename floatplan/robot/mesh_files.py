"""Mesh files of ``<collision>`` elements: where they are, and their corners and edges."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError


def find_mesh(filename: str, folder: Path) -> Path | None:
    """Return the file that a URDF in ``folder`` means by ``filename``, None where there is none.

    ``package://name/rest`` is looked for in the folders above the URDF and below ``ROS_PACKAGE_PATH`` and
    ``AMENT_PREFIX_PATH``; anything else is a path, absolute or from the URDF.
    """
    return next((path for path in map(Path, _candidates(filename, folder.absolute())) if path.is_file()), None)


def load_mesh(path: Path, element: str) -> tuple[Array, IntArray]:
    """Return corners (k, 3) and edges (e, 2) of a mesh file, in its own units.

    Raises
    ------
    InputError
        If the file is not a mesh, or an empty one.
    """
    import trimesh

    try:
        mesh = trimesh.load_scene(path).to_mesh()
        corners = np.asarray(mesh.vertices, dtype=np.float64)
        edges = np.asarray(mesh.edges_unique, dtype=np.int64)
    except Exception as error:  # the readers of trimesh raise whatever their formats make them stumble on
        raise InputError(f"cannot be read as a mesh: {error}", source=path, element=element) from None
    if not len(corners) or not np.isfinite(corners).all():
        raise InputError("holds no mesh, or one whose corners are not finite", source=path, element=element)
    return corners, edges


def _candidates(filename: str, folder: Path) -> Iterator[str]:
    if not filename.startswith("package://"):
        path = unquote(urlparse(filename).path) if filename.startswith("file://") else filename
        yield str(folder / path)
        return
    inside = filename.removeprefix("package://").lstrip("/")
    package, _, rest = inside.partition("/")
    for above in (folder, *folder.parents):
        yield f"{above}/{inside}"
        if above.name == package:
            yield f"{above}/{rest}"
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        for root in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield f"{root}/{inside}"
            yield f"{root}/share/{inside}"
