"""The motion of a whole jump, stances and flight: its state at any time, forces, links, coordinates of a plan."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from floatplan.arguments import numbers
from floatplan.arrays import Array, IntArray, read_only
from floatplan.errors import InputError
from floatplan.jumps.contacts import (
    GroundContact,
    contact_depths,
    contact_positions,
    links_of,
    names_of,
    near_contact,
)
from floatplan.jumps.motion import JumpState, Stance, flight_state, joined
from floatplan.motion.dynamics import FlightState
from floatplan.motion.flight import FullMotion, MotionInFile, PinocchioDynamics
from floatplan.motion.planar.clearance import LinkShapes, Segments, pair_distances
from floatplan.plans.measures import PlanWarning, overlap_warnings
from floatplan.plans.plan import Plan
from floatplan.plans.planned_motion import least_distances
from floatplan.plans.trajectory import JumpPhase
from floatplan.pool import one_thread
from floatplan.problem.ground_step import GroundStep, edge_obstacles
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Obstacle, Posture
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.robot.standing import Spot, corners, positions_from_com, undersides


class JumpGeometry(Protocol):
    """What a check asks of the shapes of a robot, in a plane or in space.

    ``located`` is what :meth:`locate` returns for the N instants of a state.
    """

    def links_of(self, contacts: Iterable[Any]) -> set[str | None]:
        """Links on which contacts stand."""

    def locate(self, state: FlightState) -> Any:
        """Where the robot is at the N instants of a state."""

    def lowest(self, located: Any) -> Iterator[tuple[str, Array]]:
        """Links that can touch the ground, each with the height (N,) of its lowest point, m."""

    def segments(self, located: Any) -> Any:
        """The links' capsules."""

    def distances(self, segments: Any, links: Sequence[str]) -> Array:
        """Distances (N, r) between the capsules of two links, m."""

    def rotated_heights(self, state: FlightState, error: float) -> Iterator[float]:
        """Least heights over the ground of all but feet, m, of a robot that is rotated by an error, rad, on its feet.

        There are none of a robot that is all feet.
        """


class PlanarGeometry:
    """The geometry of a robot in a plane; located are postures (n+1, N), rad, and the centre of mass (N,), m.

    Attributes
    ----------
    robot : Robot
    contacts : on which it stands at some time
    step : of the ground, where it has one
    """

    def __init__(self, robot: Robot, contacts: Sequence[GroundContact], step: GroundStep | None = None) -> None:
        self.robot = robot
        self.step = step
        self.contacts = list({contact.name: contact for contact in contacts}.values())

    def links_of(self, contacts: Iterable[GroundContact]) -> set[str | None]:
        """Links on which contacts stand."""
        return links_of(self.robot, contacts)

    def locate(self, state: FlightState) -> tuple[Array, Any]:
        """Postures and centre of mass at the N instants of a state."""
        return np.vstack((state.orientation, state.positions.T)), state.com_position @ [1, 1j]

    def lowest(self, located: tuple[Array, Any]) -> Iterator[tuple[str, Array]]:
        """Links that can touch the ground, each with the height (N,) of its lowest point, m, by corners of its hull.

        Where the ground has a step, corners over the higher one count by so much less.
        """
        y, com = located
        for link in self.robot.touching_links:
            of_link = corners(self.robot.link_hulls[link])
            heights = undersides(self.robot, of_link, y) + com.imag[:, None]
            if self.step is not None:
                heights -= self.step.above_low((positions_from_com(self.robot, of_link, y) + com[:, None]).real)
            yield link, heights.min(axis=1)

    def segments(self, located: tuple[Array, Any]) -> Segments:
        """The links' capsules."""
        y, com = located
        tree = self.robot.tree
        return LinkShapes(tree, self.robot.shapes).place(com, tree.absolute_angles(y[0], y[1:].T))

    def distances(self, segments: Segments, links: Sequence[str]) -> Array:
        """Distances (N, r) between the capsules of two links, m."""
        owners = np.array([shape.link for shape in self.robot.shapes])
        first, second = (segments.of(np.flatnonzero(owners == link)) for link in links)
        return pair_distances(first, second)

    def rotated_heights(self, state: FlightState, error: float) -> Iterator[float]:
        """Least heights over the ground of all but feet, m, of a robot that is rotated either way on its feet."""
        if not self._points:
            return
        y, _ = self.locate(state)
        radii = np.array([corner.radius for corner in self._points])
        of_points = positions_from_com(self.robot, self._points, y)
        of_feet = contact_positions(self.robot, self.contacts, y)
        for sign in (1.0, -1.0):
            rotation = np.exp(1j * sign * error)
            ground = ((of_feet * rotation).imag - contact_depths(self.contacts)).min(axis=1)
            yield float(((of_points * rotation).imag - radii - ground[:, None]).min())

    @cached_property
    def _points(self) -> list[Spot]:
        """Corners of the links' hulls but for those of the feet."""
        robot = self.robot
        feet: dict[str | None, list[Spot]] = {}  # by link
        for contact in self.contacts:
            for frame, spot in zip(contact.frames, contact.spots, strict=True):
                feet.setdefault(robot.contact_link(robot.frames[frame].link), []).append(spot)
        points = []
        for link in robot.touching_links:
            own_feet = feet.get(link, [])
            points += [corner for corner in corners(robot.link_hulls[link]) if not near_contact(corner, own_feet)]
        return points


