"""A robot on a free base in MuJoCo, with the ground: its links' hulls, of jumps in a plane as prisms; feet as spheres.

Every joint of the file moves, those that plans lock too, between its stops, and has its armature, damping and friction.
Links touch the ground, not one another.
"""

from collections.abc import Iterator
from math import atan2, pi, remainder
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.check import LIGHT
from floatplan.jumps.contacts import links_of
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import point_in_joint
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.jumps.spatial.standing import feet_links
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import evenly
from floatplan.simulation.base_states import base_states
from floatplan.simulation.mujoco_model import STEP, MujocoRobot, MujocoSpec
from floatplan.simulation.perturbation import Sample
from floatplan.simulation.reduced_model import ReducedModel

LINK = "link "  # before the name of its shape, since a foot may be called as its link; a number is after it
SMALLEST = 5e-3  # [m] radius of a foot's sphere
STIFF = (4e-3, 1.0)  # [s, -] time constant and damping of contacts and stops


class ContactRobot:
    """A robot of J moving joints and C feet on the ground, simulated.

    Attributes
    ----------
    mujoco_robot : of the joints of ``robot.model`` in its order, on a free joint in the axes of the file
    feet : (C) names of the points that stand at some time
    touched : geoms that touched the ground
    forces, points : (C, 3) N, m, of the feet; in the air forces are zero and points NaN
    slips : (C,) m/s, of those that press on the ground
    """

    def __init__(self, jump: JumpMotion, reduced: ReducedModel, friction: float, sample: Sample) -> None:
        self.robot = jump.problem.robot
        self.mujoco_robot = MujocoRobot(contact_spec(jump, reduced, friction, sample))
        self.model = self.mujoco_robot.model
        self.data = self.mujoco_robot.data
        self.axes = reduced.axes
        self.light = LIGHT * self.robot.mass * jump.problem.flight.gravity
        self.feet = tuple(feet_spheres(jump))
        self.foot_of = {self.model.geom(name).id: index for index, name in enumerate(self.feet)}
        self.touched: set[int] = set()
        self.forces = np.zeros((0, 3))
        self.points = np.zeros((0, 3))
        self.slips = np.zeros(0)
        self.is_spatial = isinstance(jump, SpatialJumpMotion)
        self.base = base_states(reduced)
        self.orientation: Any = None  # of the base, which goes on in time
        self.ground = jump.ground

    def begin(self, base: Array, positions: Array) -> None:
        """Stand with the base at a position (3,) m, quaternion w x y z, and with positions as of ``robot.model``."""
        self.data.qpos[:7] = base
        self.data.qpos[self.mujoco_robot.positions] = positions[self.base.size :]
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
            a[:3] -= np.cross(v[3:6], v[:3])
            return a
        return self._in_plane(self.data.qacc)

    def _in_plane(self, rates: Array) -> Array:
        normal = self.robot.plane.normal
        return np.concatenate((self.axes @ rates[:3], [rates[3:6] @ normal], rates[self.mujoco_robot.velocities]))

    def move(self, torques: Array, duration: float) -> bool:
        """Simulate for a duration, s, under torques (J,), N m, and read the contacts; whether the motion is finite."""
        data = self.data
        data.qfrc_applied[self.mujoco_robot.velocities] = torques
        for _ in range(round(duration / self.model.opt.timestep)):
            self.mujoco_robot.mujoco.mj_step(self.model, data)
            self.touched.update(data.contact.geom[: data.ncon, 1].tolist())
        count = len(self.feet)
        self.forces = np.zeros((count, 3))
        self.points = np.full((count, 3), np.nan)
        self.slips = np.zeros(count)
        contacts = data.contact
        rows = zip(contacts.geom[:, 1].tolist(), contacts.efc_address.tolist(), strict=True)
        for index, (geom, row) in enumerate(rows):
            foot = self.foot_of.get(geom)
            if foot is not None and row >= 0:
                force = data.efc_force[row : row + 3]
                self.forces[foot] = force @ contacts.frame[index].reshape(3, 3)
                self.points[foot] = contacts.pos[index]
                if force[0] > self.light:
                    self.slips[foot] = np.hypot(*data.efc_vel[row + 1 : row + 3])
        return bool(np.isfinite(data.qpos).all())

    def presses(self) -> bool:
        """Whether any foot presses on the ground."""
        return bool((self.forces @ self.robot.up > self.light).any())

    def links(self) -> tuple[str, ...]:
        """Names of links other than feet that touched the ground."""
        geoms = [geom for geom in self.touched if geom not in self.foot_of]
        names = {self.model.geom(geom).name.removeprefix(LINK).rpartition(" ")[0] for geom in geoms}
        return tuple(sorted(names))

    def stands(self, base: Array, orientation: Any) -> bool:
        """Whether the base is oriented as planned in the end, whole turns included, but for its yaw, and as high.

        Of ``base`` as of :meth:`begin`, and the ``orientation`` there, at the end.
        """
        up = np.asarray(self.robot.up)
        up_now = pin.Quaternion(*self.data.qpos[3:7]).matrix().T @ up
        up_planned = pin.Quaternion(*base[3:]).matrix().T @ up
        height_now = self.data.qpos[:3] @ up - self.ground
        height_planned = base[:3] @ up - self.ground
        tipped = 0.5  # [rad] of the base: one that is further off does not stand
        has_turned = self.base.apart(self.orientation, orientation) < self.base.astray
        is_level = (up_now * up_planned).sum() > np.cos(tipped)
        is_high = height_now > 0.6 * height_planned
        return bool(has_turned and is_level and is_high)


