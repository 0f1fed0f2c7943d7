"""From a problem in space and a request to the program of a jump: feet, standing postures, phases, bounds."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.phases import Side, over_step
from floatplan.jumps.rounds import NodeMargins
from floatplan.jumps.setup import (
    check_frames,
    check_robot_stands,
    duration_bounds,
    narrowed,
    refuse_beyond_ranges,
    refuse_other_ground,
)
from floatplan.jumps.spatial.coordinates import Mechanics, rotations_about
from floatplan.jumps.spatial.model import BASE, SpatialModel
from floatplan.jumps.spatial.nodes import SpatialBounds, SpatialEnds
from floatplan.jumps.spatial.phases import SpatialPhase, is_one_sole, side_phases, usual_groups
from floatplan.jumps.spatial.pieces import Expression
from floatplan.jumps.spatial.program import MIDDLE_ANGLE, SpatialProgram
from floatplan.jumps.spatial.standing import (
    ClearancePoint,
    Foot,
    Kinematics,
    LegReach,
    clearance_points,
    feet_at,
    feet_links,
    foot_corners,
    leg_reach,
    not_standing,
    rolling,
    shank_points,
    standing_joints,
)
from floatplan.motion.planar.contact_rates import End
from floatplan.problem.attitude import Attitude, required
from floatplan.problem.ground_step import GroundStep
from floatplan.problem.jump import Ending, JumpRequest
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import frame_position
from floatplan.tables import LARGEST_MIDDLE_ANGLE, POINT_FEET

IN_PLANE = "is for jumps in a plane, so far"


@dataclass(frozen=True, eq=False)
class SpatialSetup:
    """A jump in space as it is requested: all but the margins of the program by which it is planned.

    Attributes
    ----------
    problem : Problem
    request : JumpRequest
    axes : of the base's angles
    phases : of the jump
    ends : where the robot stands before and after, its centre of mass above the origin at first
    origin : (3,) m, where that origin is in the problem's world: on the ground
    step : of the ground, from that origin; None where it is level
    """

    problem: Problem
    request: JumpRequest
    axes: str
    phases: tuple[SpatialPhase, ...]
    ends: SpatialEnds
    origin: Array
    step: GroundStep | None = None

    @property
    def feet(self) -> list[Foot]:
        """All feet."""
        return list({foot.name: foot for phase in self.phases for foot in phase.feet}.values())

    @cached_property
    def mechanics(self) -> Mechanics:
        """The robot with these feet."""
        return Mechanics(self.problem.robot, self.axes, float(self.problem.flight.gravity), self.feet)

    def program(self, margins: NodeMargins) -> SpatialProgram:
        """Return the program with some margins."""
        problem = self.problem
        request = self.request
        torque_share = request.margin["torque"] * margins.torque
        torque = np.array(problem.motor_torque_limits)
        if not np.isfinite(torque).any():  # the first motors are those of the planned joints, in their order
            torque[: len(problem.torque_limits)] = problem.torque_limits
        most = torque_share * np.minimum(torque, problem.motor_stall)
        without_limit = problem.robot.mass * float(problem.flight.gravity) * float(self.ends.y[0, 2])
        ranges = narrowed(np.asarray(problem.position_limits), margins.range)
        standing = self.ends.y[:, BASE:]
        ranges[:, 0] = np.minimum(ranges[:, 0], standing.min(axis=0))
        ranges[:, 1] = np.maximum(ranges[:, 1], standing.max(axis=0))
        bounds = SpatialBounds(
            torque=torque_share * torque,
            stall=torque_share * problem.motor_stall,
            slope=problem.motor_slope,
            velocity=request.margin["velocity"] * margins.velocity * problem.velocity_limits,
            position=ranges,
            friction=margins.friction * request.friction,
            clearance=min(request.clearance, self._lowest / 2) + margins.clearance,
            lift=margins.lift,
            dip=margins.dip,
            shank_height=margins.shank_height,
            tilt=min(self._largest_tilt, margins.tilt),
            leeway=math.inf if request.leeway is None else request.leeway,
            impact=request.landing.impact,
            least_force=max(margins.least_force, request.least_force),
            inside=margins.inside,
            scales=np.where(np.isfinite(most), most, without_limit),
        )
        phases = tuple(replace(phase, intervals=round(margins.refinement * phase.intervals)) for phase in self.phases)
        corners = foot_corners(problem.robot, self.feet, POINT_FEET)
        shanks = shank_points(problem.robot, self.feet, margins.shank_height) if margins.shank_height else []
        return SpatialProgram(
            self._model,
            phases,
            self.ends,
            self.clearance_points_of_robot,
            corners,
            shanks,
            bounds,
            request.friction,
            step=self.step,
            expressions=self._expressions,
        )

    @cached_property
    def _model(self) -> SpatialModel:
        """The robot's, of all programs."""
        return SpatialModel(self.problem.robot, self.axes, float(self.problem.flight.gravity), self.feet)

    @cached_property
    def _expressions(self) -> dict[Any, Expression]:
        """Those of all programs: deriving them takes seconds."""
        return {}

    @property
    def is_combined(self) -> bool:
        """Whether flip and twist are more than a whole rotation."""
        rotation = float(np.abs(np.diff(self.ends.y[:, 3:BASE], axis=0)).sum())
        return rotation > 2 * math.pi + 0.1

    @property
    def _largest_tilt(self) -> float:
        """Of the base's middle angle, rad: a little less than what the flight's plan may tilt.

        Where rotations are combined, it is much less: with the middle angle near 90 degrees they become half the flip,
        and the twist in the other direction about another axis.
        """
        return math.radians(45.0) if self.is_combined else LARGEST_MIDDLE_ANGLE - math.radians(5.0)

    @property
    def standing_pose(self) -> tuple[Array, Array]:
        """The base's rotation (3, 3) and joints (n,) in which the robot stands."""
        standing = self.ends.standing
        return rotations_about(self.axes, standing[3:BASE, None])[0], standing[BASE:]

    @cached_property
    def clearance_points_of_robot(self) -> list[ClearancePoint]:
        """What stays above the ground, but for the feet."""
        return clearance_points(self.problem.robot, self.feet, *self.standing_pose)

    @property
    def _lowest(self) -> float:
        """Height of the lowest clearance point where the robot stands, m."""
        kinematics = Kinematics(self.problem.robot)
        kinematics.pose(np.zeros(3), *self.standing_pose)
        foot = self.feet[0]
        ground = kinematics.point(foot.body, foot.local)[2] - foot.depth
        points = self.clearance_points_of_robot
        heights = [kinematics.point(point.body, point.local)[2] - point.radius - ground for point in points]
        return max(min(heights, default=0.0), 0.0)


