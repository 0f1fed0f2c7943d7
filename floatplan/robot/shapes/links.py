"""The links' shapes in the plane.

A link with ``<collision>`` geometry is the capsules around its projection; they hold it, so that a clearance of the
capsules is one of the link. A link without is the segments from its own origin to the origins of its children's joints,
of radius 0: the paper's links. A joint's origin is where the URDF puts it; a locked prismatic joint holds its child
away from there, and the child then has the segment between the two as well. Over the ground a link is as high as its
convex hull, whose corners are kept beside the capsules; hulls of what moves as one have far fewer corners.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from floatplan.arrays import ComplexArray
from floatplan.errors import InputError
from floatplan.files import read_text, write_atomically
from floatplan.robot.planar.tree import SAME, PlanarTree, TreeLayout
from floatplan.robot.shapes.capsules import Outline, PlaneCapsule, capsules_of, fit, is_fit, with_fewer_corners
from floatplan.robot.shapes.collisions import (
    KINDS,
    Mesh,
    MeshUse,
    Projection,
    find_mesh,
    load_mesh,
    mesh_digest,
    read_collision,
)
from floatplan.robot.urdf.tree import UrdfTree

MOST_COLLISIONS = 500  # [-] of a robot; those of example-robot-data have up to 112
CACHE_VERSION = 4  # [-] of the fit: raised with a change of its results, so that older entries are not used
LARGEST_ENTRY = 10_000  # [bytes] of a file of the cache


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
        for outline, use, mesh in _collisions(layout, link, folder, meshes):
            fitted += capsules_of(fit(outline)) if use is None or mesh is None else _mesh_capsules(use, mesh)
            points.setdefault(outline.radius, []).append(outline.points)
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
        (layout.body_of[link], outline)
        for link in layout.tree.links
        for outline, *_ in _collisions(layout, link, folder, meshes)
    ]


def mesh_digests(tree: UrdfTree, folder: Path) -> dict[str, str]:
    """Return the SHA-256 of the mesh files of collision elements by their names there, of those that can be read."""
    digests: dict[str, str] = {}
    for link, filename, path in _meshes(tree, folder):
        if path is not None and filename not in digests:
            with contextlib.suppress(InputError):
                digests[filename] = mesh_digest(path, f'link "{link}"')
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
) -> Iterator[tuple[Outline, MeshUse | None, Mesh | None]]:
    """A link's collision geometry in the plane; with it the mesh, where it is one."""
    body, placement = layout.body_of[link], layout.placements[link]
    row = (layout.plane.horizontal + 1j * layout.plane.vertical) @ placement.rotation * layout.back(body)
    projection = Projection(row, layout.local(body, placement.translation))
    for collision in layout.tree.links[link].collisions:
        shape = read_collision(link, collision, projection, folder)
        if isinstance(shape, Outline):
            yield shape, None, None
        elif shape is not None:
            mesh = load_mesh(shape.path, shape.scale, shape.element)
            if mesh.sha256 != meshes.get(shape.filename):
                reason, advice = "has changed since the robot was read", "read the robot again"
                raise InputError(reason, source=shape.path, element=shape.element, advice=advice)
            yield Outline(shape.projection(mesh.corners), mesh.edges), shape, mesh


def _mesh_capsules(use: MeshUse, mesh: Mesh) -> list[PlaneCapsule]:
    """The capsules around a mesh in the plane, from the cache: fitting them takes longer than checking that they fit.

    Entries are not trusted: one is used only where its capsules hold the mesh as it is now. Its name is a digest of all
    that the capsules depend on; the shift is left out, as they move with it.
    """
    outline, shift = Outline(mesh.corners @ use.projection.row, mesh.edges), use.projection.shift
    digest = hashlib.sha256(f"{CACHE_VERSION} {mesh.sha256} {use.path.suffix.lower()}".encode())
    digest.update(np.ascontiguousarray(use.scale).tobytes())
    digest.update((np.round(use.projection.row, 12) + 0.0).tobytes())
    entry, fitted = cache_folder() / f"{digest.hexdigest()}.json", None
    with contextlib.suppress(ValueError, TypeError, KeyError, RecursionError):  # missing, damaged or forged
        content = json.loads(read_text(entry, LARGEST_ENTRY, "a cache entry"))
        fitted = content if is_fit(content, outline) else None
    if fitted is None:
        fitted = fit(outline)
        with contextlib.suppress(OSError, InputError):  # where it cannot be written, fitting is repeated the next time
            write_atomically(entry, json.dumps(fitted))
    return [PlaneCapsule(each.start + shift, each.end + shift, each.radius) for each in capsules_of(fitted)]


def cache_folder() -> Path:
    """Folder of the capsules around meshes: below ``XDG_CACHE_HOME``, or ``.cache`` in the home folder."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "floatplan" / "capsules"


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
