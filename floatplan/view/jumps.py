"""Whole jumps as pictures and pages show them: with what these ask of a plan, and with what pushes on the feet."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import InputError
from floatplan.motion.dynamics import FlightState
from floatplan.motion.flight import LinkShapes, PinocchioDynamics
from floatplan.plans.measures import PlanWarning
from floatplan.plans.plan import Plan
from floatplan.plans.planned_motion import least_distances
from floatplan.plans.verdicts import Tone, verdict_in_words
from floatplan.problem.parts import Obstacle, Posture
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.stance.check import LIGHT, JumpCheck
from floatplan.stance.contacts import Contact
from floatplan.stance.jump_motion import JumpMotion
from floatplan.view.style import CONTACTS, round_below

UNKNOWN = complex(np.nan, np.nan)
SAMPLES = 601  # [-] instants among which forces are largest
ARROW = 0.8  # [-] length of the largest force as drawn, over the greatest height of the centre of mass
CONE = 0.3  # [-] of a friction cone as drawn, over the same


@dataclass(frozen=True, eq=False)
class JumpView:
    """A jump, and what was found out about it, with the members that pictures use of a plan.

    Its clock begins with the jump, that of its obstacles too. Raises :class:`InputError` where no jump was found.
    """

    jump: JumpMotion
    check: JumpCheck
    verdict: str
    certificate: ClassVar[None] = None  # of all of it: its flight has one

    def __post_init__(self) -> None:
        if self.jump.flight is None:
            raise InputError(f"{self.verdict}, so there is nothing to show")

    @property
    def flight(self) -> Plan:
        """The flight in its middle."""
        assert self.jump.flight is not None
        return self.jump.flight

    @property
    def tone(self) -> Tone:
        """Of the verdict."""
        flight = self.flight
        return verdict_in_words(flight.ok, flight.certificate, bool(self.warnings))[1] if self.check.ok else "bad"

    @property
    def warnings(self) -> tuple[PlanWarning, ...]:
        """What the jump does beside what was asked."""
        return self.jump.warnings

    @property
    def robot(self) -> Robot:
        """The robot that jumps."""
        return self.jump.problem.robot

    @property
    def duration(self) -> float:
        """From standing to standing, s."""
        return self.jump.duration

    @property
    def flown(self) -> tuple[float, float]:
        """Takeoff and landing, s."""
        return self.jump.takeoff_time, self.jump.takeoff_time + self.flight.duration

    @property
    def dynamics(self) -> PinocchioDynamics:
        """The robot's rigid-body dynamics."""
        return self.flight.in_plane.dynamics

    @cached_property
    def problem(self) -> Problem:
        """That of the flight, with name, limits and obstacles of the jump, its duration and its ends."""
        asked, found, ends = self.jump.problem, self.flight.problem, self.at([0.0, self.duration])
        within = np.clip(ends.positions, *found.position_limits.T)  # which robots that fall may leave
        start, goal = map(Posture, ends.orientation.tolist(), within)
        obstacles = tuple(_later(each, self.jump.takeoff_time) for each in asked.obstacles)
        flight = replace(found.flight, duration=self.duration)
        own = replace(found, name=asked.name, limits=asked.limits, start=start, goal=goal)
        return replace(own, flight=flight, obstacles=obstacles)

    @cached_property
    def contacts(self) -> dict[str, Contact]:
        """What stands at some time, by the names of its points, in the order in which it comes."""
        contacts = (contact for stance in self.jump.stances for contact in stance.contacts)
        return {" + ".join(contact.names): contact for contact in contacts}

    @property
    def colours(self) -> dict[str, str]:
        """Of the contacts, by their names."""
        return {name: CONTACTS[index % len(CONTACTS)] for index, name in enumerate(self.contacts)}

    @property
    def efforts(self) -> dict[str, float]:
        """What the locked joints can hold, N m; infinite where the file does not say."""
        return {name: self.robot.joint_tree.joint[name].effort for name in self.robot.locked}

    @property
    def ground(self) -> float:
        """Height of the ground, m."""
        return self.jump.ground

    @cached_property
    def samples(self) -> tuple[Array, Array, Array]:
        """Even instants (N,), s, heights (N,) of the centre of mass, m, and sizes (N, contacts) of forces, N."""
        times = np.linspace(0.0, self.duration, SAMPLES)
        return times, self.at(times).com_position[:, 1] - self.ground, np.abs(np.nan_to_num(self.forces(times)))

    @property
    def height(self) -> float:
        """Greatest height of the centre of mass over the ground, m."""
        return float(self.samples[1].max())

    @property
    def metres_per_newton(self) -> float:
        """Of forces as drawn."""
        return ARROW * self.height / float(self.samples[2].max())

    @property
    def scale(self) -> str:
        """What forces and cones as drawn mean, for a person."""
        force, friction = round_below(0.3 / self.metres_per_newton), self.jump.request.friction
        return f"force: {force:g} N are {force * self.metres_per_newton:.2g} m; cone: friction {friction:g}"

    @property
    def cone(self) -> ComplexArray:
        """Corners (3,) of a friction cone as drawn, m, its tip at 0."""
        side = complex(self.jump.request.friction, 1.0)
        return np.array([0j, side, -side.conjugate()], np.complex128) / abs(side) * CONE * self.height

    def moments(self, flying: int = 2) -> Array:
        """Instants (4 + flying,), s: standing, the last push's largest force, some in flight, then the reverse."""
        (times, _, sizes), (begin, end) = self.samples, self.flown
        push, fall = self.jump.before[-1].span[0], self.jump.after[0].span[1]
        stances = (push < times) & (times < begin), (end < times) & (times < fall)
        before, after = (times[(stance * sizes.sum(axis=1)).argmax()] for stance in stances)
        return np.array([0.0, before, *np.linspace(begin, end, flying + 2)[1:-1], after, self.duration])

    def at(self, times: npt.ArrayLike) -> FlightState:
        """State (N,) at times (N,), s, as a plan has it."""
        state, robot, tree = self.jump.at(times), self.robot, self.robot.tree
        base = tree.point_weights(np.array([0]), np.array([0j]))[0]
        joints, rates, changes = state.planned(robot)[:, 1:].transpose(0, 2, 1)
        orientation, turned = state.positions[:, 2], state.velocities[:, 2]
        rotations = tree.rotations(tree.absolute_angles(orientation, joints))
        spun = 1j * tree.turn * (turned[:, None] + rates @ tree.turns.T) * rotations
        arms, speeds = (np.stack((each.real, each.imag), axis=1) for each in (rotations @ base, spun @ base))
        inertia = self.dynamics.momentum_map(joints)
        return FlightState(
            *(state.times, orientation, turned, joints, rates, changes),
            *(state.torques @ robot.selection, state.torques @ robot.transmission),
            *(state.positions[:, :2] - arms, state.velocities[:, :2] - speeds, state.positions[:, :2]),
            inertia[:, 0] * turned + (inertia[:, 1:] * rates).sum(axis=1),
        )

    def clearances(self, times: Array, obstacles: Sequence[Obstacle]) -> Array:
        """Least distance (N,) m between any link and any of the obstacles that exist then; infinite where none does."""
        state, tree = self.at(times), self.robot.tree
        angles, com = tree.absolute_angles(state.orientation, state.positions), state.com_position @ [1, 1j]
        segments = LinkShapes(tree, self.robot.shapes).place(np.asarray(com, np.complex128), angles)
        return np.asarray(np.min([least_distances(segments, each, times) for each in obstacles], axis=0))

    def forces(self, times: Array) -> ComplexArray:
        """Forces (N, contacts) N, of all points together, horizontal + i vertical; NaN where none acts."""
        forces = {name: values @ [1, 1j] for name, values in self.jump.at(times).forces.items()}
        whole = np.stack([sum(forces[name] for name in each.names) for each in self.contacts.values()], axis=1)
        return np.where(whole == 0, UNKNOWN, whole)

    def feet(self, times: Array) -> ComplexArray:
        """Places (N, contacts) m of where these forces act, between left and right; NaN where nothing stands."""
        plane, points = self.robot.plane, self.jump.at(times).points
        middles = np.stack(
            [sum(points[name] for name in each.names) / len(each.names) for each in self.contacts.values()]
        )
        return np.asarray(middles @ plane.horizontal + 1j * (middles @ plane.vertical)).T

    def columns(self, times: Array) -> dict[str, Array]:
        """Sampled quantities (N,) by key, SI; those of contact, joint, motor or locked joint i end in ``.i``.

        ``torque_use``, of a motor's limit or of its torque-speed curve, whichever is nearer, ``rate_use``, ``held_use``
        and ``friction`` are shares: 0 where nothing limits.
        """
        jump, problem, robot = self.jump.at(times), self.problem, self.robot
        state, forces, feet = self.at(times), self.forces(times), self.feet(times)
        torque_use, rate_use = limit_shares(problem, state)
        light = LIGHT * robot.mass * problem.flight.gravity
        cones = self.jump.request.friction * np.where(forces.imag > light, forces.imag, np.nan)
        rows = [robot.model.idx_vs[robot.model.getJointId(name)] for name in robot.locked]
        columns = {
            "stands": np.where(np.isnan(forces), np.nan, -np.arange(len(self.contacts))),
            "foot_x": feet.real,
            "foot_z": feet.imag,
            "force_x": forces.real,
            "force_z": forces.imag,
            "friction": np.abs(forces.real) / cones,
            "torque_use": torque_use,
            "rate_use": rate_use,
            "held_use": jump.torques[:, rows] / [*self.efforts.values()],
        }
        found = {f"{name}.{index}": each for name, all_of in columns.items() for index, each in enumerate(all_of.T)}
        return found | {"com_height": state.com_position[:, 1] - self.ground}


Shown: TypeAlias = Plan | JumpView


def limit_shares(problem: Problem, state: FlightState) -> tuple[Array, Array]:
    """Shares (N, motors) of limits on torque, or of torque-speed curves if these are nearer, and (N, joints) on rate.

    Signed as torques and rates are; 0 where nothing limits.
    """
    motors, speeds = state.motor_torques, np.abs(state.velocities @ problem.robot.motor_ratios.T)
    of_curve = (np.abs(motors) + problem.motor_slope * speeds) / problem.motor_stall
    shares = np.sign(motors) * np.maximum(np.abs(motors) / problem.motor_torque_limits, of_curve)
    return shares, state.velocities / problem.velocity_limits


def _later(obstacle: Obstacle, delay: float) -> Obstacle:
    """The same obstacle for a clock that begins so many seconds earlier."""
    shift = delay * np.array(obstacle.velocity)
    places: dict[str, Any] = {name: tuple((getattr(obstacle, name) - shift).tolist()) for name in obstacle.places()}
    window = obstacle.window and (obstacle.window[0] + delay, obstacle.window[1] + delay)
    return replace(obstacle, **places, window=window)