def spatial_setup(problem: Problem, request: JumpRequest) -> SpatialSetup:
    """Resolve what a problem in space and a request ask for.

    Raises
    ------
    InputError
        No frame takes off, a contact cannot be one, the ends are not level, there is no standing posture, or the
        request asks for what only jumps in a plane have.
    """
    robot = problem.robot
    check_robot_stands(problem)
    _refuse_what_is_planar(request)
    refuse_other_ground(problem, request)
    start = required(problem.initial.attitude)
    goal = required(problem.final.attitude)
    axes = goal.axes or "zyx"
    start, goal = (Attitude(angles=tuple(end.angles_about(axes).tolist()), axes=axes) for end in (start, goal))
    _refuse_tilted_ends(start, goal)
    before = _target(robot, request.takeoff.from_)
    after = before if request.landing.to == "standing" else _target(robot, request.landing.to)
    feet = _named_feet(robot, request, start, before)
    joints = np.empty((2, len(robot.joints)))
    heights = np.empty(2)
    for index, (target, attitude, side) in enumerate(((before, start, "takeoff"), (after, goal, "landing"))):
        joints[index], heights[index] = _standing(problem, request, feet, attitude, target, side)
    takeoff, landing = usual_groups(robot, feet, start, goal, joints[0])
    if request.takeoff.contacts:
        takeoff = phase_feet(request.takeoff.contacts, feet)
    if request.landing.contacts:
        landing = phase_feet(request.landing.contacts, feet)
    for side, groups in (("takeoff", takeoff), ("landing", landing)):
        for group in groups:
            if len(group) < 2:
                reason = f"{group[0].frame!r} would stand on its own"
                raise InputError(reason, element=f"jump.{side}.contacts", advice="name two feet at least in each phase")
            if request.feet == "rolling" and len(group) not in (2, len(feet)):
                reason = f"{len(group)} feet would roll where {len(feet)} stand before or after: two do, or all, so far"
                raise InputError(
                    reason, element=f"jump.{side}.contacts", advice='name two feet, or let feet = "points"'
                )
    ends, origin = _ends(problem, request, axes, feet, (start, goal), joints, heights)
    step = GroundStep.of(request, (np.array(problem.takeoff.position) - origin).tolist(), 0.0)
    if step is not None:
        _refuse_at_edge(problem, request, step, axes, feet, ends)
    unit = math.sqrt(float(ends.y[0, 2]) / float(problem.flight.gravity))
    check_frames(problem, [foot.frame for foot in takeoff[0]], [foot.frame for foot in landing[0]])
    rotation = float(np.abs(goal.angles_about(axes) - start.angles_about(axes)).sum())
    meets_one_sole = is_one_sole(takeoff[-1]) or is_one_sole(landing[0])
    (usual_flight,) = side_phases("flight", [()], unit, [None], rotation, meets_one_sole)
    reach = reach_before_takeoff(problem, request, axes, takeoff[0], ends)
    flight = usual_flight.of_speed(reach.fastest, float(problem.flight.gravity))
    if flight is not usual_flight:  # of faster legs the search gets as far from a guess that is beyond their reach
        ends = replace(ends, tallest=reach.tallest)
    if "duration" in request.fixed:
        time = problem.flight.duration
        flight = replace(flight, duration=time, bounds=(time, time))
    phases = (
        *side_phases("takeoff", takeoff, unit, duration_bounds(request, "takeoff", len(takeoff))),
        replace(flight, **over_step(flight, request.rise, float(problem.flight.gravity))),
        *side_phases("landing", landing, unit, duration_bounds(request, "landing", len(landing))),
    )
    return SpatialSetup(problem, request, axes, phases, ends, origin, step)


