"""The answer, alive: a plan that is a motion, callable in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.motion.ballistics import Ballistics
from floatplan.motion.clearance import LinkShapes, obstacle_distances
from floatplan.motion.extrema import chebyshev_nodes, largest_magnitudes, resolution
from floatplan.motion.flight_state import FlightState, Peaks
from floatplan.motion.pinocchio_dynamics import PinocchioDynamics
from floatplan.motion.quadrature import NODE_COUNTS, GaussLegendre, gauss_legendre
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.plan_record import PlanRecord, load_record
from floatplan.problem import Problem
from floatplan.problem_file import problem_from_dict, problem_to_dict
from floatplan.recorded_robot import recorded_robot, robot_record
from floatplan.robot.planarity import leak_along
from floatplan.robot.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PEAK_NODES = (33, 65, 129, 257)
PEAK_RESOLUTION = 1e-10  # tail of the Chebyshev coefficients of torques and rates, relative to the largest value
CLEARANCE_GRID = 257  # instants of the first look for the least clearance
CLEARANCE_REFINEMENTS = 4  # times that the look at each candidate narrows, 8-fold each
RESOLVED = 1e-14  # tail of the Legendre coefficients of theta0', relative to the largest, that counts as none


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned flight: the motion ``q_i(t) = centre_i + amplitude_i sin(sum_k b_ik t^k)`` and what follows from it.

    Attributes
    ----------
    problem : Problem
    centre, amplitude : (n,) rad
    coefficients : (n, k+1)
        b of (12), powers of t in seconds.
    angular_momentum : kg m^2/s
    angular_momentum_bounds : (low, high) of (9)
    ballistics : path of the centre of mass
    status : "optimal", "feasible" or "infeasible"
    ok : whether every constraint holds
    explanation : sentences for a person
    solver : iterations, evaluations, seconds, seed, ...
    """

    problem: Problem
    centre: Array
    amplitude: Array
    coefficients: Array
    angular_momentum: float
    angular_momentum_bounds: tuple[float, float]
    ballistics: Ballistics
    status: str
    ok: bool
    explanation: str
    solver: Mapping[str, Any]

    @property
    def robot(self) -> Robot:
        """The robot that flies."""
        return self.problem.robot

    @cached_property
    def dynamics(self) -> PinocchioDynamics:
        """The robot's rigid-body dynamics."""
        return PinocchioDynamics(self.robot)

    @property
    def duration(self) -> float:
        """Flight time, s."""
        return float(self.problem.flight.duration)

    def __call__(self, times: npt.ArrayLike) -> FlightState:
        """Return the state at times; see :meth:`at`."""
        return self.at(times)

    def at(self, times: npt.ArrayLike) -> FlightState:
        """State of the robot at times (N,) or one time, s, within [0, duration].

        Raises
        ------
        InputError
            A time is not a number or lies outside the flight.
        """
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64)).ravel()
        slack = 1e-12 * self.duration
        if not ((instants >= -slack) & (instants <= self.duration + slack)).all():
            raise InputError(f"a time lies outside the flight, [0, {self.duration}] s", element="times")
        positions, velocities, accelerations = self.joint_motion(instants)
        momentum_map = self.dynamics.momentum_map(positions)
        joint_part = np.einsum("ki,ki->k", momentum_map[:, 1:], velocities)
        rate = (self.angular_momentum - joint_part) / momentum_map[:, 0]
        orientation = self.orientation(instants)
        com = self.ballistics.positions(instants)
        angles = self.robot.tree.absolute_angles(orientation, positions)
        base = self.robot.tree.rotations(angles) @ self.robot.tree.point_weights(np.array([0]), np.array([0j]))[0]
        return FlightState(
            times=read_only(instants),
            orientation=read_only(orientation),
            orientation_rate=read_only(rate),
            positions=read_only(positions),
            velocities=read_only(velocities),
            accelerations=read_only(accelerations),
            torques=read_only(self.dynamics.torques(positions, velocities, accelerations, rate)),
            com_position=read_only(com),
            com_velocity=read_only(self.ballistics.velocities(instants)),
            base_position=read_only(com + np.stack((base.real, base.imag), axis=1)),
            angular_momentum=read_only(momentum_map[:, 0] * rate + joint_part),
        )

    @cached_property
    def peaks(self) -> Peaks:
        """Largest torques and rates, and the least clearance, over all times."""
        for count in PEAK_NODES:
            state = self.at(chebyshev_nodes(count) * self.duration)
            values = np.concatenate((state.torques, state.velocities), axis=1)
            if resolution(state.torques) < PEAK_RESOLUTION and resolution(state.velocities) < PEAK_RESOLUTION:
                break
        largest = largest_magnitudes(values)
        n = len(self.robot.joints)
        return Peaks(read_only(largest[:n]), read_only(largest[n:]), self._least_clearance())

    def clearances(self, times: npt.ArrayLike) -> Array:
        """Least distance (N,) m between any link and any obstacle that exists then; infinite where none does."""
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64))
        positions, _, _ = self.joint_motion(instants)
        angles = self.robot.tree.absolute_angles(self.orientation(instants), positions)
        com = self.ballistics.positions(instants)
        segments = LinkShapes(self.robot.tree, self.robot.shapes).place(com[:, 0] + 1j * com[:, 1], angles)
        least = np.full(len(instants), np.inf)
        for obstacle in self.problem.obstacles:
            distance = obstacle_distances(segments, obstacle, instants).values.min(axis=1)
            low, high = obstacle.window or (-np.inf, np.inf)
            least = np.minimum(least, np.where((instants >= low) & (instants <= high), distance, np.inf))
        return least

    def _least_clearance(self) -> float | None:
        """Least of :meth:`clearances` over the flight: a grid, then ever finer grids about its lowest places."""
        if not self.problem.obstacles:
            return None
        ends = [time for obstacle in self.problem.obstacles for time in obstacle.window or ()]
        grid = np.unique(np.clip([*np.linspace(0, self.duration, CLEARANCE_GRID), *ends], 0, self.duration))
        values = self.clearances(grid)
        reach = self.duration / (CLEARANCE_GRID - 1)
        for _ in range(CLEARANCE_REFINEMENTS):
            padded = np.pad(values, 1, constant_values=np.inf)
            lowest = np.flatnonzero((values <= padded[:-2]) & (values <= padded[2:]) & np.isfinite(values))
            lowest = lowest[np.argsort(values[lowest])[:8]]
            near = grid[lowest][:, None] + reach * np.linspace(-1, 1, 17)
            grid = np.unique(np.concatenate((grid[lowest], np.clip(near, 0, self.duration).ravel())))
            values = self.clearances(grid)
            reach /= 8
        return float(values.min()) if np.isfinite(values.min()) else None

    def joint_motion(self, times: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities, accelerations (N, n) at times (N,)."""
        return self._written.at(times)

    @cached_property
    def _written(self) -> WrittenMotion:
        return WrittenMotion.from_powers(self.centre, self.amplitude, self.coefficients, self.duration)

    def orientation(self, times: Array) -> Array:
        """Orientation (N,) rad at times (N,), by (18)."""
        quadrature, rates = self._orientation_rates
        integrals = quadrature.integrals(times / self.duration) @ rates
        return np.asarray(self.problem.initial.orientation + self.duration * integrals)

    @cached_property
    def final_orientation(self) -> float:
        """Orientation at the end of the flight, rad."""
        quadrature, rates = self._orientation_rates
        return float(self.problem.initial.orientation + self.duration * (quadrature.weights @ rates))

    @cached_property
    def _orientation_rates(self) -> tuple[GaussLegendre, Array]:
        """Quadrature with as many nodes as theta0' needs, and theta0' (N,) at them."""
        for count in NODE_COUNTS:
            quadrature = gauss_legendre(count)
            positions, velocities, _ = self.joint_motion(quadrature.nodes * self.duration)
            rates = self.dynamics.base_rate(positions, velocities, self.angular_momentum)
            if quadrature.tail(rates) <= RESOLVED * max(float(np.abs(rates).max()), 1e-300):
                break
        return quadrature, rates

    @cached_property
    def record(self) -> PlanRecord:
        """The plan as data: what :meth:`save` writes."""
        peaks = self.peaks
        return PlanRecord(
            status=self.status,
            ok=self.ok,
            explanation=self.explanation,
            problem=problem_to_dict(self.problem),
            robot=robot_record(self.robot),
            angular_momentum=self.angular_momentum,
            angular_momentum_bounds=self.angular_momentum_bounds,
            centre=self.centre,
            amplitude=self.amplitude,
            coefficients=self.coefficients,
            orientation={
                "start": self.problem.initial.orientation,
                "end": self.final_orientation,
                "goal": self.problem.final.orientation,
            },
            com={
                "position0": self.ballistics.position0,
                "velocity0": self.ballistics.velocity0,
                "gravity": self.ballistics.gravity,
            },
            objective={"name": self.problem.motion.objective, "value": self.objective_value},
            torque_peak=peaks.torque,
            velocity_peak=peaks.velocity,
            clearance_min=peaks.clearance,
            solver=self.solver,
            out_of_plane_leak=self.out_of_plane_leak,
            floatplan=_version(),
        )

    @cached_property
    def out_of_plane_leak(self) -> float:
        """Largest angular momentum that the motion makes out of the plane, over that in it."""
        state = self.at(chebyshev_nodes(PEAK_NODES[0]) * self.duration)
        return leak_along(self.robot, state.positions, state.velocities, state.orientation_rate, self.angular_momentum)

    @cached_property
    def objective_value(self) -> float:
        """|b| of (17), or the integral of squared torques (N^2 m^2 s) or accelerations (rad^2/s^3)."""
        if self.problem.motion.objective == "coefficients":
            return float(np.linalg.norm(self.coefficients))
        quadrature = gauss_legendre(NODE_COUNTS[-1])
        state = self.at(quadrature.nodes * self.duration)
        integrand = state.torques if self.problem.motion.objective == "torque" else state.accelerations
        return float(self.duration * (quadrature.weights @ (integrand**2).sum(axis=1)))

    @property
    def certificate(self) -> Mapping[str, Any] | None:
        """What was proved of the plan, as the plan file holds it; None where nothing was."""
        record = vars(self).get("record")
        return None if record is None else record.certificate

    def with_record(self, record: PlanRecord) -> Plan:
        """Return the same motion with what its checks found, and with the status that the record gives it."""
        plan = replace(self, status=record.status, ok=record.ok, explanation=record.explanation)
        known = {name: value for name, value in vars(self).items() if name not in vars(plan)}
        vars(plan).update(known, record=record)
        return plan

    def save(self, path: str | Path) -> Path:
        """Write the plan file, whole or not at all."""
        return self.record.save(path)

    def figures(self, compare: Plan | None = None) -> dict[str, Figure]:
        """Return the paper's figures, by name, as matplotlib figures; the curves of a plan to compare are dashed."""
        from floatplan.view.figures import figures

        return figures(self, compare=compare)

    def animate(self, path: str | Path = "flight.gif", *, speed: float = 0.5) -> Path:
        """Write a film of the flight, ``.gif`` or ``.mp4``, and return its path; ``speed`` 0.5 is slow motion."""
        from floatplan.view.animation import animate

        return animate(self, path, speed=speed)

    def _repr_html_(self) -> str:
        """The report, as notebooks show it: it plays."""
        from floatplan.view.report import notebook_frame

        return notebook_frame(self)


def rebuild(record: PlanRecord, source: str | Path | None = None, urdf: str | Path | None = None) -> Plan:
    """Bring a record back to life; the URDF, elsewhere if ``urdf`` says so, must still be what it was.

    Raises
    ------
    InputError
        The URDF is missing or has changed, or the record's problem does not fit it.
    """
    robot = recorded_robot(record.robot, source, urdf)
    plan = Plan(
        problem=problem_from_dict(dict(record.problem), robot, source),
        centre=record.centre,
        amplitude=record.amplitude,
        coefficients=record.coefficients,
        angular_momentum=record.angular_momentum,
        angular_momentum_bounds=record.angular_momentum_bounds,
        ballistics=Ballistics(
            read_only(record.com["position0"]), read_only(record.com["velocity0"]), float(record.com["gravity"])
        ),
        status=record.status,
        ok=record.ok,
        explanation=record.explanation,
        solver=record.solver,
    )
    plan.__dict__["record"] = record
    return plan


def load_plan(path: str | Path, urdf: str | Path | None = None) -> Plan:
    """Read a plan file and the URDF that it names, or another place of the same file.

    Raises
    ------
    InputError
        Either is missing, damaged, or does not belong to the other.
    """
    return rebuild(load_record(path), path, urdf)


def _version() -> str:
    try:
        return version("floatplan")
    except PackageNotFoundError:
        return ""
