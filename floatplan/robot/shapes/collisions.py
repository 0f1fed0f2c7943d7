"""Geometry of ``<collision>`` elements: mesh files, their corners and edges; projections onto the plane as outlines."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse
from xml.etree.ElementTree import Element

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.errors import InputError
from floatplan.files import is_file, read_regular
from floatplan.robot.shapes.capsules import Outline
from floatplan.robot.urdf.check import read_origin
from floatplan.robot.urdf.tree import number, only, triple

MESH_KINDS = ("stl", "obj", "dae", "ply", "off", "glb", "gltf")  # not archives: a small one can hold gigabytes
LARGEST_MESH = 100_000_000  # [bytes]
LARGEST = 1e3  # [m] farther from its link's frame no corner of a robot is
STL_HEADER = 84  # [bytes] of a binary STL file; the last four are the number of triangles
# the 32 corners of a polygon around the unit disc, which is 0.5 % larger
AROUND = np.exp(2j * np.pi * (np.arange(32) + 0.5) / 32) / np.cos(np.pi / 32)
KINDS = ("sphere", "box", "capsule", "cylinder", "ellipsoid", "mesh")
UNMOVED = complex(-0.0, -0.0)  # [m] a shift that changes nothing, not even the sign of zero
CUBE = np.array(list(product((-0.5, 0.5), repeat=3)))
AXIS = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]])
FLAT = 1e-9  # [-] sine below which an axis counts as in the plane, or along the normal


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh: corners (k, 3) in m, triangles (f, 3) and edges (e, 2) between them, and the SHA-256 of the file."""

    corners: Array
    faces: IntArray
    edges: IntArray
    sha256: str


def find_mesh(filename: str, folder: Path) -> Path | None:
    """Return the file that a URDF in ``folder`` means by ``filename``, None where there is none.

    ``package://name/path`` is searched in the folders above the URDF and below ``ROS_PACKAGE_PATH`` and
    ``AMENT_PREFIX_PATH``; anything else is a path, absolute or from the URDF.
    """
    return next(filter(is_file, map(Path, _candidates(filename, folder.absolute()))), None)


def check_mesh_file(path: Path, element: str) -> None:
    """Refuse, before any other program reads it, a file that is too large or of a kind that is no mesh.

    Raises
    ------
    InputError
        Its name ends as no mesh's does, or it is larger than ``LARGEST_MESH``.
    """
    kind = path.suffix.lower().lstrip(".")
    if kind not in MESH_KINDS:
        raise InputError(f'".{kind}" is not one of {", ".join(MESH_KINDS)}', source=path, element=element)
    if path.stat().st_size > LARGEST_MESH:
        raise InputError(f"is larger than {LARGEST_MESH // 1_000_000} MB, as no mesh is", source=path, element=element)


def load_mesh(path: Path, scale: Array, element: str) -> Mesh:
    """Read a mesh file, all its geometries: one that cannot be read is an error.

    Parameters
    ----------
    path : path
    scale : (3,)
        Of the file's units along its axes.
    element : str
        The element of the URDF that error messages name.

    Raises
    ------
    InputError
        If the file is not a mesh, has no faces, faces without corners, or corners that are not finite or farther away
        than any robot is large.
    """
    try:
        content = read_regular(path, LARGEST_MESH, "a mesh")
        corners, faces = _corners_and_faces(content, path.suffix.lower().lstrip("."))
    except InputError as error:
        raise error.within(element=element) from None
    except Exception as error:  # the readers of trimesh raise exceptions of any kind
        raise InputError(f"cannot be read as a mesh: {error}", source=path, element=element) from None
    reason = _fault(corners, faces, scale)
    if reason:
        raise InputError(reason, source=path, element=element, advice="repair the mesh, or remove the <collision>")
    used, numbers = np.unique(faces, return_inverse=True)
    distinct_corners, merged = _merged(corners[used] * scale)
    triangles = merged[numbers.reshape(faces.shape)]
    return Mesh(distinct_corners, triangles, _edges(triangles), hashlib.sha256(content).hexdigest())


def _corners_and_faces(content: bytes, kind: str) -> tuple[Array, IntArray]:
    """All corners (k, 3) and faces (f, 3) as they are written: trimesh's "processing" would drop and move some.

    Files that the content refers to are not read: it is the whole mesh.
    """
    import trimesh

    if kind not in MESH_KINDS:
        raise ValueError(f'".{kind}" is not one of {", ".join(MESH_KINDS)}')
    if kind == "stl" and (corners := _binary_stl(content)) is not None:
        return corners, np.arange(len(corners)).reshape(-1, 3)
    loaders = trimesh.exchange.load.mesh_loaders
    faults = rb"<(?:\w+:)?(?:float_array[^>]*>[^<]*\bnan\b|p>[^<]*-)"
    if kind == "dae" and re.search(
        faults, content, re.IGNORECASE
    ):  # pycollada takes NaN for 0, and -1 for the last corner
        raise ValueError("a number in it is NaN, or a face has a negative corner")
    options = {"ignore_broken": False} if kind == "dae" else {}
    with np.errstate(all="ignore"):
        parsed = loaders[kind](io.BytesIO(content), file_type=kind, **options)
        for geometry in (parsed, *parsed.get("geometry", {}).values()):
            if "faces" in geometry:
                geometry["process"] = False
        mesh = trimesh.load_scene(parsed).to_mesh()
        return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


