"""The flight on a real free joint, in MuJoCo: how far does the robot roll and yaw that was planned in a plane?

The base is free in space, every joint of the URDF turns about the axis that the file gives it, and nothing is rigid:
joints get the torques that the plan takes. Locked and coupled joints, which the plan holds where they are or together,
are held by gains besides, as a robot's motors do.
"""

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, BoolArray
from floatplan.errors import FloatplanError, InputError
from floatplan.plans.record import PlanRecord
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot
from floatplan.simulation import forward
from floatplan.simulation.forward import JointTorques, State
from floatplan.simulation.mujoco_model import SpatialModel, rigid_joints, spatial_model
from floatplan.simulation.perturbation import Perturbation
from floatplan.simulation.recorded_motion import RecordedMotion, reduced_model
from floatplan.simulation.takeoff import perturbed_takeoff

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
    balanced : bodies whose inertia no body can have, by first link
        MuJoCo refuses it: the largest change of a principal moment, kg m^2.
    """

    roll: float
    yaw: float
    orientation_error: float
    position_error: Array
    locked_error: float
    com_error: float
    held: tuple[str, ...]
    balanced: dict[str, float]


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
    drawn = perturbation.drawn(seed, 0, len(reduced.joints), reduced.model.njoints)
    model = spatial_model(robot, reduced, drawn.mass, drawn.inertia)
    couplings = {*robot.coupled, *(coupling.leader for coupling in robot.coupled.values())}
    held = np.array([feedback is not None or name in robot.locked or name in couplings for name in reduced.joints])
    takeoff = _in_space(robot, model, perturbed_takeoff(record, reduced, drawn))
    control, fastest = _gains(model, takeoff[0], held, feedback or HOLD)
    step = forward.whole_step(record.duration, min(step, STABLE / fastest if fastest else math.inf), 1)
    if record.duration / step > forward.MOST_STEPS:
        reason = f"the gains of the joints take steps of {step:.2g} s, more than {forward.MOST_STEPS}"
        raise InputError(reason, element="engine", advice="use the engine pinocchio, or a lower feedback")
    landing = _fly(model, JointTorques(motion, drawn.torque, control), takeoff, step, record.duration)
    goal, plane, place = record.problem["goal"]["positions"], robot.plane, model.base_position
    w, x, y, z = landing[place + 3 : place + 7].tolist()
    wanted = pin.AngleAxis(float(record.orientation["goal"]), np.asarray(plane.normal)).matrix()
    turn = pin.log3(pin.Quaternion(w, x, y, z).normalized().matrix() @ wanted.T)
    position_error, locked_errors = reduced.off_goal(landing[model.positions], goal)
    aside = (_com(model, takeoff[0]) @ plane.normal) * plane.normal
    com_error = _com(model, landing) - motion.com_position(record.duration) @ reduced.axes - aside
    return SpatialLanding(
        roll=float(turn @ plane.horizontal),
        yaw=float(turn @ plane.vertical),
        orientation_error=abs(float(turn @ plane.normal)),
        position_error=position_error,
        locked_error=float(locked_errors.max(initial=0.0)),
        com_error=float(np.linalg.norm(com_error)),
        held=tuple(np.array(reduced.joints)[held].tolist()),
        balanced=model.balanced,
    )


def _in_space(robot: Robot, model: SpatialModel, takeoff: State) -> State:
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


def _gains(model: SpatialModel, position: Array, held: BoolArray, bandwidth: float) -> tuple[Array, float]:
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
    gains = forward.critical_gains(bandwidth, inertia)
    rates = np.linalg.eigvals(inverse * gains[1])
    return gains, float(np.abs(rates).max(initial=0.0))


def _fly(model: SpatialModel, torques: JointTorques, takeoff: State, step: float, duration: float) -> Array:
    """Positions at the end, the base's turn along the geodesic."""
    mujoco = import_mujoco()
    dynamics = torques.applied(forward.mujoco_accelerations(model.model), model.positions, model.velocities)

    def checked(time: float, position: Array, velocity: Array) -> Array:
        if not np.abs(velocity).max() < RUNAWAY:  # nor where it is no number
            raise FloatplanError(f"the replay in space ran away {time:.3g} s after takeoff; try a shorter --step")
        return dynamics(time, position, velocity)

    def moved(position: Array, velocity: Array, time: float) -> Array:
        position = position.copy()
        mujoco.mj_integratePos(model.model, position, velocity, time)
        return position

    positions, velocities = forward.fly_in_steps(checked, takeoff, np.array([duration]), step, moved)
    checked(duration, positions[-1], velocities[-1])
    return np.asarray(positions[-1])


def _com(model: SpatialModel, position: Array) -> Array:
    """Centre of mass (3,)."""
    mujoco = import_mujoco()
    data = mujoco.MjData(model.model)
    data.qpos[:] = position
    mujoco.mj_kinematics(model.model, data)
    mujoco.mj_comPos(model.model, data)
    return np.array(data.subtree_com[0])
