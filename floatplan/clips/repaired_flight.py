"""One flight of a clip, planned anew: the nearest motion that falls at g and turns with one angular momentum.

Postures at both ends are the clip's. How long the flight takes is chosen: "retime" keeps postures and heights, so that
the centre of mass takes as long as it needs to fall; "raise" keeps the duration, and the centre of mass rises higher.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arguments import number, one_of
from floatplan.arrays import Array
from floatplan.clips.clip import Clip
from floatplan.clips.fall import fit_longer_fall
from floatplan.clips.flights import CHECKED, LEAST_DURATION, RANGE_MARGIN, SAMPLING, ClipFlight
from floatplan.clips.judge import FlightJudgement, com_of_frames, largest_share
from floatplan.clips.planned.ends import StillEnds
from floatplan.clips.timing import fall_duration
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.spatial.kinematics import body_poses, centre_of_mass
from floatplan.motion.spatial.rotations import logarithm, of_quaternions, unwrapped_angles
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import plan as plan_flight
from floatplan.planning.planner import planned
from floatplan.plans.plan import Plan
from floatplan.problem.attitude import Attitude
from floatplan.problem.parts import ClipReference, Flight, Landing, Limits, Motion, Posture, Takeoff
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.base import FREE_FLYER as BASE
from floatplan.tables import CHOICES, GRAVITY, Range, RepairName

Choice: TypeAlias = RepairName | float
# [-] weight of the clip's own duration in that of the planned flight; the remainder is that of the fall's duration
CLIP_WEIGHTS = {"retime": 0.0, "raise": 1.0}
CHOICE = one_of(*CHOICES["repair"], or_number=number(Range(0.0, 1.0, "")))
NODES = 24  # [-] of the quadrature at which the clip is read, and rates at the ends are fitted
# [s] of a repaired flight: its clip is searched for flights at instants of its own, and may lose one at each end
SHORTEST = LEAST_DURATION + 2.0 / SAMPLING.rate


@dataclass(frozen=True, eq=False)
class PlannedFlight:
    """What planning a flight of a clip anew gave.

    Attributes
    ----------
    flight : ClipFlight
    plan : Plan, optional
        None where there is none.
    choice : "retime", "raise", or a number from 0, retime, to 1, raise
    joints_rms, joints_largest : rad, root mean square and largest difference of the plan's joints from the clip's
    base_largest : rad, largest angle between the plan's and the clip's attitude of the base, along the flight
    rate_share, torque_share : the largest share of a limit that a motor takes, and its name; None without limits
    reason : why the plan cannot replace the flight; "" where it can
    """

    flight: ClipFlight
    plan: Plan | None
    choice: str | float
    joints_rms: float
    joints_largest: float
    base_largest: float
    rate_share: tuple[float, str] | None
    torque_share: tuple[float, str] | None
    reason: str

    @property
    def duration(self) -> float:
        """Of the plan, or of the clip's flight where there is none, s."""
        return self.flight.duration if self.plan is None else self.plan.duration

    @property
    def repairable(self) -> bool:
        """Whether there is a plan instead, within the robot's limits and near to the clip."""
        return not self.reason


def plan_flight_anew(
    clip: Clip,
    judged: FlightJudgement,
    choice: Choice = "auto",
    degree: int | None = None,
    gravity: float = GRAVITY,
    ends: StillEnds | None = None,
) -> PlannedFlight:
    """Plan a flight of a clip anew.

    Parameters
    ----------
    judged : FlightJudgement
        The flight and its verdict.
    choice : "retime", "raise", a number between 0, retime, and 1, raise, or "auto": the first of both that keeps the
        robot's limits, else the nearer one
    degree : of the polynomials (12); by the flight's duration where left out
    gravity : m/s^2
    ends : the postures of takeoff and landing with feet that are still, optional
    """
    choices: tuple[str | float, ...] = tuple(CLIP_WEIGHTS) if choice == "auto" else (choice,)
    tried: list[PlannedFlight] = []
    for one_choice in choices:
        planned_flight = _planned(clip, judged, one_choice, degree, gravity, ends)
        if planned_flight.repairable:
            return planned_flight
        tried.append(planned_flight)
    return min(tried, key=lambda flight: (flight.plan is None, _largest_use(flight), flight.joints_largest))


def _largest_use(planned_flight: PlannedFlight) -> float:
    """The largest share of a limit, of rates and torques, that a flight takes; 0 without limits."""
    shares = (planned_flight.rate_share, planned_flight.torque_share)
    return max((share[0] for share in shares if share is not None), default=0.0)


