"""The links' shapes in the plane.

A link with ``<collision>`` geometry is the capsules around its projection; they contain it, so that a clearance of the
capsules is one of the link. A link without is the segments from its own origin to the origins of its children's joints,
of radius 0: the paper's links. A joint's origin is where the URDF puts it; a locked prismatic joint moves its child
away from there, and the child then has the segment between the two as well. Over the ground a link is as high as its
convex hull, whose corners are stored with the capsules; hulls of bodies that move as one have far fewer corners.
"""

import contextlib
import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from floatplan.arrays import ComplexArray
from floatplan.errors import InputError
from floatplan.files import read_regular
from floatplan.robot.planar.tree import SAME, PlanarTree, TreeLayout
from floatplan.robot.shapes.capsules import Outline, PlaneCapsule, fit, with_fewer_corners
from floatplan.robot.shapes.collisions import KINDS, LARGEST_MESH, Projection, find_mesh, read_collision
from floatplan.robot.urdf.tree import UrdfTree

LINE_RADIUS = 0.055  # [-] radius of links that are lines, in pictures and for overlaps, over their median length
MOST_COLLISIONS = 500  # [-] of a robot; those of example-robot-data have up to 112


@dataclass(frozen=True)
class LinkCapsule:
    """A link's shape in the plane: all points within ``radius`` of the segment from ``start`` to ``end``.

    ``body`` indexes :class:`PlanarTree`; ``start`` and ``end`` are complex positions in that body's frame, m.
    """

    link: str
    body: int
    start: complex
    end: complex
    radius: float


def link_shapes(
    layout: TreeLayout, folder: Path, meshes: Mapping[str, str]
) -> tuple[tuple[LinkCapsule, ...], dict[str, list[LinkCapsule]]]:
    """Return the shapes of all links, in the order of the links in the file, and the hulls of those that have any.

    Parameters
    ----------
    layout : TreeLayout
    folder : path
        Of the URDF, from which mesh files are searched.
    meshes : mapping
        Of the files, from :func:`mesh_digests`.

    Raises
    ------
    InputError
        If there are too many collisions, the geometry of one is wrong, or its file is not a mesh, or has changed.
    """
    count = sum(len(link.collisions) for link in layout.tree.links.values())
    if count > MOST_COLLISIONS:
        raise InputError(f"has {count} collision elements, more than {MOST_COLLISIONS}", advice="simplify its geometry")
    shapes: list[LinkCapsule] = []
    hulls: dict[str, list[LinkCapsule]] = {}
    for link in layout.tree.links:
        fitted: list[PlaneCapsule] = []
        points: dict[float, list[ComplexArray]] = {}
        for outline, shift in _collisions(layout, link, folder, meshes):
            fitted += [PlaneCapsule(one.start + shift, one.end + shift, one.radius) for one in fit(outline)]
            points.setdefault(outline.radius, []).append(outline.points + shift)
        body = layout.body_of[link]
        capsules = [LinkCapsule(link, body, one.start, one.end, one.radius) for one in _outermost(fitted)]
        capsules = capsules or _segments(layout, link)
        shapes += capsules
        if capsules:
            hull = []
            for radius, of_radius in points.items():
                corners = Outline.convex(np.concatenate(of_radius)).points
                hull += [LinkCapsule(link, body, start, end, radius) for start, end in _pairs(corners)]
            hulls[link] = hull or capsules
    return tuple(shapes), hulls


def link_outlines(layout: TreeLayout, folder: Path, meshes: Mapping[str, str]) -> list[tuple[int, Outline]]:
    """Return the collision geometry in the plane, which the capsules cover, each with the body whose frame it is in.

    Parameters and errors are those of :func:`link_shapes`.
    """
    outlines = []
    for link in layout.tree.links:
        for outline, shift in _collisions(layout, link, folder, meshes):
            outlines.append((layout.body_of[link], replace(outline, points=outline.points + shift)))
    return outlines


def mesh_digests(tree: UrdfTree, folder: Path) -> dict[str, str]:
    """Return the SHA-256 of the mesh files of collision elements by their names there, of those that can be read."""
    digests: dict[str, str] = {}
    for _, filename, path in _meshes(tree, folder):
        if path is not None and filename not in digests:
            with contextlib.suppress(InputError):
                digests[filename] = hashlib.sha256(read_regular(path, LARGEST_MESH, "a mesh")).hexdigest()
    return digests


def missing_meshes(tree: UrdfTree, folder: Path) -> list[tuple[str, str]]:
    """Return the link and the file name of each mesh of a collision element that does not exist."""
    return [(link, filename) for link, filename, path in _meshes(tree, folder) if path is None]


