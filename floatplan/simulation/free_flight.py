"""A plan in a plane on a real free joint, in MuJoCo: how far does the robot roll and yaw?

The base is free in space, every joint of the URDF has the axis of the file, and nothing is rigid: joints get the
torques that the plan takes. Locked and coupled joints are also controlled by gains, as by a robot's motors.
"""

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, BoolArray
from floatplan.errors import FloatplanError, InputError
from floatplan.plans.record import PlanRecord
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot
from floatplan.simulation import integration
from floatplan.simulation.engines import JointTorques
from floatplan.simulation.gains import critical_gains
from floatplan.simulation.mujoco_model import MujocoRobot, MujocoSpec, rigid_joints
from floatplan.simulation.perturbation import Perturbation
from floatplan.simulation.plan_motion import PlanarPlanMotion
from floatplan.simulation.reduced_model import reduced_model
from floatplan.simulation.spatial_motion import perturbed_takeoff


@dataclass(frozen=True, eq=False)
class SpatialLanding:
    """Where the robot that is free in space lands, relative to the plan.

    Attributes
    ----------
    roll, yaw : rad
        About the plane's horizontal axis, and about its vertical: the rotation that the plan has not.
    orientation_error : rad
        About the plane's normal.
    position_error : (n,) rad
        Of each planned joint, or of one coupled to it where that is further off.
    locked_error : rad, of the locked joint that is furthest off; m of one that slides
    com_error : m, of the centre of mass from its parabola
    held : joints that are controlled by gains
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


def fly_with_free_base(
    robot: Robot, record: PlanRecord, perturbation: Perturbation, seed: int, feedback: float | None, step: float
) -> SpatialLanding:
    """Fly a recorded plan in a plane with every joint of its robot, its base free.

    Parameters
    ----------
    feedback : float, optional
        Bandwidth, rad/s, of gains on all joints; left out, gains of 50 rad/s are on locked and coupled ones alone.
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
    sample = perturbation.sampled(seed, 0, len(reduced.joints), reduced.model.njoints)
    motion = PlanarPlanMotion(record, reduced)
    flying = MujocoRobot(MujocoSpec(robot, reduced, sample, free=True))
    couplings = {*robot.coupled, *(coupling.leader for coupling in robot.coupled.values())}
    always = {*robot.locked, *couplings}
    controlled = np.array([feedback is not None or name in always for name in reduced.joints])
    plane = robot.plane
    axes = reduced.axes
    takeoff = flying.own_state(*_on_free_joint(robot, *perturbed_takeoff(record, reduced, sample)))
    gains, fastest = _gains(flying, takeoff[0], controlled, feedback or 50.0)
    stable = 1.0  # [-] largest rate of decay times step; the Runge-Kutta method is stable up to 2.8
    step = integration.whole_step(record.duration, min(step, stable / fastest if fastest else math.inf), 1)
    if record.duration / step > integration.MOST_STEPS:
        reason = f"the gains of the joints take steps of {step:.2g} s, more than {integration.MOST_STEPS}"
        raise InputError(reason, element="engine", advice="use the engine pinocchio, or a lower feedback")
    dynamics = JointTorques(motion, sample.torque, gains).dynamics(flying)

    def checked(time: float, q: Array, v: Array) -> Array:
        if not np.abs(v).max() < 1e6:  # rad/s, m/s; nor where it is no number
            raise FloatplanError(f"the replay in space ran away {time:.3g} s after takeoff; try a shorter --step")
        return dynamics(time, q, v)

    (landed,) = integration.fly_in_steps(checked, flying.moved, takeoff, np.array([record.duration]), step)
    checked(record.duration, *landed)

    q, _ = flying.reduced_state(*landed)
    goal = pin.AngleAxis(float(record.orientation["goal"]), np.asarray(plane.normal)).matrix()
    error = pin.log3(pin.Quaternion(q[3:7]).matrix() @ goal.T)
    position_error, locked_errors = reduced.off_goal(q[7:], record.problem["goal"]["positions"])
    out_of_plane = (_com(flying, takeoff[0]) @ plane.normal) * plane.normal
    com_error = _com(flying, landed[0]) - motion.com_position(record.duration) @ axes - out_of_plane
    return SpatialLanding(
        roll=float(error @ plane.horizontal),
        yaw=float(error @ plane.vertical),
        orientation_error=abs(float(error @ plane.normal)),
        position_error=position_error,
        locked_error=float(locked_errors.max(initial=0.0)),
        com_error=float(np.linalg.norm(com_error)),
        held=tuple(np.array(reduced.joints)[controlled].tolist()),
        balanced=flying.balanced,
    )


def _on_free_joint(robot: Robot, positions: Array, velocities: Array) -> tuple[Array, Array]:
    """A planar configuration and velocity on a free joint, as Pinocchio has them."""
    plane = robot.plane
    axes = np.stack((plane.horizontal, plane.vertical))
    angle = BASE_COORDINATES - 1
    attitude = pin.Quaternion(pin.AngleAxis(positions[angle], np.asarray(plane.normal)))
    base = np.concatenate((positions[:angle] @ axes, attitude.coeffs()))
    linear = attitude.matrix().T @ (velocities[:angle] @ axes)
    base_velocity = np.concatenate((linear, velocities[angle] * plane.normal))
    q = np.append(base, positions[BASE_COORDINATES:])
    return q, np.append(base_velocity, velocities[BASE_COORDINATES:])


def _gains(flying: MujocoRobot, q: Array, controlled: BoolArray, bandwidth: float) -> tuple[Array, float]:
    """Critically damped gains of the controlled joints at a posture, and the fastest rate of decay, 1/s."""
    flying.data.qpos[:] = q
    flying.mujoco.mj_forward(flying.model, flying.data)
    columns = np.eye(flying.model.nv)[flying.velocities]
    inverse = np.zeros_like(columns)
    flying.mujoco.mj_solveM(flying.model, flying.data, inverse, columns)
    inverse = inverse[:, flying.velocities]
    gains = critical_gains(bandwidth, controlled / np.diagonal(inverse))
    rates = np.linalg.eigvals(inverse * gains[1])
    return gains, float(np.abs(rates).max(initial=0.0))


def _com(flying: MujocoRobot, q: Array) -> Array:
    """Centre of mass (3,)."""
    flying.data.qpos[:] = q
    flying.mujoco.mj_kinematics(flying.model, flying.data)
    flying.mujoco.mj_comPos(flying.model, flying.data)
    return np.array(flying.data.subtree_com[0])
