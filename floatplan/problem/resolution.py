"""From the user's values to those of a problem: checked, in the order of joints and motors, errors with their keys.

The ground is a horizontal line through the lowest point of the link that takes off, at t = 0.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arguments import either
from floatplan.arrays import Array, IntArray, read_only
from floatplan.errors import InputError, faults, refuse
from floatplan.problem import parts
from floatplan.problem.attitude import Attitude, tilt
from floatplan.problem.ballistics import frame_from_com
from floatplan.problem.parts import OBSTACLE_KINDS, JointState, JointValues
from floatplan.problem.spatial_obstacles import SPATIAL_OBSTACLE_KINDS
from floatplan.robot.robot import Frame, Robot
from floatplan.tables import (
    BOUNDARY,
    FLIGHT_EVENTS,
    JOINT_LIMITS,
    LARGEST_MIDDLE_ANGLE,
    LIMIT_TABLE,
    MOST_OBSTACLES,
    LimitRow,
)

MOST_DISTANCES = 800  # [-] between shapes of links and obstacles
MOST_JOINTS = 60  # [-] that are planned: humanoids without their hands have about 30
NARROWEST = 1e-6  # [rad] of a joint's range
FULL_RANGE = (-math.pi, math.pi)
TOUCHING = 2e-3  # [m] what is no higher over the ground than that may be meant to touch it


def joint_state(robot: Robot, posture: parts.Posture, element: str) -> JointState:
    """Return a posture as arrays in joint order."""
    settled = posture.settled or (None, None)
    frame_rests = _is_word(posture.velocities, FLIGHT_EVENTS[element], f"{element}.velocities")
    free_accelerations = _is_word(posture.accelerations, "free", f"{element}.accelerations")
    velocities = settled[0] if frame_rests else posture.velocities
    accelerations = settled[1] if free_accelerations else posture.accelerations
    attitude = posture.orientation if isinstance(posture.orientation, Attitude) else None
    if (attitude is None) == (robot.in_plane is None):
        raise _not_so(robot, f"{element}.orientation", "an angle", "an Attitude: quaternion_xyzw, or angles and axes")
    if frame_rests and robot.in_plane is None:
        raise InputError(
            f"{FLIGHT_EVENTS[element]!r} is for flights in a plane, and not yet for those in space",
            element=f"{element}.velocities",
            advice="give the rates",
        )
    return JointState(
        orientation=math.nan if isinstance(posture.orientation, Attitude) else float(posture.orientation),
        attitude=attitude,
        positions=_joint_values(robot, posture.positions, f"{element}.positions", default=None),
        velocities=_joint_values(robot, velocities, f"{element}.velocities", default=0.0),
        accelerations=_joint_values(robot, accelerations, f"{element}.accelerations", default=0.0),
        frame_rests=frame_rests,
        free_accelerations=free_accelerations,
    )


def _not_so(robot: Robot, element: str, planar: str, spatial: str) -> InputError:
    """What a flight in a plane, or in space, does not support."""
    if robot.in_plane is None:
        return InputError(f"must be {spatial}, where the robot flies in space", element=element)
    advice = 'in space it may be: [robot] base = "free-flyer"'
    return InputError(f"must be {planar}, where the robot flies in a plane", element=element, advice=advice)


def flight_errors(robot: Robot, flight: parts.Flight) -> Iterator[InputError]:
    """What the flight asks in space of a robot that flies in a plane, or the other way round."""
    momentum = flight.angular_momentum
    speed = flight.horizontal_velocity
    if robot.in_plane:
        momentum_fits = not isinstance(momentum, tuple) and momentum != "suggested"
        speed_fits = not isinstance(speed, tuple)
        coordinates = 2
    else:
        momentum_fits = isinstance(momentum, tuple | str) or momentum == 0
        speed_fits = isinstance(speed, tuple) or speed == 0
        coordinates = 3
    if not momentum_fits:
        choices = "0, three numbers, 'suggested' or 'free'"
        yield _not_so(robot, "flight.angular_momentum", "a number, 'midpoint' or 'free'", choices)
    if not speed_fits:
        yield _not_so(robot, "flight.horizontal_velocity", "a number", "two numbers, along x and y")
    position = (0.0, 0.0) if flight.takeoff is None else flight.takeoff.position
    if len(position) != coordinates and any(position):
        yield _not_so(robot, "flight.takeoff.position", "two numbers", "three numbers")


def _is_word(values: object, word: str, element: str) -> bool:
    if not isinstance(values, str):
        return False
    if values != word:
        raise InputError(f"must be numbers or {word!r}, not {values!r}", element=element)
    return True


def _joint_values(robot: Robot, values: Any, element: str, default: float | None) -> Array:
    """Values (n,) in joint order; joints that a mapping leaves out take the default, and without one are missing.

    NaN for None.
    """
    if values is None:
        return read_only(np.full(len(robot.joints), np.nan))
    if isinstance(values, Mapping):
        check_joint_names(robot, values, element)
        missing = [joint for joint in robot.joints if joint not in values]
        if missing and default is None:
            advice = f"give one for each of {listed(robot)}"
            raise InputError(f"no value for joint {missing[0]!r}", element=element, advice=advice)
        filled = [values.get(joint, default) for joint in robot.joints]
    else:
        filled = [values] * len(robot.joints) if isinstance(values, int | float) else values
    return read_only(np.array(_in_order(robot, filled, element), dtype=np.float64))


def _in_order(robot: Robot, values: Sequence[Any] | Array, element: str) -> Sequence[Any]:
    """Values in joint order; another number of them is refused."""
    if len(values) != len(robot.joints):
        reason = f"{len(values)} values for {len(robot.joints)} joints"
        raise InputError(reason, element=element, advice=f"joints: {listed(robot)}")
    return list(values)


def degrees_of(robot: Robot, motion: parts.Motion) -> tuple[int, ...]:
    """Return k_i of (12) for each joint."""
    n = len(robot.joints)
    if n > MOST_JOINTS:
        raise InputError(f"{n} planned joints, more than {MOST_JOINTS}", element="robot.joints", advice="lock some")
    if isinstance(motion.degree, str):
        return (7,) * n
    degrees = (motion.degree,) * n if isinstance(motion.degree, int) else motion.degree
    return tuple(_in_order(robot, degrees, "motion.degree"))


def reference_of(robot: Robot, motion: parts.Motion) -> Array | None:
    """Return the recorded motion (K, n), rad, of the objective "clip", at instants evenly apart; None of others."""
    if motion.clip is None:
        return None
    element = "motion.clip.positions"
    if motion.clip.positions is None:
        raise InputError("are missing", element=element, advice="load the problem from its file, which reads clip.file")
    widths = set(map(len, motion.clip.positions))
    if widths != {len(robot.joints)}:
        reason = f"has {min(widths)} numbers an instant, for {len(robot.joints)} planned joints"
        raise InputError(reason, element=element)
    return read_only(motion.clip.positions)


def takeoff_of(robot: Robot, flight: parts.Flight) -> parts.Takeoff:
    """Return the takeoff with its default filled in."""
    takeoff = flight.takeoff or parts.Takeoff(robot.joint_tree.root)
    _check_frame(robot, takeoff.frame, "flight.takeoff.frame")
    if robot.in_plane is None and len(takeoff.position) == 2:
        return parts.Takeoff.unchecked(frame=takeoff.frame, position=(*takeoff.position, 0.0))
    return takeoff


def landing_of(
    robot: Robot, flight: parts.Flight, start: parts.Posture, goal: parts.Posture, ground: bool
) -> parts.Landing:
    """Return the landing with its defaults filled in: on the ground where there is one."""
    takeoff = takeoff_of(robot, flight)
    landing = flight.landing or parts.Landing.unchecked(
        frame=takeoff.frame, height=None if ground else takeoff.position[-1]
    )
    _check_frame(robot, landing.frame, "flight.landing.frame")
    if landing.height is None and ground:
        line = ground_height(robot, takeoff.frame, takeoff.position, joint_state(robot, start, "start"))
        height = resting_height(robot, landing.frame, line, joint_state(robot, goal, "goal"))
        return parts.Landing(landing.frame, height)
    return parts.Landing.unchecked(frame=landing.frame, height=landing.height or 0.0)


def check_joint_names(robot: Robot, values: Mapping[str, object], element: str) -> None:
    """Refuse names that are not those of planned joints."""
    for joint in values:
        if joint not in robot.joints:
            reason = f"{joint!r} is not a planned joint of the robot"
            raise InputError(reason, element=element, advice=f"joints: {listed(robot)}")


def _check_frame(robot: Robot, name: str, element: str) -> None:
    if name not in robot.frame_names:
        advice = f"frames: {', '.join(sorted(robot.frame_names))}"
        raise InputError(f"the robot has no frame {name!r}", element=element, advice=advice)


def listed(robot: Robot) -> str:
    """Return the planned joints, for a message."""
    return ", ".join(robot.joints)


def position_limits(robot: Robot, limits: parts.Limits) -> Array:
    """Return the joint ranges (n, 2) in rad that a problem with these limits has: always finite."""
    intervals = robot.position_limits.copy()
    intervals[~np.isfinite(intervals).all(axis=1)] = FULL_RANGE
    if isinstance(limits.position, str):
        if limits.position == "full":
            intervals[:] = FULL_RANGE
        return read_only(intervals)
    if isinstance(limits.position, Mapping):
        check_joint_names(robot, limits.position, "limits.position")
        ranges = limits.position
    else:
        ranges = dict(zip(robot.joints, _in_order(robot, limits.position, "limits.position"), strict=True))
    for joint, (low, high) in ranges.items():
        element = f"limits.position.{joint}"
        if not low < high:
            raise InputError(f"low {low} is not below high {high}", element=element)
        if high - low < NARROWEST:
            reason = f"[{low}, {high}] is narrower than {NARROWEST:g} rad"
            raise InputError(reason, element=element, advice="lock the joint")
        intervals[robot.joints.index(joint)] = low, high
    return read_only(intervals)


def joint_limits(robot: Robot, limits: parts.Limits) -> dict[str, Array]:
    """Return the limits (n,) of the planned coordinates' motion, by key of ``[limits]``.

    Raises
    ------
    InputError
        All that is wrong with them.
    """
    resolved: dict[str, Array] = {}

    def resolve(row: LimitRow) -> None:
        resolved[row.key] = _joint_limit(robot, row, getattr(limits, row.key))

    refuse(faults(partial(resolve, row) for row in JOINT_LIMITS))
    return resolved


def _joint_limit(robot: Robot, row: LimitRow, values: str | JointValues) -> Array:
    """Return limits (n,), in the row's unit, of the planned coordinates, infinite where there is none.

    A number or a mapping is about each motor: a leader is as slow as its followers demand, by their ratios.
    """
    if isinstance(values, str):
        if row.in_urdf and values == "urdf":
            return read_only(getattr(robot, f"{row.key}_limits"))
        return read_only(np.full(len(robot.joints), math.inf))
    if not isinstance(values, Mapping | int | float):
        return read_only(_in_order(robot, values, f"limits.{row.key}"))
    scales_by_ratio = row.quantity in ("velocities", "accelerations")
    if not scales_by_ratio and np.count_nonzero(robot.motor_ratios) > len(robot.joints):
        reason = "is not known of each motor where joints follow others"
        raise InputError(reason, element=f"limits.{row.key}", advice="give a list, a number for each planned joint")
    return read_only(least_of_motors(robot, motor_limits(robot, row, values)))


def least_of_motors(robot: Robot, own: Array) -> Array:
    """Limits (.., n) of coordinates, of the motors' own (.., m): the least that a motor demands, by its ratio."""
    with np.errstate(divide="ignore", invalid="ignore"):
        per_coordinate = own[..., None] / np.abs(robot.motor_ratios)
    return np.asarray(np.where(robot.motor_ratios != 0, per_coordinate, math.inf).min(axis=-2))


