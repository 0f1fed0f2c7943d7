"""Stiffness and damping by which joints follow their paths: torques ``kp (q_d - q) + kd (q_d' - q')``, N m.

| gains | by which rule |
| --- | --- |
| `critical_gains` | critical for a bandwidth and the inertias of joints: feedback of plans in the air |
| `uniform_gains` | the same for all joints, by their inertia in flight and the robot's weight: the bench |
| `gains_of_jump` | `uniform_gains` for a jump: exports, and where `search_gains` of `jump_replay.py` begins |
| `gains_by_phase` | by joint and phase of a jump, for a bandwidth: `replay --feedback` |
| `requested_gains` | what a user requests, of all joints or of some by name |
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from scipy.linalg import expm

from floatplan.arguments import by_name, number
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.base import FREE_FLYER
from floatplan.simulation.contact.shapes import feet_spheres
from floatplan.tables import Range

GAIN = number(Range(0.0, 1e12, ""))
Gain: TypeAlias = float | Mapping[str, float]  # of all joints, or of some by name
Gains: TypeAlias = tuple[Gain | None, Gain | None]  # stiffness, damping

FASTEST = 1e4  # [rad/s] bandwidth of feedback
BANDWIDTH = 100.0  # [rad/s] of a controller's feedback, unless another is requested


def critical_gains(bandwidth: float, inertia: Array) -> Array:
    """Return stiffness and damping (2, m), critical, for a bandwidth, rad/s, and joints' inertia (m,), kg m^2."""
    return read_only([bandwidth**2 * inertia, 2.0 * bandwidth * inertia])


def joint_inertia(model: Any, posture: Array) -> Array:
    """Return the inertia (m,), kg m^2, that each joint of a ``pinocchio.Model`` accelerates at a posture.

    It is ``1 / (M^-1)_jj``: the torque of the joint over its acceleration while the robot floats.
    """
    return np.asarray(1.0 / np.diagonal(_joint_inverse(model, posture)))


def _joint_inverse(model: Any, posture: Array, spots: Sequence[tuple[int, Array]] = ()) -> Array:
    """Accelerations (J, J) of the joints for their torques, 1/(kg m^2), on a base that floats.

    Spots do not accelerate: each is the number of the joint that carries it, and its position (3,) m in that joint's
    axes.
    """
    data = model.createData()
    upper = np.triu(pin.computeMinverse(model, data, np.asarray(posture)))  # all that Pinocchio fills in
    inverse = upper + np.triu(upper, 1).T
    base = BASE_COORDINATES if model.nq == model.nv else FREE_FLYER
    if spots:
        pin.computeJointJacobians(model, data, np.asarray(posture))
        rows = []
        for joint, position in spots:
            jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL)
            rows.append(jacobian[:3] - pin.skew(position) @ jacobian[3:])
        fixed = np.concatenate(rows)
        # More spots than a rigid body has freedoms, or those of a planar base, make rows that depend on others.
        forces = np.linalg.pinv(fixed @ inverse @ fixed.T, rcond=1e-8, hermitian=True) @ fixed @ inverse
        inverse -= inverse @ fixed.T @ forces
    return np.asarray(inverse[base:, base:])


def _bandwidth_inertia(inverse: Array) -> Array:
    """Inertia (J,), kg m^2, for gains whose bandwidth no mode exceeds of all joints at once.

    Each joint's own is ``1 / inverse_jj``. Where all have feedback at once, one mode accelerates more: with gains in
    proportion to these, by the largest eigenvalue of the inverse that is scaled by them.
    """
    mobility = np.diagonal(inverse)
    fixed = 1e-9 * mobility.max()  # 1/(kg m^2): less is rounding, of joints that contacts let not move at all
    own = 1.0 / np.maximum(mobility, fixed)
    scaled = np.sqrt(own)[:, None] * inverse * np.sqrt(own)
    return np.asarray(own / np.linalg.eigvalsh(scaled)[-1])


def fastest_bandwidth(delay: float, period: float) -> float:
    """Return the bandwidth, rad/s, at which critical gains ring that are late by a delay and constant in a period, s.

    Of s^2 + (2 w s + w^2) exp(-s T), with T the delay and half of the period, roots cross the imaginary axis at
    s = i w sqrt(2 + sqrt(5)), where w T is atan(2 sqrt(2 + sqrt(5))) over that root. Without a delay
    torques that stay for a period ring before: from one over the period on.
    """
    crossing = np.sqrt(2.0 + np.sqrt(5.0))
    of_delay = float(np.arctan(2.0 * crossing) / crossing / (delay + period / 2))
    return min(of_delay, 1.0 / period)