def feet_and_posture(problem: Problem, request: JumpRequest, side: End) -> tuple[list[Foot], Array, float]:
    """Return the feet on which a robot stands at a side of a jump, its joints (n,) there, and the height of its base.

    Raises
    ------
    InputError
        As of :func:`spatial_setup`.
    """
    robot = problem.robot
    check_robot_stands(problem)
    if request.feet == "rolling":
        reason = "'rolling' is for whole jumps, so far: a stance that is looked for on its own is on points"
        raise InputError(reason, element="jump.feet", advice="leave it out")
    level = Attitude(angles=(0.0, 0.0, 0.0), axes="zyx")
    target = _target(robot, request.takeoff.from_)
    feet = _named_feet(robot, request, level, target)
    if side == "landing" and request.landing.to != "standing":
        target = _target(robot, request.landing.to)
    return feet, *_standing(problem, request, feet, level, target, side)


def _refuse_what_is_planar(request: JumpRequest) -> None:
    """Refuse what jumps in space have not yet."""
    if request.objective != "torque":
        raise InputError(f"{request.objective!r} {IN_PLANE}", element="jump.objective", advice='leave it out: "torque"')
    for name in request.fixed:
        if name != "duration":
            raise InputError(f"{name!r} {IN_PLANE}", element="jump.fixed", advice="leave it out")


