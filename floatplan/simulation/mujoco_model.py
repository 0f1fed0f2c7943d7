"""The robot for MuJoCo, on slides and a hinge in its plane or on a free joint, from its reduced model in Pinocchio.

Nothing is in it but inertia, gravity, rotors and joints; :mod:`floatplan.simulation.contact.model` adds the ground.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.robot.robot import Robot
from floatplan.simulation.perturbation import Sample
from floatplan.simulation.reduced_model import ReducedModel, reduced_model
from floatplan.simulation.spatial_motion import quaternion_rate

LEAST = 1e-14  # [kg m^2] moment of inertia, or [kg] mass, of a body that moves: MuJoCo refuses 1e-15
STEP = 5e-4  # [s] of MuJoCo's simulation, which is fixed
GYRATION = 1e-3  # [m] least radius of gyration of a body that is free in space, where the file has a point or a line


class MujocoSpec:
    """The ``mujoco.MjSpec`` of a perturbed robot of m moving joints.

    On a planar base a body has its moment about the normal about all axes: the others do not count. On a free one the
    axes of the joints are the file's, and moments that MuJoCo refuses are balanced.

    Attributes
    ----------
    spec : mujoco.MjSpec
        Joints are called ``joint`` and their number in the reduced model.
    bodies : number of a joint of the reduced model -> its body
    balanced : name of a body's first link -> the largest change of a principal moment, kg m^2
    """

    def __init__(self, robot: Robot, reduced: ReducedModel, sample: Sample, free: bool) -> None:
        mujoco = import_mujoco()
        kinds = mujoco.mjtJoint
        self.robot = robot
        self.reduced = reduced
        self.free = free
        self.spec = mujoco.MjSpec()
        self.spec.option.gravity = reduced.model.gravity.linear
        self.spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        self.balanced: dict[str, float] = {}
        model = reduced.model
        tree = robot.file_tree if free else robot.layout.tree
        base = self.spec.worldbody.add_body()
        if free:
            base.add_joint(name="base", type=kinds.mjJNT_FREE)
        else:
            plane = robot.plane
            base.add_joint(name="horizontal", type=kinds.mjJNT_SLIDE, axis=plane.horizontal)
            base.add_joint(name="vertical", type=kinds.mjJNT_SLIDE, axis=plane.vertical)
            base.add_joint(name="orientation", type=kinds.mjJNT_HINGE, axis=plane.normal)
        self.bodies = {reduced.base_joint: base}
        links = {reduced.base_joint: tree.root}
        for number in range(reduced.base_joint + 1, model.njoints):
            joint = tree.joint[model.names[number]]
            placement = model.jointPlacements[number]
            body = self.bodies[model.parents[number]].add_body(
                pos=placement.translation, quat=_quaternion_wxyz(placement.rotation)
            )
            body.add_joint(
                name=f"joint{number}",
                type=kinds.mjJNT_HINGE if joint.turns else kinds.mjJNT_SLIDE,
                axis=joint.axis,
                armature=robot.armature.get(joint.name, 0.0),
            )
            self.bodies[number] = body
            links[number] = joint.child
        data = model.createData()
        pin.forwardKinematics(model, data, np.array(reduced.reference))
        for number, body in self.bodies.items():
            normal = None if free else data.oMi[number].rotation.T @ robot.plane.normal
            change = _set_inertia(body, model.inertias[number], normal, sample.mass[number], sample.inertia[number])
            if change:
                self.balanced[links[number]] = change

    def compiled(self) -> Any:
        """The ``mujoco.MjModel``; InputError where MuJoCo refuses it, such as for a link that moves and has no mass."""
        try:
            return self.spec.compile()
        except ValueError as error:
            reason = f"MuJoCo refuses the robot: {error}"
            raise InputError(reason, source=self.robot.source, element="engine") from None


class MujocoRobot:
    """A robot of m moving joints in MuJoCo, and the engine of its flight: accelerations in MuJoCo's coordinates.

    Attributes
    ----------
    model, data : mujoco.MjModel, mujoco.MjData
    positions, velocities : (m,) int
        Entry of each joint of the reduced model in ``qpos`` and ``qvel``; the base's entries come first.
    balanced : as of :class:`MujocoSpec`

    Flights without contact integrate :meth:`accelerations` themselves, with torques that change within a step: MuJoCo's
    own integrators take those from a callback that is one for all threads. With contact :meth:`step` is used.
    """

    def __init__(self, spec: MujocoSpec) -> None:
        self.mujoco = import_mujoco()
        self.model = spec.compiled()
        self.data = self.mujoco.MjData(self.model)
        self.balanced = spec.balanced
        self.free = spec.free
        joints = [self.model.joint(f"joint{number}") for number in list(spec.bodies)[1:]]
        self.positions = np.array([joint.qposadr[0] for joint in joints], dtype=np.int64)
        self.velocities = np.array([joint.dofadr[0] for joint in joints], dtype=np.int64)

    def step(self) -> None:
        """Simulate one step of the model's under ``data.qfrc_applied``.

        In the air by Runge and Kutta, which keeps angular momentum to 1e-6 of it where implicit steps of 0.5 ms lose
        0.7 % in the flight of a Go2's roll; on the ground implicitly, which evaluates contacts once and not four times.
        """
        integrators = self.mujoco.mjtIntegrator
        touches = self.data.ncon > 0
        self.model.opt.integrator = integrators.mjINT_IMPLICITFAST if touches else integrators.mjINT_RK4
        self.mujoco.mj_step(self.model, self.data)

    def accelerations(self, q: Array, v: Array, forces: Array) -> Array:
        """Return accelerations (nv,) under forces (nv,)."""
        data = self.data
        data.qpos[:] = q
        data.qvel[:] = v
        data.qfrc_applied[:] = forces
        self.mujoco.mj_forward(self.model, data)
        return np.array(data.qacc)

    def moved(self, q: Array, v: Array, duration: float) -> Array:
        """Return the configuration after a duration, s, at a velocity; the base rotates along the geodesic."""
        if not self.free:  # quicker
            return np.asarray(q + duration * v)
        q = q.copy()
        self.mujoco.mj_integratePos(self.model, q, v, duration)
        return q

    def rate(self, q: Array, v: Array) -> Array:
        """Return the derivative of a configuration by time, of a free base."""
        rate = np.empty_like(q)
        rate[:3] = v[:3]
        rate[3:7] = np.roll(quaternion_rate(np.roll(q[3:7], -1), v[3:6]), 1)
        rate[self.positions] = v[self.velocities]
        return rate

    def own_state(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return MuJoCo's configuration and velocity for the reduced model's on the same base."""
        own_q = np.zeros(self.model.nq)
        own_v = np.zeros(self.model.nv)
        own_q[:3] = q[:3]
        own_v[:3] = v[:3]
        if self.free:
            own_q[:7] = free_base(q)
            own_v[:3] = pin.Quaternion(q[3:7]).matrix() @ v[:3]
            own_v[3:6] = v[3:6]
        own_q[self.positions] = q[len(q) - len(self.positions) :]
        own_v[self.velocities] = v[len(v) - len(self.velocities) :]
        return own_q, own_v

    def reduced_state(self, own_q: Array, own_v: Array) -> tuple[Array, Array]:
        """Return the reduced model's configuration and velocity for MuJoCo's: the inverse of :meth:`own_state`."""
        positions = own_q[self.positions]
        velocities = own_v[self.velocities]
        if not self.free:
            return np.concatenate((own_q[:3], positions)), np.concatenate((own_v[:3], velocities))
        quaternion = pin.Quaternion(*own_q[3:7]).normalized()  # w, x, y, z
        base_velocity = quaternion.matrix().T @ own_v[:3]
        q = np.concatenate((own_q[:3], quaternion.coeffs(), positions))
        return q, np.concatenate((base_velocity, own_v[3:6], velocities))


