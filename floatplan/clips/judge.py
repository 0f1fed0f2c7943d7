"""Whether a flight of a clip can fly: fall of its centre of mass, turning of its base, and what it would take.

Verdicts on a flight:

afloat      the centre of mass accelerates by less than 1.5 m/s^2, measured to 1.5 m/s^2: something carries the robot
unphysical  it has a fault
physical    it has no fault, and its fall is measured to 1.5 m/s^2
undecided   it has no fault, but too few frames to measure its fall to 1.5 m/s^2
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.clips.clip import Clip
from floatplan.clips.fall import Fall, fit_fall
from floatplan.clips.flights import FOOT_CLEARANCE, STANCE_SPAN, STILL, ClipFlight
from floatplan.clips.turning import LEAST_FRAMES, JointFit, RotationFit, nearest_turning
from floatplan.motion.spatial.dynamics import SpatialDynamics
from floatplan.motion.spatial.kinematics import body_poses, centre_of_mass, free_dynamics
from floatplan.motion.spatial.rotations import of_quaternions
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.base import FREE_FLYER as BASE
from floatplan.tables import GRAVITY


@dataclass(frozen=True, eq=False)
class FlightJudgement:
    """The verdict on one flight of a clip.

    Attributes
    ----------
    flight : ClipFlight
    verdict : "physical", "unphysical", "undecided" or "afloat", as at the head of ``floatplan.clips.judge``
    faults : what is wrong, a sentence each
    fall : Fall
    joints : JointFit, optional
    rotation : RotationFit, optional
        None, as the joints' fit, of a flight of too few frames.
    rate_share, torque_share : the largest share of a limit that a motor takes, and its name; None where the robot has
        no such limits
    wrench : (2,) N and N m
        Force, and root mean square of the moment, that a simulator must add at the base for the motion to be tracked.
    floating, sinking, sliding : m, within 0.3 s before and after the flight
        Largest height over the ground of a foot that is still, largest depth of any foot under the ground, and longest
        way of a foot along the ground while it is lower than 2 cm.
    """

    flight: ClipFlight
    verdict: str
    faults: tuple[str, ...]
    fall: Fall
    joints: JointFit | None
    rotation: RotationFit | None
    rate_share: tuple[float, str] | None
    torque_share: tuple[float, str] | None
    wrench: tuple[float, float]
    floating: float
    sinking: float
    sliding: float


def judge_flight(clip: Clip, flight: ClipFlight, gravity: float = GRAVITY) -> FlightJudgement:
    """Judge one flight of a clip by its frames that are within it."""
    frames = slice(flight.first, flight.last + 1)
    times = np.asarray(clip.times[frames])
    attitudes = of_quaternions(clip.base_quaternion[frames])
    fall = fit_fall(times, com_of_frames(clip, frames))
    dynamics = free_dynamics(clip.robot)
    joints = rotation = rate_share = torque_share = None
    if len(times) >= LEAST_FRAMES:
        joints, rotation = nearest_turning(dynamics, times, np.asarray(clip.positions[frames]), attitudes)
    if joints is not None and rotation is not None:
        rate_share, torque_share = _shares(clip.robot, dynamics, joints, rotation)
    faults = _faults(fall, rotation, joints, gravity)
    floating, sinking, sliding = _stance_errors(clip, flight)
    return FlightJudgement(
        flight=flight,
        verdict=_verdict(fall, faults),
        faults=faults,
        fall=fall,
        joints=joints,
        rotation=rotation,
        rate_share=rate_share,
        torque_share=torque_share,
        wrench=_wrench(clip.robot, fall, joints, rotation, dynamics, times, gravity),
        floating=floating,
        sinking=sinking,
        sliding=sliding,
    )


def com_of_frames(clip: Clip, frames: slice) -> Array:
    """Positions (K, 3) of the centre of mass in frames of a clip, m."""
    attitudes = of_quaternions(clip.base_quaternion[frames])
    return centre_of_mass(
        clip.robot, body_poses(clip.robot, clip.base_position[frames], attitudes, clip.positions[frames])
    )


def _faults(fall: Fall, rotation: RotationFit | None, joints: JointFit | None, gravity: float) -> tuple[str, ...]:
    """What keeps a flight from flying, a sentence each."""
    faults: list[str] = []
    if np.isfinite(fall.interval):
        if abs(fall.fall - gravity) > fall.tolerance:
            faults.append(f"the centre of mass falls at {fall.fall:.2f} m/s^2, not {gravity:g}")
        if fall.sideways > fall.tolerance:
            faults.append(f"the centre of mass accelerates sideways at {fall.sideways:.2f} m/s^2")
    if not fall.on_parabola:
        faults.append(f"the centre of mass is {1e3 * fall.rms:.0f} mm rms from any parabola")
    if joints is None:
        return tuple(faults)
    if rotation is None:
        faults.append("no flight with these joints and a constant angular momentum could be integrated")
        return tuple(faults)
    if rotation.noise > np.deg2rad(1.0):  # [rad] from frame to frame: more is a fault of its own
        faults.append(f"rough: attitudes jump by {np.rad2deg(rotation.noise):.1f} degrees from frame to frame")
    if rotation.rms > rotation.tolerance:
        off = np.rad2deg(rotation.rms)
        faults.append(f"attitudes are {off:.1f} degrees rms from any flight with a constant angular momentum")
    return tuple(faults)


def _verdict(fall: Fall, faults: tuple[str, ...]) -> str:
    """The verdict, as at the head of this file."""
    widest = 1.5  # [m/s^2] confidence interval of a fall that counts as measured
    least = 1.5  # [m/s^2] a smaller acceleration of the centre of mass is no fall: something carries the robot
    slow = float(np.hypot(fall.fall, fall.sideways)) < least
    if fall.interval <= widest and slow and fall.on_parabola:
        return "afloat"
    if faults:
        return "unphysical"
    return "physical" if fall.interval <= widest else "undecided"


def _shares(
    robot: Robot, dynamics: SpatialDynamics, joints: JointFit, rotation: RotationFit
) -> tuple[tuple[float, str] | None, tuple[float, str] | None]:
    """The largest share of a rate's and of a torque's limit, in free flight, each with its motor."""
    s = np.linspace(0.0, 1.0, 65)  # instants at which rates and torques are compared with their limits
    positions, velocities, accelerations = joints.at(joints.begin + s * joints.duration)
    inertia, joint_map = dynamics.momentum_maps(positions)
    attitudes = rotation.motion.at(s)
    relative = np.einsum("kaj,kj->ka", joint_map, velocities)
    rates = np.linalg.solve(inertia, (rotation.angular_momentum @ attitudes - relative)[..., None])[..., 0]
    torques = dynamics.torques(positions, velocities, accelerations, rates)
    of_motors = np.abs(torques @ robot.transmission[BASE:])
    motor_rates = np.abs(velocities[:, [robot.model_joints.index(name) for name in robot.motors]])
    return (
        largest_share(motor_rates, robot.motor_velocity_limits, robot.motors),
        largest_share(of_motors, robot.motor_torque_limits, robot.motors),
    )


def largest_share(values: Array, limits: Array, names: tuple[str, ...]) -> tuple[float, str] | None:
    """The largest share that values (K, m) have of limits (m,), and whose it is; None where nothing is limited."""
    limited = np.flatnonzero(np.isfinite(limits))
    if not len(limited):
        return None
    shares = values[:, limited].max(axis=0) / limits[limited]
    largest = int(shares.argmax())
    return float(shares[largest]), names[limited[largest]]


def _wrench(
    robot: Robot,
    fall: Fall,
    joints: JointFit | None,
    rotation: RotationFit | None,
    dynamics: SpatialDynamics,
    times: Array,
    gravity: float,
) -> tuple[float, float]:
    """Force, N, and moment, N m, that a simulator must add: ``m |c'' - g|``, root mean square of dh/dt."""
    acceleration = 2.0 * fall.coefficients[2] + np.array([0.0, 0.0, gravity])
    force = robot.mass * float(np.linalg.norm(acceleration))
    if joints is None or rotation is None:
        return force, float("nan")
    # what the attitudes are off, as a smooth motion of degree 4: its angular acceleration is not the flight's
    middle = 0.5 * (times[0] + times[-1])
    degree = min(4, len(times) - 1)
    terms = np.vander(times - middle, degree + 1, increasing=True)
    coefficients, *_ = np.linalg.lstsq(terms, rotation.residuals, rcond=None)
    orders = np.arange(degree + 1)
    powers = np.where(orders >= 2, orders - 2, 0)
    factors = np.where(orders >= 2, orders * (orders - 1), 0)
    angular = ((times - middle)[:, None] ** powers * factors) @ coefficients
    inertia, _ = dynamics.momentum_maps(joints.at(times)[0])
    attitudes = rotation.motion.at(np.clip((times - joints.begin) / joints.duration, 0.0, 1.0))
    in_world = attitudes @ inertia @ np.swapaxes(attitudes, 1, 2)
    moments = np.einsum("kab,kb->ka", in_world, angular)
    return force, float(np.sqrt((moments**2).sum(axis=1).mean()))


def _stance_errors(clip: Clip, flight: ClipFlight) -> tuple[float, float, float]:
    """How far feet next to a flight float over the ground, sink into it, and slide along it, m.

    Feet that are still float: a foot that leaves or arrives is not, and does not float. Any foot may sink. Feet lower
    than 2 cm slide.
    """
    scene = clip.scene
    step = float(scene.times[1] - scene.times[0])
    floating = sinking = sliding = 0.0
    for begin, end in ((flight.begin - STANCE_SPAN, flight.begin), (flight.end, flight.end + STANCE_SPAN)):
        near = np.flatnonzero((scene.times >= begin) & (scene.times <= end))
        if not len(near):
            continue
        heights = scene.clearances[near]
        velocities = scene.foot_velocities[near]
        low = heights < 0.05  # [m] over the ground: a foot that is still and higher does not stand
        stands = (np.linalg.norm(velocities, axis=2) < STILL) & low
        along_ground = np.linalg.norm(velocities[..., :2], axis=2)
        slid = np.where(heights < FOOT_CLEARANCE, along_ground, 0.0).sum(axis=0) * step
        floating = max(floating, float(heights[stands].max(initial=0.0)))
        sinking = max(sinking, float(-heights.min()))
        sliding = max(sliding, float(slid.max()))
    return floating, sinking, sliding
