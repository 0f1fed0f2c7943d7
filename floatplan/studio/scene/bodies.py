"""Robots in the scene: one frame for each body of the tree, and what is drawn hangs from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

import floatplan as fp
from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.motion.planar.ballistics import ballistics
from floatplan.problem.parts import JointState
from floatplan.robot.parts import Plane
from floatplan.studio.scene.detail import Mesh, coarser, fewer, joined, plain_colour, seen_capsules
from floatplan.studio.work.flown import Poses, body_poses
from floatplan.view.postures import Postures, posture_at
from floatplan.view.scene.moving_robot import capsule, joint_angles, visual_model
from floatplan.view.scene.solids import point_in_space
from floatplan.view.style import palette

Colour = tuple[int, int, int]
DETAIL = 0.005  # [-] of meshes, in reaches of the robot: a pixel of a flight that fills a small window
SHARE, FEW = 0.2, 200  # [-] of their triangles that are drawn, and of a mesh all the same
SECTIONS = (12, 8)  # [-] of a capsule, along and around its axis
SUBDIVISIONS = 1  # [-] of an icosahedron: what is grabbed is small
GRIP = 0.035  # [-] radius of what is grabbed, in reaches of the robot


def in_space(plane: Plane, places: ComplexArray) -> Array:
    """Places (...) of the plane as points (..., 3)."""
    return np.asarray(places.real[..., None] * plane.horizontal + places.imag[..., None] * plane.vertical)


def in_plane(plane: Plane, eye: Array, point: Array) -> complex | None:
    """Where the line from an eye (3,) through a point (3,) meets the plane; None where it never does."""
    aside = np.cross(plane.horizontal, plane.vertical)
    ray = point - eye
    slope = float(ray @ aside)
    if abs(slope) < 1e-6 * float(np.linalg.norm(ray)):
        return None
    met = eye - (eye @ aside) / slope * ray
    return complex(met @ plane.horizontal, met @ plane.vertical)


def turned(plane: Plane, angles: Array) -> Array:
    """Quaternions (..., 4), w x y z, of angles (...) about the normal."""
    sines = np.sin(angles / 2)[..., None] * plane.normal
    return np.concatenate((np.cos(angles / 2)[..., None], sines), axis=-1)


def ghost_poses(problem: fp.Problem, state: JointState, time: float) -> Poses:
    """The bodies of a posture, its centre of mass where the flight has it at a time, s."""
    path = ballistics(problem).positions(np.array([time]))
    com = path[:, 0] + 1j * path[:, 1]
    return body_poses(problem.robot, np.array([state.orientation]), state.positions[None], com)


@dataclass(frozen=True, eq=False)
class Shapes:
    """How capsules are drawn: radii (S,), m, and parts (S,), 0 for the base and i + 1 for what joint i moves."""

    radius: Array
    part: IntArray

    @classmethod
    def of(cls, plan: fp.Plan) -> Shapes:
        """As all pictures draw them."""
        placed: Postures = posture_at(plan, plan.problem.initial, 0.0)
        return cls(placed.radius, placed.part)


@dataclass(frozen=True, eq=False)
class Grip:
    """What is grabbed of a part: its node, the body that it is on, and where, m."""

    node: Any
    body: int
    end: complex


class Bodies:
    """A robot whose bodies can be put anywhere."""

    def __init__(self, server: Any, name: str, robot: fp.Robot) -> None:
        self.name, self._server, self._robot = name, server, robot
        self.root = server.scene.add_frame(name, show_axes=False)
        self.frames = [
            server.scene.add_frame(f"{name}/{body}", show_axes=False) for body in range(len(robot.tree.mass))
        ]

    def add_capsules(
        self, shapes: Shapes, colour: Colour | None = None, opacity: float | None = None
    ) -> list[tuple[int, Any]]:
        """Draw the links as capsules, in one colour or in those of all pictures; return parts with their nodes.

        What moves together is one mesh; what another capsule hides always is left out.
        """
        from trimesh.util import concatenate

        robot = self._robot
        colours = [tuple(int(255 * part) for part in each) for each in palette(len(robot.joints) + 1)]
        together: dict[tuple[int, int], list[Any]] = {}
        for index in seen_capsules(robot, shapes.radius):
            shape, radius, part = robot.shapes[index], float(shapes.radius[index]), int(shapes.part[index])
            start, end = (point_in_space(robot.plane, place) for place in (shape.start, shape.end))
            together.setdefault((shape.body, part), []).append(capsule(start, end, radius, SECTIONS))
        nodes = []
        for (body, part), meshes in together.items():
            mesh = concatenate(meshes)
            node = self._server.scene.add_mesh_simple(
                f"{self.name}/{body}/capsules{part}",
                np.asarray(mesh.vertices),
                np.asarray(mesh.faces),
                color=colour or colours[part],
                opacity=opacity,
            )
            nodes.append((part, node))
        return nodes

    def add_meshes(self, size: float, share: float = SHARE) -> bool:
        """Draw the links as the URDF does, as fine as a robot of a size, m, shows it; return whether it does.

        What moves together and has one colour is one mesh; of its triangles a share is drawn, fewest where it is flat.
        """
        robot, scene = self._robot, self._server.scene
        model = visual_model(robot)
        if model is None:
            return False
        plane, layout = robot.plane, robot.layout
        model.update_cfg(_configuration(model, robot))
        resting = np.zeros(len(robot.joints))
        poses = body_poses(robot, np.zeros(1), resting[None], np.zeros(1, dtype=np.complex128))
        root = robot.frames[robot.tree.names[0]]
        base = complex(poses.places[0, 0] + root.local * robot.tree.rotations(poses.angles)[0, 0])
        origins = in_space(plane, poses.places[0] - base)
        together: dict[tuple[int, Colour], list[Mesh]] = {}
        for number, (geometry, mesh) in enumerate(model.scene.geometry.items()):
            link = model.scene.graph.transforms.parents[geometry]
            body = layout.body_of[link]
            placed = mesh.copy()
            placed.apply_transform(model.get_transform(geometry))
            placed.apply_translation(-origins[body])
            placed.apply_transform(_turn(plane, -float(poses.angles[0, body])))
            colour = plain_colour(placed)
            if colour is None:
                scene.add_mesh_trimesh(f"{self.name}/{body}/mesh{number}", placed)
            else:
                together.setdefault((body, colour), []).append((placed.vertices, placed.faces))
        for number, ((body, colour), meshes) in enumerate(together.items()):
            vertices, faces = coarser(*joined(meshes), DETAIL * size)
            count = max(math.ceil(share * len(faces)), FEW)
            name = f"{self.name}/{body}/links{number}"
            scene.add_mesh_simple(name, *fewer(vertices, faces, count), color=colour)
        return True

    def add_grips(self, shapes: Shapes, reach: float, colour: Colour) -> dict[int, Grip]:
        """Add what is grabbed: for each part the end of a link that is farthest from its joint."""
        from trimesh.creation import icosphere

        robot, found, ball = self._robot, {}, icosphere(SUBDIVISIONS, GRIP * reach)
        for part in range(len(robot.joints) + 1):
            ends = [
                (abs(end), shape.body, end)
                for shape, of in zip(robot.shapes, shapes.part, strict=True)
                for end in (shape.start, shape.end)
                if of == part
            ]
            if not ends:
                continue
            _, body, end = max(ends, key=lambda each: each[0])
            node = self._server.scene.add_mesh_simple(
                f"{self.name}/{body}/grip{part}",
                ball.vertices,
                ball.faces,
                color=colour,
                position=point_in_space(robot.plane, end),
            )
            found[part] = Grip(node, body, end)
        return found

    def put(self, poses: Poses, index: int) -> None:
        """Put the bodies where they are at an instant."""
        plane = self._robot.plane
        points = in_space(plane, poses.places[index])
        turns = turned(plane, poses.angles[index])
        for frame, point, turn in zip(self.frames, points, turns, strict=True):
            frame.position = point
            frame.wxyz = turn


def _configuration(model: Any, robot: fp.Robot) -> Array:
    """The model's joints at planned positions zero."""
    angles = joint_angles(robot, np.zeros(len(robot.joints)))
    return np.array([angles[name] for name in model.actuated_joint_names])


def _turn(plane: Plane, angle: float) -> Array:
    """The rotation (4, 4) by an angle about the normal."""
    import trimesh

    return np.asarray(trimesh.transformations.rotation_matrix(angle, plane.normal))