def free_base(configurations: Array) -> Array:
    """Positions and quaternions w, x, y, z (.., 7) of bases, as MuJoCo has them, of configurations (.., 7 + J)."""
    return np.asarray(configurations[..., [0, 1, 2, 6, 3, 4, 5]])


def rigid_joints(robot: Robot) -> set[str]:
    """Locked joints that must be rigid in MuJoCo, where a joint's body must have inertia about its axis."""
    rigid: set[str] = set()
    while True:
        model = reduced_model(robot, 0.0, rigid).model
        light = set()
        for number, name in enumerate(model.names):
            joint = robot.file_tree.joint.get(name)
            if joint is None:  # of the base
                continue
            body = model.inertias[number]
            arm = np.cross(joint.axis, body.lever)
            moment = joint.axis @ body.inertia @ joint.axis + body.mass * arm @ arm
            if moment <= body.mass * GYRATION**2 if joint.turns else body.mass == 0:
                light.add(number)
        too_light = set()
        for number, name in enumerate(model.names):
            if name in robot.locked and {number, model.parents[number]} & light:
                too_light.add(name)
        if not too_light:
            return rigid
        rigid |= too_light


def balanced_in_words(balanced: Mapping[str, float]) -> str:
    """Say which inertias were balanced, and by how much."""
    return f"of {', '.join(balanced)}, which no body can have: moments changed by {max(balanced.values()):.2g} kg m^2"


def _set_inertia(body: Any, source: Any, normal: Array | None, mass_factor: float, inertia_factor: float) -> float:
    """Set a body's inertia, a ``pinocchio.Inertia`` scaled by factors; how much of a moment was balanced, kg m^2.

    With a normal (3,) only its moment about that counts. Else principal moments are made such as MuJoCo takes them:
    none less than a small one, or more than the sum of the others.
    """
    mass = source.mass
    inertia = source.inertia
    least = LEAST
    if normal is None:
        mass = max(mass, LEAST)  # between the joints of a shoulder there is none
        least = max(LEAST, mass * GYRATION**2)
    else:
        inertia = normal @ inertia @ normal * np.eye(3)
    moments, axes = np.linalg.eigh(inertia)  # rising
    axes[:, 0] *= np.linalg.det(axes)  # right-handed
    balanced = np.maximum(moments, least)
    largest = balanced[2] * (1 + 1e-9)  # a little less than the sum of the others, for rounding
    balanced[:2] += max(largest - balanced[0] - balanced[1], 0.0) / 2
    body.mass = mass * mass_factor
    body.ipos = source.lever
    body.inertia = balanced * inertia_factor
    body.iquat = _quaternion_wxyz(axes)
    body.explicitinertial = True
    change = float(np.abs(balanced - moments).max())
    rounding = max(1e-6 * moments[-1], LEAST)
    return change if normal is None and change > rounding else 0.0


def _quaternion_wxyz(rotation: Array) -> Array:
    """Return the quaternion w, x, y, z of a rotation matrix."""
    return np.roll(pin.Quaternion(rotation).coeffs(), 1)