def contact_spec(jump: JumpMotion, reduced: ReducedModel, friction: float, sample: Sample) -> MujocoSpec:
    """Return a jump's robot on its ground; of ``reduced`` nothing is rigid.

    Feet are spheres about their frames, as large as these are high above the ground where they stand; each end of a
    sole, in space its heel and each toe, is one of ``SMALLEST``.

    Parameters
    ----------
    friction : of the ground
    sample : factors of the links' masses and inertias, and the armature in addition to the problem's
    """
    mujoco = import_mujoco()
    geoms = mujoco.mjtGeom
    robot = jump.problem.robot
    up = np.asarray(robot.up, dtype=np.float64)
    mujoco_spec = MujocoSpec(robot, reduced, sample, free=True)
    spec = mujoco_spec.spec
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
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
        pos=jump.ground * up,
        zaxis=up,
        solref=STIFF,
        contype=1,
        friction=[friction, 0, 0],
    )
    touching = {"solref": STIFF, "contype": 0, "conaffinity": 1, "friction": [0, 0, 0]}
    for name, (number, centre, radius) in feet_spheres(jump).items():
        body = mujoco_spec.bodies[number]
        body.add_geom(name=name, type=geoms.mjGEOM_SPHERE, size=[radius, 0, 0], pos=centre, **touching)
    hulls = _solid_hulls(jump) if isinstance(jump, SpatialJumpMotion) else _prisms(jump)
    for count, (link, number, corners) in enumerate(hulls):
        shape = f"{LINK}{link} {count}"
        spec.add_mesh(name=shape, uservert=corners.ravel())
        mujoco_spec.bodies[number].add_geom(name=shape, type=geoms.mjGEOM_MESH, meshname=shape, **touching)
    return mujoco_spec


def feet_spheres(jump: JumpMotion) -> dict[str, tuple[int, Array, float]]:
    """Return the joint that carries each foot's sphere, its centre (3,) m in the joint's axes, and its radius, m."""
    robot = jump.problem.robot
    if isinstance(jump, SpatialJumpMotion):
        return _feet_in_space(jump)
    y = jump.before[0].grid.y[:, 0]
    upwards = 1j * robot.tree.rotations(-robot.tree.absolute_angles(y[0], y[1:]))
    feet: dict[str, tuple[int, Array, float]] = {}
    for contact in jump.contacts:
        radius = SMALLEST if contact.of_sole else max(contact.depth, SMALLEST)
        for name, frame, spot in zip(contact.names, contact.frames, contact.spots, strict=True):
            centre = spot.place + (radius - contact.depth) * upwards[spot.body]
            feet[name] = (*point_in_joint(robot, frame, complex(centre)), radius)
    return feet


def _feet_in_space(jump: JumpMotion) -> dict[str, tuple[int, Array, float]]:
    """The same of a jump in space."""
    model = jump.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, jump.at(0.0).positions[0])
    feet: dict[str, tuple[int, Array, float]] = {}
    for foot in jump.contacts:
        radius = max(foot.depth, SMALLEST)
        upwards = data.oMi[foot.body].rotation.T @ jump.robot.up
        feet[foot.name] = (foot.body, foot.local + (radius - foot.depth) * upwards, radius)
    return feet


def _prisms(jump: JumpMotion) -> Iterator[tuple[str, int, Array]]:
    """Links but those that stand, the joints that carry them, and corners (c, 3) m of prisms in these joints' axes."""
    robot = jump.problem.robot
    standing = links_of(robot, jump.contacts)
    for link in robot.link_hulls:
        prism = None if link in standing else _prism(robot, link)
        if prism is not None:
            yield link, *prism


def _solid_hulls(jump: JumpMotion) -> Iterator[tuple[str, int, Array]]:
    """The same in space: points on the solids of links."""
    robot = jump.problem.robot
    standing = feet_links(robot, jump.contacts)
    directions = evenly(60)  # so many points make a round solid round to 3 % of its radius
    for solid in robot.solids:
        around = directions @ solid.axes.T if solid.axes.any() else np.zeros((1, 3))
        points = (solid.points[:, None] + around).reshape(-1, 3)
        thickness = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]
        if solid.link not in standing and thickness > 1e-4:  # m: what is flat has no hull
            yield solid.link, solid.body, points


def _prism(robot: Robot, link: str) -> tuple[int, Array] | None:
    """The joint that carries a link, and its prism (2 c, 3) m in the joint's axes; None of what is no shape."""
    corners = np.array([[side.start, side.end] for side in robot.link_hulls[link]]).ravel()
    centred = corners - corners.mean()
    if np.linalg.svd(np.stack((centred.real, centred.imag)), compute_uv=False)[-1] < 1e-4:  # m: a line
        return None
    in_joint = [point_in_joint(robot, link, complex(corner)) for corner in corners]
    joint = in_joint[0][0]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.reference.copy())
    half_width = 0.02 / 2  # m
    across = half_width * data.oMi[joint].rotation.T @ robot.plane.normal
    middle = np.array([point for _, point in in_joint])
    return joint, np.concatenate((middle - across, middle + across))