def sum_of_motors(robot: Robot, own: Array) -> Array:
    """Generalised torques (.., n) that the motors' own (.., m) add up to, by ratio."""
    ratios = np.abs(robot.motor_ratios)
    return np.asarray((ratios * np.where(ratios > 0, own[..., None], 0.0)).sum(axis=-2))


def motor_limits(robot: Robot, row: LimitRow, values: str | JointValues) -> Array:
    """Return limits (m,) of the motors' own quantity, in the row's unit, infinite where there is none.

    They are one for all, or by name; a leader's value holds for followers that are not named. A sequence (n,) is about
    the planned coordinates: it is a motor's own limit where the joint has but one motor.
    """
    if isinstance(values, Mapping):
        return read_only(of_motors(robot, values, f"limits.{row.key}", math.inf))
    if isinstance(values, str) and values == "urdf":
        return read_only(getattr(robot, f"motor_{row.key}_limits"))
    if isinstance(values, str | int | float):
        return read_only(np.full(len(robot.motors), math.inf if isinstance(values, str) else values))
    of_joints = np.array(_in_order(robot, values, f"limits.{row.key}"), dtype=np.float64)
    single, leader = (robot.motor_ratios != 0).sum(axis=0) == 1, _leaders(robot)
    return read_only(np.where(single[leader], of_joints[leader], math.inf))