def _binary_stl(content: bytes) -> Array | None:
    """Corners (3 f, 3) of the f triangles of a binary STL file; None of what is none, such as one that is text.

    A library takes six times the memory for this.
    """
    if len(content) < STL_HEADER:
        return None
    count = int.from_bytes(content[STL_HEADER - 4 : STL_HEADER], "little")
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    if not count or len(content) != STL_HEADER + count * triangle.itemsize:
        return None
    triangles = np.frombuffer(content, triangle, count, STL_HEADER)
    return triangles["corners"].reshape(-1, 3).astype(np.float64)


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
    if not _same(corners[first], numbers, corners):  # two corners have one key, as in symmetric meshes
        bits = (corners + 0.0).view(np.uint64)  # of -0.0 those of 0.0
        key = _mixed(_mixed(_mixed(bits[:, 0]) ^ bits[:, 1]) ^ bits[:, 2])
        _, first, numbers = np.unique(key, return_index=True, return_inverse=True)
        if not _same(corners[first], numbers, corners):
            return corners, np.arange(len(corners))
    return corners[first], numbers


def _mixed(bits: Any) -> Any:
    """Integers (k,) of 64 bits, each bit spread over all others: a hash, of which equal ones are rare."""
    # 2^64 over the golden ratio, odd: multiplying by it spreads bits; integers of arrays wrap around in silence
    mixer = np.uint64(0x9E3779B97F4A7C15)
    for _ in range(2):
        bits = (bits ^ (bits >> np.uint64(32))) * mixer
    return bits


def _same(distinct: Array, numbers: IntArray, corners: Array) -> bool:
    """Whether corners (k, 3) are those of their numbers (k,) among distinct ones, one axis after the other."""
    return all(bool((distinct[numbers, axis] == corners[:, axis]).all()) for axis in range(3))


def _edges(faces: IntArray) -> IntArray:
    """Edges (e, 2) of triangles (f, 3), each once."""
    count = int(faces.max()) + 1
    sides = [(faces[:, begin], faces[:, end]) for begin, end in ((0, 1), (1, 2), (2, 0))]
    keys = np.concatenate([np.minimum(*ends) * count + np.maximum(*ends) for ends in sides])
    return np.stack(np.divmod(np.unique(keys), count), axis=1)


def _candidates(filename: str, folder: Path) -> Iterator[str]:
    if not filename.startswith("package://"):
        path = unquote(urlparse(filename).path) if filename.startswith("file://") else filename
        yield str(folder / path)
        return
    inside = filename.removeprefix("package://").lstrip("/")
    package, _, below = inside.partition("/")
    for above in (folder, *folder.parents):
        yield f"{above}/{inside}"
        if above.name == package:
            yield f"{above}/{below}"
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        for root in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield f"{root}/{inside}"
            yield f"{root}/share/{inside}"


@dataclass(frozen=True, eq=False)
class Projection:
    """From a link's frame to the plane: position = (2, 3) ``rows`` @ point + ``shift``, the rows as a complex (3,)."""

    row: ComplexArray
    shift: complex

    def __call__(self, points: Array) -> ComplexArray:
        """Positions (k,) of points (k, 3)."""
        return np.asarray(points @ self.row + self.shift, dtype=np.complex128)

    def after(self, placement: Any) -> Projection:
        """The same from a frame at ``placement`` (``pinocchio.SE3``) in the link's."""
        return Projection(self.row @ placement.rotation, complex(placement.translation @ self.row + self.shift))


@dataclass(frozen=True, eq=False)
class Geometry:
    """The geometry of a ``<collision>`` in its link's frame.

    Attributes
    ----------
    kind : among ``KINDS``
    placement : pinocchio.SE3
        Of the geometry's own frame in the link's.
    size : (3,) m
        A box's edges; an ellipsoid's radii; radius, radius and length along z of the others that are round.
    mesh : Mesh, where it is one
    """

    kind: str
    placement: Any
    size: Array
    mesh: Mesh | None = None

    def outline(self, projection: Projection) -> tuple[Outline, complex]:
        """Return the outline in a plane, and its shift, m.

        That of a mesh is about the origin of its file, so that its capsules do not depend on its position.
        """
        placed = projection.after(self.placement)
        radius = float(self.size[0])
        if self.mesh is not None:
            return Outline(self.mesh.corners @ placed.row, self.mesh.edges), placed.shift
        if self.kind == "box":
            return Outline.convex(placed(CUBE * self.size)), UNMOVED
        if self.kind == "ellipsoid":
            return Outline.convex(_ellipse(self.size, placed)), UNMOVED
        if self.kind == "sphere":
            return Outline.convex(placed(np.zeros((1, 3))), radius), UNMOVED
        ends = AXIS * self.size[2]
        round_ends = self.kind == "capsule"
        return Outline.convex(placed(ends), radius) if round_ends else _cylinder(radius, ends, placed), UNMOVED

    def solid(self) -> tuple[Array, Array]:
        """Return points (k, 3) and semi-axes (3, 3), its columns, m, in the link's frame.

        The geometry is the convex hull of the points, grown by the ellipsoid of these semi-axes; of a mesh its hull.
        """
        radius = float(self.size[0])
        length = float(self.size[2])
        if self.mesh is not None:
            points = hull_corners(self.mesh.corners)
            axes = np.zeros(3)
        elif self.kind == "box":
            points = CUBE * self.size
            axes = np.zeros(3)
        elif self.kind in ("ellipsoid", "sphere"):
            points = np.zeros((1, 3))
            axes = self.size if self.kind == "ellipsoid" else np.full(3, radius)
        else:
            points = AXIS * length
            axes = np.array([radius, radius, radius * (self.kind == "capsule")])
        rotation = self.placement.rotation
        shift = self.placement.translation
        return points @ rotation.T + shift, rotation * axes


