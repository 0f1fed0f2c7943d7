"""Mesh files of ``<collision>`` elements: where they are, and their corners and edges."""

from __future__ import annotations

import hashlib
import io
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError
from floatplan.files import is_file, read_regular

KINDS = ("stl", "obj", "dae", "ply", "off", "glb", "gltf")  # not archives: a small one can hold gigabytes
LARGEST_MESH = 100_000_000  # [bytes]
LARGEST = 1e3  # [m] farther from its link's frame no corner of a robot is
FAULT_IN_COLLADA = re.compile(rb"<(?:\w+:)?(?:float_array[^>]*>[^<]*\bnan\b|p>[^<]*-)", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh: corners (k, 3) in m, edges (e, 2) between them, and the SHA-256 of the file."""

    corners: Array
    edges: IntArray
    sha256: str


def find_mesh(filename: str, folder: Path) -> Path | None:
    """Return the file that a URDF in ``folder`` means by ``filename``, None where there is none.

    ``package://name/rest`` is searched in the folders above the URDF and below ``ROS_PACKAGE_PATH`` and
    ``AMENT_PREFIX_PATH``; anything else is a path, absolute or from the URDF.
    """
    return next((path for path in map(Path, _candidates(filename, folder.absolute())) if is_file(path)), None)


def mesh_digest(path: Path, element: str) -> str:
    """Return the SHA-256 of a mesh file.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    return hashlib.sha256(_content(path, element)).hexdigest()


def check_mesh_file(path: Path, element: str) -> None:
    """Refuse, before any other program reads it, a file that is too large or of a kind that is no mesh.

    Raises
    ------
    InputError
        Its name ends as no mesh's does, or it is larger than ``LARGEST_MESH``.
    """
    kind = path.suffix.lower().lstrip(".")
    if kind not in KINDS:
        raise InputError(f'".{kind}" is not one of {", ".join(KINDS)}', source=path, element=element)
    if path.stat().st_size > LARGEST_MESH:
        raise InputError(f"is larger than {LARGEST_MESH // 1_000_000} MB, as no mesh is", source=path, element=element)


def load_mesh(path: Path, scale: Array, element: str) -> Mesh:
    """Read a mesh file, every part of it: a part that cannot be read is an error.

    Parameters
    ----------
    path : path
    scale : (3,)
        Of the file's units along its axes.
    element : str
        What error messages name as the place in the URDF.

    Raises
    ------
    InputError
        If the file is not a mesh, has no faces, faces without corners, or corners that are not finite or farther away
        than any robot is large.
    """
    content = _content(path, element)
    try:
        corners, faces = _corners_and_faces(content, path.suffix.lower().lstrip("."))
    except Exception as error:  # the readers of trimesh raise exceptions of any kind
        raise InputError(f"cannot be read as a mesh: {error}", source=path, element=element) from None
    reason = _fault(corners, faces, scale)
    if reason:
        raise InputError(reason, source=path, element=element, advice="repair the mesh, or remove the <collision>")
    used, numbers = np.unique(faces, return_inverse=True)
    places, merged = _merged(corners[used] * scale)
    return Mesh(places, _edges(merged[numbers.reshape(faces.shape)]), hashlib.sha256(content).hexdigest())


def _content(path: Path, element: str) -> bytes:
    try:
        return read_regular(path, LARGEST_MESH, "a mesh")
    except InputError as error:
        raise error.within(element=element) from None


def _corners_and_faces(content: bytes, kind: str) -> tuple[Array, IntArray]:
    """All corners (k, 3) and faces (f, 3) as they are written: what trimesh calls processing would drop and move some.

    Files that the content refers to are not read: it alone is the mesh.
    """
    import trimesh

    if kind not in KINDS:
        raise ValueError(f'".{kind}" is not one of {", ".join(KINDS)}')
    loaders = trimesh.exchange.load.mesh_loaders
    if kind == "dae" and FAULT_IN_COLLADA.search(content):  # pycollada takes NaN for zero, and -1 for the last corner
        raise ValueError("a number in it is NaN, or a face has a negative corner")
    options = {"ignore_broken": False} if kind == "dae" else {}
    with np.errstate(all="ignore"):
        parsed = loaders[kind](io.BytesIO(content), file_type=kind, **options)
        for part in (parsed, *parsed.get("geometry", {}).values()):
            part |= {"process": False} if "faces" in part else {}
        mesh = trimesh.load_scene(parsed).to_mesh()
        return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


def _fault(corners: Array, faces: IntArray, scale: Array) -> str | None:
    """What is wrong with a mesh, None where nothing is."""
    if not len(faces) or not len(corners):
        return "holds no mesh: it has no faces"
    if corners.shape[1:] != (3,) or faces.shape[1:] != (3,):
        return "has corners that are not three numbers, or faces that are no triangles"
    if faces.min() < 0 or faces.max() >= len(corners):
        return f"has a face with a corner that does not exist, of {len(corners)} corners"
    if not np.isfinite(corners).all():
        return "has a corner that is not finite"
    reach = float(np.abs(corners * scale).max())
    if not reach <= LARGEST:
        return f"has a corner {reach:.3g} m away, farther than any robot is large ({LARGEST:g} m)"
    return None


def _merged(corners: Array) -> tuple[Array, IntArray]:
    """Corners without repetitions, and the number (k,) of each among them; only what is exactly the same is merged."""
    x, y, z = corners.T
    key = x + np.sqrt(2.0) * y + np.sqrt(3.0) * z  # one number per corner, to sort by
    _, first, numbers = np.unique(key, return_index=True, return_inverse=True)
    if (corners[first][numbers] != corners).any():  # two corners have one key by chance
        return corners, np.arange(len(corners))
    return corners[first], numbers


def _edges(faces: IntArray) -> IntArray:
    """Edges (e, 2) of triangles (f, 3), each once."""
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    count = int(ends.max()) + 1
    return np.stack(np.divmod(np.unique(ends[:, 0] * count + ends[:, 1]), count), axis=1)


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