def left_out(tree: UrdfTree, folder: Path) -> InputError | None:
    """Return the error of the first collision geometry that no shape is around: missing, unknown, or a second one."""
    for link, filename in missing_meshes(tree, folder):
        reason = f'collision mesh "{filename}" not found, so clearance cannot be computed'
        advice = "put it there, set ROS_PACKAGE_PATH, or remove the <collision>"
        return InputError(reason, element=f'link "{link}"', advice=advice)
    for link, element in tree.links.items():
        for collision in element.collisions:
            if collision.find("geometry/*") is None:
                reason = "has a <collision> without geometry"
                advice = "give its <geometry>, or remove it"
                return InputError(reason, element=f'link "{link}"', advice=advice)
            for number, shape in enumerate(collision.iterfind("geometry/*")):
                if number or shape.tag not in KINDS:
                    reason = f"collision geometry <{shape.tag}> is not read, so clearance cannot be computed"
                    advice = f"give one of {', '.join(KINDS)} in each <collision>"
                    return InputError(reason, element=f'link "{link}"', advice=advice)
    return None


def moving_hulls(
    tree: PlanarTree, hulls: Mapping[str, Sequence[LinkCapsule]], separate: Collection[str], bodies: Collection[int]
) -> tuple[LinkCapsule, ...]:
    """Return capsules whose ends reach as far as the links in every direction.

    Parameters
    ----------
    tree : PlanarTree
    hulls : link -> capsules whose ends are the corners of its own hull
    separate : links whose own capsules are all among the result
    bodies : those taken exactly; others reach up to a millimetre farther
    """
    merged = tree.coincident.tolist()  # bodies that always have the same pose are one
    exact = {merged[body] for body in bodies}
    own: list[LinkCapsule] = []
    for link in separate:
        own += hulls[link]
    groups: dict[tuple[int, float], list[LinkCapsule]] = {}
    for hull in hulls.values():
        for capsule in hull:
            groups.setdefault((merged[capsule.body], capsule.radius), []).append(capsule)
    joined: list[LinkCapsule] = []
    for (body, radius), members in groups.items():
        ends = _ends(members)
        around = Outline.convex(ends, radius)
        corners = around.points if body in exact else with_fewer_corners(around).points
        own_here = [capsule for capsule in own if merged[capsule.body] == body and capsule.radius == radius]
        distance = abs(corners[:, None] - _ends(own_here)[None, :])
        for start, end in _pairs(corners[distance.min(axis=1, initial=np.inf) > SAME]):
            nearest = members[int(abs(ends - start).argmin()) % len(members)]
            joined.append(LinkCapsule(nearest.link, nearest.body, start, end, radius))
    return (*own, *joined)


def _meshes(tree: UrdfTree, folder: Path) -> Iterator[tuple[str, str, Path | None]]:
    """The link, the file name and the file, where it exists, of each mesh of a collision element."""
    for link in tree.links.values():
        for collision in link.collisions:
            for mesh in collision.iterfind("geometry/mesh"):
                filename = mesh.get("filename", "")
                yield link.name, filename, find_mesh(filename, folder)


def _collisions(
    layout: TreeLayout, link: str, folder: Path, meshes: Mapping[str, str]
) -> Iterator[tuple[Outline, complex]]:
    """A link's collision geometry in the plane, each with its shift, m."""
    body = layout.body_of[link]
    placement = layout.placements[link]
    row = (layout.plane.horizontal + 1j * layout.plane.vertical) @ placement.rotation * layout.back(body)
    projection = Projection(row, layout.local(body, placement.translation))
    for collision in layout.tree.links[link].collisions:
        shape = read_collision(link, collision, folder, meshes)
        if shape is not None:
            yield shape.outline(projection)


def _pairs(corners: ComplexArray) -> list[tuple[complex, complex]]:
    """Segments from corner to corner, whose ends are all of them."""
    last = len(corners) - 1
    return [(complex(corners[i]), complex(corners[min(i + 1, last)])) for i in range(0, last + 1, 2)]


def _ends(capsules: Sequence[LinkCapsule]) -> ComplexArray:
    starts = [capsule.start for capsule in capsules]
    ends = [capsule.end for capsule in capsules]
    return np.array([*starts, *ends], dtype=np.complex128)


def _outermost(capsules: list[PlaneCapsule]) -> list[PlaneCapsule]:
    """Capsules less those inside another; of two that are the same, the first stays."""
    different = list(dict.fromkeys(capsules))
    ends = np.array([(one.start, one.end) for one in different]).reshape(-1, 2)
    radius = np.array([one.radius for one in different])
    inside = np.zeros(len(different), dtype=bool)
    for number, other in enumerate(different):
        covered = other.depth(ends.ravel()).reshape(-1, 2).min(axis=1) >= radius
        covered[number] = False
        inside |= covered
    return [different[number] for number in np.flatnonzero(~inside).tolist()]


def _segments(layout: TreeLayout, link: str) -> list[LinkCapsule]:
    """From the link's origin to those of its children's joints, and of its own where it stands away from there."""
    if layout.tree.links[link].frame:
        return []
    body = layout.body_of[link]
    start = layout.local(body, layout.placements[link].translation)
    ends: dict[complex, None] = {}
    for joint in layout.tree.joints:
        if link in (joint.parent, joint.child):
            origin = layout.placements[joint.parent] * joint.origin.placement
            ends[layout.local(body, origin.translation)] = None
    segments = [LinkCapsule(link, body, start, end, 0.0) for end in ends if end != start]
    if not segments and layout.tree.links[link].inertial is not None:
        return [LinkCapsule(link, body, start, start, 0.0)]
    return segments
