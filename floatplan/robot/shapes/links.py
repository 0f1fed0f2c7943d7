"""The links' shapes in the plane.

A link with ``<collision>`` geometry is the capsules around its projection; they hold it, so that a clearance of the
capsules is one of the link. A link without is the segments from its own origin to the origins of its children's joints,
of radius 0: the paper's links. A joint's origin is where the URDF puts it; a locked prismatic joint holds its child
away from there, and the child then has the segment between the two as well. Over the ground a link is as high as its
convex hull, whose corners are kept beside the capsules.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.parts import LinkCapsule
from floatplan.robot.planar.layout import TreeLayout
from floatplan.robot.shapes.cache import mesh_capsules
from floatplan.robot.shapes.capsules import Outline, PlaneCapsule, fit_capsules
from floatplan.robot.shapes.meshes import Mesh, find_mesh, load_mesh, mesh_digest
from floatplan.robot.shapes.outlines import KINDS, MeshUse, Projection, read_collision
from floatplan.robot.urdf.tree import UrdfJoint, UrdfTree

MOST_COLLISIONS = 500  # [-] of a robot; those of example-robot-data have up to 112


def link_shapes(
    layout: TreeLayout, folder: Path | None, meshes: Mapping[str, str]
) -> tuple[tuple[LinkCapsule, ...], dict[str, list[LinkCapsule]]]:
    """Return the shapes of all links, in the order of the links in the file, and the hulls of those that have any.

    Parameters
    ----------
    layout : TreeLayout
    folder : path or None
        Of the URDF, from which mesh files are searched.
    meshes : mapping
        What :func:`mesh_digests` said of the files.

    Raises
    ------
    InputError
        If there are too many collisions, the geometry of one is wrong, or its file is not a mesh, or not the one that
        it was.
    """
    count = sum(len(link.collisions) for link in layout.tree.links.values())
    if count > MOST_COLLISIONS:
        raise InputError(f"has {count} collision elements, more than {MOST_COLLISIONS}", advice="simplify its geometry")
    joints: dict[str, list[UrdfJoint]] = {name: [] for name in layout.tree.links}
    for joint in layout.tree.joints:
        joints[joint.parent].append(joint)
        joints[joint.child].append(joint)
    shapes: list[LinkCapsule] = []
    hulls: dict[str, list[LinkCapsule]] = {}
    for link, own in joints.items():
        capsules, outlines = _capsules(layout, link, folder, meshes)
        body = layout.body_of[link]
        capsules = capsules or _segments(layout, link, own)
        corners = [LinkCapsule(link, body, *ends) for outline in _convex(outlines) for ends in _ends(outline)]
        shapes += capsules
        if capsules:
            hulls[link] = corners or capsules
    return tuple(shapes), hulls


def mesh_digests(tree: UrdfTree, folder: Path | None) -> dict[str, str]:
    """Return the SHA-256 of the mesh files of collision elements by their names there, of those that can be read."""
    digests = {}
    for link, filename in _mesh_names(tree):
        path = None if folder is None else find_mesh(filename, folder)
        if path is not None and filename not in digests:
            with contextlib.suppress(InputError):
                digests[filename] = mesh_digest(path, f'link "{link}"')
    return digests


def link_outlines(layout: TreeLayout, folder: Path | None) -> list[tuple[int, Outline]]:
    """Return the collision geometry in the plane, which the capsules hold, each with the body whose frame it is in.

    Raises
    ------
    InputError
        As :func:`link_shapes`.
    """
    outlines = []
    for name, link in layout.tree.links.items():
        for collision in link.collisions:
            outline = read_collision(name, collision, _projection(layout, name), folder)
            if isinstance(outline, MeshUse):
                outline = _outline(outline, load_mesh(outline.path, outline.scale, outline.element))
            if outline is not None:
                outlines.append((layout.body_of[name], outline))
    return outlines


def missing_meshes(tree: UrdfTree, folder: Path | None) -> list[tuple[str, str]]:
    """Return the link and the file name of each mesh of a collision element that is not to be found."""
    return [
        (link, filename)
        for link, filename in _mesh_names(tree)
        if folder is None or find_mesh(filename, folder) is None
    ]


def unread_geometry(tree: UrdfTree) -> list[tuple[str, str]]:
    """Return link and tag of what collision elements hold that no shape is around: unknown kinds, second ones."""
    return [
        (link.name, shape.tag)
        for link in tree.links.values()
        for collision in link.collisions
        for number, shape in enumerate(collision.iterfind("geometry/*"))
        if number or shape.tag not in KINDS
    ]


def _mesh_names(tree: UrdfTree) -> list[tuple[str, str]]:
    """The link and the file name of each mesh of a collision element."""
    return [
        (link.name, mesh.get("filename", ""))
        for link in tree.links.values()
        for collision in link.collisions
        for mesh in collision.iterfind("geometry/mesh")
    ]


def _capsules(
    layout: TreeLayout, link: str, folder: Path | None, meshes: Mapping[str, str]
) -> tuple[list[LinkCapsule], list[Outline]]:
    """The capsules around a link's collision geometry, and the geometry itself."""
    fitted: list[PlaneCapsule] = []
    outlines: list[Outline] = []
    for collision in layout.tree.links[link].collisions:
        outline = read_collision(link, collision, _projection(layout, link), folder)
        if isinstance(outline, MeshUse):
            mesh = _same_mesh(outline, meshes)
            fitted += mesh_capsules(outline, mesh)
            outlines.append(_outline(outline, mesh))
        elif outline is not None:
            fitted += fit_capsules(outline)
            outlines.append(outline)
    body = layout.body_of[link]
    capsules = [LinkCapsule(link, body, each.start, each.end, each.radius) for each in _outermost(fitted)]
    return capsules, outlines


