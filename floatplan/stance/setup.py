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
from floatplan.stance.program import JumpProgram
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

    def program(self, room: Room) -> JumpProgram:
        """Return the program with some room between what the request lets the stances use and the nodes."""
        problem, request = self.problem, self.request
        share = request.margin["torque"] * room.torque
        bounds = Bounds(
            torque=share * problem.motor_torque_limits,
            stall=share * problem.motor_stall,
            slope=problem.motor_slope * share,
            velocity=request.margin["velocity"] * room.velocity * problem.velocity_limits,
            position=np.asarray(problem.position_limits),
            friction=room.friction * request.friction,
        )
        model = PlanarModel(problem.robot, float(problem.flight.gravity))
        watched = watched_points(problem.robot, self.ground, self.standing[0, 1:], room.directions)
        phases = [replace(each, intervals=round(room.finer * each.intervals)) for each in self.phases]
        ends = (("start", 0, problem.initial), ("goal", -1, problem.final))
        return JumpProgram(
            NodeRows(model, phases, watched, bounds, self.standing),
            [(at, np.append(state.orientation, state.positions)) for key, at, state in ends if key in request.fixed],
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
    turns = round((problem.final.orientation - problem.initial.orientation) / TURN)
    groups = request.contacts
    takeoff, landing = _default_groups(problem, turns) if groups is None else groups
    found = [[_contacts(robot, names) for names in side] for side in (takeoff, landing)]
    limits = np.asarray(problem.position_limits)
    posture = standing_posture(robot, found[0][0], np.asarray(robot.resting), limits)
    takeoff_contacts, landing_contacts = found
    for side, groups_of_side in (("takeoff", takeoff_contacts), ("landing", landing_contacts)):
        if any(len(contacts) > MOST for contacts in groups_of_side):
            raise InputError(
                f"more than {MOST} points would stand at once", element=f"jump.contacts.{side}", advice="name fewer"
            )
    anchor = takeoff_contacts[0][0]
    ground = float(heights_over_com(robot, anchor.spots[:1], 0.0, posture)[0].imag - anchor.depth)
    bounds = list(request.durations or [None] * (len(takeoff) + len(landing) + 1))
    if len(bounds) != len(takeoff) + len(landing) + 1:
        raise InputError(
            f"{len(bounds)} pairs for {len(takeoff) + len(landing) + 1} phases",
            element="jump.durations",
            advice="give one for each phase, the flight's too",
        )
    if "duration" in request.fixed:
        bounds[len(takeoff)] = (problem.flight.duration, problem.flight.duration)
    phases = phases_of(takeoff_contacts, landing_contacts, -ground, float(problem.flight.gravity), bounds)
    standing = np.stack((np.append(0.0, posture), np.append(TURN * turns, posture)))
    return Setup(problem, request, phases, standing, ground)


def _default_groups(problem: Problem, turns: int) -> tuple[list[list[str]], list[list[str]]]:
    """Frames of the phases where none are asked: all feet, and those on the side to which it turns."""
    robot, frame = problem.robot, problem.takeoff.frame
    if problem.takeoff_frame.body == 0:
        raise InputError(
            "no frame takes off, so that nothing stands", element="flight.takeoff", advice="name a foot there"
        )
    feet = standing_feet(robot, frame, np.asarray(robot.resting))
    if len(feet) == 1:
        toe = contact_at(robot, frame, np.asarray(robot.resting))[0]
        if not toe.suffix:
            return [[frame]], [[frame]]
        return [[frame], [toe.name]], [[toe.name], [frame]]
    backwards = turns * robot.tree.turn >= 0
    first, last = (feet[0], feet[-1]) if backwards else (feet[-1], feet[0])
    return [feet, [first]], [[last], feet]


def _contacts(robot: Robot, names: Sequence[str]) -> tuple[Contact, ...]:
    """Contacts of a phase's names; of a sole toe and heel, or the one named."""
    found: list[Contact] = []
    for name in names:
        frame, dot, _ = name.partition(".") if name not in robot.frames else (name, "", "")
        points = contact_at(robot, frame, np.asarray(robot.resting))
        chosen = [each for each in points if not dot or each.name == name]
        if not chosen:
            raise InputError(
                f"{name!r} is no point of a sole", element="jump.contacts", advice=f"name {points[0].name!r}"
            )
        found += chosen
    return tuple(found)
