"""Forces on the feet during a whole jump, for pictures and pages."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import cycle
from typing import Protocol, runtime_checkable

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.jumps.check import LIGHT, JumpCheck
from floatplan.jumps.contacts import GroundContact
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.spatial.standing import Foot
from floatplan.motion.dynamics import FlightState
from floatplan.plans.trajectory import JumpPhase, Trajectory
from floatplan.plans.verdicts import Tone
from floatplan.problem.problem import Problem
from floatplan.robot.shapes.capsules import convex_hull
from floatplan.view.solids import CAMERA
from floatplan.view.style import PALETTE, round_below


def flies_in_space(motion: Trajectory) -> bool:
    """Whether a robot moves in space."""
    return motion.robot.in_plane is None


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
    contacts: dict[str, GroundContact | Foot]
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
    def axes(self) -> dict[str, Array]:
        """Axes (3,) of the world along which components of forces are listed, by the letters of their names."""
        if flies_in_space(self.jump):
            return dict(zip("xyz", np.eye(3), strict=True))
        plane = self.jump.robot.plane
        return {"x": plane.horizontal, "z": plane.vertical}

    @cached_property
    def cone_in_world(self) -> Array:
        """Corners (k, 3) of a friction cone in pictures, m: its rim, and the tip, which is at 0.

        It is as long as 0.3 of the greatest height of the centre of mass.
        """
        side = np.array([self.jump.request.friction, 1.0])
        radius, height = 0.3 * self.jump.height * side / np.linalg.norm(side)
        angles = np.linspace(0.0, 2 * np.pi, 33)  # of the rim's corners, the last on the first
        axes = self.axes
        across = np.cross(axes["z"], axes["x"])
        rim = np.outer(np.cos(angles), axes["x"]) + np.outer(np.sin(angles), across)
        return np.vstack((radius * rim + height * axes["z"], np.zeros(3)))

    @property
    def cone(self) -> ComplexArray:
        """Corners (k,) of a friction cone in pictures, m, its tip at 0."""
        return convex_hull(self.seen(self.cone_in_world))

    def seen(self, points: Array) -> ComplexArray:
        """Positions (...) in pictures of points (..., 3), m: in a plane horizontal + i vertical, else by the camera."""
        if flies_in_space(self.jump):
            return CAMERA(points)
        plane = self.jump.robot.plane
        return np.asarray(points @ plane.horizontal + 1j * (points @ plane.vertical))

    def forces_in_world(self, times: Array) -> Array:
        """Forces (N, contacts, 3) N, summed over the points of a contact; NaN where none acts."""
        return _forces(self.jump, self.contacts, times)

    def feet_in_world(self, times: Array) -> Array:
        """Positions (N, contacts, 3) m where these forces act, between left and right; NaN where nothing stands."""
        points = self.jump.at(times).points
        feet = np.empty((len(times), len(self.contacts), 3))
        for index, contact in enumerate(self.contacts.values()):
            feet[:, index] = np.mean([points[name] for name in contact.names], axis=0)
        return feet

    def forces(self, times: Array) -> ComplexArray:
        """The same forces (N, contacts) N, as they are seen in pictures."""
        return self.seen(self.forces_in_world(times))

    def feet(self, times: Array) -> ComplexArray:
        """The same positions (N, contacts) m, as they are seen in pictures."""
        return self.seen(self.feet_in_world(times))


@lru_cache(maxsize=8)
def footing(jump: JumpMotion) -> Footing:
    """Return what a jump stands on; there has to be a jump."""
    contacts: dict[str, GroundContact | Foot] = {}
    for stance in jump.stances:
        for contact in stance.contacts:
            contacts[" + ".join(contact.names)] = contact
    times = np.linspace(0.0, jump.duration, 601)  # forces are largest among 601 instants
    return Footing(jump, contacts, times, np.linalg.norm(np.nan_to_num(_forces(jump, contacts, times)), axis=2))


def _forces(jump: JumpMotion, contacts: dict[str, GroundContact | Foot], times: Array) -> Array:
    of_points = jump.forces(times)
    forces = np.zeros((len(times), len(contacts), 3))
    for index, contact in enumerate(contacts.values()):
        for name in contact.names:
            forces[:, index] += of_points[name]
    acts = forces.any(axis=2, keepdims=True)
    return np.where(acts, forces, np.nan)


def moments(jump: JumpMotion, flying: int = 2) -> Array:
    """Instants, s: standing; of each flight the last push's largest force and some in flight; the fall's; standing.

    There are 4 + ``flying`` of one flight, and 1 + ``flying`` more of each other one of a sequence.
    """
    standing = footing(jump)
    force = standing.sizes.sum(axis=1)

    def of_largest_force(phase: JumpPhase) -> float:
        inside = (phase.begin < standing.times) & (standing.times < phase.end)
        return float(standing.times[(inside * force).argmax()])

    phases = jump.phases
    flights = [index for index, phase in enumerate(phases) if phase.kind == "flight"]
    times = [0.0]
    for index in flights:
        times.append(of_largest_force(phases[index - 1]))
        times.extend(np.linspace(phases[index].begin, phases[index].end, flying + 2)[1:-1])
    times.append(of_largest_force(phases[flights[-1] + 1]))
    times.append(jump.duration)
    return np.array(times)


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
    forces = standing.forces_in_world(state.times)
    feet = standing.feet_in_world(state.times)
    torque_use, rate_use = limit_shares(problem, state)
    light = LIGHT * robot.mass * problem.flight.gravity
    axes = standing.axes
    vertical = forces @ axes["z"]
    horizontal = np.linalg.norm(forces - vertical[:, :, None] * axes["z"], axis=2)
    cones = jump.request.friction * np.where(vertical > light, vertical, np.nan)
    rows = [robot.model.idx_vs[robot.model.getJointId(name)] for name in robot.locked]
    tables = {
        "stands": np.where(np.isnan(vertical), np.nan, -np.arange(len(standing.contacts))),
        "friction": horizontal / cones,
        "torque_use": torque_use,
        "rate_use": rate_use,
        "held_use": jump.at(state.times).torques[:, rows] / [*efforts(jump).values()],
    }
    for letter, axis in axes.items():
        tables[f"foot_{letter}"] = feet @ axis
        tables[f"force_{letter}"] = forces @ axis
    columns: dict[str, Array] = {}
    for name, table in tables.items():
        add_columns(columns, name, table)
    columns["com_height"] = state.com_position[:, -1] - jump.ground
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
