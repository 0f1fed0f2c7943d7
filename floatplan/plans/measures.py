"""What a plan does, measured: how much of its limits each motor uses, and what it does in addition to the request.

A proof holds for the request. What the motion does to the ground and to the limits that the URDF gives is measured,
requested or not: it is a warning in addition to the verdict.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.motion.dynamics import Peaks
from floatplan.motion.flight import FAST, Contact
from floatplan.plans.overlaps import Overlap, overlaps
from floatplan.plans.planned_motion import PlannedMotion
from floatplan.problem.parts import JointState
from floatplan.problem.problem import Problem
from floatplan.robot import Coupling
from floatplan.robot.planar.choice import MOST_LEANING, against_gravity
from floatplan.robot.robot import Robot
from floatplan.robot.wheels import wheels
from floatplan.tables import CLEARANCE, JOINT_LIMITS, LIMIT_TABLE, POINT_FEET, RELATIVE, ROUNDED_FRAME_SPEED, LimitRow

USED = (LIMIT_TABLE["torque"], *JOINT_LIMITS)  # the limits whose utilisation is reported, the first goes before equals
Kind: TypeAlias = Literal[
    "gravity",
    "ground",
    "position",
    "velocity",
    "torque",
    "holding_torque",
    "takeoff",
    "landing",
    "turns",
    "leak",
    "overlap",
]


@dataclass(frozen=True)
class WarningThresholds:
    """What a plan may do without a warning."""

    rounding: float = 1e-9  # [rad] of joint ranges
    out_of_plane: float = math.radians(1)  # [rad] at landing: corrections in flight leave as much in the plane
    torque: float = 2.0
    """[-] of the robot's weight times its length: the strongest motors of legged robots have 0.3 (Mini Cheetah: 17 N m,
    9 kg, 0.6 m), people's knees and hips as much; flips among the examples without limits take up to 0.6."""
    angle: float = 2 * math.tau  # [rad] requested at an end, or from one to the other


THRESHOLDS = WarningThresholds()


@dataclass(frozen=True)
class PlanWarning:
    """Something that a plan does in addition to what the problem requests.

    Attributes
    ----------
    kind : str
        "gravity", "ground", "position", "velocity", "torque", "holding_torque", "takeoff", "landing", "turns", "leak"
        or "overlap"
    subject : link, both links, joint, or the frame that cannot be at rest
    value, limit : in ``unit``; None where it could not be measured
    instant : s, when; None where it belongs to no instant
    message : a sentence: what, when, and what to do
    """

    kind: Kind
    subject: str
    value: float | None
    limit: float | None
    unit: str
    instant: float | None
    message: str

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file holds."""
        return asdict(self)


@dataclass(frozen=True)
class Utilisation:
    """How much of its limits a motor uses; limits are the requested ones, else the URDF's, else None.

    Attributes
    ----------
    joint : name
    torque_peak, torque_limit : N m; the motor's own
    torque_utilisation : peak over limit
    torque_instant : s
    velocity_peak, velocity_limit, velocity_utilisation, velocity_instant : the same of its rate, rad/s
    acceleration_peak, acceleration_limit, acceleration_utilisation, acceleration_instant : rad/s^2
    position_low, position_high : rad, between which the joint moves
    range_used : share of the joint's range between them
    instant : s, of the peak that uses most of its limit; of the torque's without limits
    """

    joint: str
    torque_peak: float
    torque_limit: float | None
    torque_utilisation: float | None
    torque_instant: float
    velocity_peak: float
    velocity_limit: float | None
    velocity_utilisation: float | None
    velocity_instant: float
    acceleration_peak: float
    acceleration_limit: float | None
    acceleration_utilisation: float | None
    acceleration_instant: float
    position_low: float
    position_high: float
    range_used: float
    instant: float

    @property
    def worst(self) -> float:
        """The largest of the utilisations; 0 without limits."""
        return max(getattr(self, f"{row.key}_utilisation") or 0.0 for row in USED)

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file holds."""
        return asdict(self)


