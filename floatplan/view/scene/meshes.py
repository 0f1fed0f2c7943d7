"""A robot in three dimensions, in so few triangles that pages stay quick.

A page without a graphics card computes every triangle, so that triangles too small to be seen are left out.
"""

import io
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.errors import InputError, import_optional
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.collisions import LARGEST, check_mesh_file, find_mesh

Mesh = tuple[Array, IntArray]


def visual_model(robot: Robot) -> Any:
    """Return the robot's ``yourdfpy.URDF`` with its visual meshes, or None where it has none or files are missing.

    Raises
    ------
    InputError
        A mesh cannot be read, is too large, or is an archive.
    """
    root = ElementTree.fromstring(robot.xml)
    folder = robot.path.parent
    if not _drop_missing_visuals(root, folder):
        return None
    import yourdfpy

    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)
    try:
        with np.errstate(all="ignore"):
            model = yourdfpy.URDF.load(
                io.BytesIO(ElementTree.tostring(root)),
                load_meshes=True,
                build_scene_graph=True,
                filename_handler=lambda fname: str(find_mesh(fname, folder)),
            )
            reach = max((float(np.abs(mesh.vertices).max()) for mesh in model.scene.geometry.values()), default=0.0)
        if reach <= LARGEST:
            return model
        reason = f"a visual mesh has a corner {reach:.3g} m away, farther than any robot is large ({LARGEST:g} m)"
    except Exception as error:  # the readers of meshes raise exceptions of any kind
        reason = f"a visual mesh cannot be read: {error}"
    advice = "repair the mesh, or remove the <visual>"
    raise InputError(reason, source=robot.path, element="visual", advice=advice)


def _drop_missing_visuals(root: Any, folder: Path) -> bool:
    """Take the visuals whose files are missing out of a URDF, and what couples joints; return whether any stay."""
    for joint in root.iter("joint"):
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            path = None if mesh is None else find_mesh(mesh.get("filename", ""), folder)
            if path is not None:
                check_mesh_file(path, f'link "{link.get("name")}": visual: mesh')
            elif mesh is not None:
                link.remove(visual)
    return root.find("link/visual") is not None


def joint_angles(robot: Robot, positions: Array) -> dict[str, float]:
    """Return the position of every joint that moves, by name: planned, coupled and locked; rad or m."""
    names = robot.model_joints
    full = robot.reference[-len(names) :] + robot.selection[-len(names) :] @ positions
    return dict(zip(names, full.tolist(), strict=True))


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
    library = import_optional("fast_simplification", name="fast-simplification", element="meshes", extra="view")
    # of a mesh of size 100 the library's first round moves no point by more than 0.0015
    length = np.ptp(vertices, axis=0).max() / 100.0
    vertices, faces = library.simplify(vertices / length, faces, target_count=count)
    return length * vertices, faces


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Return several meshes as one."""
    import trimesh

    vertices, faces = trimesh.util.append_faces(*zip(*meshes, strict=True))
    return vertices, faces


def bends(positions: ComplexArray, angle: float) -> IntArray:
    """Of the positions (N,) along a path, ascending indices of those that show its shape.

    The first, the last, and one wherever its direction has changed by another ``angle``, rad.
    """
    steps = np.diff(positions)
    rotation = np.cumsum(np.abs(np.angle(steps[1:] * steps[:-1].conj())))
    further = np.flatnonzero(np.diff(np.floor(rotation / angle), prepend=0.0))
    return np.concatenate(([0], further + 1, [len(positions) - 1]))


def uniform_colour(mesh: Any) -> tuple[int, int, int] | None:
    """The one colour of a ``trimesh.Trimesh``; None where it has several, a texture, or is transparent."""
    visual = mesh.visual
    if visual.kind == "texture":
        material = visual.material
        has_texture = getattr(material, "image", None) is not None
        has_texture = has_texture or getattr(material, "baseColorTexture", None) is not None
        colours = None if has_texture else np.atleast_2d(material.main_color)
    else:
        colours = np.unique(visual.face_colors, axis=0)
    if colours is None or len(colours) != 1 or colours[0, 3] < 255:
        return None
    red, green, blue, _ = map(int, colours[0])
    return red, green, blue
