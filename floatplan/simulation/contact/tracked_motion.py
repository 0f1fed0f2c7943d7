"""A motion that a controller tracks: what joints do at each of its periods. A jump is one, and a recorded motion is."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import JumpState
from floatplan.robot.robot import Robot
from floatplan.simulation.base_states import base_states
from floatplan.simulation.contact.shapes import ContactShapes, shapes_of_jump
from floatplan.simulation.control_loop import Motors
from floatplan.simulation.limits import MOST_PERIODS
from floatplan.simulation.mujoco_model import free_base
from floatplan.simulation.reduced_model import ReducedModel, reduced_model
from floatplan.simulation.simulated_jump import STANDING

PERIOD = 2e-3  # [s] of the joints' control


@dataclass(frozen=True, eq=False)
class TrackedMotion:
    """A motion of a robot of J moving joints, at the K periods of control from its beginning until it has stood.

    Attributes
    ----------
    robot : Robot
    reduced : ReducedModel, of which nothing is rigid
    gravity : m/s^2
    shapes : ContactShapes
    duration : of the motion, s; then it stays as in its end for ``STANDING``
    flights : when each flight begins and ends, s; a motion without any is one flight from its beginning to its end
    positions : (K, nq) of the reduced model; orientations go on from one to the next
    velocities : (K, nv)
    torques : (K, J) N m, which the motion takes without what the joints lose
    goals : the base's orientation where each flight ends, as of ``BaseStates``
    begin_ground, end_ground : heights of the ground on which it stands at the beginning and at the end, m
    base_ends : (2, 7), the base's position, m, and quaternion w, x, y, z, at its beginning and its end
    motors : Motors
    """

    robot: Robot
    reduced: ReducedModel
    gravity: float
    shapes: ContactShapes
    duration: float
    flights: tuple[tuple[float, float], ...]
    positions: Array
    velocities: Array
    torques: Array
    goals: tuple[Any, ...]
    begin_ground: float
    end_ground: float
    base_ends: Array
    motors: Motors


def control_times(duration: float) -> Array:
    """Return the beginnings (K,), s, of the periods of a motion of a duration, s, at whose end the robot stands.

    InputError where it lasts too long to be simulated.
    """
    longest = MOST_PERIODS * PERIOD - STANDING
    if duration > longest:
        raise InputError(f"lasts {duration:.4g} s, more than the {longest:.4g} s that are simulated", advice="cut it")
    return np.asarray(np.arange(int((duration + STANDING) / PERIOD) + 1) * PERIOD, dtype=np.float64)


def tracked_jump(jump: JumpMotion) -> tuple[TrackedMotion, JumpState]:
    """Return a jump that is to be tracked, and its states at the periods of control.

    InputError where the jump is periodic, or lasts too long.
    """
    assert jump.flight is not None
    if jump.request.is_periodic:
        reason = "a periodic jump ends in motion, and never stands"
        raise InputError(reason, element="jump.landing.to", advice="fly as many flights from standing to standing")
    problem = jump.problem
    robot = problem.robot
    reduced = reduced_model(robot, problem.flight.gravity, rigid=())
    base = base_states(reduced)
    planned = jump.at(np.minimum(control_times(jump.duration), jump.duration))
    planned = replace(planned, positions=base.continuous(planned.positions))
    motors = Motors(
        effort=np.array([robot.joint_tree.joint[name].effort for name in reduced.joints]),
        stall=np.full(len(reduced.joints), np.inf),
        slope=np.zeros(len(reduced.joints)),
    )
    of_motors = list(map(reduced.joints.index, robot.motors))
    motors.effort[of_motors] = problem.motor_torque_limits
    motors.stall[of_motors] = problem.motor_stall
    motors.slope[of_motors] = problem.motor_slope
    flights = jump.timed_flights
    tracked = TrackedMotion(
        robot=robot,
        reduced=reduced,
        gravity=problem.flight.gravity,
        shapes=shapes_of_jump(jump),
        duration=jump.duration,
        flights=tuple((flight.begin, flight.end) for flight in flights),
        positions=planned.positions,
        velocities=planned.velocities,
        torques=planned.torques[:, reduced.of_joints[1]],
        goals=tuple(base.goal(flight.plan.problem) for flight in flights),
        begin_ground=jump.stances[0].ground,
        end_ground=jump.stances[-1].ground,
        base_ends=free_base(jump.q([0.0, jump.duration])),
        motors=motors,
    )
    return tracked, planned
