"""A robot on a free base in MuJoCo, with the ground: its feet, and its other links' hulls.

Every joint of the file moves, those that plans lock too, between its stops, and has its armature, damping and friction.
Links touch the ground, not one another.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, pi, remainder
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, IntArray
from floatplan.jumps.check import LIGHT
from floatplan.problem.ground_step import GroundStep
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.robot.robot import Robot
from floatplan.simulation.base_states import base_states
from floatplan.simulation.contact.tracked_motion import TrackedMotion
from floatplan.simulation.mujoco_model import STEP, MujocoRobot, MujocoSpec
from floatplan.simulation.perturbation import Sample

SOLE = "sole "  # before the name of a foot's hull; a number is after it
LINK = "link "  # before the name of its shape, since a foot may be called as its link; a number is after it
STIFF = (4e-3, 1.0)  # [s, -] time constant and damping of contacts and stops


@dataclass(frozen=True)
class StandingBounds:
    """What counts as standing at the end of a motion."""

    height: float = 0.6  # [-] of the planned height of the base over the ground: a robot that lies or sits is lower
    tilt: float = 0.5  # [rad] of the base: feedback of joints does not bring back a robot that leans so far
    rotation: float = np.pi / 2  # [rad] from the planned attitude, whole turns included: feet that slide may yaw it


class ContactRobot:
    """A robot of J moving joints and C feet on the ground, simulated.

    Attributes
    ----------
    mujoco_robot : of the joints of ``robot.model`` in its order, on a free joint in the axes of the file
    feet : (C) names of the points that stand at some time
    touched : geoms that touched the ground
    """

    def __init__(self, tracked: TrackedMotion, friction: float, sample: Sample) -> None:
        self.robot = tracked.robot
        reduced = tracked.reduced
        self.mujoco_robot = MujocoRobot(contact_spec(tracked, friction, sample))
        self.model = self.mujoco_robot.model
        self.data = self.mujoco_robot.data
        self.axes = reduced.axes
        self.light = LIGHT * self.robot.mass * tracked.gravity
        soles = [f"{SOLE}{link} {count}" for count, (link, _, _) in enumerate(tracked.shapes.soles)]
        self.feet = (*tracked.shapes.balls, *soles)
        self.foot_of = {self.model.geom(name).id: index for index, name in enumerate(self.feet)}
        self.touched: set[int] = set()
        self._pairs = b""  # of geoms in contact at the last step
        self.is_spatial = reduced.is_spatial
        self.base = base_states(reduced)
        self.orientation: Any = None  # of the base, which goes on in time
        self.end_ground = tracked.end_ground
        self.is_ground = self.model.geom_bodyid == 0  # of each geom: the world is the first body

    def begin(self, base: Array, positions: Array, velocities: Array | None = None) -> None:
        """Begin with the base at a position (3,) m, quaternion w x y z; joints and velocities are of ``robot.model``.

        Without velocities nothing moves.
        """
        self.data.qpos[:7] = base
        self.data.qpos[self.mujoco_robot.positions] = positions[self.base.size :]
        if velocities is not None and self.is_spatial:
            self.data.qvel[:] = self.mujoco_robot.own_state(positions, velocities)[1]
        elif velocities is not None:
            self.data.qvel[:3] = velocities[:2] @ self.axes
            self.data.qvel[3:6] = velocities[2] * self.robot.plane.normal
            self.data.qvel[self.mujoco_robot.velocities] = velocities[self.base.size :]
        self.orientation = self.base.orientation(positions[None])
        self.mujoco_robot.mujoco.mj_forward(self.model, self.data)

    def state(self) -> tuple[Array, Array]:
        """Positions and velocities of all coordinates of ``robot.model``, in its plane or in space."""
        if self.is_spatial:
            q, v = self.mujoco_robot.reduced_state(self.data.qpos, self.data.qvel)
            sign = 1.0 if self.orientation @ q[3:7] > 0 else -1.0  # as the one before
            q[3:7] *= sign
            self.orientation = q[3:7]
            return q, v
        quaternion = self.data.qpos[3:7]
        pitch = 2 * atan2(quaternion[1:] @ self.robot.plane.normal, quaternion[0])
        self.orientation += remainder(pitch - self.orientation, 2 * pi)  # whole turns included
        positions = (self.axes @ self.data.qpos[:3], [self.orientation], self.data.qpos[self.mujoco_robot.positions])
        return np.concatenate(positions), self._in_plane(self.data.qvel)

    def accelerations(self) -> Array:
        """Accelerations of the same coordinates; in space of the base as Pinocchio has them, in the base's axes."""
        if self.is_spatial:
            _, v = self.mujoco_robot.reduced_state(self.data.qpos, self.data.qvel)
            _, a = self.mujoco_robot.reduced_state(self.data.qpos, self.data.qacc)
            x, y, z, *rates = v[:6].tolist()
            # Their cross product: NumPy's takes longer than everything else here.
            a[0] -= rates[1] * z - rates[2] * y
            a[1] -= rates[2] * x - rates[0] * z
            a[2] -= rates[0] * y - rates[1] * x
            return a
        return self._in_plane(self.data.qacc)

    def _in_plane(self, rates: Array) -> Array:
        normal = self.robot.plane.normal
        return np.concatenate((self.axes @ rates[:3], [rates[3:6] @ normal], rates[self.mujoco_robot.velocities]))

    def move(self, torques: Array, duration: float) -> bool:
        """Simulate for a duration, s, under torques (J,), N m; whether the motion is finite."""
        data = self.data
        data.qfrc_applied[self.mujoco_robot.velocities] = torques
        for _ in range(round(duration / STEP)):
            self.mujoco_robot.step()
            pairs = data.contact.geom
            content = pairs.tobytes()
            if content != self._pairs:  # mostly they are those of the step before
                self._pairs = content
                self.touched.update(self._robot_geoms(pairs)[0].tolist())
        return bool(np.isfinite(data.qpos).all())

    def forces(self) -> tuple[Array, Array]:
        """Forces (C, 3) N of the ground on the feet, and the points (C, 3) m where they act; in the air 0 and NaN."""
        contacts = self.data.contact
        forces = np.zeros((len(self.feet), 3))
        points = np.full((len(self.feet), 3), np.nan)
        for index, foot, row, sign in self._foot_contacts():
            forces[foot] += sign * (self.data.efc_force[row : row + 3] @ contacts.frame[index].reshape(3, 3))
            points[foot] = contacts.pos[index]
        return forces, points

    def slips(self) -> Array:
        """Speeds (C,) m/s over the ground of feet that press on it; of others zero."""
        slips = np.zeros(len(self.feet))
        for _, foot, row, _ in self._foot_contacts():
            if self.data.efc_force[row] > self.light:
                slips[foot] = np.hypot(*self.data.efc_vel[row + 1 : row + 3])
        return slips

    def _foot_contacts(self) -> Iterator[tuple[int, int, int, float]]:
        """Contacts of feet that bear forces: their index, the foot, their first row of constraints, and the sign.

        The sign is 1 where forces of the contact are on the robot, else -1.
        """
        contacts = self.data.contact
        geoms, signs = self._robot_geoms(contacts.geom)
        rows = zip(geoms.tolist(), contacts.efc_address.tolist(), signs.tolist(), strict=True)
        for index, (geom, row, sign) in enumerate(rows):
            foot = self.foot_of.get(geom)
            if foot is not None and row >= 0:
                yield index, foot, row, sign

    def _robot_geoms(self, pairs: IntArray) -> tuple[IntArray, Array]:
        """Of pairs of geoms (N, 2) in contact, those of the robot; and 1 where contact forces are on them, else -1.

        MuJoCo orders the pairs by the kinds of their shapes.
        """
        is_second = self.is_ground[pairs[:, 0]]
        return np.where(is_second, pairs[:, 1], pairs[:, 0]), np.where(is_second, 1.0, -1.0)

    def presses(self) -> bool:
        """Whether any foot presses on the ground."""
        forces, _ = self.forces()
        return bool((forces @ self.robot.up > self.light).any())

    def links(self) -> tuple[str, ...]:
        """Names of links other than feet that touched the ground."""
        geoms = [geom for geom in self.touched if geom not in self.foot_of]
        names = {self.model.geom(geom).name.removeprefix(LINK).rpartition(" ")[0] for geom in geoms}
        return tuple(sorted(names))

    def stands(self, base: Array, apart: float) -> bool:
        """Whether the robot stands as planned: its base level, rotated by all planned turns, and nearly as high.

        Parameters
        ----------
        base : (7,), the planned one, as of :meth:`begin`
        apart : rad, by which the base is off its planned attitude, whole turns included
        """
        up = np.asarray(self.robot.up)
        up_now = pin.Quaternion(*self.data.qpos[3:7]).matrix().T @ up
        up_planned = pin.Quaternion(*base[3:]).matrix().T @ up
        height_now = self.data.qpos[:3] @ up - self.end_ground
        height_planned = base[:3] @ up - self.end_ground
        is_level = up_now @ up_planned > np.cos(StandingBounds.tilt)
        is_high = height_now > StandingBounds.height * height_planned
        return bool(is_level and is_high and apart < StandingBounds.rotation)