def _refuse_tilted_ends(start: Attitude, goal: Attitude) -> None:
    """Refuse ends in which the base is not level, and axes about which its angles are no coordinates."""
    axes = goal.axes
    assert axes is not None
    if axes[0] == axes[2]:
        advice = (
            'name three different ones: "xyz" of a roll, "yxz" or "yzx" of a flip, "zyx" of a jump about the vertical'
        )
        raise InputError(
            f"angles about {axes!r} are not defined where the base is level", element="goal.orientation", advice=advice
        )
    rotation = float(np.abs(np.array(goal.angles) - np.array(start.angles)).max())
    most = 1080.0  # [degrees] twice of what programs have had solutions for
    if math.degrees(rotation) > most + 1.0:
        reason = f"the base would turn by {math.degrees(rotation):.4g} degrees, no jump turns by more than {most:.4g}"
        advice = "ask for fewer turns, or plan the flight alone with floatplan plan"
        raise InputError(reason, element="goal.orientation", advice=advice)
    for key, attitude in (("start", start), ("goal", goal)):
        assert attitude.angles is not None
        middle = attitude.angles[1]
        if abs(middle) > MIDDLE_ANGLE:
            reason = f"the middle angle, about {axes[1]}, is {math.degrees(middle):.4g} degrees, beyond 75"
            advice = "name other axes, the largest rotation's first: their middle angle has to stay small"
            raise InputError(reason, element=f"{key}.orientation", advice=advice)
        tilt = math.acos(min(1.0, float(attitude.matrix[2, 2])))
        level = 1e-3  # [rad] by which a base that stands may be tilted
        if tilt > level:
            reason = f"a jump ends as level as it begins: it would be tilted by {math.degrees(tilt):.3g} degrees"
            advice = "ask for angles that leave it level, or plan the flight alone with floatplan plan"
            raise InputError(reason, element=f"{key}.orientation", advice=advice)


def _target(robot: Robot, requested: Ending) -> Array:
    """Joints (n,) rad that are requested, others being in the reference posture."""
    by_joint = requested if isinstance(requested, Mapping) else {}
    return np.array(
        [by_joint.get(name, angle) for name, angle in zip(robot.joints, robot.resting.tolist(), strict=True)]
    )


def _named_feet(robot: Robot, request: JumpRequest, start: Attitude, joints: Array) -> list[Foot]:
    """All feet: those of the outer phases, or else the limbs' ends that are as low as the takeoff's frame."""
    key = "jump.takeoff.contacts"
    if request.takeoff.contacts:
        names = list(request.takeoff.contacts[0])
    elif request.landing.contacts:
        names = list(request.landing.contacts[-1])
        key = "jump.landing.contacts"
    else:
        names = _lowest_frames(robot, start, joints)
    feet: list[Foot] = []
    for name in names:
        body, _ = frame_position(robot.model, robot.joint_tree, name)
        for other in feet:
            if other.body == body:
                reason = f"{name!r} stands twice: on the same leg as {other.frame!r}"
                raise InputError(reason, element=key, advice="name one foot of each leg")
        points = feet_at(robot, name, start, joints, key)
        if request.feet == "rolling":
            points = tuple(rolling(robot, point, start, joints) for point in points)
        feet += points
    for side, groups in (("takeoff", request.takeoff.contacts), ("landing", request.landing.contacts)):
        for index, group in enumerate(groups or ()):
            unknown = set(group) - {foot.frame for foot in feet}
            if unknown:
                reason = f"{min(unknown)!r} is not among what stands at first: {', '.join(names)}"
                element = f"jump.{side}.contacts[{index}]"
                raise InputError(reason, element=element, advice="name the same feet before and after")
            repeated = {name for name in group if group.count(name) > 1}
            if repeated:
                element = f"jump.{side}.contacts[{index}]"
                raise InputError(f"{min(repeated)!r} stands twice", element=element, advice="name each foot once")
        outer = (groups or (names,))[0 if side == "takeoff" else -1]
        left_out = {foot.frame for foot in feet} - set(outer)
        if left_out:
            reason = f"{min(left_out)!r} would be left in the air"
            raise InputError(reason, element=f"jump.{side}.contacts", advice="name all feet in the outer phase")
    return feet