def _planned(
    clip: Clip,
    judged: FlightJudgement,
    choice: str | float,
    degree: int | None,
    gravity: float,
    ends: StillEnds | None,
) -> PlannedFlight:
    """Plan with one choice: within the limits where the nearest motion exceeds them, or is expected to.

    Where there is none within them, the nearest motion tells by how much.
    """
    flight = judged.flight
    duration = repaired_duration(clip, judged, choice, gravity)
    if duration < SHORTEST:
        return _none(flight, choice, f"it falls over its own heights in {duration:.2g} s, too short for a flight")

    def plan_within(near: Plan | None = None) -> Plan:
        margin = 0.985  # [-] of the limits, which hold at nodes and are judged between them
        problem = flight_problem(clip, flight, duration, degree, gravity, share_of_limits=margin)
        if ends is not None:
            return ends.plan(problem)
        return planned(problem, SearchOptions(), near=near).plan

    expects_more = _is_limited(_expected_share(judged, duration))
    if expects_more:
        within = plan_within()
        if within.ok:
            return _judged(clip, flight, choice, within)
    problem = flight_problem(clip, flight, duration, degree, gravity)
    plan = plan_flight(problem) if ends is None else ends.plan(problem)
    if not plan.ok:
        return _none(flight, choice, f"no flight was found: {plan.explanation}")
    nearest = _judged(clip, flight, choice, plan)
    if expects_more or not _is_limited(_largest_use(nearest)):
        return nearest
    within = plan_within(near=plan)
    return _judged(clip, flight, choice, within) if within.ok else nearest


def _expected_share(judged: FlightJudgement, duration: float) -> float:
    """Largest share of a limit that a clip's motion takes in so many seconds: torques grow with the pace squared."""
    pace = judged.flight.duration / duration
    rate = 0.0 if judged.rate_share is None else judged.rate_share[0] * pace
    torque = 0.0 if judged.torque_share is None else judged.torque_share[0] * pace**2
    return max(rate, torque)


def _is_limited(share: float) -> bool:
    """Whether a motion that takes such a share of a limit is to be planned within the limits."""
    hopeless = 20.0  # [-] of a limit: above, there is no plan, and the search takes seconds
    return 1.0 < share <= hopeless


def _none(flight: ClipFlight, choice: str | float, reason: str) -> PlannedFlight:
    return PlannedFlight(flight, None, choice, math.nan, math.nan, math.nan, None, None, reason)


def _limits_within(robot: Robot, share: float) -> dict[str, Any]:
    """Keys of ``Limits``: a share of those of the robot's file."""
    rates = _finite_limits(robot.motors, share * robot.motor_velocity_limits)
    torques = _finite_limits(robot.motors, share * robot.motor_torque_limits)
    return {"velocity": rates or "none", "torque": torques or "none"}


def _finite_limits(motors: Sequence[str], limits: Array) -> dict[str, float]:
    """Limits by motor, those without one left out."""
    return {motor: limit for motor, limit in zip(motors, limits.tolist(), strict=True) if math.isfinite(limit)}


def repaired_duration(clip: Clip, judged: FlightJudgement, choice: str | float, gravity: float = GRAVITY) -> float:
    """How long a flight of a clip takes when it is repaired, s: that of its fall over its own heights, or the clip's.

    With a number as ``choice`` it is between both. Where the centre of mass is on a parabola, its heights are those of
    the parabola: noise of the frames at takeoff, top and landing would change the duration. The parabola of few frames
    is noisy too: frames next to the flight in which feet are low are added as far as they are on it.
    """
    flight = judged.flight
    times = flight.begin + flight.duration * np.linspace(0.0, 1.0, CHECKED)
    if judged.fall.on_parabola and math.isfinite(judged.fall.interval):
        longest = clip.scene.longest(flight)
        frames = slice(longest.first, longest.last + 1)
        first = flight.first - longest.first
        fall = fit_longer_fall(clip.times[frames], com_of_frames(clip, frames), first, first + flight.frames - 1)
        heights = fall.at(times)[:, 2]
    else:
        heights = centre_of_mass(clip.robot, clip.curve.poses(times))[:, 2]
    weight = CLIP_WEIGHTS[choice] if isinstance(choice, str) else choice
    falling = fall_duration(float(heights[0]), float(heights.max()), float(heights[-1]), gravity)
    return weight * flight.duration + (1.0 - weight) * falling


