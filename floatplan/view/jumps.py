"""Whole jumps as pictures and pages show them: with what these ask of a plan, and with what pushes on the feet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, BoolArray, ComplexArray
from floatplan.errors import InputError
from floatplan.motion.dynamics import FlightState
from floatplan.motion.planar.clearance import LinkShapes
from floatplan.motion.planar.full_model import PinocchioDynamics
from floatplan.plans.plan import Plan
from floatplan.plans.planned_motion import least_distances
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.stance.check import LIGHT, JumpCheck
from floatplan.stance.contacts import Contact
from floatplan.stance.jump_motion import JumpPhase
from floatplan.stance.motion import JumpState, Stance
from floatplan.view.style import CONTACTS

UNKNOWN = complex(np.nan, np.nan)
SAMPLES = 601  # [-] instants among which forces are largest
ARROW = 0.8  # [-] length of the largest force as drawn, over the greatest height of the centre of mass
CONE = 0.3  # [-] of a friction cone as drawn, over the same


class CheckedJump(Protocol):
    """A jump with its check: :class:`floatplan.stance.jump.Jump`, which knows the planner that pictures do not know."""

    @property
    def problem(self) -> Problem: ...  # noqa: D102
    @property
    def request(self) -> JumpRequest: ...  # noqa: D102
    @property
    def flight(self) -> Plan | None: ...  # noqa: D102
    @property
    def stances(self) -> tuple[Stance, ...]: ...  # noqa: D102
    @property
    def phases(self) -> tuple[JumpPhase, ...]: ...  # noqa: D102
    @property
    def takeoff_time(self) -> float: ...  # noqa: D102
    @property
    def duration(self) -> float: ...  # noqa: D102
    @property
    def ok(self) -> bool: ...  # noqa: D102
    @property
    def explanation(self) -> str: ...  # noqa: D102
    @property
    def verdict(self) -> str: ...  # noqa: D102
    @property
    def check(self) -> JumpCheck: ...  # noqa: D102
    def at(self, times: npt.ArrayLike) -> JumpState: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class JumpView:
    """A jump with the members that pictures use of a plan; its clock begins with the jump, that of obstacles too.

    Attributes
    ----------
    jump : Jump

    Raises
    ------
    InputError
        No jump was found, so that there is nothing to show.
    """

    jump: CheckedJump

    def __post_init__(self) -> None:
        """Refuse what has no motion."""
        if self.jump.flight is None:
            raise InputError(f"no jump was found, so there is nothing to show: {self.jump.explanation}")

    @property
    def flight(self) -> Plan:
        """The flight in its middle."""
        assert self.jump.flight is not None
        return self.jump.flight

    @property
    def robot(self) -> Robot:
        """The robot that jumps."""
        return self.jump.problem.robot

    @property
    def duration(self) -> float:
        """From standing to standing, s."""
        return self.jump.duration

    @cached_property
    def problem(self) -> Problem:
        """That of the flight, with the limits and obstacles of the jump."""
        asked = self.jump.problem
        obstacles = tuple(_later(each, self.jump.takeoff_time) for each in asked.obstacles)
        return replace(self.flight.problem, name=asked.name, limits=asked.limits, obstacles=obstacles)

    @cached_property
    def dynamics(self) -> PinocchioDynamics:
        """The robot's rigid-body dynamics."""
        return PinocchioDynamics(self.robot)

    @cached_property
    def contacts(self) -> dict[str, Contact]:
        """What stands at some time, by the names of its points, in the order in which it comes."""
        contacts = (contact for stance in self.jump.stances for contact in stance.contacts)
        return {" + ".join(contact.names): contact for contact in contacts}

    @property
    def colours(self) -> list[str]:
        """Of the contacts."""
        return [CONTACTS[index % len(CONTACTS)] for index in range(len(self.contacts))]

    @cached_property
    def flight_span(self) -> tuple[float, float]:
        """Takeoff and landing, s."""
        return next((phase.begin, phase.end) for phase in self.jump.phases if phase.kind == "flight")

    @cached_property
    def ground(self) -> float:
        """Height of the ground, m."""
        return min(stance.place.imag - stance.contacts[0].depth for stance in self.jump.stances)

    @cached_property
    def _largest(self) -> tuple[float, float, Array]:
        """Greatest height of the centre of mass, m, largest force on a contact, N, and the sum (N,) of all, N."""
        times = np.linspace(0.0, self.duration, SAMPLES)
        sizes = np.nan_to_num(np.abs(np.stack(list(self.forces(self.jump.at(times)).values()))))
        return float(self.com(times)[:, 1].max() - self.ground), float(sizes.max()), sizes.sum(axis=0)

    @property
    def largest(self) -> tuple[float, float]:
        """Greatest height of the centre of mass over the ground, m, and largest force, N, of all feet together."""
        return self._largest[0], float(self._largest[2].max())

    @property
    def metres_per_newton(self) -> float:
        """Of forces as drawn."""
        height, force, _ = self._largest
        return ARROW * height / force

    @property
    def cone(self) -> ComplexArray:
        """Corners (3,) of a friction cone as drawn, m, its tip at 0."""
        side = complex(self.jump.request.friction, 1.0)
        return np.array([0j, side, -side.conjugate()], np.complex128) / abs(side) * CONE * self._largest[0]

    def moments(self, flying: int = 2) -> Array:
        """Instants (4 + flying,), s: standing, largest force, some in flight, largest force again, standing."""
        times, sizes = np.linspace(0.0, self.duration, SAMPLES), self._largest[2]
        begin, end = self.flight_span
        pushes, catches = (np.where(side, sizes, -1.0).argmax() for side in (times < begin, times > end))
        flown = np.linspace(begin, end, flying + 2)[1:-1].tolist()
        return np.array([0.0, times[pushes], *flown, times[catches], self.duration])

    def at(self, times: npt.ArrayLike) -> FlightState:
        """State (N,) at times (N,), s, as a plan has it; the angular momentum is that about the centre of mass."""
        return self._state(self.jump.at(times))

    def _state(self, state: JumpState) -> FlightState:
        robot, tree = self.robot, self.robot.tree
        planned = np.linalg.pinv(robot.selection).T
        joints, rates = (state.positions - robot.reference) @ planned, state.velocities @ planned
        turned, base = state.velocities[:, 2], tree.point_weights(np.array([0]), np.array([0j]))[0]
        rotations = tree.rotations(tree.absolute_angles(state.positions[:, 2], joints))
        spun = 1j * tree.turn * (turned[:, None] + rates @ tree.turns.T) * rotations
        com, speed = (
            _planar(values[:, :2]) - arms @ base
            for values, arms in ((state.positions, rotations), (state.velocities, spun))
        )
        inertia = self.dynamics.momentum_map(joints)
        return FlightState(
            times=state.times,
            orientation=state.positions[:, 2],
            orientation_rate=turned,
            positions=joints,
            velocities=rates,
            accelerations=state.accelerations @ planned,
            torques=state.torques @ robot.selection,
            motor_torques=state.torques @ robot.transmission,
            com_position=np.stack((com.real, com.imag), axis=1),
            com_velocity=np.stack((speed.real, speed.imag), axis=1),
            base_position=state.positions[:, :2],
            angular_momentum=inertia[:, 0] * turned + np.einsum("ki,ki->k", inertia[:, 1:], rates),
        )

    def orientation(self, times: Array) -> Array:
        """Orientation (N,) rad at times (N,)."""
        return self.at(times).orientation

    def joint_motion(self, times: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities, accelerations (N, n) at times (N,)."""
        state = self.at(times)
        return state.positions, state.velocities, state.accelerations

    def com(self, times: Array) -> Array:
        """Centre of mass (N, 2) m at times (N,)."""
        return self.at(times).com_position

    def clearances(self, times: Array, obstacles: Sequence[Obstacle]) -> Array:
        """Least distance (N,) m between any link and any of the obstacles that exist then; infinite where none does."""
        state, shapes = self.at(times), LinkShapes(self.robot.tree, self.robot.shapes)
        angles = self.robot.tree.absolute_angles(state.orientation, state.positions)
        segments = shapes.place(_planar(state.com_position), angles)
        return reduce(np.minimum, (least_distances(segments, each, times) for each in obstacles))

    def forces(self, state: JumpState) -> dict[str, ComplexArray]:
        """Forces (N,) N of each contact, of all its points together, horizontal + i vertical; NaN where none stands."""
        forces = {name: _planar(values) for name, values in state.forces.items()}
        return {
            name: np.where(self._stands(contact, state.times), sum(forces[each] for each in contact.names), UNKNOWN)
            for name, contact in self.contacts.items()
        }

    def feet(self, times: Array) -> list[ComplexArray]:
        """Places (N,) m of each contact's first point at times (N,), standing or not: where its force acts."""
        tree, state = self.robot.tree, self.at(times)
        rotations = tree.rotations(tree.absolute_angles(state.orientation, state.positions))
        spots = [contact.spots[0] for contact in self.contacts.values()]
        weights = tree.point_weights(
            np.array([body for body, _ in spots]), np.array([place for _, place in spots], np.complex128)
        )
        return [*(_planar(state.com_position)[:, None] + rotations @ weights.T).T]

    def _stands(self, contact: Contact, times: Array) -> BoolArray:
        """Whether (N,) a contact stands at times (N,); at a change of contacts as in the phase before."""
        phases = self.jump.phases
        standing = np.array([contact.names[0] in phase.contacts for phase in phases])
        return np.asarray(standing[np.searchsorted([phase.end for phase in phases[:-1]], times)])

    def columns(self, times: Array) -> Mapping[str, Array]:
        """Sampled quantities (N,) of a jump beside those of a plan: forces, N, height, m, and shares of limits.

        ``force_x``, ``force_z`` and ``friction`` of contacts, ``torque_use`` and ``curve_use`` of motors, ``rate_use``
        of joints and ``held_use`` of locked ones, by index; 0 where nothing limits. Torques have their signs.
        """
        jump, problem, robot = self.jump.at(times), self.jump.problem, self.robot
        state = self._state(jump)
        found: dict[str, Any] = {"com_height": state.com_position[:, 1] - self.ground}
        least = LIGHT * robot.mass * problem.flight.gravity
        for index, force in enumerate(self.forces(jump).values()):
            found[f"force_x.{index}"], found[f"force_z.{index}"] = force.real, force.imag
            cone = self.jump.request.friction * np.where(force.imag > least, force.imag, np.nan)
            found[f"friction.{index}"] = np.abs(force.real) / cone
        motors = state.motor_torques
        speeds = np.abs(state.velocities @ robot.motor_ratios.T)
        uses = {
            "torque_use": motors / problem.motor_torque_limits,
            "curve_use": (np.abs(motors) + problem.motor_slope * speeds) / problem.motor_stall,
            "rate_use": state.velocities / problem.velocity_limits,
            "held_use": jump.torques[:, self.held_rows] / self.held_efforts,
        }
        return found | {f"{name}.{index}": each for name, use in uses.items() for index, each in enumerate(use.T)}

    @property
    def certificate(self) -> None:
        """Nothing is proved of all of a jump."""

    @cached_property
    def held_rows(self) -> list[int]:
        """Coordinates of the locked joints in ``robot.model``."""
        model = self.robot.model
        return [model.joints[model.getJointId(name)].idx_v for name in self.robot.locked]

    @property
    def held_efforts(self) -> Array:
        """What the locked joints can hold (l,), N m; infinite where the file does not say."""
        efforts = self.robot.model.effortLimit[self.held_rows]
        return np.where(efforts > 0, efforts, np.inf)


Shown: TypeAlias = Plan | JumpView


def _planar(values: Array) -> ComplexArray:
    return np.asarray(values[:, 0] + 1j * values[:, 1])


def _later(obstacle: Obstacle, delay: float) -> Obstacle:
    """The same obstacle for a clock that begins so many seconds earlier."""
    shift = delay * np.array(obstacle.velocity)
    places: dict[str, Any] = {name: tuple((getattr(obstacle, name) - shift).tolist()) for name in obstacle.places()}
    window = obstacle.window and (obstacle.window[0] + delay, obstacle.window[1] + delay)
    return replace(obstacle, **places, window=window)