def utilisation(problem: Problem, peaks: Peaks) -> tuple[Utilisation, ...]:
    """Return how much of its limits each motor uses, worst first."""
    limits = limits_of_motors(problem) if problem.robot.motors else {}
    rows = (_of_motor(problem, peaks, limits, index) for index in range(len(problem.robot.motors)))
    return tuple(sorted(rows, key=lambda row: -row.worst))


def limits_of_motors(problem: Problem) -> dict[str, Array]:
    """Return the limit (m,) of each motor, or (N, m), by the names of limits: the requested, the URDF's, or none."""
    robot = problem.robot
    leaders, ratios, _ = zip(*(_coupling(robot, joint) for joint in robot.motors), strict=True)
    limits: dict[str, Array] = {}
    for row in USED:
        if row.of == "motors":
            requested = np.minimum(problem.motor_torque_limits, problem.motor_stall)
        else:
            requested = np.abs(ratios) * problem.joint_limits[row.key][..., list(leaders)]
        of_urdf = np.array(getattr(robot, f"motor_{row.key}_limits")) if row.in_urdf else np.inf
        limits[row.key] = np.where(np.isfinite(requested), requested, of_urdf)
    return limits


def momentum_in_one_number(motion: PlannedMotion) -> float:
    """Angular momentum of a flight, kg m^2/s: in a plane with its sign, in space its magnitude."""
    momentum = motion.angular_momentum
    return float(momentum) if np.ndim(momentum) == 0 else math.hypot(*momentum)


def largest_use(rows: Sequence[Utilisation]) -> float | None:
    """Return the largest share of a limit that a motor uses; None where none has a limit."""
    largest: float | None = None
    for use in rows:
        for row in USED:
            share = getattr(use, f"{row.key}_utilisation")
            if share is not None and (largest is None or share > largest):
                largest = share
    return largest


def limits_shown(rows: Sequence[Utilisation]) -> tuple[LimitRow, ...]:
    """Limits whose utilisation is worth a column: those that are always reported, and those that some motor has."""
    shown = []
    for row in USED:
        limits = [getattr(use, f"{row.key}_limit") for use in rows]
        if row.always or any(limit is not None for limit in limits):
            shown.append(row)
    return tuple(shown)


def _of_motor(problem: Problem, peaks: Peaks, limits: Mapping[str, Array], index: int) -> Utilisation:
    robot = problem.robot
    joint = robot.motors[index]
    leader, ratio, offset = _coupling(robot, joint)
    low, high = sorted((ratio * peaks.position[leader] + offset).tolist())
    least, most = sorted((ratio * problem.position_limits[leader] + offset).tolist())
    used: dict[str, Any] = {}
    largest = 0.0
    instant = float(peaks.motor_torque_instant[index])
    for row in USED:
        if row.of == "motors":
            peak, when = peaks.motor_torque[index], peaks.motor_torque_instant[index]
        else:
            peak, when = abs(ratio) * peaks.joints[row.key][leader], peaks.joint_instants[row.key][leader]
        own = float(limits[row.key][index])
        limit = own if math.isfinite(own) else None
        use = None if limit is None else float(peak) / limit
        if (use or 0.0) > largest:
            largest = use or 0.0
            instant = float(when)
        values = {"peak": float(peak), "limit": limit, "utilisation": use, "instant": float(when)}
        used |= {f"{row.key}_{name}": value for name, value in values.items()}
    used |= {"position_low": low, "position_high": high, "range_used": (high - low) / (most - least)}
    return Utilisation(joint=joint, **used, instant=instant)


def measured_warnings(plan: PlannedMotion, contacts: Sequence[Contact]) -> tuple[PlanWarning, ...]:
    """Return what the plan does to the ground and to limits, wherever that is more than they allow."""
    problem = plan.problem
    return (
        *_gravity(plan),
        *_ground(plan),
        *overlap_warnings(problem, lambda times: plan.joint_motion(times)[0], plan.duration),
        *_contacts(plan, contacts),
        *_ranges_and_rates(problem.robot, plan.peaks),
        *_torques(plan),
        *_beyond_sense(plan),
        *_turns(problem),
        *_leak(plan),
    )