def flight_problem(
    clip: Clip,
    flight: ClipFlight,
    duration: float,
    degree: int | None = None,
    gravity: float = GRAVITY,
    share_of_limits: float | None = None,
) -> Problem:
    """The problem whose plan is a flight of a clip, nearest to it.

    Parameters
    ----------
    duration : s, of the plan
    degree : of the polynomials (12); by the flight's duration where left out
    gravity : m/s^2
    share_of_limits : of the rates and torques of the robot's file, within which the plan is to stay; without these
        limits if left out
    """
    robot = clip.robot
    ends = np.array([flight.begin, flight.end])
    at = np.concatenate((ends, flight.begin + flight.duration * gauss_legendre(NODES).nodes))
    bases = clip.curve.base_positions(ends)
    positions = clip.curve.positions(at)
    com = centre_of_mass(robot, clip.curve.poses(ends))
    columns = [robot.model_joints.index(joint) for joint in robot.joints]
    planned = positions[:, columns]
    low, high = _ranges(robot.position_limits, planned)
    # [s, -] longer flights need higher degrees; within limits, which bind for a while only, so do short ones
    lowest = 9 if share_of_limits is None else 10
    by_duration = ((0.35, lowest), (0.7, 11), (math.inf, 13))
    chosen = degree or next(value for longest, value in by_duration if duration <= longest)
    rates = _end_rates(planned, (low + high) / 2, (high - low) / 2, duration, chosen)
    limits: dict[str, Any] = {"position": tuple(zip(low.tolist(), high.tolist(), strict=True))}
    if share_of_limits is not None:
        rates = np.clip(rates, -share_of_limits * robot.velocity_limits, share_of_limits * robot.velocity_limits)
        limits |= _limits_within(robot, share_of_limits)
    goal_angles = _attitudes_of_ends(clip, flight)
    postures = []
    for end in (0, 1):
        posture = Posture(
            orientation=goal_angles[end],
            positions=tuple(planned[end].tolist()),
            velocities=tuple(rates[end].tolist()),
            accelerations="free",
        )
        postures.append(posture)
    across = (com[1, :2] - com[0, :2]) / duration
    instants = flight.begin + flight.duration * np.linspace(0.0, 1.0, CHECKED)
    reference = clip.curve.positions(instants)[:, columns]
    root = robot.joint_tree.root
    return Problem(
        robot,
        start=postures[0],
        goal=postures[1],
        flight=Flight(
            duration=duration,
            angular_momentum="free",
            takeoff=Takeoff(frame=root, position=tuple(bases[0].tolist())),
            landing=Landing(frame=root, height=float(bases[1, 2])),
            horizontal_velocity=tuple(across.tolist()),
            gravity=gravity,
        ),
        motion=Motion(degree=chosen, objective="clip", clip=ClipReference(positions=reference.tolist())),
        limits=Limits(**limits),
        name=f"{clip.path.stem}_{flight.begin:.2f}",
    )


def _ranges(limits: Array, positions: Array) -> tuple[Array, Array]:
    """Ranges (n,) of the joints that hold a clip's positions (K, n) well inside, so that none is at an edge."""
    low = np.minimum(np.maximum(limits[:, 0], -math.pi), positions.min(axis=0) - RANGE_MARGIN)
    high = np.maximum(np.minimum(limits[:, 1], math.pi), positions.max(axis=0) + RANGE_MARGIN)
    return low, high


def _end_rates(positions: Array, centre: Array, amplitude: Array, duration: float, degree: int) -> Array:
    """Rates (2, n), rad/s, at takeoff and landing of the polynomials (12) that are nearest to a clip's positions.

    The clip's own rates there are of no use: the joints' accelerations jump where feet leave the ground, which the
    splines between frames smear over both sides.

    Parameters
    ----------
    positions : (2 + K, n) rad
        At takeoff, at landing, and at the nodes of the quadrature.
    """
    grid = gauss_legendre(NODES)
    s = grid.nodes[:, None]
    arguments = np.arcsin(np.clip((positions - centre) / amplitude, -1.0, 1.0))
    first, last, between = arguments[0], arguments[1], arguments[2:]
    legendre = np.polynomial.legendre.legvander(2.0 * grid.nodes - 1.0, degree - 2)
    free = s * (1.0 - s) * legendre
    weights = np.sqrt(grid.weights)[:, None]
    # the weight 1e-4 of the polynomials' order, squared: without it few frames would leave ends undetermined
    smooth = 1e-4 * np.diag(np.arange(degree - 1) ** 2.0)
    targets = weights * (between - first - s * (last - first))
    coefficients, *_ = np.linalg.lstsq(
        np.concatenate((weights * free, smooth)),
        np.concatenate((targets, np.zeros((degree - 1, len(centre))))),
        rcond=None,
    )
    at_ends = np.polynomial.legendre.legvander(np.array([-1.0, 1.0]), degree - 2) @ coefficients
    slopes = np.stack((last - first + at_ends[0], last - first - at_ends[1]))
    return np.asarray(amplitude * np.cos(arguments[:2]) * slopes / duration)