def hull_corners(points: Array) -> Array:
    """Corners (h, 3) of the convex hull of points (k, 3); the points themselves where they are flat."""
    import trimesh

    with contextlib.suppress(Exception):  # of the library, of any kind
        return np.asarray(trimesh.convex.convex_hull(points).vertices)
    return points


def read_collision(link: str, collision: Element, folder: Path, meshes: Mapping[str, str]) -> Geometry | None:
    """Return the geometry of a collision element; None where there is none.

    Parameters
    ----------
    link : str
    collision : XML element
    folder : path
        Of the URDF, from which mesh files are searched.
    meshes : mapping
        SHA-256 of the mesh files by their names.

    Raises
    ------
    InputError
        If a number in it is not one, a length is negative, or a mesh file is none, or has changed.
    """
    collision_name = f'link "{link}": collision'
    geometry = only(collision_name, collision, "geometry")
    if geometry is None or len(geometry) == 0:
        return None
    placement = read_origin(collision_name, collision).placement
    shape = geometry[0]
    where = f"{collision_name}: {shape.tag}"
    if shape.tag == "mesh":
        filename = shape.get("filename", "")
        path = find_mesh(filename, folder)
        scale = triple(f"{where}: scale", shape, "scale", (1.0, 1.0, 1.0))
        if not scale.all():
            reason = "has a zero, which leaves nothing of the mesh"
            raise InputError(reason, element=f"{where}: scale", advice="give three numbers")
        if path is None:
            return None
        mesh = load_mesh(path, scale, where)
        if mesh.sha256 != meshes.get(filename):
            reason = "has changed since the robot was read"
            advice = "read the robot again"
            raise InputError(reason, source=path, element=where, advice=advice)
        return Geometry(shape.tag, placement, scale, mesh)
    if shape.tag == "box":
        size = _triple(where, shape, "size")
        if size.min() < 0.0:
            raise InputError("is negative", element=f"{where}: size")
        return Geometry(shape.tag, placement, size)
    if shape.tag == "ellipsoid":  # of an MJCF
        return Geometry(shape.tag, placement, _triple(where, shape, "radii"))
    if shape.tag not in KINDS:
        return None
    radius = _length(where, shape, "radius")
    length = 0.0 if shape.tag == "sphere" else _length(where, shape, "length")
    return Geometry(shape.tag, placement, np.array([radius, radius, length]))


def _ellipse(radii: Array, placed: Projection) -> ComplexArray:
    """Corners of a polygon around an ellipsoid of three radii, whose outline is an ellipse."""
    seen = radii * placed.row
    axes, lengths, _ = np.linalg.svd(np.array([seen.real, seen.imag]))
    rim = axes @ (lengths[:, None] * np.array([AROUND.real, AROUND.imag]))
    return np.asarray(placed(np.zeros((1, 3))) + rim[0] + 1j * rim[1])


def _cylinder(radius: float, ends: Array, placed: Projection) -> Outline:
    """The outline of a cylinder between the middles (2, 3) of its end discs."""
    axis = complex(placed.row[2])  # of the unit vector along z, as seen in the plane
    slant = min(abs(axis), 1.0)
    if slant < FLAT:
        return Outline.convex(placed(np.zeros((1, 3))), radius)
    along = axis / abs(axis)
    thickness = np.sqrt(max(1.0 - slant**2, 0.0))  # of an end disc seen from its side
    if thickness < FLAT:
        rim = np.array([1j * radius, -1j * radius]) * along
    else:
        rim = radius * along * (thickness * AROUND.real + 1j * AROUND.imag)
    return Outline.convex((placed(ends)[:, None] + rim[None, :]).ravel())


def _triple(where: str, shape: Element, key: str) -> Array:
    if shape.get(key) is None:
        raise InputError(f"has no {key}", element=where, advice="give three numbers")
    return triple(f"{where}: {key}", shape, key, (0.0, 0.0, 0.0))


def _length(where: str, shape: Element, key: str) -> float:
    length = number(where, shape, key, None)
    if length < 0.0:
        raise InputError(f"is negative: {length:g} m", element=f"{where}: {key}")
    return length
