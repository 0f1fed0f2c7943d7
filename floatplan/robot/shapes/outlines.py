"""Projections of ``<collision>`` geometry onto the plane, as outlines that hold it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import InputError
from floatplan.robot.shapes.capsules import Outline
from floatplan.robot.shapes.meshes import find_mesh
from floatplan.robot.urdf.check import read_origin
from floatplan.robot.urdf.read import number, only, triple

ROUND_CORNERS = 32  # [-] of the polygon around a disc seen aslant: it is 0.5 % larger
KINDS = ("sphere", "box", "capsule", "cylinder", "mesh")
FLAT = 1e-9  # [-] sine below which an axis counts as in the plane, or along the normal


@dataclass(frozen=True, eq=False)
class Projection:
    """From a link's frame to the plane: place = (2, 3) ``rows`` @ point + ``shift``, the rows as a complex (3,)."""

    row: ComplexArray
    shift: complex

    def __call__(self, points: Array) -> ComplexArray:
        """Places (k,) of points (k, 3)."""
        return np.asarray(points @ self.row + self.shift, dtype=np.complex128)

    def after(self, placement: Any) -> Projection:
        """The same from a frame at ``placement`` (``pinocchio.SE3``) in the link's."""
        return Projection(self.row @ placement.rotation, complex(placement.translation @ self.row + self.shift))


@dataclass(frozen=True, eq=False)
class MeshUse:
    """A mesh file in a collision element: its name there, path, scale (3,), and projection to the plane."""

    filename: str
    path: Path
    scale: Array
    projection: Projection
    element: str


def read_collision(link: str, collision: Element, projection: Projection, folder: Path) -> Outline | MeshUse | None:
    """Return the outline of a collision element in the plane, or for a mesh, its use; None where there is neither.

    Parameters
    ----------
    link : str
    collision : XML element
    projection : Projection
        From the link's frame to the plane.
    folder : path
        Of the URDF, from which mesh files are searched.

    Raises
    ------
    InputError
        If a number in it is not one, or a length is negative.
    """
    place = f'link "{link}": collision'
    geometry = only(place, collision, "geometry")
    if geometry is None or len(geometry) == 0:
        return None
    placed = projection.after(read_origin(place, collision).placement)
    shape = geometry[0]
    where = f"{place}: {shape.tag}"
    if shape.tag == "mesh":
        filename = shape.get("filename", "")
        path, scale = find_mesh(filename, folder), triple(f"{where}: scale", shape, "scale", (1.0, 1.0, 1.0))
        if not scale.all():
            reason = "has a zero, which leaves nothing of the mesh"
            raise InputError(reason, element=f"{where}: scale", advice="give three numbers")
        return None if path is None else MeshUse(filename, path, scale, placed, where)
    if shape.tag == "box":
        size = triple(f"{where}: size", shape, "size", (0.0, 0.0, 0.0))
        if size.min() < 0.0:
            raise InputError("is negative", element=f"{where}: size")
        corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        return Outline.convex(placed(corners * size))
    if shape.tag not in KINDS:
        return None
    radius = _length(where, shape, "radius")
    if shape.tag == "sphere":
        return Outline.convex(placed(np.zeros((1, 3))), radius)
    ends = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]]) * _length(where, shape, "length")
    return Outline.convex(placed(ends), radius) if shape.tag == "capsule" else _cylinder(radius, ends, placed)


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
        around = np.exp(2j * np.pi * (np.arange(ROUND_CORNERS) + 0.5) / ROUND_CORNERS) / np.cos(np.pi / ROUND_CORNERS)
        rim = radius * along * (thickness * around.real + 1j * around.imag)
    return Outline.convex((placed(ends)[:, None] + rim[None, :]).ravel())


def _length(where: str, shape: Element, key: str) -> float:
    length = number(where, shape, key, None)
    if length < 0.0:
        raise InputError(f"is negative: {length:g} m", element=f"{where}: {key}")
    return length