@dataclass(frozen=True, eq=False)
class NextFlight:
    """A flight of a sequence, and the stances that follow it.

    Attributes
    ----------
    flight : Plan, whose t = 0 is its takeoff
    shift : where the origin of its world is in that of the jump, m, horizontal and vertical
    after : stances after it, up to the next flight
    """

    flight: Plan
    shift: tuple[float, float]
    after: tuple[Stance, ...]


@dataclass(frozen=True, eq=False)
class TimedFlight:
    """A flight in its jump: its plan, when it takes off and lands, s, and its world's origin (2,), m; () in space."""

    plan: Plan
    begin: float
    end: float
    shift: tuple[float, ...] = ()

    def state(self, times: Array) -> JumpState:
        """State at times (N,) s from the jump's start, in the jump's world."""
        state = flight_state(self.plan, self.begin, times)
        if not any(self.shift):
            return state
        positions = state.positions.copy()
        positions[:, : len(self.shift)] += self.shift
        return replace(state, positions=read_only(positions))


@dataclass(frozen=True, eq=False, repr=False)
class JumpMotion(MotionInFile):
    """A jump as a function of time; its world is that of its first flight.

    Attributes
    ----------
    problem : Problem, as it was passed
    request : JumpRequest
    flight : the first Plan, whose t = 0 is the takeoff; None where there is no jump
    before, after : stances before it and after it, in order of time
    more : flights that follow these, in order of time
    """

    problem: Problem
    request: JumpRequest
    flight: Plan | None = None
    before: tuple[Any, ...] = ()  # of Stance, or of its counterpart in space: each an AnyStance
    after: tuple[Any, ...] = ()
    more: tuple[NextFlight, ...] = ()

    @property
    def robot(self) -> Robot:
        """The robot that jumps."""
        return self.problem.robot

    @property
    def stances(self) -> tuple[Any, ...]:
        """All stances."""
        stances = [*self.before, *self.after]
        for following in self.more:
            stances += following.after
        return tuple(stances)

    @property
    def flights(self) -> tuple[Plan, ...]:
        """All flights, in order of time."""
        return () if self.flight is None else (self.flight, *(following.flight for following in self.more))

    @cached_property
    def timed_flights(self) -> tuple[TimedFlight, ...]:
        """All flights with their times and places."""
        if self.flight is None:
            return ()
        flights = [TimedFlight(self.flight, *self.flight_span)]
        stances = self.after
        for following in self.more:
            begin = stances[-1].span[1]
            flights.append(TimedFlight(following.flight, begin, begin + following.flight.duration, following.shift))
            stances = following.after
        return tuple(flights)

    @cached_property
    def pieces(self) -> tuple[Any, ...]:
        """Stances and flights (TimedFlight) in order of time."""
        pieces = [*self.before, *self.timed_flights[:1], *self.after]
        for flight, following in zip(self.timed_flights[1:], self.more, strict=True):
            pieces += [flight, *following.after]
        return tuple(pieces)

    @property
    def step(self) -> GroundStep | None:
        """Of the ground, where takeoff and landing are on grounds of different heights."""
        if not self.stances:
            return None
        left = self.before[-1].ground if self.before else self.after[0].ground - self.request.rise
        return GroundStep.of(self.request, self.problem.takeoff.position, left)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """The problem's obstacles, and the edge between grounds of different heights."""
        return (*self.problem.obstacles, *edge_obstacles(self.step))

    @property
    def contacts(self) -> list[Any]:
        """Contacts of all stances, by stance."""
        return list(chain.from_iterable(stance.contacts for stance in self.stances))

    @property
    def takeoff_time(self) -> float:
        """When the flight begins, s from the jump's start."""
        return self.before[-1].span[1] if self.before else 0.0

    @property
    def duration(self) -> float:
        """From its beginning to its end, standing as a rule, s."""
        return self.stances[-1].span[1] if self.after else 0.0

    @property
    def flight_span(self) -> tuple[float, float]:
        """Takeoff and landing of the first flight, s."""
        assert self.flight is not None
        return self.takeoff_time, self.takeoff_time + self.flight.duration

    @property
    def ground(self) -> float:
        """Height of the ground, the lower one where there is a step, m."""
        if self.step is not None:
            return self.step.low
        grounds: list[float] = [stance.ground for stance in self.stances]
        return min(grounds)

    @cached_property
    def height(self) -> float:
        """Greatest height of the centre of mass over the ground, m."""
        times = np.linspace(0.0, self.duration, 601)  # 3 ms apart, in which it falls by 0.01 mm next to the highest
        return float(self.state(times).com_position[:, -1].max()) - self.ground

    @cached_property
    def geometry(self) -> JumpGeometry:
        """Where the robot's links are."""
        return PlanarGeometry(self.robot, self.contacts, self.step)

    @property
    def dynamics(self) -> PinocchioDynamics:
        """The robot's rigid-body dynamics."""
        assert self.flight is not None
        dynamics: PinocchioDynamics = self.flight.dynamics
        return dynamics

    @cached_property
    def whole_problem(self) -> Problem:
        """The flight's problem with what the jump's problem sets: name, limits and obstacles, ends and duration.

        Its clock begins with the jump, that of its obstacles too.
        """
        ends = self.state([0.0, self.duration])  # refused where there is no jump
        assert self.flight is not None
        of_flight = self.flight.problem
        positions = np.clip(ends.positions, *of_flight.position_limits.T)  # which robots that fall may leave
        start, goal = map(Posture, self._orientations(ends), positions)
        return replace(
            of_flight,
            name=self.problem.name,
            limits=self.problem.limits,
            start=start,
            goal=goal,
            flight=replace(of_flight.flight, duration=self.duration),
            obstacles=tuple(delayed(obstacle, self.takeoff_time) for obstacle in self.obstacles),
        )

    def _orientations(self, ends: FlightState) -> list[Any]:
        """Orientations of the base at the jump's ends, as a problem has them."""
        orientations: list[Any] = ends.orientation.tolist()
        return orientations

    @property
    def phases(self) -> tuple[JumpPhase, ...]:
        """Phases in order of time."""
        if self.flight is None:
            return ()
        phases = []
        for piece in self.pieces:
            if isinstance(piece, TimedFlight):
                phases.append(JumpPhase("flight", (), piece.begin, piece.end))
            else:
                phases.append(JumpPhase("stance", names_of(piece.contacts), *piece.span))
        return tuple(phases)

    @cached_property
    @one_thread
    def warnings(self) -> tuple[PlanWarning, ...]:
        """What it does unrequested: its flights' warnings, and links that overlap at instants of it.

        None where there is no jump.
        """
        if self.flight is None:
            return ()
        others = []
        for number, flight in enumerate(self.flights):
            ignored = {"overlap"}
            if number:  # its orientations have the turns of the flights before
                ignored.add("turns")
            if self.request.rise:  # it is over two grounds
                ignored.add("ground")
            others += [warning for warning in flight.warnings if warning.kind not in ignored]
        return (*others, *overlap_warnings(self.problem, self.planned_positions, self.duration))

    def refuse_unless_ok(self, action: str) -> None:
        """Raise InputError where there is no jump to "fly", say."""
        if self.flight is None:
            reason = f"no jump was found, so there is nothing to {action}"
            advice = "plan it with other limits, durations or friction"
            raise InputError(reason, element="status", advice=advice)

    @one_thread
    def at(self, times: npt.ArrayLike) -> JumpState:
        """State at times (N,) s from the jump's start; at a change of contacts that of the phase before.

        Raises
        ------
        InputError
            A time is not a number or lies outside the jump; or there is no jump.
        """
        instants = np.atleast_1d(np.asarray(numbers(times, "times"), dtype=np.float64)).ravel()
        if self.flight is None:
            raise InputError("no jump was found", element="times")
        if not ((instants >= 0) & (instants <= self.duration)).all():
            raise InputError(f"a time lies outside the jump, [0, {self.duration:g}] s", element="times")
        phase_of = self._phase_of(instants)
        pieces = []
        for number, piece in enumerate(self.pieces):
            rows = np.flatnonzero(phase_of == number)
            if len(rows):
                state_at = piece.state if isinstance(piece, TimedFlight) else piece.at
                pieces.append((rows, state_at(instants[rows])))
        return joined(instants, self.problem.robot, pieces, names_of(self.contacts))

    def _phase_of(self, times: Array) -> IntArray:
        """Indices (N,) of the phases at times (N,), s; at a change of contacts that of the phase before."""
        ends = [phase.end for phase in self.phases]
        return np.searchsorted(ends[:-1], times)

    @one_thread
    def state(self, times: npt.ArrayLike) -> FlightState:
        """State at times (N,), s, in the quantities of a plan; errors as of :meth:`at`."""
        return self.state_of(self.at(times))

    def state_of(self, full: JumpState) -> FlightState:
        """A state of its robot in the quantities of a plan."""
        robot = self.robot
        tree = robot.tree
        orientation = full.positions[:, 2]
        orientation_rate = full.velocities[:, 2]
        positions, velocities, accelerations = full.planned(robot)[:, 1:].transpose(0, 2, 1)

        # The coordinates are of the base's origin; the centre of mass follows from where it sees that origin.
        weights = tree.point_weights(np.array([0]), np.array([0j]))[0]
        rotations = tree.rotations(tree.absolute_angles(orientation, positions))
        rotation_rates = 1j * tree.turn * (orientation_rate[:, None] + velocities @ tree.turns.T) * rotations
        base_from_com = rotations @ weights
        base_speed = rotation_rates @ weights

        momentum_map = self.dynamics.momentum_map(positions)
        return FlightState(
            times=full.times,
            orientation=orientation,
            orientation_rate=orientation_rate,
            positions=positions,
            velocities=velocities,
            accelerations=accelerations,
            torques=full.torques @ robot.selection,
            motor_torques=full.torques @ robot.transmission,
            com_position=full.positions[:, :2] - np.stack((base_from_com.real, base_from_com.imag), axis=1),
            com_velocity=full.velocities[:, :2] - np.stack((base_speed.real, base_speed.imag), axis=1),
            base_position=full.positions[:, :2],
            angular_momentum=momentum_map[:, 0] * orientation_rate + (momentum_map[:, 1:] * velocities).sum(axis=1),
        )

    def clearances(self, times: Array, obstacles: Sequence[Obstacle]) -> Array:
        """Least distance (N,), m, between any link and any of the obstacles that exist then; infinite without any."""
        segments = self.geometry.segments(self.geometry.locate(self.state(times)))
        return np.asarray(np.min([least_distances(segments, obstacle, times) for obstacle in obstacles], axis=0))

    @one_thread
    def planned_positions(self, times: Array) -> Array:
        """Planned positions (N, n), rad, at times (N,) s from the jump's start; there has to be a flight."""
        assert self.flight is not None
        phase_of = self._phase_of(times)
        positions = np.empty((len(times), len(self.problem.robot.joints)))
        for number, piece in enumerate(self.pieces):
            rows = np.flatnonzero(phase_of == number)
            if not len(rows):
                continue
            if isinstance(piece, TimedFlight):
                since = np.clip(times[rows] - piece.begin, 0.0, piece.plan.duration)
                positions[rows] = piece.plan.joint_motion(since)[0]
            else:
                positions[rows] = piece.joints(times[rows])
        return positions

    def full_motion(self, times: npt.ArrayLike) -> FullMotion:
        """Motion of every joint of the URDF, and of the base in space, at N times; errors as of :meth:`at`."""
        return FullMotion(self.problem.robot, self.at(times))

    def forces(self, times: npt.ArrayLike) -> dict[str, Array]:
        """Forces (..., 3), N, in the world's axes, of every point that stands at some time; zero where it does not."""
        plane = self.problem.robot.plane
        axes = np.stack((plane.horizontal, plane.vertical))
        in_plane = self.at(times).forces
        return {name: (force @ axes).reshape(*np.shape(times), 3) for name, force in in_plane.items()}

    def contact_points(self, times: npt.ArrayLike) -> dict[str, Array]:
        """Where those forces act (..., 3), m, in the world; NaN where the point is not in contact.

        Of a point it is the origin of its frame, of a foot that rolls the lowest point of its circle.
        """
        points = self.at(times).points
        return {name: point.reshape(*np.shape(times), 3) for name, point in points.items()}


def delayed(obstacle: Obstacle, delay: float) -> Obstacle:
    """Return the same obstacle for a clock that begins so many seconds earlier."""
    shift = delay * np.array(obstacle.velocity)
    points: dict[str, Any] = {}
    for name in obstacle.places():
        points[name] = tuple((getattr(obstacle, name) - shift).tolist())
    window = obstacle.window and (obstacle.window[0] + delay, obstacle.window[1] + delay)
    return replace(obstacle, **points, window=window)
