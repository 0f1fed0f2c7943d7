"""Forces on the feet during a whole jump, for pictures and pages."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import cycle
from typing import Protocol, runtime_checkable

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.jumps.check import LIGHT, JumpCheck
from floatplan.jumps.contacts import GroundContact
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.motion.dynamics import FlightState
from floatplan.plans.verdicts import Tone
from floatplan.problem.problem import Problem
from floatplan.view.style import PALETTE, round_below


@runtime_checkable
class CheckedJump(Protocol):
    """A :class:`floatplan.Jump`, whose stances have been checked; a simulated jump has no such check."""

    @property
    def check(self) -> JumpCheck:
        """The check of its stances."""

    @property
    def verdict(self) -> str:
        """The result of the check, for a person."""

    @property
    def tone(self) -> Tone:
        """Whether that is good, bad or open."""


@dataclass(frozen=True, eq=False)
class Footing:
    """What a jump stands on, the forces there, and their scale in pictures.

    Attributes
    ----------
    jump : JumpMotion
    contacts : by the names of their points, in the order of touching the ground
    times : (N,) s, even instants
    sizes : (N, contacts) N, of the forces then
    """

    jump: JumpMotion
    contacts: dict[str, GroundContact]
    times: Array
    sizes: Array

    @property
    def colours(self) -> dict[str, str]:
        """Of the contacts, by their names."""
        return dict(zip(self.contacts, cycle(PALETTE.contacts), strict=False))

    @property
    def metres_per_newton(self) -> float:
        """Scale of forces in pictures: the largest is 0.8 of the greatest height of the centre of mass."""
        return 0.8 * self.jump.height / float(self.sizes.max())

    @property
    def scale(self) -> str:
        """What the lengths of forces and the width of cones mean, for a person."""
        force = round_below(0.3 / self.metres_per_newton)
        friction = self.jump.request.friction
        return f"force: {force:g} N are {force * self.metres_per_newton:.2g} m; cone: friction {friction:g}"

    @property
    def cone(self) -> ComplexArray:
        """Corners (3,) of a friction cone in pictures, m, its tip at 0; 0.3 of the greatest height of the CM long."""
        side = complex(self.jump.request.friction, 1.0)
        return np.array([0j, side, -side.conjugate()], np.complex128) / abs(side) * 0.3 * self.jump.height

    def forces(self, times: Array) -> ComplexArray:
        """Forces (N, contacts) N, summed over the points of a contact, horizontal + i vertical; NaN where none acts."""
        return _forces(self.jump, self.contacts, times)

    def feet(self, times: Array) -> ComplexArray:
        """Positions (N, contacts) m where these forces act, between left and right; NaN where nothing stands."""
        plane = self.jump.robot.plane
        points = self.jump.at(times).points
        feet = np.empty((len(times), len(self.contacts)), dtype=np.complex128)
        for index, contact in enumerate(self.contacts.values()):
            middle = np.mean([points[name] for name in contact.names], axis=0)
            feet[:, index] = middle @ plane.horizontal + 1j * (middle @ plane.vertical)
        return feet


@lru_cache(maxsize=8)
def footing(jump: JumpMotion) -> Footing:
    """Return what a jump stands on; there has to be a jump."""
    contacts = {}
    for stance in jump.stances:
        for contact in stance.contacts:
            contacts[" + ".join(contact.names)] = contact
    times = np.linspace(0.0, jump.duration, 601)  # forces are largest among 601 instants
    return Footing(jump, contacts, times, np.abs(np.nan_to_num(_forces(jump, contacts, times))))


def _forces(jump: JumpMotion, contacts: dict[str, GroundContact], times: Array) -> ComplexArray:
    of_points = jump.at(times).forces
    forces = np.zeros((len(times), len(contacts)), dtype=np.complex128)
    for index, contact in enumerate(contacts.values()):
        for name in contact.names:
            forces[:, index] += of_points[name] @ [1, 1j]
    return np.where(forces == 0, complex(np.nan, np.nan), forces)


def moments(jump: JumpMotion, flying: int = 2) -> Array:
    """Instants (4 + flying,), s: standing, the last push's largest force, some in flight, then the reverse."""
    standing = footing(jump)
    takeoff, landing = jump.flight_span
    times = standing.times
    force = standing.sizes.sum(axis=1)
    last_push = (jump.before[-1].span[0] < times) & (times < takeoff)
    first_fall = (landing < times) & (times < jump.after[0].span[1])
    before = times[(last_push * force).argmax()]
    after = times[(first_fall * force).argmax()]
    return np.array([0.0, before, *np.linspace(takeoff, landing, flying + 2)[1:-1], after, jump.duration])


def efforts(jump: JumpMotion) -> dict[str, float]:
    """Largest torques of the locked joints, N m; infinite where the file names none."""
    return {name: jump.robot.joint_tree.joint[name].effort for name in jump.robot.locked}


def jump_columns(jump: JumpMotion, state: FlightState) -> dict[str, Array]:
    """Sampled quantities (N,) by key, SI, at a state's times; those of contact, joint, motor, locked joint i end in .i.

    ``torque_use``, of a motor's limit or of its torque-speed curve, whichever is nearer, ``rate_use``, ``held_use`` of
    locked joints and ``friction`` are shares: 0 where nothing limits.
    """
    standing = footing(jump)
    problem = jump.whole_problem
    robot = jump.robot
    forces = standing.forces(state.times)
    feet = standing.feet(state.times)
    torque_use, rate_use = limit_shares(problem, state)
    light = LIGHT * robot.mass * problem.flight.gravity
    cones = jump.request.friction * np.where(forces.imag > light, forces.imag, np.nan)
    rows = [robot.model.idx_vs[robot.model.getJointId(name)] for name in robot.locked]
    tables = {
        "stands": np.where(np.isnan(forces), np.nan, -np.arange(len(standing.contacts))),
        "foot_x": feet.real,
        "foot_z": feet.imag,
        "force_x": forces.real,
        "force_z": forces.imag,
        "friction": np.abs(forces.real) / cones,
        "torque_use": torque_use,
        "rate_use": rate_use,
        "held_use": jump.at(state.times).torques[:, rows] / [*efforts(jump).values()],
    }
    columns: dict[str, Array] = {}
    for name, table in tables.items():
        add_columns(columns, name, table)
    columns["com_height"] = state.com_position[:, 1] - jump.ground
    return columns


def add_columns(columns: dict[str, Array], name: str, table: Array) -> None:
    """Add the columns of a table (N, m) under ``name.0``, ``name.1``, ..."""
    for index, column in enumerate(table.T):
        columns[f"{name}.{index}"] = column


def limit_shares(problem: Problem, state: FlightState) -> tuple[Array, Array]:
    """Shares (N, motors) of limits on torque, or of torque-speed curves if these are nearer, and (N, joints) on rate.

    Signed as torques and rates are; 0 where nothing limits.
    """
    motors = state.motor_torques
    speeds = np.abs(state.velocities @ problem.robot.motor_ratios.T)
    of_curve = (np.abs(motors) + problem.motor_slope * speeds) / problem.motor_stall
    shares = np.sign(motors) * np.maximum(np.abs(motors) / problem.motor_torque_limits, of_curve)
    return shares, state.velocities / problem.velocity_limits