def _attitudes_of_ends(clip: Clip, flight: ClipFlight) -> tuple[Attitude, Attitude]:
    """Attitudes at takeoff and landing; of more than 90 degrees as angles, which count whole rotations."""
    instants = flight.begin + flight.duration * np.linspace(0.0, 1.0, CHECKED)
    attitudes = clip.curve.attitudes(instants)
    steps = logarithm(np.swapaxes(attitudes[:-1], 1, 2) @ attitudes[1:])
    turned = float(np.linalg.norm(steps, axis=1).sum())
    if turned < math.pi / 2:  # the shortest way is the clip's
        quaternions = Rotation.from_matrix(attitudes[[0, -1]]).as_quat()
        first, last = (Attitude(quaternion_xyzw=tuple(quaternion.tolist())) for quaternion in quaternions)
        return first, last
    orders = ("yxz", "xyz", "zyx", "yzx", "xzy", "zxy")
    unwrapped = {axes: unwrapped_angles(axes, attitudes) for axes in orders}
    # the middle angle is between -90 and 90 degrees: the order in which it stays smallest
    axes = min(orders, key=lambda order: float(np.abs(unwrapped[order][:, 1]).max()))
    ends = unwrapped[axes][[0, -1]].tolist()
    first, last = (Attitude(angles=tuple(angles), axes=axes) for angles in ends)
    return first, last


def _judged(clip: Clip, flight: ClipFlight, choice: str | float, plan: Plan) -> PlannedFlight:
    """Compare a plan with the flight of the clip, and with the robot's limits."""
    robot = clip.robot
    s = np.linspace(0.0, 1.0, CHECKED)
    motion = plan.full_motion(s * plan.duration)
    instants = flight.begin + s * flight.duration
    change = motion.positions - clip.curve.positions(instants)
    attitudes = of_quaternions(motion.base_quaternion)
    turned = logarithm(attitudes @ np.swapaxes(clip.curve.attitudes(instants), 1, 2))
    motors = [robot.model_joints.index(motor) for motor in robot.motors]
    rates = np.abs(motion.velocities[:, motors])
    torques = np.abs(motion.torques @ robot.transmission[BASE:])
    rate_share = largest_share(rates, robot.motor_velocity_limits, robot.motors)
    torque_share = largest_share(torques, robot.motor_torque_limits, robot.motors)
    largest = float(np.abs(change).max())
    reasons = []
    for quantity, largest_use in (("rate", rate_share), ("torque", torque_share)):
        if largest_use is not None:
            share, motor = largest_use
            if share > 1.0:
                reasons.append(f"{motor} needs {100 * share:.0f} % of its {quantity}")
    poses = body_poses(robot, motion.base_position, attitudes, motion.positions)
    clearances = clip.scene.foot_solids.lowest(poses)[..., 2] - clip.ground.at(instants)[:, None]
    if clearances.min() < -0.01:  # [m] more is not what feet press in
        foot = clip.scene.foot_names[int(clearances.min(axis=0).argmin())]
        reasons.append(f"{foot} would be {-1e3 * clearances.min():.0f} mm under the ground")
    if largest > math.radians(30.0):  # a flight with a larger change is another motion
        joint = robot.model_joints[int(np.abs(change).max(axis=0).argmax())]
        reasons.append(f"{joint} would move {math.degrees(largest):.0f} degrees from the clip")
    return PlannedFlight(
        flight=flight,
        plan=plan,
        choice=choice,
        joints_rms=float(np.sqrt((change**2).mean())),
        joints_largest=largest,
        base_largest=float(np.linalg.norm(turned, axis=1).max()),
        rate_share=rate_share,
        torque_share=torque_share,
        reason="; ".join(reasons),
    )
