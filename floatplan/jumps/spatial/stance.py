"""The motion of a stance in space, from what is saved: places of base and joints, and how feet share the forces."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.optimize import nnls

from floatplan.arrays import Array, read_only
from floatplan.jumps.motion import JumpState, quintic_spline, values
from floatplan.jumps.spatial.coordinates import Mechanics, of_contact, rotations_about
from floatplan.jumps.spatial.impact import unexplained
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.standing import Foot
from floatplan.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class SpatialGrid:
    """A stance on G instants, quintics between them.

    Attributes
    ----------
    times : (G,) s, from the jump's start
    y, v, a : (6+n, G) position of the base's origin, m, its angles and joints, rad, with their derivatives
    planned_forces : (3 F, G) of the feet, N, near to which the actual ones are, linear between instants
    """

    times: Array
    y: Array
    v: Array
    a: Array
    planned_forces: Array

    @cached_property
    def curve(self) -> object:
        """Piecewise polynomial of y."""
        return quintic_spline(self.times, np.stack((self.y, self.v, self.a)))

    def at(self, times: Array) -> Array:
        """y, y', y'' (3, 6+n, N) at times (N,)."""
        return values(self.curve, times)


@dataclass(frozen=True, eq=False)
class SpatialStance:
    """One stance phase.

    Attributes
    ----------
    robot : Robot
    gravity : m/s^2
    axes : of the base's angles
    contacts : feet that stand
    friction : coefficient, within whose cone the feet share the forces where they can
    grid : SpatialGrid
    """

    robot: Robot
    gravity: float
    axes: str
    contacts: tuple[Foot, ...]
    friction: float
    grid: SpatialGrid

    @cached_property
    def mechanics(self) -> Mechanics:
        """The robot with these feet."""
        return Mechanics(self.robot, self.axes, self.gravity, self.contacts)

    @cached_property
    def span(self) -> tuple[float, float]:
        """Begin and end, s."""
        return float(self.grid.times[0]), float(self.grid.times[-1])

    @property
    def ground(self) -> float:
        """Height of the ground below its feet, m."""
        places = self.mechanics.feet(self.grid.at(self.grid.times[:1]), [self.contacts[0].name])
        return float(places[0, 0, 0, 2] - self.contacts[0].depth)

    def joints(self, times: Array) -> Array:
        """Planned positions (N, n), rad, at times (N,) s."""
        return np.asarray(self.grid.at(times)[0, BASE:].T)

    def at(self, times: Array) -> JumpState:
        """State at times (N,) s from the jump's start."""
        motion = self.grid.at(times)
        mechanics = self.mechanics
        names = [foot.name for foot in self.contacts]
        coordinates = mechanics.coordinates(motion)
        q, v, a = coordinates
        places, _ = mechanics.places_and_jacobians(q, names, of_slip=False)
        wrench = mechanics.wrench_of(coordinates)
        rotation = rotations_about(self.axes, motion[0, 3:BASE])
        base = np.hstack(
            (
                np.einsum("nij,nj->ni", rotation, wrench[:, :3]),
                np.einsum("nij,nj->ni", rotation, wrench[:, 3:BASE]),
            )
        )
        planned_forces = np.array([np.interp(times, self.grid.times, row) for row in self.grid.planned_forces]).T
        contacts = places - [[0.0, 0.0, foot.radius] for foot in self.contacts]
        arms = contacts - motion[0, :3].T[:, None]
        weight = self.gravity * self.robot.mass
        planned_forces = planned_forces.reshape(len(times), len(names), 3)
        forces = shared_forces(base, arms, planned_forces, weight, self.friction)
        # What is left on the base: force and moment in its own axes, as RNEA has them.
        left = base - np.hstack((forces.sum(axis=1), np.cross(arms, forces).sum(axis=1)))
        torques = wrench.copy()
        torques[:, :3] = np.einsum("nji,nj->ni", rotation, left[:, :3])
        torques[:, 3:BASE] = np.einsum("nji,nj->ni", rotation, left[:, 3:])
        torques[:, BASE:] -= self._carried(q, forces)
        return JumpState(
            times=read_only(times),
            positions=read_only(continuous(q)),
            velocities=read_only(v),
            accelerations=read_only(a),
            forces={name: read_only(forces[:, column]) for column, name in enumerate(names)},
            torques=read_only(torques),
            points={name: read_only(contacts[:, column]) for column, name in enumerate(names)},
        )

    def inverse_dynamics(self, state: JumpState) -> tuple[Array, dict[str, tuple[Array, Array]]]:
        """What the motors and the base take of a state's forces; see :class:`~floatplan.jumps.motion.AnyStance`.

        The points are frames of the robot's own model, apart from what the state was computed with; points of soles,
        which have none, get some. Of balls that roll, the force acts at the lowest point, whose speed it is; what they
        have rolled is the integral of ``w x r e_z``, by trapezoids.
        """
        model = self.robot.model.copy()
        model.gravity.linear = np.array([0.0, 0.0, -self.gravity])
        frame_numbers = {foot.name: _frame_number(model, foot) for foot in self.contacts}
        data = model.createData()
        count = len(state.times)
        torques = np.empty_like(state.torques)
        feet = {name: (np.empty((count, 3)), np.empty(count)) for name in frame_numbers}
        rolling = {foot.name: np.empty((count, 3)) for foot in self.contacts if foot.radius}  # angular velocities
        radii = self.mechanics.radii
        rows = zip(state.positions, state.velocities, state.accelerations, strict=True)
        for index, (q, v, a) in enumerate(rows):
            torques[index] = pin.rnea(model, data, q, v, a)
            pin.computeJointJacobians(model, data, q)
            pin.updateFramePlacements(model, data)
            for name, (positions, speeds) in feet.items():
                frame = model.frames[frame_numbers[name]]
                down = data.oMi[frame.parentJoint].rotation[2]  # the vertical in the joint's axes
                lowest = pin.SE3(np.eye(3), frame.placement.translation - radii[name] * down)
                aligned = pin.LOCAL_WORLD_ALIGNED
                jacobian = pin.getFrameJacobian(model, data, frame.parentJoint, lowest, aligned)
                torques[index] -= jacobian[:3].T @ state.forces[name][index]
                positions[index] = data.oMf[frame_numbers[name]].translation
                speeds[index] = np.linalg.norm(jacobian[:3] @ v)
                if name in rolling:
                    rolling[name][index] = jacobian[3:] @ v
        steps = np.diff(state.times)[:, None]
        for name, spins in rolling.items():
            velocities = np.cross(spins, [0.0, 0.0, radii[name]])
            feet[name][0][1:] -= np.cumsum(steps * (velocities[1:] + velocities[:-1]) / 2, axis=0)
        return torques, feet

    def impact(self, before: JumpState, after: JumpState, friction: float) -> tuple[float, float]:
        """Check an impact with which its feet come to the ground.

        Parameters
        ----------
        before, after : states of one instant in the same configuration
        friction : coefficient of the cones in which the impulses are

        Returns
        -------
        float
            Speed of the fastest foot before it, m/s; after it feet that stand have none, as in any stance.
        float
            Largest change of a rate that impulses inside these cones do not explain, m/s or rad/s.
        """
        without = {foot.name: np.zeros((1, 3)) for foot in self.contacts}
        feet = self.inverse_dynamics(replace(before, forces=without))[1]
        speed = max(float(speeds[0]) for _, speeds in feet.values())
        # Inverse dynamics without rates, less what gravity takes: changes of rates are accelerations there.
        still = np.zeros_like(after.velocities)
        standing = replace(after, velocities=still, accelerations=still, forces=without)
        own = np.hstack((np.eye(still.shape[1])[:, :BASE], self.robot.selection))  # base and planned joints
        of_gravity = self.inverse_dynamics(standing)[0][0]

        def momenta(**other: Any) -> Array:
            return np.asarray(own.T @ (self.inverse_dynamics(replace(standing, **other))[0][0] - of_gravity))

        mass = np.stack([momenta(accelerations=direction[None]) for direction in own.T], axis=1)
        effects = np.zeros((len(mass), len(self.contacts), 3))
        for column, foot in enumerate(self.contacts):
            for axis in range(3):
                effects[:, column, axis] = -momenta(forces={**without, foot.name: np.eye(3)[[axis]]})
        change = np.linalg.lstsq(own, (after.velocities - before.velocities)[0], rcond=None)[0]
        try:
            left = unexplained(change, mass, effects, friction)
        # Of numbers beyond all sense, as files may hold; or where least squares take too many iterations.
        except (np.linalg.LinAlgError, ValueError, RuntimeError):
            return speed, np.inf
        return speed, float(np.abs(left).max())

    def _carried(self, q: Array, forces: Array) -> Array:
        """Torques (N, J) by which forces (N, F, 3) at the feet act on the joints of the robot's model at q (N, nq)."""
        mechanics = self.mechanics
        carried = np.zeros((len(q), self.robot.model.nv - BASE))
        for index, configuration in enumerate(q):
            pin.computeJointJacobians(mechanics.model, mechanics.data, configuration)
            pin.updateFramePlacements(mechanics.model, mechanics.data)
            for column, foot in enumerate(self.contacts):
                number = mechanics.frame_numbers[foot.name]
                jacobian = pin.getFrameJacobian(mechanics.model, mechanics.data, number, pin.LOCAL_WORLD_ALIGNED)
                at_contact = of_contact(jacobian[:, BASE:], foot.radius)
                carried[index] += at_contact.T @ forces[index, column]
        return carried


