"""The links' shapes in the plane.

A link with ``<collision>`` geometry is the capsules around its projection; they hold it, so that a clearance of the
capsules is one of the link. A link without is the segments from its own origin (its joint) to the origins of its
children's joints, of radius 0: the paper's links.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from floatplan.robot.capsule_cache import mesh_capsules
from floatplan.robot.capsule_fit import Outline, PlaneCapsule, fit_capsules
from floatplan.robot.mesh_files import find_mesh, load_mesh
from floatplan.robot.outlines import MeshUse, Projection, read_collision
from floatplan.robot.parts import Capsule
from floatplan.robot.tree_builder import TreeLayout
from floatplan.robot.urdf_tree import UrdfTree


def link_shapes(layout: TreeLayout, folder: Path | None) -> tuple[Capsule, ...]:
    """Return the shapes of all links, in the order of the links in the file.

    Parameters
    ----------
    layout : TreeLayout
    folder : path or None
        Of the URDF, from which mesh files are looked for.

    Raises
    ------
    InputError
        If the geometry of a collision is wrong, or its file is not a mesh.
    """
    children: dict[str, list[str]] = {name: [] for name in layout.tree.links}
    for joint in layout.tree.joints:
        children[joint.parent].append(joint.child)
    shapes: list[Capsule] = []
    for link, below in children.items():
        shapes += _capsules(layout, link, folder) or _segments(layout, link, below)
    return tuple(shapes)


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
                corners, edges = load_mesh(outline.path, outline.element)
                outline = Outline(outline.projection(corners * outline.scale), edges)
            if outline is not None:
                outlines.append((layout.body_of[name], outline))
    return outlines


def missing_meshes(tree: UrdfTree, folder: Path | None) -> list[tuple[str, str]]:
    """Return the link and the file name of each mesh of a collision element that is not to be found."""
    missing = []
    for link in tree.links.values():
        for collision in link.collisions:
            for mesh in collision.iterfind("geometry/mesh"):
                filename = mesh.get("filename", "")
                if folder is None or find_mesh(filename, folder) is None:
                    missing.append((link.name, filename))
    return missing


def _capsules(layout: TreeLayout, link: str, folder: Path | None) -> list[Capsule]:
    fitted: list[PlaneCapsule] = []
    for collision in layout.tree.links[link].collisions:
        outline = read_collision(link, collision, _projection(layout, link), folder)
        if isinstance(outline, MeshUse):
            fitted += mesh_capsules(outline)
        elif outline is not None:
            fitted += fit_capsules(outline)
    body = layout.body_of[link]
    return [Capsule(link, body, capsule.start, capsule.end, capsule.radius) for capsule in _outermost(fitted)]


def _outermost(capsules: list[PlaneCapsule]) -> list[PlaneCapsule]:
    """Capsules less those inside another; of two that are the same, the first stays."""
    different = list(dict.fromkeys(capsules))
    return [one for one in different if not any(other.holds(one) for other in different if other is not one)]


def _projection(layout: TreeLayout, link: str) -> Projection:
    """From the link's frame to its body's frame in the plane."""
    home = layout.bodies[layout.body_of[link]]
    placement = layout.placements[link]
    back = np.exp(-1j * layout.plane.turn * home.offset)
    row = (layout.plane.horizontal + 1j * layout.plane.vertical) @ placement.rotation * back
    return Projection(row, layout.local(layout.body_of[link], placement.translation))


def _segments(layout: TreeLayout, link: str, children: list[str]) -> list[Capsule]:
    body = layout.body_of[link]
    start = layout.local(body, layout.placements[link].translation)
    ends = dict.fromkeys(layout.local(body, layout.placements[child].translation) for child in children)
    segments = [Capsule(link, body, start, end, 0.0) for end in ends if end != start]
    if not segments and layout.tree.links[link].inertial is not None:
        return [Capsule(link, body, start, start, 0.0)]
    return segments