def torque_limits(robot: Robot, values: str | JointValues) -> Array:
    """Return limits (n,) N m of the generalised torques: as stated, or what those of the motors add up to."""
    if isinstance(values, str | Mapping | int | float):
        return read_only(sum_of_motors(robot, motor_limits(robot, LIMIT_TABLE["torque"], values)))
    return read_only(_in_order(robot, values, "limits.torque"))


def _leaders(robot: Robot) -> IntArray:
    """Index (m,) of the planned joint that each motor turns, or follows."""
    return np.asarray(np.abs(robot.motor_ratios).argmax(axis=1))


def motor_values(robot: Robot, limits: parts.Limits, name: str, default: float) -> Array:
    """Return one field of the motors' curves (m,), the default where a motor has none."""
    curves = of_motors(robot, limits.motor, "limits.motor", None)
    return read_only([default if curve is None else getattr(curve, name) for curve in curves])


def of_motors(robot: Robot, values: Mapping[str, Any], element: str, default: Any) -> list[Any]:
    """What a mapping says of each of the m motors: by its own name, else by its leader's; refuse other names."""
    for joint in values:
        if joint in robot.coupled and joint not in robot.motors:
            leader = robot.coupled[joint].leader
            reason = f"{joint!r} has no motor of its own: the URDF couples it to {leader!r} by <mimic>"
            raise InputError(reason, element=element, advice=f"set that of {leader!r}")
        if joint not in robot.motors:
            reason = f"{joint!r} is not a planned joint of the robot, nor one coupled to it"
            raise InputError(reason, element=element, advice=f"joints: {', '.join(robot.motors)}")
    of_motors = []
    for motor, leader in zip(robot.motors, _leaders(robot).tolist(), strict=True):
        of_motors.append(values.get(motor, values.get(robot.joints[leader], default)))
    return of_motors