def shared_forces(wrench: Array, arms: Array, planned_forces: Array, weight: float, friction: float) -> Array:
    """Forces (N, F, 3) at points that make a wrench (N, 6), near to planned ones (N, F, 3): by least squares.

    What bears little changes little: squares are over planned vertical forces, so that feet are released gently. Where
    a force leaves the friction cone, the nearest forces inside it are taken.

    Parameters
    ----------
    wrench : (N, 6) force, N, and moment about the base's origin, N m
    arms : (N, F, 3) of the points from that origin, m
    planned_forces : (N, F, 3) N
    weight : of the robot, N
    friction : coefficient
    """
    count, feet, _ = arms.shape
    lightest = 1e-6  # [-] of the weight: a foot that bears nothing takes next to nothing
    loads = np.repeat(np.maximum(planned_forces[:, :, 2], 0.0) / weight + lightest, 3, axis=1)
    arm_map = np.zeros((count, 6, 3 * feet))
    for foot in range(feet):
        arm_map[:, :3, 3 * foot : 3 * foot + 3] = np.eye(3)
        x, y, z = arms[:, foot].T
        arm_map[:, 3, 3 * foot + 1] = -z
        arm_map[:, 3, 3 * foot + 2] = y
        arm_map[:, 4, 3 * foot] = z
        arm_map[:, 4, 3 * foot + 2] = -x
        arm_map[:, 5, 3 * foot] = -y
        arm_map[:, 5, 3 * foot + 1] = x
    flat = planned_forces.reshape(count, -1)
    missing = wrench - np.einsum("nij,nj->ni", arm_map, flat)
    scaled = arm_map * np.sqrt(loads)[:, None]
    change = np.sqrt(loads) * np.einsum("nij,nj->ni", np.linalg.pinv(scaled, rcond=1e-9), missing)
    forces = (flat + change).reshape(count, feet, 3)
    horizontal = np.linalg.norm(forces[:, :, :2], axis=2)
    leaves = (horizontal > friction * np.maximum(forces[:, :, 2], 0.0) + 1e-9 * weight).any(axis=1)
    for index in np.flatnonzero(leaves):
        forces[index] = _in_cones(arm_map[index], wrench[index], flat[index], loads[index], weight, friction)
    return np.asarray(forces)


