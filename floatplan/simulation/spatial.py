"""The flight on a real free joint, in MuJoCo: how far does the robot roll and yaw that was planned in a plane?

The base is free in space, every joint of the URDF turns about the axis that the file gives it, and nothing is rigid:
joints get the torques that the plan takes. Locked and coupled joints, which the plan holds where they are or together,
are held by gains besides, as a robot's motors do.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, BoolArray, read_only
from floatplan.errors import FloatplanError, InputError
from floatplan.plans.record import PlanRecord
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot
from floatplan.simulation.feedback import Feedback, JointTorques
from floatplan.simulation.forward import MOST_STEPS, State, runge_kutta_step, whole_step
from floatplan.simulation.mujoco_model import SpatialModel, import_mujoco, rigid_joints, spatial_model
from floatplan.simulation.perturbation import Perturbation
from floatplan.simulation.recorded_motion import RecordedMotion, perturbed_takeoff
from floatplan.simulation.reduced_model import ReducedModel, reduced_model

HOLD = 50.0  # [rad/s] bandwidth of the gains on locked and coupled joints
STABLE = 1.0  # [-] largest rate of decay times step; the Runge-Kutta method is stable up to 2.8
RUNAWAY = 1e6  # [rad/s] or m/s


@dataclass(frozen=True, eq=False)
class SpatialLanding:
    """Where the robot lands that is free in space, against where the plan says.

    Attributes
    ----------
    roll, yaw : rad
        About the plane's horizontal axis, and about its vertical: the turn that the plan has not.
    orientation_error : rad
        About the plane's normal.
    position_error : (n,) rad
        Of each planned joint, or of one coupled to it where that is further off.
    locked_error : rad, of the locked joint that is furthest off; m of one that slides
    com_error : m, of the centre of mass from its parabola
    held : joints that gains hold
    """

    roll: float
    yaw: float
    orientation_error: float
    position_error: Array
    locked_error: float
    com_error: float
    held: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers."""
        return {**asdict(self), "position_error": self.position_error.tolist(), "held": list(self.held)}


def fly_in_space(
    robot: Robot, record: PlanRecord, perturbation: Perturbation, seed: int, feedback: float | None, step: float
) -> SpatialLanding:
    """Fly a recorded plan with every joint of its robot, its base free.

    Parameters
    ----------
    feedback : float, optional
        Bandwidth, rad/s, of gains on all joints; left out, locked and coupled ones alone are held.
    step : float
        s, at most; shorter where the gains are stiff.

    Raises
    ------
    InputError
        MuJoCo refuses the robot, or the gains would take too many steps.
    FloatplanError
        The motion ran away.
    """
    reduced = reduced_model(robot, float(record.com["gravity"]), rigid=rigid_joints(robot))
    motion = RecordedMotion(record, reduced)
    names = list(reduced.model.names)[BASE_COORDINATES + 1 :]
    drawn = perturbation.drawn(seed, 0, len(names), reduced.model.njoints)
    takeoff = perturbed_takeoff(record, reduced, drawn)
    model = spatial_model(robot, reduced, drawn.mass, drawn.inertia)
    couplings = {*robot.coupled, *(coupling.leader for coupling in robot.coupled.values())}
    held = np.array([name in robot.locked or name in couplings or feedback is not None for name in names], dtype=bool)
    position, velocity = _in_space(robot, model, takeoff)
    control, fastest = _gains(model, position, held, feedback or HOLD)
    step = whole_step(motion.duration, min(step, STABLE / fastest if fastest else math.inf), 1)
    if motion.duration / step > MOST_STEPS:
        reason = f"the gains of the joints take steps of {step:.2g} s, more than {MOST_STEPS}"
        raise InputError(reason, element="engine", advice="use the engine pinocchio, or a lower feedback")
    flown = _fly(model, JointTorques(motion, drawn.torque, control), (position, velocity), step, motion.duration)
    aside = _com(model, position) @ robot.plane.normal
    place = _com(model, flown) - motion.com_position(motion.duration) @ reduced.axes - aside * robot.plane.normal
    return _landing(robot, record, reduced, model, flown, place, tuple(np.array(names)[held].tolist()))