def contact_spec(tracked: TrackedMotion, friction: float, sample: Sample) -> MujocoSpec:
    """Return the robot of a motion on its ground.

    Parameters
    ----------
    friction : of the ground
    sample : factors of the links' masses and inertias, and the armature in addition to the problem's
    """
    mujoco = import_mujoco()
    geoms = mujoco.mjtGeom
    robot = tracked.robot
    reduced = tracked.reduced
    shapes = tracked.shapes
    up = np.asarray(robot.up, dtype=np.float64)
    mujoco_spec = MujocoSpec(robot, reduced, sample, free=True)
    spec = mujoco_spec.spec
    spec.option.timestep = STEP
    # Contacts and stops are on here, which MujocoSpec turns off.
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_AUTORESET
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0  # stiffness of friction over that of the normal force: feet do not creep
    spec.compiler.degree = False
    stops = np.stack((robot.model.lowerPositionLimit, robot.model.upperPositionLimit), axis=1)[reduced.of_joints[0]]
    for number, (name, stop) in enumerate(zip(reduced.joints, stops, strict=True), reduced.base_joint + 1):
        joint = spec.joint(f"joint{number}")
        if np.isfinite(stop).all():
            joint.range = stop
            joint.solref_limit = STIFF
        joint.armature += sample.armature
        joint.damping[0] = robot.damping.get(name, 0.0)
        joint.frictionloss = robot.friction.get(name, 0.0)
    spec.worldbody.add_geom(
        name="floor",
        type=geoms.mjGEOM_PLANE,
        size=[0, 0, 1],
        pos=shapes.ground * up,
        zaxis=up,
        solref=STIFF,
        contype=1,
        friction=[friction, 0, 0],
    )
    if shapes.step is not None:
        _add_step(spec, robot, shapes.step, friction)
    # Friction of a contact is the larger one of its two shapes: that of the ground.
    touching = {"solref": STIFF, "contype": 0, "conaffinity": 1, "friction": [0, 0, 0]}
    for name, (number, centre, radius) in shapes.balls.items():
        body = mujoco_spec.bodies[number]
        body.add_geom(name=name, type=geoms.mjGEOM_SPHERE, size=[radius, 0, 0], pos=centre, **touching)
    for prefix, hulls in ((SOLE, shapes.soles), (LINK, shapes.hulls)):
        for count, (link, number, corners) in enumerate(hulls):
            shape = f"{prefix}{link} {count}"
            spec.add_mesh(name=shape, uservert=corners.ravel())
            mujoco_spec.bodies[number].add_geom(name=shape, type=geoms.mjGEOM_MESH, meshname=shape, **touching)
    return mujoco_spec


def _add_step(spec: Any, robot: Robot, step: GroundStep, friction: float) -> None:
    """Add the higher ground of a jump: a box on the floor, which is the lower one."""
    half = np.array([2.0, (step.high - step.low) / 2, 2.0])  # [m] far along, as high as it is, far across
    middle = np.array([step.along(half[0]), step.low + half[1], step.across or 0.0])
    if step.across is not None:
        along, upwards = np.eye(3)[[step.axis, 2]]
        middle[2] *= np.cross(along, upwards)[1 - step.axis]
    else:
        along, upwards = robot.plane.horizontal, robot.plane.vertical
    axes = np.stack((along, upwards, np.cross(along, upwards)), axis=1)
    spec.worldbody.add_geom(
        name="step",
        type=import_mujoco().mjtGeom.mjGEOM_BOX,
        size=half,
        pos=axes @ middle,
        quat=pin.Quaternion(axes).coeffs()[[3, 0, 1, 2]],
        solref=STIFF,
        contype=1,
        conaffinity=0,
        friction=[friction, 0, 0],
    )
