"""What pushes on the feet of a whole jump, as pictures and pages show it."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.jumps.check import LIGHT, JumpCheck
from floatplan.jumps.contacts import Contact
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.motion.dynamics import FlightState
from floatplan.plans.verdicts import Tone
from floatplan.problem.problem import Problem
from floatplan.view.style import CONTACTS, round_below

UNKNOWN = complex(np.nan, np.nan)
SAMPLES = 601  # [-] instants among which forces are largest
ARROW = 0.8  # [-] length of the largest force as drawn, over the greatest height of the centre of mass
CONE = 0.3  # [-] of a friction cone as drawn, over the same


@runtime_checkable
class CheckedJump(Protocol):
    """What a :class:`floatplan.Jump` has, and a jump that was flown has not: a check of its stances."""

    @property
    def check(self) -> JumpCheck:
        """What the check found."""

    @property
    def verdict(self) -> str:
        """What was found out, for a person."""

    @property
    def tone(self) -> Tone:
        """Whether that is good, bad or open."""


@dataclass(frozen=True, eq=False)
class Footing:
    """What a jump stands on, the forces there, and how they are drawn.

    Attributes
    ----------
    jump : JumpMotion
    contacts : what stands at some time, by the names of its points, in the order in which it comes
    times : (N,) s, even instants
    sizes : (N, contacts) N, of the forces then
    """

    jump: JumpMotion
    contacts: dict[str, Contact]
    times: Array
    sizes: Array

    @property
    def colours(self) -> dict[str, str]:
        """Of the contacts, by their names."""
        return {name: CONTACTS[index % len(CONTACTS)] for index, name in enumerate(self.contacts)}

    @property
    def metres_per_newton(self) -> float:
        """Of forces as drawn."""
        return ARROW * self.jump.height / float(self.sizes.max())

    @property
    def scale(self) -> str:
        """What forces and cones as drawn mean, for a person."""
        force = round_below(0.3 / self.metres_per_newton)
        friction = self.jump.request.friction
        return f"force: {force:g} N are {force * self.metres_per_newton:.2g} m; cone: friction {friction:g}"

    @property
    def cone(self) -> ComplexArray:
        """Corners (3,) of a friction cone as drawn, m, its tip at 0."""
        side = complex(self.jump.request.friction, 1.0)
        return np.array([0j, side, -side.conjugate()], np.complex128) / abs(side) * CONE * self.jump.height

    def forces(self, times: Array) -> ComplexArray:
        """Forces (N, contacts) N, of all points together, horizontal + i vertical; NaN where none acts."""
        return _forces(self.jump, self.contacts, times)

    def feet(self, times: Array) -> ComplexArray:
        """Places (N, contacts) m of where these forces act, between left and right; NaN where nothing stands."""
        plane = self.jump.robot.plane
        points = self.jump.at(times).points
        middles = np.stack([np.mean([points[name] for name in each.names], axis=0) for each in self.contacts.values()])
        return np.asarray(middles @ plane.horizontal + 1j * (middles @ plane.vertical)).T


@lru_cache(maxsize=8)
def footing(jump: JumpMotion) -> Footing:
    """Return what a jump stands on; there has to be a jump."""
    contacts = {" + ".join(contact.names): contact for stance in jump.stances for contact in stance.contacts}
    times = np.linspace(0.0, jump.duration, SAMPLES)
    return Footing(jump, contacts, times, np.abs(np.nan_to_num(_forces(jump, contacts, times))))


def _forces(jump: JumpMotion, contacts: dict[str, Contact], times: Array) -> ComplexArray:
    forces = {name: values @ [1, 1j] for name, values in jump.at(times).forces.items()}
    whole = np.stack([sum(forces[name] for name in each.names) for each in contacts.values()], axis=1)
    return np.where(whole == 0, UNKNOWN, whole)


def moments(jump: JumpMotion, flying: int = 2) -> Array:
    """Instants (4 + flying,), s: standing, the last push's largest force, some in flight, then the reverse."""
    standing = footing(jump)
    (takeoff, landing) = jump.flight_span
    times = standing.times
    force = standing.sizes.sum(axis=1)
    last_push = (jump.before[-1].span[0] < times) & (times < takeoff)
    first_fall = (landing < times) & (times < jump.after[0].span[1])
    before, after = (times[(stance * force).argmax()] for stance in (last_push, first_fall))
    return np.array([0.0, before, *np.linspace(takeoff, landing, flying + 2)[1:-1], after, jump.duration])


def efforts(jump: JumpMotion) -> dict[str, float]:
    """What the locked joints can hold, N m; infinite where the file does not say."""
    return {name: jump.robot.joint_tree.joint[name].effort for name in jump.robot.locked}


def jump_columns(jump: JumpMotion, state: FlightState) -> dict[str, Array]:
    """Sampled quantities (N,) by key, SI, at a state's times; those of contact, joint, motor, locked joint i end in .i.

    ``torque_use``, of a motor's limit or of its torque-speed curve, whichever is nearer, ``rate_use``, ``held_use``
    and ``friction`` are shares: 0 where nothing limits.
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
    columns = {f"{name}.{index}": column for name, table in tables.items() for index, column in enumerate(table.T)}
    return columns | {"com_height": state.com_position[:, 1] - jump.ground}


def limit_shares(problem: Problem, state: FlightState) -> tuple[Array, Array]:
    """Shares (N, motors) of limits on torque, or of torque-speed curves if these are nearer, and (N, joints) on rate.

    Signed as torques and rates are; 0 where nothing limits.
    """
    motors = state.motor_torques
    speeds = np.abs(state.velocities @ problem.robot.motor_ratios.T)
    of_curve = (np.abs(motors) + problem.motor_slope * speeds) / problem.motor_stall
    shares = np.sign(motors) * np.maximum(np.abs(motors) / problem.motor_torque_limits, of_curve)
    return shares, state.velocities / problem.velocity_limits