def _gravity(plan: PlannedMotion) -> Iterator[PlanWarning]:
    """Gravity along another axis of the root link than the robot's file has it."""
    robot = plan.robot
    contradiction = against_gravity(robot.up, robot.gravity_direction)
    if robot.gravity_direction is None or contradiction is None or plan.ballistics.gravity == 0:
        return
    angle = math.acos(min(1.0, max(-1.0, float(robot.up @ -robot.gravity_direction))))
    advice = "[robot] plane names another" if robot.in_plane else "rotate its root link, as z is up in space"
    message = f"{contradiction[0].upper()}{contradiction[1:]}; {advice}."
    yield PlanWarning("gravity", robot.joint_tree.root, angle, math.acos(MOST_LEANING), "rad", None, message)


def _ground(plan: PlannedMotion) -> Iterator[PlanWarning]:
    """Links below the horizontal line on which the robot took off; without gravity there is no such line."""
    if plan.ballistics.gravity == 0:
        return
    takeoff = plan.problem.takeoff.frame if plan.robot.in_plane is None else plan.problem.takeoff_frame.link
    try:
        plan.robot.check_shapes()
        height, instant, link = plan.least_height()
    except InputError as error:
        message = f"What the flight does to the ground could not be measured: {error}."
        yield PlanWarning("ground", takeoff, None, 0.0, "m", None, message)
        return
    jump = plan.problem.jump is not None
    if not height >= -(POINT_FEET if jump else CLEARANCE):
        at_takeoff = float(plan.whole.heights(np.zeros(1))[0].min())
        if at_takeoff < -CLEARANCE:
            message = (
                f"{link} gets {-height:.3g} m below where {takeoff} left, at {instant:.3g} s, and something is"
                f" {-at_takeoff:.3g} m below it at takeoff; flight.takeoff names the frame that leaves the ground."
            )
        else:
            advice = "; ground = true keeps it above."
            message = f"{link} is {-height:.3g} m below the ground that {takeoff} left, at {instant:.3g} s" + (
                f": feet of jumps may be {POINT_FEET:g} m." if jump else advice
            )
        yield PlanWarning("ground", link, height, 0.0, "m", instant, message)


def overlap_warnings(problem: Problem, positions: Callable[[Array], Array], duration: float) -> tuple[PlanWarning, ...]:
    """Return warnings of links that a motion brings into one another, requested or not.

    Parameters
    ----------
    problem : Problem
        Pairs of its ``self_clearances`` are proved apart, and are not looked at.
    positions : planned positions (N, n), rad, at times (N,), s, from 0 to ``duration``
    duration : s
    """
    robot = problem.robot
    aside = [frozenset(pair.links) for pair in problem.self_clearances]
    try:
        pairs = overlaps(robot, positions, duration, aside)
    except InputError as error:
        message = f"Whether links overlap could not be measured: {error}."
        return (PlanWarning("overlap", robot.joint_tree.root, None, 0.0, "m", None, message),)
    return tuple(_overlap_warning(robot, overlap) for overlap in pairs)


def _overlap_warning(robot: Robot, overlap: Overlap) -> PlanWarning:
    first, second = overlap.links
    in_reference = f", in the reference posture {overlap.reference_depth:.2g} m" if overlap.reference_depth > 0 else ""
    shapes = "" if robot.has_shapes else ", as the bars that are drawn, since the file gives no shapes"
    if overlap.joint is not None:
        advice = f"a narrower limits.position of {overlap.joint} keeps them apart"
    else:
        advice = "[[self_clearance]] keeps them apart"
    message = (
        f"{first} is {overlap.depth:.2g} m inside {second} at {overlap.instant:.3g} s{in_reference}{shapes}; {advice}."
    )
    subject = f"{first} {second}"
    return PlanWarning("overlap", subject, overlap.depth, overlap.reference_depth, "m", overlap.instant, message)


