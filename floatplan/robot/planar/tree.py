"""The robot in its plane: bodies that rotate as one, and the positions of their points.

With the absolute angle of body b written as ``phi_b = orientation + turns_b @ positions + offsets_b`` (radians about
the plane's normal), every point of the robot relative to the centre of mass is a fixed linear combination of the
rotated unit vectors ``exp(i sigma phi_b)``; that is (6), (20) and (21) of the paper for any tree. Points of the plane
are complex numbers, horizontal + i vertical; sigma is the plane's ``turn``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray, read_only
from floatplan.robot.planar.choice import Choice, Plane
from floatplan.robot.urdf.tree import UrdfTree

SAME = 1e-9  # [m] points that are nowhere farther apart are one, and shorter lengths are none


@dataclass(frozen=True, eq=False)
class PlanarTree:
    """Bodies 0..m-1 of a planar tree, parents before children; body 0 carries the base.

    Attributes
    ----------
    names : tuple of str
        Name of each body: the link at its root.
    parent : (m,) int
        Index of the parent body, -1 for body 0.
    anchor : (m,) complex
        Position of the body's joint in its parent's frame, m; 0 for body 0.
    mass : (m,) kg
    center : (m,) complex
        Centre of mass in the body's frame, m.
    inertia : (m,) kg m^2
        About the body's own centre of mass and the plane's normal.
    armature : (m,) kg m^2
        Of the rotor that is geared to the joint between the body and its parent, as that joint feels it; 0 for body 0.
    turns : (m, n)
        Derivative of each body's absolute angle by the planned positions: entries 0, +-1, or coupling ratios.
    motor_turns : (m, motors)
        Derivative of each body's absolute angle by the positions of the robot's motors, each of them on its own.
    offsets : (m,) rad
        Absolute angle of each body at orientation 0 and planned positions 0.
    turn : float
        +1 where a positive angle about the normal rotates the horizontal axis towards the vertical one, else -1.
    origins : (m, m) complex, m
        Weights of rotations that give the bodies' origins, from the base's origin.
    com : (m,) complex, m
        Weights that give the centre of mass, from the base's origin.
    coupling : (m, m) complex, kg m^2
        The matrix C, Hermitian: ``W^H diag(mass) W``, W the weights of the bodies' mass centres.
    rotors : (m, n) kg m^2, or None where there are none
        Moments that accelerate the bodies' rotors, by the planned accelerations. Momentum does not count rotors.
    distinct_turns : (g, n), and (m,) int
        Rows of the turns that differ, in the order of their first appearance, and which of them each body has.
    """

    names: tuple[str, ...]
    parent: IntArray
    anchor: ComplexArray
    mass: Array
    center: ComplexArray
    inertia: Array
    armature: Array
    turns: Array
    motor_turns: Array
    offsets: Array
    turn: float
    origins: ComplexArray = field(init=False)
    com: ComplexArray = field(init=False)
    coupling: ComplexArray = field(init=False)
    rotors: Array | None = field(init=False)
    distinct_turns: tuple[Array, IntArray] = field(init=False)

    def __post_init__(self) -> None:
        """Compute what follows from the bodies: origins, the matrix C, moments of rotors, which bodies rotate alike."""
        count = len(self.mass)
        origins = np.zeros((count, count), dtype=np.complex128)
        for body, parent in enumerate(self.parent.tolist()[1:], 1):
            origins[body] = origins[parent]
            origins[body, parent] += self.anchor[body]
        centers = origins + np.diag(self.center)
        com = np.asarray(self.mass @ centers / self.mass.sum())
        from_com = centers - com
        coupling = np.asarray(from_com.conj().T @ (self.mass[:, None] * from_com))

        # A joint's torque accelerates its rotor too: a moment of the joint's body, against its parent, so that it is in
        # no other joint's torque.
        rotors = None
        if self.armature.any():
            own = self.armature[1:, None] * (self.turns[1:] - self.turns[self.parent[1:]])
            moments = np.zeros_like(self.turns)
            moments[1:] = own
            np.subtract.at(moments, self.parent[1:], own)
            rotors = read_only(moments)

        number_of: dict[tuple[float, ...], int] = {}
        group = [number_of.setdefault(row, len(number_of)) for row in map(tuple, (self.turns + 0.0).tolist())]
        distinct = np.array(list(number_of)).reshape(len(number_of), -1)

        for array in (origins, com, coupling):
            array.setflags(write=False)
        vars(self).update(
            origins=origins, com=com, coupling=coupling, rotors=rotors, distinct_turns=(distinct, np.array(group))
        )

    def absolute_angles(self, orientation: Array, positions: Array) -> Array:
        """Angles phi (..., m) of the bodies, from orientation (...) and positions (..., n), rad."""
        return orientation[..., None] + positions @ self.turns.T + self.offsets

    def rotations(self, angles: Array) -> ComplexArray:
        """Rotations exp(i sigma phi), from angles phi of any shape, rad."""
        rotations = np.empty(np.shape(angles), dtype=np.complex128)
        np.cos(angles, out=rotations.real)  # much cheaper than the complex exponential
        np.multiply(self.turn, np.sin(angles), out=rotations.imag)
        return rotations

    def point_weights(self, body: IntArray, local: ComplexArray) -> ComplexArray:
        """Weights W (points, m): a point's position relative to the centre of mass is ``rotations @ W.T``.

        Parameters
        ----------
        body : (points,) int
            The body that each point is fixed to.
        local : (points,) complex
            Its position in that body's frame, m.
        """
        weights: ComplexArray = self.origins[body]
        weights[np.arange(len(body)), body] += local
        return np.asarray(weights - self.com, dtype=np.complex128)

    def places_from_com(self, weights: ComplexArray, orientation: Array, positions: Array) -> ComplexArray:
        """Places (..), m, of points by their weights (m,) or (.., m), for orientations (..) and positions (.., n), rad.

        Each is computed as a single one: to the same bits.
        """
        angles = orientation[..., None] + (positions[..., None, :] * self.turns).sum(axis=-1) + self.offsets
        return np.asarray((self.rotations(angles) * weights).sum(axis=-1))

    @cached_property
    def coincident(self) -> IntArray:
        """Of each body the first (m,) that always has the same pose, such as of legs coupled left to right."""
        count = len(self.mass)
        samples = 3  # postures: bodies that coincide in three random ones always do
        postures = np.random.default_rng(0).uniform(-1.0, 1.0, (samples, self.turns.shape[1]))
        rotations = self.rotations(self.absolute_angles(np.zeros(samples), postures))
        weights = self.point_weights(np.repeat(np.arange(count), 2), np.tile(np.array([0j, 1 + 0j]), count))
        positions = (rotations @ weights.T).reshape(samples, count, 2)
        apart = abs(positions[:, :, None] - positions[:, None, :]).max(axis=(0, 3))
        return np.asarray(np.argmax(apart <= SAME, axis=1))


@dataclass(frozen=True)
class Frame:
    """A named point of the robot: a link's or joint's origin, fixed to a body of the :class:`PlanarTree`, m.

    ``link`` is the link itself, or the joint's child; ``weights`` (m,) give its place relative to the centre of mass,
    see :meth:`PlanarTree.point_weights`.
    """

    body: int
    local: complex
    link: str
    weights: ComplexArray = field(compare=False, repr=False)


@dataclass(frozen=True, eq=False)
class _Body:
    """A body: its root link, its angle (turns @ positions + offset), and its origin in the root link's plane.

    ``motor_turns`` are those by the positions of the motors.
    """

    name: str
    parent: int
    turns: Array
    motor_turns: Array
    offset: float
    origin: complex


@dataclass(frozen=True, eq=False)
class TreeLayout:
    """The bodies, which body each link belongs to, and where the links are when the planned positions are zero.

    ``placements`` are ``pinocchio.SE3`` in the root link; ``frames`` the origins of every link and joint by name, the
    link's where both have one name.
    """

    tree: UrdfTree
    plane: Plane
    bodies: tuple[_Body, ...]
    body_of: Mapping[str, int]
    placements: Mapping[str, Any]
    planar_tree: PlanarTree = field(init=False)
    frames: Mapping[str, Frame] = field(init=False)

    def __post_init__(self) -> None:
        """Make what every problem of the robot needs."""
        planar_tree = self._planar_tree()
        bodies = np.array(list(self.body_of.values()))
        origins = [self.local(body, self.placements[link].translation) for link, body in self.body_of.items()]
        weights = planar_tree.point_weights(bodies, np.array(origins))
        weights.setflags(write=False)
        links = {}
        for index, (link, body) in enumerate(self.body_of.items()):
            links[link] = Frame(body, origins[index], link, weights[index])
        joints = {joint.name: links[joint.child] for joint in self.tree.joints}
        frames = joints | {link: links[link] for link in self.tree.links}
        vars(self).update(planar_tree=planar_tree, frames=frames)

    @classmethod
    def of(cls, tree: UrdfTree, choice: Choice) -> TreeLayout:
        """Links that do not move relative to each other, gathered into bodies, parents first."""
        positions = choice.positions_at_zero
        placements = tree.placements(positions)
        bodies = [_Body(tree.root, -1, np.zeros(len(choice.planned)), np.zeros(len(choice.motors)), 0.0, 0j)]
        body_of = {tree.root: 0}
        angle = {tree.root: 0.0}
        for joint in tree.joints:
            parent = body_of[joint.parent]
            sign = choice.signs.get(joint.name, 0.0)
            angle[joint.child] = angle[joint.parent] + sign * positions.get(joint.name, 0.0)
            body_of[joint.child] = parent
            if joint.name in choice.ratios:
                body_of[joint.child] = len(bodies)
                turns = bodies[parent].turns + sign * choice.ratios[joint.name]
                motor_turns = bodies[parent].motor_turns + sign * choice.motor_ratios[joint.name]
                origin = choice.required_plane.project(placements[joint.child].translation)
                bodies.append(_Body(joint.child, parent, turns, motor_turns, angle[joint.child], origin))
        return cls(tree, choice.required_plane, tuple(bodies), body_of, placements)

    def back(self, body: int) -> complex:
        """Rotation, as a factor, from the plane to a body's frame at planned positions zero."""
        return complex(np.exp(-1j * self.plane.turn * self.bodies[body].offset))

    def local(self, body: int, point: Array) -> complex:
        """Position in a body's frame of a ``point`` (3,) of the root link, at planned positions zero."""
        return (self.plane.project(point) - self.bodies[body].origin) * self.back(body)

    def _planar_tree(self) -> PlanarTree:
        """The bodies with their masses, centres of mass and inertias about the plane's normal."""
        count = len(self.bodies)
        mass = np.zeros(count)
        inertia = np.zeros(count)
        moment = np.zeros(count, dtype=np.complex128)
        members = []  # body, mass and position of each link
        for link in self.tree.links.values():
            if link.inertial is None:
                continue
            body = self.body_of[link.name]
            placement = self.placements[link.name] * link.inertial.origin.placement
            position = self.local(body, placement.translation)
            normal = placement.rotation.T @ self.plane.normal
            mass[body] += link.inertial.mass
            moment[body] += link.inertial.mass * position
            inertia[body] += normal @ link.inertial.inertia @ normal
            members.append((body, link.inertial.mass, position))
        center = np.divide(moment, mass, out=np.zeros_like(moment), where=mass > 0.0)
        for body, link_mass, position in members:
            inertia[body] += link_mass * abs(position - center[body]) ** 2
        parent = np.array([body.parent for body in self.bodies], dtype=np.int64)
        anchor = np.zeros(count, dtype=np.complex128)
        armature = np.zeros(count)
        for index, body_below in enumerate(self.bodies[1:], 1):
            anchor[index] = self.local(body_below.parent, self.placements[body_below.name].translation)
            armature[index] = self.tree.carrier[body_below.name].armature or 0.0
        for array in (parent, anchor, center):
            array.setflags(write=False)
        return PlanarTree(
            names=tuple(body.name for body in self.bodies),
            parent=parent,
            anchor=anchor,
            mass=read_only(mass),
            center=center,
            inertia=read_only(inertia),
            armature=read_only(armature),
            turns=read_only([body.turns for body in self.bodies]),
            motor_turns=read_only([body.motor_turns for body in self.bodies]),
            offsets=read_only([body.offset for body in self.bodies]),
            turn=self.plane.turn,
        )
