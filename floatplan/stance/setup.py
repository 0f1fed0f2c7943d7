"""From a problem and a request to the program of a jump: contacts, standing postures, phases, bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.problem.problem import Problem
from floatplan.robot import Robot
from floatplan.stance.contacts import Contact, contact_at, heights_over_com, standing_feet, watched_points
from floatplan.stance.model import PlanarModel
from floatplan.stance.phases import Phase, phases_of, standing_posture
from floatplan.stance.program import JumpProgram, inside
from floatplan.stance.request import JumpRequest
from floatplan.stance.rows import Bounds, NodeRows

MOST = 2  # [-] contacts of a phase
TURN = 2 * math.pi


@dataclass(frozen=True)
class Room:
    """How much stricter the program is than the check, since it looks at its nodes alone.

    Attributes
    ----------
    torque, velocity, friction : shares of what is allowed
    directions : in which each body's hull is watched
    finer : by which factor nodes are more than usual
    """

    torque: float
    velocity: float
    friction: float
    directions: int
    finer: float = 1.0


@dataclass(frozen=True, eq=False)
class Setup:
    """A jump as it is asked: all but the tightening of limits by which it is planned.

    Attributes
    ----------
    problem : Problem
    request : JumpRequest
    phases : of the jump
    standing : (2, n+1) orientation and joints before and after, rad
    ground : height of the ground over the centre of mass, standing, m
    """

    problem: Problem
    request: JumpRequest
    phases: tuple[Phase, ...]
    standing: Array
    ground: float

    def node(self, room: Room) -> NodeRows:
        """Rows of nodes, with some room between them and what the request lets the stances use."""
        problem, request = self.problem, self.request
        share = request.margin["torque"] * room.torque
        bounds = Bounds(
            torque=share * problem.motor_torque_limits,
            stall=share * problem.motor_stall,
            slope=problem.motor_slope,
            velocity=request.margin["velocity"] * room.velocity * problem.velocity_limits,
            position=np.asarray(problem.position_limits),
            friction=room.friction * request.friction,
        )
        model = PlanarModel(problem.robot, float(problem.flight.gravity))
        rest = self.standing[0 if self.phases[0].contacts else -1, 1:]
        watched = watched_points(problem.robot, self.ground, rest, room.directions)
        phases = [replace(each, intervals=round(room.finer * each.intervals)) for each in self.phases]
        return NodeRows(model, phases, watched, bounds, self.standing)

    def program(self, room: Room) -> JumpProgram:
        """Return the program with some room."""
        ends = (("start", 0, self.problem.initial), ("goal", -1, self.problem.final))
        fixed = self.request.fixed
        return JumpProgram(
            self.node(room),
            [(at, np.append(state.orientation, state.positions)) for key, at, state in ends if key in fixed],
            self._momentum,
        )

    @property
    def _momentum(self) -> float | None:
        """The flight's angular momentum, kg m^2/s, where the request keeps it."""
        asked = self.problem.flight.angular_momentum
        if "angular_momentum" not in self.request.fixed:
            return None
        if isinstance(asked, str):
            raise InputError(f"{asked!r} is no number to keep", element="flight.angular_momentum", advice="give one")
        return float(asked)


def jump_setup(problem: Problem, request: JumpRequest) -> Setup:
    """Resolve what a problem and a request ask for.

    Raises
    ------
    InputError
        No frame takes off, a contact cannot be one, there is no gravity, or no standing posture is found.
    """
    robot = problem.robot
    if not problem.flight.gravity > 0:
        raise InputError("nothing stands without gravity", element="flight.gravity", advice="give it, as 9.81")
    wanted = _wanted(robot, request)
    turns = round((problem.final.orientation - problem.initial.orientation) / TURN)
    groups = request.contacts
    takeoff, landing = _default_groups(problem, turns, wanted) if groups is None else groups
    found = [[_contacts(robot, names, wanted) for names in side] for side in (takeoff, landing)]
    limits = inside(np.asarray(problem.position_limits))
    posture = standing_posture(robot, found[0][0], wanted, limits)
    takeoff_contacts, landing_contacts = found
    for side, groups_of_side in (("takeoff", takeoff_contacts), ("landing", landing_contacts)):
        _check_counts(groups_of_side, side)
    ground = _ground(robot, takeoff_contacts[0][0], posture)
    bounds = list(request.durations or [None] * (len(takeoff) + len(landing) + 1))
    if len(bounds) != len(takeoff) + len(landing) + 1:
        raise InputError(
            f"{len(bounds)} pairs for {len(takeoff) + len(landing) + 1} phases",
            element="jump.durations",
            advice="give one for each phase, the flight's too",
        )
    if "duration" in request.fixed:
        bounds[len(takeoff)] = (problem.flight.duration, problem.flight.duration)
    phases = phases_of(takeoff_contacts, landing_contacts, -ground, float(problem.flight.gravity), bounds, turns)
    standing = np.stack((np.append(0.0, posture), np.append(TURN * turns, posture)))
    return Setup(problem, request, phases, standing, ground)