def end_errors(
    robot: Robot, limits: Array, flight: parts.Flight, state: JointState, element: str
) -> Iterator[InputError]:
    """What is wrong at an end of the flight, within the joints' ranges (n, 2), rad.

    A joint outside its range, one on its edge that does not stand still or accelerates outwards; rates of a still
    frame where none is named that stands on the ground. Rounding is not wrong: a motion that begins on the edge
    meets what is off by no more than the tolerances of the boundary conditions.
    """
    if state.frame_rests and flight.takeoff is None and (element == "start" or flight.landing is None):
        reason = f"{FLIGHT_EVENTS[element]!r} needs a frame that stands on the ground"
        advice = f"name it as flight.{FLIGHT_EVENTS[element]}, or give the rates"
        yield InputError(reason, element=f"{element}.velocities", advice=advice)
    values = (array.tolist() for array in (limits, state.positions, state.velocities, state.accelerations))
    for joint, (low, high), position, velocity, acceleration in zip(robot.joints, *values, strict=True):
        inside = min(position - low, high - position)
        if inside > 1e-12 * (high - low):  # closer to an end of the range, a joint stands on its edge
            continue
        edge = f"on the edge of the joint's range [{low:.6g}, {high:.6g}]"
        off_position, off_rate, off_acceleration = BOUNDARY
        if not inside >= -off_position:
            degrees, lowest, highest = map(math.degrees, (position, low, high))
            reason = f"{position:.6g} rad is outside the joint's range [{low:.6g}, {high:.6g}] by {-inside:.2g} rad"
            reason += f" ({degrees:.4g} degrees, outside {lowest:.4g} to {highest:.4g})"
            advice = "move it inside, or widen the range with limits.position"
            yield InputError(reason, element=f"{element}.positions.{joint}", advice=advice)
        elif abs(velocity) > off_rate:
            advice = "a joint can only be on the edge of its range with zero velocity"
            yield InputError(f"{velocity:.6g} rad/s {edge}", element=f"{element}.velocities.{joint}", advice=advice)
        elif acceleration * math.copysign(1.0, 2 * position - low - high) > off_acceleration:
            reason = f"{acceleration:.6g} rad/s^2 {edge} points out of it"
            yield InputError(reason, element=f"{element}.accelerations.{joint}")