def _lowest_frames(robot: Robot, start: Attitude, joints: Array) -> list[str]:
    """Links at the ends of limbs that reach as low as that of the takeoff's frame."""
    within = 0.02  # [m] of the takeoff frame's link
    kinematics = Kinematics(robot)
    kinematics.pose(np.zeros(3), start.matrix, joints)
    model = robot.model
    carrying = set(model.parents)
    ends: dict[int, tuple[float, str]] = {}
    for link in {solid.link for solid in robot.solids}:
        body = next(solid.body for solid in robot.solids if solid.link == link)
        if body > 1 and body not in carrying:
            ends[body] = min(ends.get(body, (math.inf, "")), (kinematics.lowest([link]), link))
    lowest = min((height for height, _ in ends.values()), default=math.inf)
    names = [link for body, (height, link) in sorted(ends.items()) if height < lowest + within]
    if not names:
        raise InputError("nothing stands on the ground", element="jump.takeoff.contacts", advice="name the feet")
    return names


def _standing(
    problem: Problem, request: JumpRequest, feet: Sequence[Foot], attitude: Attitude, target: Array, side: Side | str
) -> tuple[Array, float]:
    """Joints (n,) in which the robot stands still on all feet, and the height of the base, m."""
    robot = problem.robot
    requested = request.takeoff.from_ if side == "takeoff" else request.landing.to
    named_after = request.landing.contacts and not request.takeoff.contacts
    key = f"jump.{'landing' if named_after else side}.contacts"
    if isinstance(requested, Mapping):
        key = "jump.takeoff.from" if side == "takeoff" else "jump.landing.to"
        refuse_beyond_ranges(problem, target, key)
    joints, height = standing_joints(robot, feet, attitude, target, np.asarray(problem.position_limits))
    kinematics = Kinematics(robot)
    kinematics.pose(np.array([0.0, 0.0, height]), attitude.matrix, joints)
    on_ground = 5e-3  # [m] above it: what is as low stands too
    for link in sorted({solid.link for solid in robot.solids} - feet_links(robot, feet)):
        if kinematics.lowest([link]) < on_ground:
            reason = f"{link!r} is on the ground too"
            raise InputError(reason, element=key, advice="name all feet in the outer phase, or bend that leg")
    reason = not_standing(robot, feet, attitude, joints)
    if not reason and isinstance(requested, Mapping) and np.abs(joints - target).max() > 0.1:  # rad
        reason = "its feet are not level"
    if reason:
        advice = "give another posture, or other contacts"
        raise InputError(f"the posture is not static: {reason}", element=key, advice=advice)
    return joints, height


def phase_feet(contacts: Sequence[Sequence[str]], feet: Sequence[Foot]) -> list[tuple[Foot, ...]]:
    """Return the feet of phases, from their names."""
    return [tuple(foot for name in group for foot in feet if foot.frame == name) for group in contacts]


def _ends(
    problem: Problem,
    request: JumpRequest,
    axes: str,
    feet: Sequence[Foot],
    attitudes: tuple[Attitude, Attitude],
    joints: Array,
    heights: Array,
) -> tuple[SpatialEnds, Array]:
    """Where the robot stands before and after, and the origin (3,) in the problem's world, m."""
    kinematics = Kinematics(problem.robot)
    rows = []
    places: dict[str, dict[str, Array]] = {}
    sides: tuple[Side, ...] = ("takeoff", "landing")
    for attitude, side, own, height in zip(attitudes, sides, joints, heights, strict=True):
        ground = request.rise if side == "landing" else 0.0
        q = kinematics.pose(np.array([0.0, 0.0, height + ground]), attitude.matrix, own)
        com = pin.centerOfMass(kinematics.model, kinematics.data, q).copy()
        shift = np.array([com[0], com[1], 0.0])
        rows.append(np.concatenate(([0.0, 0.0, com[2]], attitude.angles_about(axes), own)))
        places[side] = {foot.name: kinematics.point(foot.body, foot.local) - shift for foot in feet}
    displacement = None if request.landing.displacement is None else np.array(request.landing.displacement)
    frame = problem.takeoff.frame
    origin = np.zeros(3)
    first = next((foot for foot in feet if foot.frame == frame), None)
    if first is not None:
        q = kinematics.pose(np.array([0.0, 0.0, heights[0]]), attitudes[0].matrix, joints[0])
        com = pin.centerOfMass(kinematics.model, kinematics.data, q)
        robot = problem.robot
        at_frame = kinematics.point(*frame_position(robot.model, robot.joint_tree, frame))
        origin = np.array(problem.takeoff.position) - at_frame
        origin[:2] += com[:2]
        if not first.suffix:
            origin[2] = problem.takeoff.position[-1] - first.depth
    return SpatialEnds(np.array(rows), places, displacement, rise=request.rise), origin


