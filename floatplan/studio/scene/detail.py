"""How much of a robot is drawn: what can be seen, as a page without a graphics card reckons every triangle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import floatplan as fp
from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.optional import import_optional
from floatplan.studio.work.flown import body_poses

Mesh = tuple[Array, IntArray]
SPAN = 100.0  # [-] of what is simplified, in the library's units: its first round moves no point by more than 0.0015
SAME = 1e-3  # [-] of a radius: by how much a hidden capsule may stick out


def coarser(vertices: Array, faces: IntArray, cell: float) -> Mesh:
    """Draw a mesh again with one vertex for each cube of an edge length: no point moves farther than its diagonal.

    Parameters
    ----------
    vertices : (V, 3) m
    faces : (F, 3)
    cell : edge length of the cubes, m

    Returns
    -------
    vertices : (W, 3) m
        The middle of those in a cube.
    faces : (G, 3)
        Those with three different corners, each once.
    """
    _, cube = np.unique(np.floor(vertices / cell).astype(np.int64), axis=0, return_inverse=True)
    cube = cube.reshape(-1)
    count = np.bincount(cube)
    middle = np.stack([np.bincount(cube, weights=axis) / count for axis in vertices.T], axis=1)
    corners = cube[faces]
    ordered = np.sort(corners, axis=1)
    first = np.unique(ordered, axis=0, return_index=True)[1]
    ordered = ordered[first]
    return middle, corners[first[(ordered[:, 0] < ordered[:, 1]) & (ordered[:, 1] < ordered[:, 2])]]


def fewer(vertices: Array, faces: IntArray, count: int) -> Mesh:
    """Draw a mesh, (V, 3) m and (F, 3), with about so many triangles at most: the fewest where it is flat.

    Edges collapse in the order of their quadric errors: Garland and Heckbert, Surface simplification using quadric
    error metrics (1997).

    Raises
    ------
    InputError
        fast-simplification is not installed.
    """
    if len(faces) <= count:
        return vertices, faces
    library = import_optional("fast_simplification", name="fast-simplification", element="studio", extra="view")
    length = np.ptp(vertices, axis=0).max() / SPAN
    vertices, faces = library.simplify(vertices / length, faces, target_count=count)
    return length * vertices, faces


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Return several meshes as one."""
    first = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + offset for (_, faces), offset in zip(meshes, first, strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def bends(places: ComplexArray, turn: float) -> IntArray:
    """Of the places (N,) of a path, ascending indices of those that show how it runs.

    The first, the last, and one wherever it has turned by another ``turn``, rad.
    """
    steps = np.diff(places)
    turned = np.cumsum(np.abs(np.angle(steps[1:] * steps[:-1].conj())))
    further = np.flatnonzero(np.diff(np.floor(turned / turn), prepend=0.0))
    return np.concatenate(([0], further + 1, [len(places) - 1]))


def plain_colour(mesh: Any) -> tuple[int, int, int] | None:
    """The one colour of a ``trimesh.Trimesh``; None where it has several, a picture, or lets light through."""
    visual = mesh.visual
    if visual.kind == "texture":
        material = visual.material
        pictures = (getattr(material, name, None) for name in ("image", "baseColorTexture"))
        colours = np.atleast_2d(material.main_color) if all(picture is None for picture in pictures) else None
    else:
        colours = np.unique(visual.face_colors, axis=0)
    if colours is None or len(colours) != 1 or colours[0, 3] < 255:
        return None
    red, green, blue = (int(part) for part in colours[0, :3])
    return red, green, blue


def seen_capsules(robot: fp.Robot, radius: Array) -> list[int]:
    """Capsules, by their index, that no other one hides whatever the posture: rotors in a trunk, one leg of a pair.

    Parameters
    ----------
    robot : Robot
    radius : (S,) m
        As drawn.
    """
    start, end = (np.array([getattr(shape, name) for shape in robot.shapes]) for name in ("start", "end"))
    group = _moving_alike(robot)[[shape.body for shape in robot.shapes]]
    seen: list[int] = []
    for index in np.argsort(-radius, kind="stable").tolist():
        larger = [each for each in seen if group[each] == group[index]]
        places = np.array([start[index], end[index]])
        outside = _distance(places, start[larger], end[larger]) + radius[index] - (1 + SAME) * radius[larger]
        if not (outside.max(axis=0, initial=-np.inf) <= 0.0).any():
            seen.append(index)
    return sorted(seen)


def _distance(places: Array, start: Array, end: Array) -> Array:
    """Distances (P, S) of places (P,) from segments (S,)."""
    along = end - start
    square = np.abs(along) ** 2
    offset = places[:, None] - start
    share = np.clip((offset * along.conj()).real / np.where(square > 0, square, 1.0), 0.0, 1.0)
    return np.asarray(np.abs(offset - share * along))


def _moving_alike(robot: fp.Robot) -> IntArray:
    """For each body the first that is where it is in every posture: two drawn at random tell."""
    postures = np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(robot.joints)))
    poses = body_poses(robot, np.zeros(2), postures, np.zeros(2, dtype=np.complex128))
    apart = np.abs(poses.places[:, :, None] - poses.places[:, None]) + np.abs(
        np.exp(1j * poses.angles[:, :, None]) - np.exp(1j * poses.angles[:, None])
    )
    return np.asarray(np.argmax(apart.max(axis=0) < 1e-9, axis=1))