def side_setup(problem: Problem, request: JumpRequest, side: str, meeting: Array) -> Setup:
    """Resolve one side of a jump: from standing to where a flight begins, or from where it ends to standing.

    Parameters
    ----------
    side : "takeoff" or "landing"
    meeting : (n+1,) rad, orientation and joints there

    Raises
    ------
    InputError
        As of :func:`jump_setup`.
    """
    robot, gravity = problem.robot, float(problem.flight.gravity)
    if not gravity > 0:
        raise InputError("nothing stands without gravity", element="flight.gravity", advice="give it, as 9.81")
    takes_off = side == "takeoff"
    frame = problem.takeoff.frame if takes_off else problem.landing.frame
    if robot.frames[frame].body == 0:
        raise InputError("the frame there is the base, which cannot stand", element=f"flight.{side}")
    wanted = _wanted(robot, request)
    if request.contacts is not None:
        groups = [list(names) for names in request.contacts[0 if takes_off else 1]]
    else:
        feet = standing_feet(robot, frame, wanted)
        toe = contact_at(robot, frame, wanted)[0]
        groups = [feet, [frame]] if len(feet) > 1 else [[frame], [toe.name]] if toe.suffix else [[frame]]
        groups = groups if takes_off else groups[::-1]
    contacts = [_contacts(robot, names, wanted) for names in groups]
    _check_counts(contacts, side)
    limits = inside(np.asarray(problem.position_limits))
    posture = standing_posture(robot, contacts[0 if takes_off else -1], wanted, limits)
    ground = _ground(robot, contacts[0 if takes_off else -1][0], posture)
    unbounded = [None] * (2 * len(contacts) + 1)
    both = (contacts, contacts[::-1]) if takes_off else (contacts[::-1], contacts)
    phases = [each for each in phases_of(*both, -ground, gravity, unbounded, 0) if each.side == side]
    time = problem.flight.duration
    flight = Phase("flight", (), time, (time, time), 0)
    rest = np.append(TURN * round(meeting[0] / TURN), posture)
    ends = (rest, meeting) if takes_off else (meeting, rest)
    return Setup(problem, request, (*phases, flight) if takes_off else (flight, *phases), np.stack(ends), ground)


def _check_counts(groups: Sequence[tuple[Contact, ...]], side: str) -> None:
    if any(len(contacts) > MOST for contacts in groups):
        reason = f"more than {MOST} points would stand at once"
        raise InputError(reason, element=f"jump.contacts.{side}", advice="name fewer")


def _ground(robot: Robot, contact: Contact, posture: Array) -> float:
    """Height of the ground over the centre of mass, m, standing."""
    return float(heights_over_com(robot, contact.spots[:1], 0.0, posture)[0].imag - contact.depth)


def _wanted(robot: Robot, request: JumpRequest) -> Array:
    """Positions (n,) rad near which the robot stands."""
    positions = np.array(robot.resting)
    for joint, angle in (request.standing or {}).items():
        if joint not in robot.joints:
            advice = f"joints: {', '.join(robot.joints)}"
            raise InputError(f"{joint!r} is not a planned joint", element="jump.standing", advice=advice)
        positions[robot.joints.index(joint)] = angle
    return positions


def _default_groups(problem: Problem, turns: int, wanted: Array) -> tuple[list[list[str]], list[list[str]]]:
    """Frames of the phases where none are asked: all feet, and those on the side to which it turns."""
    robot, frame = problem.robot, problem.takeoff.frame
    if problem.takeoff_frame.body == 0:
        raise InputError(
            "no frame takes off, so that nothing stands", element="flight.takeoff", advice="name a foot there"
        )
    feet = standing_feet(robot, frame, wanted)
    if len(feet) == 1:
        toe = contact_at(robot, frame, wanted)[0]
        if not toe.suffix:
            return [[frame]], [[frame]]
        return [[frame], [toe.name]], [[toe.name], [frame]]
    backwards = turns * robot.tree.turn >= 0
    first, last = (feet[0], feet[-1]) if backwards else (feet[-1], feet[0])
    return [feet, [first]], [[last], feet]


def _contacts(robot: Robot, names: Sequence[str], wanted: Array) -> tuple[Contact, ...]:
    """Contacts of a phase's names; of a sole toe and heel, or the one named."""
    found: list[Contact] = []
    for name in names:
        frame, dot, _ = name.partition(".") if name not in robot.frames else (name, "", "")
        points = contact_at(robot, frame, wanted)
        chosen = [each for each in points if not dot or each.name == name]
        if not chosen:
            raise InputError(
                f"{name!r} is no point of a sole", element="jump.contacts", advice=f"name {points[0].name!r}"
            )
        found += chosen
    return tuple(found)