def reach_before_takeoff(
    problem: Problem, request: JumpRequest, axes: str, feet: Sequence[Foot], ends: SpatialEnds
) -> LegReach:
    """How high the legs carry the robot before takeoff, and how fast, at the share of joints' rates that is allowed."""
    y = ends.y[0]
    return leg_reach(
        Kinematics(problem.robot),
        feet,
        ends.places["takeoff"],
        rotations_about(axes, y[3:BASE, None])[0],
        np.concatenate((y[2:3], y[BASE:])),
        ranges=np.asarray(problem.position_limits),
        rates=request.margin["velocity"] * problem.velocity_limits,
    )


def _refuse_at_edge(
    problem: Problem, request: JumpRequest, step: GroundStep, axes: str, feet: Sequence[Foot], ends: SpatialEnds
) -> None:
    """Refuse an edge of the ground on which a foot would stand, or next to which the robot would stand in its side."""
    if problem.takeoff.frame not in {foot.frame for foot in feet}:
        reason = f"is measured from a foot, and {problem.takeoff.frame!r}, which takes off, is none"
        advice = f"name a foot in flight.takeoff.frame: {', '.join(foot.frame for foot in feet)}"
        raise InputError(reason, element="jump.edge", advice=advice)
    assert request.edge is not None
    assert ends.displacement is not None
    ahead = math.copysign(1.0, request.edge)
    along = f"m along {'xy'[step.axis]}, or farther"
    sides: tuple[Side, ...] = ("takeoff", "landing")
    for side, y in zip(sides, ends.y, strict=True):
        moved = float(ends.displacement[step.axis]) if side == "landing" else 0.0
        if (request.rise < 0) == (side == "takeoff"):
            least = 0.04  # [m] of feet from the edge: capsules around them are clear of it then
            where = "from the edge on the higher ground"
            positions = [(ends.places[side][foot.name][step.axis], foot.frame) for foot in feet]
            distance, name = min((step.inwards * (at + moved - step.edge), frame) for at, frame in positions)
        else:
            least = 0.03  # [m] of links from the side of the higher ground
            where = "from the side of the higher ground"
            distance, name = _reach_to_edge(problem.robot, step, axes, y, moved)
        missing = least - distance
        if missing <= 0:
            continue
        distances = f"{1e3 * distance:.0f} mm {where}, {1e3 * least:.0f} mm are the least"
        reason = f"where it stands at {side}, {name!r} would be {distances}"
        position = request.edge if side == "takeoff" else moved
        enough = ahead * math.ceil(1e3 * (abs(position) + missing)) / 1e3  # mm, rounded up
        if side == "takeoff":
            advice = f"let the edge be at {enough:g} {along}"
            raise InputError(reason, element="jump.edge", advice=advice)
        advice = f"let it come {enough:g} {along}"
        raise InputError(reason, element="jump.landing.displacement", advice=advice)


def _reach_to_edge(robot: Robot, step: GroundStep, axes: str, y: Array, moved: float) -> tuple[float, str]:
    """Least distance of the links' capsules from the side of the higher ground, m, and which link's it is.

    Parameters
    ----------
    y : (6+n,) coordinates where the robot stands, of which those of the centre of mass are left out
    moved : how far it has come along the step's axis, m
    """
    kinematics = Kinematics(robot)
    q = kinematics.pose(np.zeros(3), rotations_about(axes, y[3:BASE, None])[0], y[BASE:])
    com = pin.centerOfMass(kinematics.model, kinematics.data, q).copy()
    nearest = (math.inf, "")
    for capsule in robot.solid_capsules:
        for end in (capsule.start, capsule.end):
            at = float((kinematics.point(capsule.body, end) - com)[step.axis]) + moved
            nearest = min(nearest, (step.inwards * (step.edge - at) - capsule.radius, capsule.link))
    return nearest