def ringing_joints(jump: JumpMotion, gains: Array, late: int, period: float) -> tuple[str, ...]:
    """Return the names of the joints that ring in flight with feedback that is late and constant in each period.

    Errors ring in a flight if they grow over it as a whole, in the mean over its postures; each of these is taken as if
    it stayed. The robot floats, with the inertia and the damping of joints that its model has.

    Parameters
    ----------
    gains : (2, J) N m/rad and N m s/rad, of the joints that move
    late : periods between a measurement and the feedback on it; more than ten count as ten
    period : s
    """
    none = 1e-5  # [-] growth in a period that is rounding: 0.2 % in a flight
    most_late = 10  # [-] feedback that rings so does so when it comes later, too
    postures = 9  # [-] of a flight
    robot = jump.robot
    names = robot.model_joints
    damping = np.array([robot.damping.get(name, 0.0) for name in names])
    ringing = np.zeros(len(names), dtype=bool)
    for flight in jump.timed_flights:
        times = np.linspace(flight.begin, flight.end, postures)
        growth = []
        moving = np.zeros(len(names))
        for posture in jump.at(times).positions:
            mobility = _joint_inverse(robot.model, posture)
            factors, motions = held_modes(mobility, damping, gains, min(late, most_late), period)
            growth.append(math.log(max(factors.max(), np.finfo(np.float64).tiny)))
            moving = np.maximum(moving, motions[:, factors > 1.0 + none].max(axis=1, initial=0.0))
        if np.mean(growth) > none:
            ringing |= moving > 0.5  # [-] of what the joint moves that moves most in such a mode
    return tuple(name for name, rings in zip(names, ringing.tolist(), strict=True) if rings)


def held_modes(mobility: Array, damping: Array, gains: Array, late: int, period: float) -> tuple[Array, Array]:
    """Modes of joints whose feedback is constant in each period: ``e'' = mobility (u - damping e')``.

    ``u`` is ``-(kp e + kd e')`` of so many periods ago, held for a period.

    Parameters
    ----------
    mobility : (J, J) 1/(kg m^2)
    damping : (J,) N m s/rad, of the joints themselves
    gains : (2, J) N m/rad and N m s/rad
    late : periods
    period : s

    Returns
    -------
    factors : (m,) by which each mode grows in a period
    motions : (J, m) how far joints move in each, over the one that moves most
    """
    count = len(mobility)
    rates = np.zeros((3 * count, 3 * count))  # of errors, their rates, and torques that stay
    rates[:count, count : 2 * count] = np.eye(count)
    rates[count : 2 * count, count : 2 * count] = -mobility * damping
    rates[count : 2 * count, 2 * count :] = mobility
    held = expm(period * rates)[: 2 * count]
    feedback = -np.hstack([np.diag(gain) for gain in gains])
    if late:
        queued = late * count  # torques that are still to come, the next ones first
        step = np.zeros((2 * count + queued, 2 * count + queued))
        step[: 2 * count, : 3 * count] = held
        step[2 * count : -count, 3 * count :] = np.eye(queued - count)
        step[-count:, : 2 * count] = feedback
    else:
        step = held[:, : 2 * count] + held[:, 2 * count :] @ feedback
    values, vectors = np.linalg.eig(step)
    sizes = np.abs(vectors[:count])
    largest = np.maximum(sizes.max(axis=0), np.finfo(np.float64).tiny)
    return np.abs(values), sizes / largest