def attitude_errors(start: JointState, goal: JointState) -> Iterator[InputError]:
    """A goal 180 degrees from the start, where the shortest rotation leads to it; or angles that are not defined."""
    if start.attitude is None or goal.attitude is None:
        return
    if axes := goal.attitude.axes:
        for element, attitude in (("start", start.attitude), ("goal", goal.attitude)):
            second = float(attitude.angles_about(axes)[1])
            if tilt(axes, second) > LARGEST_MIDDLE_ANGLE:
                reason = f"its second angle about {axes!r} is {math.degrees(second):.4g} degrees"
                near = "-70 to 70" if axes[0] != axes[2] else "20 to 160"
                other = "rotate about other axes, the largest rotation's first, or give the goal as a quaternion"
                advice = f"it must be within {near}: {other}"
                yield InputError(reason, element=f"{element}.orientation", advice=advice)
        return
    cosine = abs(float(start.attitude.quaternion @ goal.attitude.quaternion))
    if cosine < 1e-3:  # cosine of half the angle to the goal
        reason = "is half a turn from the start, and which way round is left open"
        advice = "give it as angles about axes, with the turns that are meant"
        yield InputError(reason, element="goal.orientation", advice=advice)


def surroundings_errors(
    robot: Robot, obstacles: Sequence[parts.Obstacle], pairs: Sequence[parts.SelfClearance], duration: float
) -> Iterator[InputError]:
    """What is wrong with what the robot keeps clear of.

    More of it than a search can look at in its time, obstacles that never meet the flight, links that do not exist.
    """
    in_plane = robot.in_plane is not None
    kinds = OBSTACLE_KINDS if in_plane else SPATIAL_OBSTACLE_KINDS
    for index, obstacle in enumerate(obstacles):
        if not isinstance(obstacle, tuple(kinds.values())):
            other = "in space" if in_plane else "in a plane"
            names = [kind.__name__ for kind in kinds.values()]
            advice = f"give a {either(names)}"
            yield InputError(
                f"a {type(obstacle).__name__} is for flights {other}", element=f"obstacles[{index}]", advice=advice
            )
            return
    for count, element in ((len(obstacles), "obstacles"), (len(pairs), "self_clearance")):
        if count > MOST_OBSTACLES:
            yield InputError(f"{count} of them, more than {MOST_OBSTACLES}", element=element, advice="leave some out")
    shapes = len(robot.capsules) if obstacles else 0
    if len(obstacles) <= MOST_OBSTACLES and shapes * len(obstacles) > MOST_DISTANCES:
        reason = f"{len(obstacles)} of them and {shapes} shapes of links make more than {MOST_DISTANCES} distances"
        advice = "leave some out, or simplify the robot's collision geometry"
        yield InputError(reason, element="obstacles", advice=advice)
    for index, obstacle in enumerate(obstacles):
        start, end = obstacle.window or (0.0, duration)
        if obstacle.window and (end < 0 or start > duration):
            reason = f"the window [{start}, {end}] s lies outside the flight of {duration} s"
            yield InputError(reason, element=f"obstacles[{index}].window")
    shaped_links = {shape.link for shape in robot.capsules} if pairs else set()
    for index, pair in enumerate(pairs):
        thickness = 0.0
        for link in pair.links:
            if link not in shaped_links:
                element, advice = f"self_clearance[{index}].links", f"links: {sorted(shaped_links)}"
                yield InputError(f"no link {link!r} with a shape", element=element, advice=advice)
            radii = [capsule.radius for capsule in robot.capsules if capsule.link == link]
            thickness += max(radii, default=0.0)
        if not in_plane and thickness + pair.margin == 0 and shaped_links.issuperset(pair.links):
            reason = f"{pair.links[0]!r} and {pair.links[1]!r} are lines, which never touch in space"
            advice = "give a margin, or <collision> geometry"
            yield InputError(reason, element=f"self_clearance[{index}]", advice=advice)


