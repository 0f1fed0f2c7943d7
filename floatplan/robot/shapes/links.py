"""The links' shapes in the plane.

A link with ``<collision>`` geometry is the capsules around its projection; they hold it, so that a clearance of the
capsules is one of the link. A link without is the segments from its own origin to the origins of its children's joints,
of radius 0: the paper's links. A joint's origin is where the URDF puts it; a locked prismatic joint holds its child
away from there, and the child then has the segment between the two as well. Over the ground a link is as high as its
convex hull, whose corners are kept beside the capsules; hulls of what moves as one have far fewer corners.
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

LINE_RADIUS = 0.055  # [-] radius of links that are lines, as drawn and as they may overlap, over their median length
MOST_COLLISIONS = 500  # [-] of a robot; those of example-robot-data have up to 112


@dataclass(frozen=True)
class LinkCapsule:
    """A link's shape in the plane: all points within ``radius`` of the segment from ``start`` to ``end``.

    ``body`` indexes :class:`PlanarTree`; ``start`` and ``end`` are complex places in that body's frame, m.
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
    shapes: list[LinkCapsule] = []
    hulls: dict[str, list[LinkCapsule]] = {}
    for link in layout.tree.links:
        fitted: list[PlaneCapsule] = []
        points: dict[float, list[ComplexArray]] = {}
        for outline, shift in _collisions(layout, link, folder, meshes):
            fitted += [PlaneCapsule(each.start + shift, each.end + shift, each.radius) for each in fit(outline)]
            points.setdefault(outline.radius, []).append(outline.points + shift)
        body = layout.body_of[link]
        capsules = [LinkCapsule(link, body, each.start, each.end, each.radius) for each in _outermost(fitted)]
        capsules = capsules or _segments(layout, link)
        shapes += capsules
        if capsules:
            convex = {radius: Outline.convex(np.concatenate(of_radius)).points for radius, of_radius in points.items()}
            ends = [(*pair, radius) for radius, corners in convex.items() for pair in _pairs(corners)]
            hulls[link] = [LinkCapsule(link, body, *each) for each in ends] or capsules
    return tuple(shapes), hulls


def link_outlines(layout: TreeLayout, folder: Path, meshes: Mapping[str, str]) -> list[tuple[int, Outline]]:
    """Return the collision geometry in the plane, which the capsules hold, each with the body whose frame it is in.

    Parameters and errors are those of :func:`link_shapes`.
    """
    return [
        (layout.body_of[link], replace(outline, points=outline.points + shift))
        for link in layout.tree.links
        for outline, shift in _collisions(layout, link, folder, meshes)
    ]


def mesh_digests(tree: UrdfTree, folder: Path) -> dict[str, str]:
    """Return the SHA-256 of the mesh files of collision elements by their names there, of those that can be read."""
    digests: dict[str, str] = {}
    for _, filename, path in _meshes(tree, folder):
        if path is not None and filename not in digests:
            with contextlib.suppress(InputError):
                digests[filename] = hashlib.sha256(read_regular(path, LARGEST_MESH, "a mesh")).hexdigest()
    return digests


def missing_meshes(tree: UrdfTree, folder: Path) -> list[tuple[str, str]]:
    """Return the link and the file name of each mesh of a collision element that is not to be found."""
    return [(link, filename) for link, filename, path in _meshes(tree, folder) if path is None]


def left_out(tree: UrdfTree, folder: Path) -> InputError | None:
    """Return the error of the first collision geometry that no shape is around: not found, unknown, or a second one."""
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
    tree: PlanarTree, hulls: Mapping[str, Sequence[LinkCapsule]], apart: Collection[str], bodies: Collection[int]
) -> tuple[LinkCapsule, ...]:
    """Return capsules whose ends reach as far as the links in every direction.

    Parameters
    ----------
    tree : PlanarTree
    hulls : link -> capsules whose ends are the corners of its own hull
    apart : links that keep all of these
    bodies : those taken exactly; others reach up to a millimetre farther
    """
    place = tree.coincident.tolist()
    exact = {place[body] for body in bodies}
    own = [each for link in apart for each in hulls[link]]
    kept: dict[tuple[int, float], list[LinkCapsule]] = {}
    for each in (each for hull in hulls.values() for each in hull):
        kept.setdefault((place[each.body], each.radius), []).append(each)
    joined: list[LinkCapsule] = []
    for (body, radius), members in kept.items():
        ends = _ends(members)
        around = Outline.convex(ends, radius)
        corners = around.points if body in exact else with_fewer_corners(around).points
        known = [each for each in own if place[each.body] == body and each.radius == radius]
        distance = abs(corners[:, None] - _ends(known)[None, :])
        for start, end in _pairs(corners[distance.min(axis=1, initial=np.inf) > SAME]):
            nearest = members[int(abs(ends - start).argmin()) % len(members)]
            joined.append(LinkCapsule(nearest.link, nearest.body, start, end, radius))
    return (*own, *joined)


def _meshes(tree: UrdfTree, folder: Path) -> Iterator[tuple[str, str, Path | None]]:
    """The link, the file name and the file, where it is to be found, of each mesh of a collision element."""
    for link in tree.links.values():
        for collision in link.collisions:
            for mesh in collision.iterfind("geometry/mesh"):
                filename = mesh.get("filename", "")
                yield link.name, filename, find_mesh(filename, folder)


def _collisions(
    layout: TreeLayout, link: str, folder: Path, meshes: Mapping[str, str]
) -> Iterator[tuple[Outline, complex]]:
    """A link's collision geometry in the plane, each with what it is shifted by, m."""
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
    return [(complex(corners[i]), complex(corners[min(i + 1, len(corners) - 1)])) for i in range(0, len(corners), 2)]


def _ends(capsules: Sequence[LinkCapsule]) -> ComplexArray:
    return np.array([*(each.start for each in capsules), *(each.end for each in capsules)], dtype=np.complex128)


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


def _segments(layout: TreeLayout, link: str) -> list[LinkCapsule]:
    """From the link's origin to those of its children's joints, and of its own where it stands away from there."""
    if layout.tree.links[link].frame:
        return []
    body = layout.body_of[link]
    start = layout.local(body, layout.placements[link].translation)
    ends = dict.fromkeys(
        layout.local(body, (layout.placements[joint.parent] * joint.origin.placement).translation)
        for joint in layout.tree.joints
        if link in (joint.parent, joint.child)
    )
    segments = [LinkCapsule(link, body, start, end, 0.0) for end in ends if end != start]
    if not segments and layout.tree.links[link].inertial is not None:
        return [LinkCapsule(link, body, start, start, 0.0)]
    return segments