def _outline(use: MeshUse, mesh: Mesh) -> Outline:
    return Outline(use.projection(mesh.corners), mesh.edges)


def _convex(outlines: list[Outline]) -> list[Outline]:
    """One convex outline around all of the same radius."""
    radii = dict.fromkeys(outline.radius for outline in outlines)
    around = {radius: [each.points for each in outlines if each.radius == radius] for radius in radii}
    return [Outline.convex(np.concatenate(points), radius) for radius, points in around.items()]


def _ends(outline: Outline) -> list[tuple[complex, complex, float]]:
    """Segments with a radius, from corner to corner, whose ends are all corners of a convex outline."""
    corners = outline.points.tolist()
    return [(corners[i], corners[min(i + 1, len(corners) - 1)], outline.radius) for i in range(0, len(corners), 2)]


def _same_mesh(use: MeshUse, meshes: Mapping[str, str]) -> Mesh:
    mesh = load_mesh(use.path, use.scale, use.element)
    if mesh.sha256 != meshes.get(use.filename):
        raise InputError(
            "has changed since the robot was read", source=use.path, element=use.element, advice="read the robot again"
        )
    return mesh


def _outermost(capsules: list[PlaneCapsule]) -> list[PlaneCapsule]:
    """Capsules less those inside another; of two that are the same, the first stays."""
    different = list(dict.fromkeys(capsules))
    ends = np.array([(one.start, one.end) for one in different]).reshape(-1, 2)
    radius = np.array([one.radius for one in different])
    inside = np.zeros(len(different), dtype=bool)
    for number, other in enumerate(different):
        held = other.depth(ends.ravel()).reshape(-1, 2).min(axis=1) >= radius
        held[number] = False
        inside |= held
    return [one for one, hidden in zip(different, inside.tolist(), strict=True) if not hidden]


def _projection(layout: TreeLayout, link: str) -> Projection:
    """From the link's frame to its body's frame in the plane."""
    home = layout.bodies[layout.body_of[link]]
    placement = layout.placements[link]
    back = np.exp(-1j * layout.plane.turn * home.offset)
    row = (layout.plane.horizontal + 1j * layout.plane.vertical) @ placement.rotation * back
    return Projection(row, layout.local(layout.body_of[link], placement.translation))


def _segments(layout: TreeLayout, link: str, joints: list[UrdfJoint]) -> list[LinkCapsule]:
    """From the link's origin to those of its children's joints, and of its own where it stands away from there."""
    body = layout.body_of[link]
    start = layout.local(body, layout.placements[link].translation)
    ends = dict.fromkeys(layout.local(body, _joint_origin(layout, joint)) for joint in joints)
    segments = [LinkCapsule(link, body, start, end, 0.0) for end in ends if end != start]
    if not segments and layout.tree.links[link].inertial is not None:
        return [LinkCapsule(link, body, start, start, 0.0)]
    return segments


def _joint_origin(layout: TreeLayout, joint: UrdfJoint) -> Array:
    """Place (3,) in the root link where the URDF puts a joint, which its motion leaves as it is."""
    return np.asarray((layout.placements[joint.parent] * joint.origin.placement).translation, dtype=np.float64)