def _in_cones(arm_map: Array, wrench: Array, planned: Array, loads: Array, weight: float, friction: float) -> Array:
    """Forces (F, 3) in pyramids of 16 sides in the friction cones that make a wrench (6,), near to planned ones (3 F,).

    They are sums of the pyramids' edges, with factors that are not negative.
    """
    sides = 16  # [-] the pyramid has 0.98 of the cone's width
    heavier = 1e-5  # [-] of the nearness to the planned forces over the wrench
    rounds = 6  # [-] at most; each leaves less of the wrench by orders of magnitude, if the cones have it at all
    angles = 2 * np.pi * np.arange(sides) / sides
    edges = np.stack((friction * np.cos(angles), friction * np.sin(angles), np.ones(sides)))
    feet = len(planned) // 3
    generators = np.kron(np.eye(feet), edges)
    nearness = heavier / np.sqrt(loads)
    rows = np.vstack((arm_map @ generators, nearness[:, None] * generators))
    # Where light feet stay near their planned forces, least squares leave some of the wrench: it is required once more,
    # as multipliers of the wrench's equations would (Hestenes 1969).
    target = wrench.copy()
    forces = planned
    for _ in range(rounds):
        factors, _ = nnls(rows, np.concatenate((target, nearness * planned)) / weight)
        forces = generators @ factors * weight
        missing = wrench - arm_map @ forces
        if np.abs(missing).max() < 1e-10 * weight:
            break
        target += missing
    return np.asarray(forces.reshape(feet, 3))


def _frame_number(model: Any, foot: Foot) -> int:
    """Number of a foot's frame in a model; one more where it is a point of a sole."""
    if not foot.suffix:
        return int(model.getFrameId(foot.frame))
    placement = pin.SE3(np.eye(3), np.array(foot.local))
    return int(model.addFrame(pin.Frame(foot.name, foot.body, 0, placement, pin.FrameType.OP_FRAME)))


def continuous(q: Array) -> Array:
    """Configurations (N, nq) whose quaternions do not change their sign from one to the next."""
    signs = np.cumprod(np.where((q[1:, 3:7] * q[:-1, 3:7]).sum(axis=1) < 0, -1.0, 1.0))
    q[1:, 3:7] *= signs[:, None]
    return q