def _contacts(plan: PlannedMotion, contacts: Sequence[Contact]) -> Iterator[PlanWarning]:
    """Frames that need joint rates beyond the limits, or beyond any robot's, to leave or meet the ground still."""
    for contact in contacts:
        instant = 0.0 if contact.end == "takeoff" else contact.problem.flight.duration
        state = plan.at(instant)
        if (
            contact.ratio == math.inf
            and contact.speed(float(state.orientation_rate), state.velocities) < ROUNDED_FRAME_SPEED
        ):
            continue
        if not contact.ok:
            subject = contact.joint or contact.frame
            rate = contact.rate
            limit = contact.limit
            message = contact.verdict.rstrip(".")
        elif contact.unlimited and contact.unlimited[1] > FAST:
            (subject, rate), limit = contact.unlimited, FAST
            message = (
                f"{subject} turns at {rate:.4g} rad/s for {contact.frame} to be at rest at {contact.end}, more than"
                f" {FAST:g} rad/s, and its file gives no limit"
            )
        else:
            continue
        message += "; another posture or momentum may help."
        yield PlanWarning(contact.end, subject, rate, limit, "rad/s", instant, message)


def _ranges_and_rates(robot: Robot, peaks: Peaks) -> Iterator[PlanWarning]:
    """Joints that leave the URDF's ranges or rotate faster than it allows, each of a group on its own."""
    for joint in (*robot.joints, *robot.coupled):
        written = robot.joint_tree.joint[joint]
        leader, ratio, offset = _coupling(robot, joint)
        low, high = sorted((ratio * peaks.position[leader] + offset).tolist())
        below, above = (written.lower - low, low, written.lower), (high - written.upper, high, written.upper)
        beyond, value, limit = max(below, above)
        if beyond > THRESHOLDS.rounding:
            message = f"{joint} goes to {value:.4g} rad, its file ends at {limit:.4g} rad"
            message += '; limits.position = "urdf" keeps it.'
            yield PlanWarning("position", joint, value, limit, "rad", None, message)
        rate = abs(ratio) * float(peaks.velocity[leader])
        instant = float(peaks.velocity_instant[leader])
        if rate > written.velocity * (1 + RELATIVE):
            message = (
                f"{joint} turns at {rate:.4g} rad/s at {instant:.3g} s, its file allows {written.velocity:.4g} rad/s;"
                ' limits.velocity = "urdf" keeps it.'
            )
            yield PlanWarning("velocity", joint, rate, written.velocity, "rad/s", instant, message)


def _torques(plan: PlannedMotion) -> Iterator[PlanWarning]:
    """Motors, and locked joints, that need more torque than the URDF's effort."""
    robot = plan.robot
    peaks = plan.peaks
    of_motors = zip(robot.motor_torque_limits, peaks.motor_torque, peaks.motor_torque_instant, strict=True)
    for joint, (limit, torque, instant) in zip(robot.motors, of_motors, strict=True):
        if torque > limit * (1 + RELATIVE):
            message = (
                f"{joint} needs {torque:.4g} N m at {instant:.3g} s, its file allows {limit:.4g} N m;"
                ' limits.torque = "urdf" keeps it.'
            )
            yield PlanWarning("torque", joint, float(torque), float(limit), "N m", float(instant), message)
    joints = robot.joint_tree.joint
    if not any(math.isfinite(joints[name].effort) for name in robot.locked):
        return
    for name, (torque, instant) in plan.holding_torques.items():
        effort = joints[name].effort
        unit = "N" if joints[name].type == "prismatic" else "N m"
        if torque > effort * (1 + RELATIVE):
            message = (
                f"Holding the locked joint {name} takes {torque:.4g} {unit} at {instant:.3g} s, its file allows"
                f" {effort:.4g} {unit}; lock it elsewhere, or move the others more slowly."
            )
            yield PlanWarning("holding_torque", name, torque, effort, unit, instant, message)