def frame_height(robot: Robot, frame: Frame, state: JointState) -> float:
    """Height of a frame over the centre of mass, m."""
    return float(_heights(robot, [frame.body], [frame.local], state)[0])


def lowest_point(robot: Robot, link: str, state: JointState) -> float:
    """Height over the centre of mass, m, of the lowest point with which a link stands.

    It is the link's own, or that of the link that it is fixed to; where that has no shape, its origin.

    Raises
    ------
    InputError
        A link's collision geometry is wrong.
    """
    standing = robot.contact_link(link)
    if standing is None:
        return frame_height(robot, robot.frames[link], state)
    shapes = robot.link_hulls[standing]
    points = []
    for shape in shapes:
        points += [(shape.body, shape.start, shape.radius), (shape.body, shape.end, shape.radius)]
    bodies, places, radii = zip(*points, strict=True)
    return float((_heights(robot, bodies, places, state) - radii).min())


def ground_height(robot: Robot, takeoff: str, position: Sequence[float], initial: JointState) -> float:
    """Height of the ground, m, where the takeoff frame is at ``position`` in the initial state; errors as above."""
    if initial.attitude is not None:
        height = _lowest_in_space(robot, takeoff, initial, initial.attitude)
        return float(position[-1] + height - frame_from_com(robot, takeoff, initial)[2])
    frame = robot.frames[takeoff]
    return position[1] + lowest_point(robot, frame.link, initial) - frame_height(robot, frame, initial)


def resting_height(robot: Robot, landing: str, ground: float, final: JointState) -> float:
    """Height of the landing frame, m, at which its link rests on the ground in the final state; errors as above."""
    if final.attitude is not None:
        height = _lowest_in_space(robot, landing, final, final.attitude)
        return float(ground - height + frame_from_com(robot, landing, final)[2])
    frame = robot.frames[landing]
    return ground - lowest_point(robot, frame.link, final) + frame_height(robot, frame, final)


def _lowest_in_space(robot: Robot, frame: str, state: JointState, attitude: Attitude) -> float:
    """Height over the centre of mass, m, of the lowest point with which a frame stands; without a shape its own."""
    joint = robot.joint_tree.joint.get(frame)
    standing = robot.contact_link(frame if joint is None else joint.child)
    data = robot.model.createData()
    com = pin.centerOfMass(robot.model, data, robot.configuration(state.positions))
    up = attitude.matrix[2]  # the world's, in the base's axes
    heights = []
    for solid in robot.solids:
        if solid.link == standing:
            placed = data.oMi[solid.body]
            heights.append(up @ (placed.translation - com) - solid.reach(-up @ placed.rotation[None])[0])
    return float(min(heights, default=frame_from_com(robot, frame, state)[2]))


def _heights(robot: Robot, bodies: Sequence[int], local: Sequence[complex], state: JointState) -> Array:
    """Heights (points,) over the centre of mass, m, of points fixed to bodies."""
    angles = robot.tree.absolute_angles(np.array(state.orientation), state.positions)
    weights = robot.tree.point_weights(np.array(bodies), np.array(local))
    return np.asarray((weights @ robot.tree.rotations(angles)).imag)


def finite_limits(motors: Sequence[str], limits: Array) -> dict[str, float]:
    """Return the limits (m,) of motors by their names, those that there are."""
    return {motor: limit for motor, limit in zip(motors, limits.tolist(), strict=True) if math.isfinite(limit)}
