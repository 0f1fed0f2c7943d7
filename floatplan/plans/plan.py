"""The answer, alive: a plan that is a motion, callable in time."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from floatplan.arguments import flag, function, made, optional, positive, text
from floatplan.arguments import path as as_path
from floatplan.arrays import Array, read_only
from floatplan.motion.dynamics import FlightState, Peaks
from floatplan.motion.planar.ballistics import ballistics
from floatplan.motion.planar.bounds import angular_momentum_interval
from floatplan.motion.planar.clearance import obstacle_distances
from floatplan.motion.quadrature import (
    NODE_COUNTS,
    chebyshev_nodes,
    extremes,
    gauss_legendre,
    largest_magnitudes,
    least_by_grids,
    resolution,
)
from floatplan.motion.sine_polynomial import SinePolynomials, basis
from floatplan.plans.contact import Contact, landing, takeoff
from floatplan.plans.measures import PlanWarning, Utilisation, measured_warnings, utilisation
from floatplan.plans.outputs import output
from floatplan.plans.planned_motion import PlannedMotion
from floatplan.plans.record import PlanRecord
from floatplan.plans.recorded_robot import robot_record
from floatplan.plans.verdicts import Certificate
from floatplan.pool.threads import one_thread
from floatplan.problem.file import problem_to_dict
from floatplan.problem.problem import Problem
from floatplan.robot.leak import leak_along
from floatplan.tables import JOINT_LIMITS, OBJECTIVE_TABLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONGEST_EXPLANATION = 300  # [characters] in a representation
PEAK_NODES = (33, 65, 129, 257)
PEAK_RESOLUTION = 1e-10  # tail of the Chebyshev coefficients of torques and rates, relative to the largest value


@dataclass(frozen=True, eq=False, repr=False)
class Plan(PlannedMotion):
    """A planned flight: a motion that can be evaluated at any time, and what was found out about it.

    Attributes
    ----------
    problem : Problem
    centre, amplitude : (n,) rad
    coefficients : (n, k+1)
        b of (12), powers of t in seconds.
    angular_momentum : kg m^2/s
    ballistics : Ballistics
    angular_momentum_bounds : (low, high) of (9), kg m^2/s
    status : "optimal", "feasible", "infeasible" or "interrupted", where Ctrl-C ended the search before a plan was found
    ok : whether every constraint holds
    explanation : sentences for a person
    solver : mapping
        What the search took and how it was told to: iterations, evaluations, seconds, seed, ...
    as_recorded : PlanRecord, optional
        The plan as data, where it was read from a file or checked; left out, ``record`` is measured.
    """

    angular_momentum_bounds: tuple[float, float]
    status: str
    ok: bool
    explanation: str
    solver: Mapping[str, Any]
    as_recorded: InitVar[PlanRecord | None] = None
    _recorded: PlanRecord | None = field(init=False, repr=False)
    _certificate: Certificate | None = field(init=False, repr=False)

    @classmethod
    def of_motion(
        cls,
        problem: Problem,
        polynomials: SinePolynomials,
        z: Array,
        angular_momentum: Array,
        coefficients: Array | None = None,
        **answer: Any,
    ) -> Plan:
        """Return the plan that moves as a search's motion.

        Parameters
        ----------
        problem : Problem
        polynomials : SinePolynomials
        z : (n, width) free coefficients
        angular_momentum : (1,) kg m^2/s
        coefficients : (n, k+1), optional
            b of (12), where they are known.
        answer : ``status``, ``ok``, ``explanation`` and ``solver``
        """
        return cls(
            **_motion(problem, polynomials, z, angular_momentum, coefficients),
            ballistics=ballistics(problem),
            angular_momentum_bounds=angular_momentum_interval(problem),
            **answer,
        )

    def moving_as(
        self, polynomials: SinePolynomials, z: Array, angular_momentum: Array, coefficients: Array | None = None
    ) -> Plan:
        """Return the plan with another motion, given as to :meth:`of_motion`."""
        return replace(self, **_motion(self.problem, polynomials, z, angular_momentum, coefficients))

    def __post_init__(self, as_recorded: PlanRecord | None) -> None:
        """Keep the record; ``dataclasses.replace`` drops it, since what it changes is another plan."""
        content = None if as_recorded is None else as_recorded.certificate
        object.__setattr__(self, "_recorded", as_recorded)
        object.__setattr__(self, "_certificate", None if content is None else Certificate.from_dict(content))

    @cached_property
    def _resolved(self) -> FlightState:
        """The state at as many Chebyshev nodes as torques and rates need."""
        for count in PEAK_NODES:
            state = self.at(chebyshev_nodes(count) * self.duration)
            if all(resolution(values) < PEAK_RESOLUTION for values in (state.motor_torques, state.velocities)):
                break
        return state

    @cached_property
    @one_thread
    def peaks(self) -> Peaks:
        """Largest torques and rates, the ranges of motion, and the least clearance, over all times."""
        state = self._resolved
        of_joints = [getattr(state, row.quantity) for row in JOINT_LIMITS]
        columns = [state.torques, state.motor_torques, *of_joints]
        largest, where = largest_magnitudes(np.concatenate(columns, axis=1))
        ends = np.cumsum([column.shape[1] for column in columns])[:-1]
        torque, motor_torque, *peaks = np.split(largest, ends)
        _, motor_instant, *instants = np.split(where * self.duration, ends)
        lowest, _, highest, _ = extremes(state.positions)
        return Peaks(
            joints={row.key: read_only(peak) for row, peak in zip(JOINT_LIMITS, peaks, strict=True)},
            joint_instants={row.key: read_only(when) for row, when in zip(JOINT_LIMITS, instants, strict=True)},
            torque=read_only(torque),
            clearance=self._least_clearance(),
            motor_torque=read_only(motor_torque),
            position=read_only(np.stack((lowest, highest), axis=1)),
            motor_torque_instant=read_only(motor_instant),
        )

    @cached_property
    @one_thread
    def holding_torques(self) -> Mapping[str, tuple[float, float]]:
        """Largest torque, N m (force, N, of a joint that slides), on each locked joint, and when, s."""
        state, robot = self._resolved, self.robot
        forces = self.dynamics.full_forces(
            state.positions, state.velocities, state.accelerations, state.orientation_rate
        )
        rows = [robot.model.getJointId(joint) - 1 for joint in robot.locked]
        largest, where = largest_magnitudes(forces[:, rows]) if rows else (np.empty(0), np.empty(0))
        pairs = zip(largest.tolist(), (where * self.duration).tolist(), strict=True)
        return MappingProxyType(dict(zip(robot.locked, pairs, strict=True)))

    @cached_property
    @one_thread
    def contacts(self) -> tuple[Contact, ...]:
        """The frames that leave and meet the ground, and the joint rates with which they would be at rest."""
        ends = (end(self.problem, self.angular_momentum) for end in (takeoff, landing))
        return tuple(contact for contact in ends if contact.found is not None)

    @cached_property
    @one_thread
    def warnings(self) -> tuple[PlanWarning, ...]:
        """What the motion does to the ground and to limits that is no part of the verdict."""
        return measured_warnings(self)

    @property
    def utilisation(self) -> tuple[Utilisation, ...]:
        """How much of its limits each motor uses, worst first."""
        return utilisation(self.problem, self.peaks)

    def _least_clearance(self) -> float | None:
        """Least of :meth:`clearances` over the flight."""
        ends = [time for obstacle in self.problem.obstacles for time in obstacle.window or ()]
        least = least_by_grids(self.clearances, self.duration, ends)[0] if self.problem.obstacles else np.inf
        return least if np.isfinite(least) else None

    @one_thread
    def least_height(self) -> tuple[float, float, str]:
        """Least height, m, of a link's surface over the ground's line; when, s; and which link's it is."""
        ground = self.problem.ground_plane
        height, instant = least_by_grids(lambda times: self.clearances(times, [ground]), self.duration, ())
        segments, shapes = self.segments(np.array([instant]), hulls=True), self.problem.ground_shapes
        distances = obstacle_distances(segments, ground, np.array([instant])).values[0]
        return height, instant, shapes[int(np.argmin(distances)) % len(shapes)].link

    @property
    def record(self) -> PlanRecord:
        """The plan as data: what :meth:`save` writes."""
        return self._measured_record if self._recorded is None else self._recorded

    @cached_property
    @one_thread
    def _measured_record(self) -> PlanRecord:
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
            motor_torque_peak=dict(zip(self.robot.motors, peaks.motor_torque.tolist(), strict=True)),
            warnings=tuple(warning.to_dict() for warning in self.warnings),
            utilisation=tuple(use.to_dict() for use in self.utilisation),
            out_of_plane_leak=self.out_of_plane_leak,
            floatplan=_version(),
            problem_file=self.problem.file_text,
        )

    @cached_property
    @one_thread
    def out_of_plane_leak(self) -> float:
        """Largest angular momentum that the motion makes out of the plane, over that in it."""
        state = self.at(chebyshev_nodes(PEAK_NODES[0]) * self.duration)
        return leak_along(self.robot, state.positions, state.velocities, state.orientation_rate, self.angular_momentum)

    @cached_property
    @one_thread
    def objective_value(self) -> float:
        """Value of the problem's objective, in the unit that the table of objectives gives."""
        quantity = OBJECTIVE_TABLE[self.problem.motion.objective].quantity
        if quantity is None:
            return float(np.linalg.norm(self.coefficients))
        quadrature = gauss_legendre(NODE_COUNTS[-1])
        integrand = getattr(self.at(quadrature.nodes * self.duration), quantity)
        return float(self.duration * (quadrature.weights @ (integrand**2).sum(axis=1)))

    @property
    def certificate(self) -> Certificate | None:
        """What was proved of the plan; None where nothing was."""
        return self._certificate

    def with_record(self, record: PlanRecord) -> Plan:
        """Return the same motion with what its checks found, and with the status that the record gives it."""
        plan = copy(self)  # with what was measured of the motion
        for name in ("status", "ok", "explanation"):
            object.__setattr__(plan, name, getattr(record, name))
        plan.__post_init__(record)
        return plan

    def __getstate__(self) -> dict[str, Any]:
        """A copy, so that other threads may go on computing while one pickles."""
        return dict(vars(self))

    def save(self, path: str | Path) -> Path:
        """Write the plan file, whole or not at all."""
        return self.record.save(as_path(path, "path"))

    def figures(self, compare: Plan | None = None) -> dict[str, Figure]:
        """Return the paper's figures, by name, as matplotlib figures; the curves of a plan to compare are dashed."""
        optional(made(Plan))(compare, "compare")
        found: dict[str, Figure] = output("figures")(self, compare=compare)
        return found

    def animate(
        self,
        path: str | Path = "flight.gif",
        *,
        speed: float = 0.5,
        progress: Callable[[int, int], None] | None = None,
    ) -> Path:
        """Write a film of the flight, ``.gif`` or ``.mp4``, and return its path.

        ``speed`` 0.5 is slow motion; ``progress`` is told how many pictures are drawn, and of how many.
        """
        path, speed = as_path(path, "path"), positive()(speed, "speed")
        progress = optional(function)(progress, "progress")
        return Path(output("animate")(self, path, speed=speed, progress=progress))

    def show(self, path: str | Path = "report.html", *, browse: bool = True) -> Path:
        """Write the report, a page that plays the flight, and open it in the browser unless ``browse`` is false."""
        browse = flag(browse, "browse")
        page = Path(output("write_report")(self, as_path(path, "path")))
        if browse:
            webbrowser.open(page.resolve().as_uri())
        return page

    def export(self, form: str, path: str | Path | None = None, rate: float | None = None) -> Path:
        """Write the plan in another format.

        Parameters
        ----------
        form : str
            "csv", "csv-full", "parquet", "npz", "pinocchio", "mujoco", "ros", "mcap" or "unitree"; see
            ``floatplan export --help``.
        path : path, optional
            The file; left out, the format's own name in the working directory.
        rate : float, optional
            Instants per second, Hz; left out, what suits the format.

        Raises
        ------
        InputError
            The format is unknown, or the rate is wrong.
        """
        path, rate = optional(as_path)(path, "path"), optional(positive(unit="Hz"))(rate, "rate")
        return Path(output("export")(self, text(form, "format"), path, rate))

    def __repr__(self) -> str:
        """A few lines: verdict, motion, peaks; nothing is computed for them that takes time."""
        proved = "" if self.certificate is None else f", {self.certificate.verdict}"
        return (
            f"Plan({self.status}{proved}, angular_momentum={self.angular_momentum:.6g} kg m^2/s,"
            f" degree {self.coefficients.shape[1] - 1})\n  {self.explanation[:LONGEST_EXPLANATION]}\n  {self.problem!r}"
        )

    def _repr_html_(self) -> str:
        """The report, as notebooks show it: it plays."""
        return str(output("notebook_frame")(self))


def _motion(
    problem: Problem, polynomials: SinePolynomials, z: Array, angular_momentum: Array, coefficients: Array | None
) -> dict[str, Any]:
    """The fields of a plan that are its motion's; its problem with the states at both ends that were chosen."""
    if problem.chooses_ends:
        ends = polynomials.motion(z, basis(polynomials.form).values(np.array([0.0, 1.0])))
        problem = problem.settled(ends.velocities, ends.accelerations)
    return {
        "problem": problem,
        "centre": read_only(polynomials.centre),
        "amplitude": read_only(polynomials.amplitude),
        "coefficients": read_only(polynomials.powers_of_seconds(z) if coefficients is None else coefficients),
        "angular_momentum": float(angular_momentum[0]),
    }


def _version() -> str:
    try:
        return version("floatplan")
    except PackageNotFoundError:
        return ""
