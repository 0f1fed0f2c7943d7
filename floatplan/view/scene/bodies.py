"""Robots in the scene: one frame for each body of the tree, and what is drawn hangs from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.robot import Plane
from floatplan.robot.robot import Robot
from floatplan.view.postures import Poses, Postures, body_poses
from floatplan.view.scene.meshes import (
    Mesh,
    capsule,
    coarser,
    fewer,
    joined,
    joint_angles,
    plain_colour,
    seen_capsules,
    visual_model,
)
from floatplan.view.style import palette, rgb_bytes

Colour = tuple[int, int, int]
DETAIL = 0.005  # [-] of meshes, in reaches of the robot: a pixel of a flight that fills a small window
SHARE, FEW = 0.2, 200  # [-] of their triangles that are drawn, and of a mesh all the same
SECTIONS = (12, 8)  # [-] of a capsule, along and around its axis
FINE_SECTIONS = (16, 16)  # [-] the same where nobody waits for it
SUBDIVISIONS = 1  # [-] of an icosahedron: what is grabbed is small
GRIP = 0.035  # [-] radius of what is grabbed, in reaches of the robot


def in_space(plane: Plane, places: ComplexArray | complex) -> Array:
    """Places (...) of the plane, horizontal + i vertical, as points (..., 3)."""
    places = np.asarray(places)
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


@dataclass(frozen=True, eq=False)
class Grip:
    """What is grabbed of a part: its node, the body that it is on, and where, m."""

    node: Any
    body: int
    end: complex


class Bodies:
    """A robot whose bodies can be put anywhere."""

    def __init__(self, server: Any, name: str, robot: Robot) -> None:
        self.name, self._server, self._robot = name, server, robot
        self.root = server.scene.add_frame(name, show_axes=False)
        self.frames = [
            server.scene.add_frame(f"{name}/{body}", show_axes=False) for body in range(len(robot.tree.mass))
        ]

    def add_capsules(
        self,
        shapes: Postures,
        colour: Colour | None = None,
        opacity: float | None = None,
        sections: tuple[int, int] = SECTIONS,
    ) -> list[tuple[int, Any]]:
        """Draw the links as capsules, in one colour or in those of all pictures; return parts with their nodes.

        ``shapes`` has the radii and the parts of the capsules.

        What moves together is one mesh; what another capsule hides always is left out.
        """
        from trimesh.util import concatenate

        robot = self._robot
        colours = [rgb_bytes(each) for each in palette(len(robot.joints) + 1)]
        together: dict[tuple[int, int], list[Any]] = {}
        for index in seen_capsules(robot, shapes.radius):
            shape, radius, part = robot.shapes[index], float(shapes.radius[index]), int(shapes.part[index])
            start, end = (in_space(robot.plane, place) for place in (shape.start, shape.end))
            together.setdefault((shape.body, part), []).append(capsule(start, end, radius, sections))
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

    def add_meshes(self, size: float | None = None, share: float = SHARE) -> bool:
        """Draw the links as the URDF does, as fine as a robot of a size, m, shows it; return whether it does.

        What moves together and has one colour is one mesh; of its triangles a share is drawn, fewest where it is flat.
        Without a size all is drawn as it is.
        """
        robot, scene = self._robot, self._server.scene
        model = visual_model(robot)
        if model is None:
            return False
        plane, layout = robot.plane, robot.layout
        resting = np.zeros(len(robot.joints))
        angles = joint_angles(robot, resting)
        model.update_cfg(np.array([angles[name] for name in model.actuated_joint_names]))
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
            if colour is None or size is None:
                scene.add_mesh_trimesh(f"{self.name}/{body}/mesh{number}", placed)
            else:
                together.setdefault((body, colour), []).append((placed.vertices, placed.faces))
        for number, ((body, colour), meshes) in enumerate(together.items()):
            vertices, faces = coarser(*joined(meshes), DETAIL * (size or 0.0))
            count = max(math.ceil(share * len(faces)), FEW)
            name = f"{self.name}/{body}/links{number}"
            scene.add_mesh_simple(name, *fewer(vertices, faces, count), color=colour)
        return True

    def add_grips(self, shapes: Postures, reach: float, colour: Colour) -> dict[int, Grip]:
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
                position=in_space(robot.plane, end),
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


def _turn(plane: Plane, angle: float) -> Array:
    """The rotation (4, 4) by an angle about the normal."""
    import trimesh

    return np.asarray(trimesh.transformations.rotation_matrix(angle, plane.normal))
