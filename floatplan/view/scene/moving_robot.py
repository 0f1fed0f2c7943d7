"""The robot in the scene: its visual meshes where the URDF has them, else the capsules of its links."""

from __future__ import annotations

import io
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.motion.flight_state import FlightState
from floatplan.plans.plan import Plan
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.meshes import LARGEST, check_mesh_file, find_mesh
from floatplan.view.postures import posture_at
from floatplan.view.scene.solids import point_in_space, quaternion
from floatplan.view.style import palette

Mover: TypeAlias = Callable[[FlightState, int], None]

ROBOT = "/robot"


def visual_model(robot: Robot) -> Any:
    """Return the robot's ``yourdfpy.URDF`` with its visual meshes, or None where it has none that can be found.

    Raises
    ------
    InputError
        A mesh cannot be read, is too large, or is an archive.
    """
    root = ElementTree.fromstring(robot.xml)
    folder = Path() if robot.path is None else robot.path.parent
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
    except Exception as error:  # the readers of meshes raise exceptions of any kind
        reason = f"a visual mesh cannot be read: {error}"
        advice = "repair the mesh, or remove the <visual>"
        raise InputError(reason, source=robot.path, element="visual", advice=advice) from None
    if not reach <= LARGEST:
        raise InputError(
            f"a visual mesh has a corner {reach:.3g} m away, farther than any robot is large ({LARGEST:g} m)",
            source=robot.path,
            element="visual",
            advice="repair the mesh, or remove the <visual>",
        )
    return model


def _drop_missing_visuals(root: Any, folder: Path) -> bool:
    """Take the visuals whose files are missing out of a URDF, and what couples joints; return whether any stay."""
    for joint in root.iter("joint"):
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
    left = 0
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            path = None if mesh is None else find_mesh(mesh.get("filename", ""), folder)
            if mesh is not None and path is None:
                link.remove(visual)
                continue
            if path is not None:
                check_mesh_file(path, f'link "{link.get("name")}": visual: mesh')
            left += 1
    return left > 0


def mesh_robot(server: Any, plan: Plan, model: Any) -> Mover:
    """Add the robot with its meshes; return what moves it."""
    from viser.extras import ViserUrdf

    base = server.scene.add_frame(ROBOT, show_axes=False)
    drawn = ViserUrdf(server, model, root_node_name=ROBOT)
    names = list(drawn.get_actuated_joint_names())
    normal, plane = plan.robot.plane.normal, plan.robot.plane

    def move(state: FlightState, index: int) -> None:
        base.position = point_in_space(plane, complex(*state.base_position[index]))
        base.wxyz = quaternion(normal, float(state.orientation[index]))
        angles = joint_angles(plan.robot, state.positions[index])
        drawn.update_cfg(np.array([angles[name] for name in names]))

    return move


def joint_angles(robot: Robot, positions: Array) -> dict[str, float]:
    """Return the position of every joint that moves, by name: planned, coupled and locked; rad or m."""
    full = robot.reference + robot.selection @ positions
    return dict(zip(list(robot.model.names)[BASE_COORDINATES + 1 :], full[BASE_COORDINATES:].tolist(), strict=True))


def capsule_robot(server: Any, plan: Plan) -> Mover:
    """Add the robot as capsules, coloured as in all pictures; return what moves it."""
    robot, plane, tree = plan.robot, plan.robot.plane, plan.robot.tree
    placed = posture_at(plan, plan.problem.initial, 0.0)
    colours = palette(len(robot.joints) + 1)
    bodies = [server.scene.add_frame(f"{ROBOT}/{body}", show_axes=False) for body in range(len(tree.mass))]
    for number, shape in enumerate(robot.shapes):
        start, end = point_in_space(plane, shape.start), point_in_space(plane, shape.end)
        mesh = capsule(start, end, float(placed.radius[number]))
        colour = tuple(int(255 * part) for part in colours[placed.part[number]])
        name = f"{ROBOT}/{shape.body}/{number}"
        server.scene.add_mesh_simple(name, np.asarray(mesh.vertices), np.asarray(mesh.faces), color=colour)
    origins = tree.point_weights(np.arange(len(bodies)), np.zeros(len(bodies), dtype=np.complex128))

    def move(state: FlightState, index: int) -> None:
        angles = tree.absolute_angles(state.orientation[index : index + 1], state.positions[index : index + 1])[0]
        places = complex(*state.com_position[index]) + origins @ tree.rotations(angles)
        for node, angle, place in zip(bodies, angles, places, strict=True):
            node.position = point_in_space(plane, complex(place))
            node.wxyz = quaternion(plane.normal, float(angle))

    return move


def capsule(start: Array, end: Array, radius: float, sections: tuple[int, int] = (16, 16)) -> Any:
    """Return the ``trimesh.Trimesh`` of a capsule between two points (3,), m; sections along and around its axis."""
    import trimesh

    length = float(np.linalg.norm(end - start))
    mesh = trimesh.creation.capsule(height=length, radius=radius, count=list(sections))
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    if length > 0:
        mesh.apply_transform(trimesh.geometry.align_vectors([0.0, 0.0, 1.0], (end - start) / length))
    mesh.apply_translation((start + end) / 2)
    return mesh