def gains_by_phase(jump: JumpMotion, bandwidth: float) -> Array:
    """Stiffness, N m/rad, and damping, N m s/rad, (P, 2, J) of all joints that move, in each phase of a jump.

    In the air gains are critical for the inertia that each joint accelerates while the robot floats, its rotor
    included, averaged over the flight. A light foot so has little stiffness and damping, and a robot on flat soles
    would tip over its ankles. Where feet stand, the joints above them accelerate far less: in a stance each joint has a
    stiffness of at least 1.5 times the robot's weight times the height of its centre of mass, as far as the bandwidth
    allows. Legs that do not stand have the gains of the air.

    Parameters
    ----------
    bandwidth : rad/s
        Of the fastest mode of all joints at once.
    """
    model = jump.problem.robot.model
    inertias = [_bandwidth_inertia(_joint_inverse(model, posture)) for posture in _postures_in_flight(jump)]
    afloat = np.mean(inertias, axis=0)
    in_air = critical_gains(bandwidth, afloat)
    enough = 1.5  # [-] of the stiffness with which it does not fall over slowly
    # Delay and half of a period are 5 ms: they cancel 5 ms of lead, and the remaining 2 ms damp. Much more lead rings
    # where a foot touches the ground but does not stand yet.
    lead = 7e-3  # [s] damping over stiffness
    feet = feet_spheres(jump)
    tipping = _tipping_stiffness(jump.robot, _weight(jump), jump.before[0].ground, jump.at(0.0).positions[0])
    gains = []
    for phase in jump.phases:
        spots = [feet[name][:2] for name in phase.contacts]
        posture = jump.at((phase.begin + phase.end) / 2).positions[0]
        most = critical_gains(bandwidth, _bandwidth_inertia(_joint_inverse(model, posture, spots)))
        needed = enough * tipping if spots else 0.0
        stiffness = np.maximum(in_air[0], np.minimum(most[0], needed))
        damping = np.maximum(in_air[1], np.minimum(most[1], lead * stiffness))
        gains.append([stiffness, damping])
    return read_only(gains)


def _tipping_stiffness(robot: Robot, weight: float, ground: float, standing: Array) -> float:
    """The weight, N, times its height over the ground in a posture (nq,), N m/rad: with less a robot falls over."""
    com = pin.centerOfMass(robot.model, robot.model.createData(), standing) @ robot.up
    return float(weight * (com - ground))


def _weight(jump: JumpMotion) -> float:
    return jump.robot.mass * jump.problem.flight.gravity


def _postures_in_flight(jump: JumpMotion) -> Array:
    """Postures (K, nq) of all its flights."""
    spans = [np.linspace(flight.begin, flight.end, 33) for flight in jump.timed_flights]
    return jump.at(np.concatenate(spans)).positions


def requested_gains(joints: Sequence[str], requested: Gain | None, element: str, default: Array) -> Array:
    """Return gains (J,) as requested, else as they are by default; InputError where one is wrong."""
    if requested is None:
        return default
    if not isinstance(requested, Mapping):
        return np.full(len(joints), GAIN(requested, element))
    gains = default.copy()
    for joint, gain in by_name(GAIN)(requested, element).items():
        if joint not in joints:
            raise InputError(f"the robot has no such joint that moves: {joint}", element=element)
        gains[joints.index(joint)] = gain
    return gains


def gains_of_jump(jump: JumpMotion, requested: Gains = (None, None)) -> Array:
    """Stiffness, N m/rad, and damping, N m s/rad, (2, J) of all joints of a jump that move: :func:`uniform_gains`."""
    standing = jump.at(0.0).positions[0]
    ground = jump.before[0].ground
    return uniform_gains(jump.robot, _weight(jump), ground, standing, _postures_in_flight(jump), requested)


def uniform_gains(
    robot: Robot, weight: float, ground: float, standing: Array, in_flight: Array, requested: Gains = (None, None)
) -> Array:
    """Stiffness, N m/rad, and damping, N m s/rad, (2, J) of all joints that move, as requested.

    Gains that are not requested are the same for all joints: a stiffness with which the joint that accelerates the
    least inertia in flight has the bandwidth that delayed measurements allow, but at least the robot's weight times the
    height of its centre of mass where it stands, without which it falls over; and a damping that is nearly critical.
    The lightest joint bounds all, since damping of more than its inertia over the delay rings. InputError where a
    requested gain is wrong.

    Parameters
    ----------
    robot : Robot
    weight : N
    ground : height of the ground, m
    standing : (nq,), posture in which it stands, of ``robot.model``
    in_flight : (K, nq)
    requested : two floats or mappings, optional
    """
    late_bandwidth = 125.0  # [rad/s] 0.97 of `fastest_bandwidth(4e-3, 2e-3)`, at which late feedback rings
    damping_time = 0.017  # [s] damping over stiffness: nearly critical
    model = robot.model
    tipping = _tipping_stiffness(robot, weight, ground, standing)
    lightest = float(np.mean([joint_inertia(model, posture).min() for posture in in_flight]))
    stiffness = float(f"{max(late_bandwidth**2 * lightest, tipping):.2g}")
    joints = robot.model_joints
    if not (isinstance(requested, Sequence) and len(requested) == 2):
        raise InputError("must be stiffness and damping, each None if left out", element="gains")
    kp, kd = requested
    return np.stack(
        [
            requested_gains(joints, kp, "kp", np.full(len(joints), stiffness)),
            requested_gains(joints, kd, "kd", np.full(len(joints), damping_time * stiffness)),
        ]
    )