def _beyond_sense(plan: PlannedMotion) -> Iterator[PlanWarning]:
    """Of motors without a limit, the one that needs most torque and the one that turns fastest, beyond what any do."""
    problem = plan.problem
    robot = plan.robot
    if not robot.motors:
        return
    limits = limits_of_motors(problem)
    rows = utilisation(problem, plan.peaks)
    without_torque_limit = []
    without_rate_limit = []
    for row in rows:
        motor = robot.motors.index(row.joint)
        if not math.isfinite(limits["torque"][motor]):
            without_torque_limit.append(row)
        if not math.isfinite(limits["velocity"][motor]) and row.joint not in wheels(robot):
            without_rate_limit.append(row)
    most = THRESHOLDS.torque * robot.mass * 9.80665 * robot.rod_length  # 9.80665 m/s^2, standard gravity
    for row in sorted(without_torque_limit, key=lambda row: row.torque_peak)[-1:]:
        if row.torque_peak > most:
            message = (
                f"{row.joint} needs {row.torque_peak:.3g} N m at {row.torque_instant:.3g} s and its file gives no"
                f" limit: {most:.3g} N m are {THRESHOLDS.torque:g} times the robot's weight times its length, more than"
                " any motor of its size has; a longer flight, or less rotation, needs less, and limits.torque keeps it."
            )
            yield PlanWarning("torque", row.joint, row.torque_peak, most, "N m", row.torque_instant, message)
    for row in sorted(without_rate_limit, key=lambda row: row.velocity_peak)[-1:]:
        if row.velocity_peak > FAST:
            message = (
                f"{row.joint} turns at {row.velocity_peak:.3g} rad/s at {row.velocity_instant:.3g} s and its file gives"
                f" no limit: no joint of a legged robot turns at {FAST:g} rad/s; a longer flight, or less rotation,"
                " needs less, and limits.velocity keeps it."
            )
            yield PlanWarning("velocity", row.joint, row.velocity_peak, FAST, "rad/s", row.velocity_instant, message)


def _turns(problem: Problem) -> Iterator[PlanWarning]:
    """Requested angles so large that degrees may have been meant, of base and joints; wheels roll on."""
    start, goal = problem.initial, problem.final
    first = _angles_of_base(start)
    last = _angles_of_base(goal)
    base = float(max(np.abs(first).max(), np.abs(last).max(), np.abs(last - first).max()))
    joints = np.abs([start.positions, goal.positions]).max(axis=0).tolist()
    for name, angle in zip((problem.robot.joint_tree.root, *problem.robot.joints), (base, *joints), strict=True):
        if angle > THRESHOLDS.angle + THRESHOLDS.rounding and name not in wheels(problem.robot):
            message = (
                f"The problem asks {angle:.4g} rad of {name}, {angle / math.tau:.3g} turns;"
                ' where degrees are meant, fp.Posture.degrees or angles = "deg" says so.'
            )
            yield PlanWarning("turns", name, angle, THRESHOLDS.angle, "rad", None, message)


def _angles_of_base(state: JointState) -> Array:
    """Angles of the base, rad: one in a plane, three in space, 0 of a quaternion."""
    return np.array([state.orientation if state.attitude is None else state.attitude.angles or 0.0])


def _leak(plan: PlannedMotion) -> Iterator[PlanWarning]:
    """What robots that are not their own mirror image rotate out of the plane that theory keeps them in."""
    turned = plan.out_of_plane
    if turned is None or np.linalg.norm(turned) <= THRESHOLDS.out_of_plane:
        return
    root = plan.robot.joint_tree.root
    size = float(np.linalg.norm(turned))
    if math.isnan(size):
        message = f"How {root} turns out of the plane could not be integrated: the motion is too wild."
    else:
        words = turns_out_of_plane(plan.robot, turned)
        message = (
            f"In space this motion leaves its plane: {root} lands {math.degrees(size):.3g} degrees from its planned"
            f' attitude, {words}; [robot] base = "free-flyer" plans with that.'
        )
    value = None if math.isnan(size) else size
    yield PlanWarning("leak", root, value, THRESHOLDS.out_of_plane, "rad", plan.duration, message)


def turns_out_of_plane(robot: Robot, turned: Array) -> str:
    """Say in degrees how a base turns about its own axes, the plane's, by a vector of rotation (3,), rad."""
    plane = robot.plane.name
    axes = (*plane, *(set("xyz") - set(plane)))
    angles = np.degrees(turned).round(2) + 0.0
    return ", ".join(f"{angle:g}° about {axis}" for angle, axis in zip(angles.tolist(), axes, strict=True))


def _coupling(robot: Robot, joint: str) -> tuple[int, float, float]:
    """Index of the planned joint that a joint follows, or is; ratio, and offset, rad."""
    coupling = robot.coupled.get(joint, Coupling(joint))
    return robot.joints.index(coupling.leader), coupling.ratio, coupling.offset