def _in_space(robot: Robot, model: SpatialModel, takeoff: tuple[Array, Array]) -> tuple[Array, Array]:
    """MuJoCo's positions and velocities from those on the planar base."""
    planar, rates = takeoff
    plane = robot.plane
    axes = np.stack((plane.horizontal, plane.vertical))
    position, velocity = np.zeros(model.model.nq), np.zeros(model.model.nv)
    place, turn = model.base_position, model.base_velocity
    half = planar[BASE_COORDINATES - 1] / 2
    position[place : place + 3] = planar[:2] @ axes
    position[place + 3 : place + 7] = np.concatenate(([math.cos(half)], math.sin(half) * plane.normal))
    velocity[turn : turn + 3] = rates[:2] @ axes
    velocity[turn + 3 : turn + 6] = rates[BASE_COORDINATES - 1] * plane.normal
    position[model.positions], velocity[model.velocities] = planar[BASE_COORDINATES:], rates[BASE_COORDINATES:]
    return position, velocity


def _gains(model: SpatialModel, position: Array, held: BoolArray, bandwidth: float) -> tuple[Feedback, float]:
    """Critically damped gains of the held joints at a posture, and the fastest rate of decay that they make, 1/s."""
    mujoco = import_mujoco()
    data = mujoco.MjData(model.model)
    data.qpos[:] = position
    mujoco.mj_forward(model.model, data)
    columns = np.eye(model.model.nv)[model.velocities]
    inverse = np.zeros_like(columns)
    mujoco.mj_solveM(model.model, data, inverse, columns)
    inverse = inverse[:, model.velocities]
    inertia = held / np.diagonal(inverse)
    control = Feedback.critically_damped(bandwidth, inertia)
    rates = np.linalg.eigvals(inverse * control.damping)
    return control, float(np.abs(rates).max(initial=0.0))


def _fly(model: SpatialModel, torques: JointTorques, takeoff: State, step: float, duration: float) -> Array:
    """Positions at the end, the base's turn along the geodesic."""
    mujoco = import_mujoco()
    data = mujoco.MjData(model.model)
    forces = data.qfrc_applied

    def acceleration(time: float, position: Array, velocity: Array) -> Array:
        data.qpos[:], data.qvel[:] = position, velocity
        forces[model.velocities] = torques(time, position[model.positions], velocity[model.velocities])
        mujoco.mj_forward(model.model, data)
        return np.array(data.qacc)

    def moved(position: Array, velocity: Array, time: float) -> Array:
        position = position.copy()
        mujoco.mj_integratePos(model.model, position, velocity, time)
        return position

    state = takeoff
    for number in range(round(duration / step)):
        end = (number + 1) * step
        state = runge_kutta_step(acceleration, state, number * step, end, moved)
        if not (np.isfinite(state[1]).all() and np.abs(state[1]).max() < RUNAWAY):
            raise FloatplanError(f"the replay in space ran away {end:.3g} s after takeoff; try a shorter --step")
    return state[0]


def _com(model: SpatialModel, position: Array) -> Array:
    """Centre of mass (3,)."""
    mujoco = import_mujoco()
    data = mujoco.MjData(model.model)
    data.qpos[:] = position
    mujoco.mj_kinematics(model.model, data)
    mujoco.mj_comPos(model.model, data)
    return np.array(data.subtree_com[0])


def _landing(
    robot: Robot,
    record: PlanRecord,
    reduced: ReducedModel,
    model: SpatialModel,
    flown: Array,
    com_error: Array,
    held: tuple[str, ...],
) -> SpatialLanding:
    plane = robot.plane
    w, x, y, z = flown[model.base_position + 3 : model.base_position + 7].tolist()
    wanted = pin.AngleAxis(float(record.orientation["goal"]), np.asarray(plane.normal)).matrix()
    turn = pin.log3(pin.Quaternion(w, x, y, z).normalized().matrix() @ wanted.T)
    goal = np.asarray(record.problem["goal"]["positions"], dtype=np.float64)
    target = (reduced.reference + reduced.selection @ goal)[BASE_COORDINATES:]
    off = np.abs(flown[model.positions] - target)
    follows = reduced.selection[BASE_COORDINATES:] != 0.0
    return SpatialLanding(
        roll=float(turn @ plane.horizontal),
        yaw=float(turn @ plane.vertical),
        orientation_error=abs(float(turn @ plane.normal)),
        position_error=read_only((off[:, None] * follows).max(axis=0, initial=0.0)),
        locked_error=float(off[~follows.any(axis=1)].max(initial=0.0)),
        com_error=float(np.linalg.norm(com_error)),
        held=held,
    )
