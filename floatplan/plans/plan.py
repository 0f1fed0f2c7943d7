"""A plan: the result of a search as a motion, callable in time; made by a search, or read from its file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import InitVar, dataclass, field
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from floatplan.arguments import attributes, in_line, in_short, made, optional
from floatplan.arguments import path as as_path
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, naming
from floatplan.motion.flight import Ballistics, Contact, landing, takeoff
from floatplan.motion.sine_polynomial import SinePolynomials, basis
from floatplan.plans.measures import PlanWarning, Utilisation, measured_warnings, utilisation
from floatplan.plans.outputs import Outputs, output
from floatplan.plans.planned_motion import PlannedMotion
from floatplan.plans.reading import check_meshes, load_record, recorded_robot, robot_record
from floatplan.plans.record import FORMAT, FORMAT_IN_SPACE, PlanRecord, check_requested
from floatplan.plans.verdicts import Certificate
from floatplan.pool import one_thread
from floatplan.problem.file import problem_from_dict, problem_to_dict
from floatplan.problem.problem import Problem
from floatplan.tables import JOINT_VALUES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAME = 1e-6  # [-] numbers that a file holds twice
IN_FILE = (  # fields that a plan file holds under the same names
    *("centre", "amplitude", "coefficients", "angular_momentum"),
    *("angular_momentum_bounds", "status", "ok", "explanation", "solver"),
)


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Outputs, PlannedMotion):
    """A planned flight: a motion that can be evaluated at any time, and the results of its checks.

    Attributes
    ----------
    problem : Problem
    centre, amplitude : (n,) rad
    coefficients : (n, k+1)
        b of (12), powers of t in seconds.
    angular_momentum : kg m^2/s; (3,) in space, in the world's axes
    ballistics : Ballistics
    angular_momentum_bounds : (low, high) of (9), kg m^2/s; None in space
    status : "optimal", "feasible", "infeasible" or "interrupted", where Ctrl-C stopped the search without a plan
    ok : whether every constraint holds
    explanation : sentences for a person
    solver : mapping
        What the search took and its options: iterations, evaluations, seconds, seed, ...
    as_recorded : PlanRecord, optional
        The plan as data, where it was read from a file or checked; left out, ``record`` is measured.
    """

    angular_momentum_bounds: tuple[float, float] | None
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
        **result: Any,
    ) -> Plan:
        """Return the plan that moves as a search's motion, with the states at both ends that were chosen.

        Parameters
        ----------
        problem : Problem
        polynomials : SinePolynomials
        z : (n, width) free coefficients
        angular_momentum : (1,) kg m^2/s, (3,) in space
        coefficients : (n, k+1), optional
            b of (12), where there are any.
        result : ``status``, ``ok``, ``explanation`` and ``solver``
        """
        if problem.chooses_ends:
            ends = polynomials.motion(z, basis(polynomials.form).values(np.array([0.0, 1.0])))
            problem = problem.settled(ends.velocities, ends.accelerations)
        if coefficients is None:
            coefficients = polynomials.powers_of_seconds(z)
        in_one_number = len(angular_momentum) == 1
        return cls(
            problem=problem,
            centre=read_only(polynomials.centre),
            amplitude=read_only(polynomials.amplitude),
            coefficients=read_only(coefficients),
            angular_momentum=float(angular_momentum[0]) if in_one_number else read_only(angular_momentum),
            ballistics=problem.path,
            angular_momentum_bounds=problem.angular_momentum_bounds,
            **result,
        )

    def moving_as(
        self, polynomials: SinePolynomials, z: Array, angular_momentum: Array, coefficients: Array | None = None
    ) -> Plan:
        """Return the plan with another motion, as to :meth:`of_motion`."""
        result = attributes(self, ("status", "ok", "explanation", "solver"))
        return Plan.of_motion(self.problem, polynomials, z, angular_momentum, coefficients, **result)

    def __post_init__(self, as_recorded: PlanRecord | None) -> None:
        """Keep the record; ``dataclasses.replace`` drops it, since what it changes is another plan."""
        content = None if as_recorded is None else as_recorded.certificate
        object.__setattr__(self, "_recorded", as_recorded)
        object.__setattr__(self, "_certificate", None if content is None else Certificate.from_dict(content))

    @cached_property
    @one_thread
    def contacts(self) -> tuple[Contact, ...]:
        """The frames that leave and meet the ground, and the joint rates with which they would be at rest.

        None in space, yet.
        """
        if self.robot.in_plane is None:
            return ()
        ends = (end(self.problem, self.angular_momentum) for end in (takeoff, landing))
        return tuple(contact for contact in ends if contact.found is not None)

    @cached_property
    @one_thread
    def warnings(self) -> tuple[PlanWarning, ...]:
        """What the motion does to the ground and to limits that does not belong to the verdict."""
        return measured_warnings(self, self.contacts)

    @property
    def utilisation(self) -> tuple[Utilisation, ...]:
        """How much of its limits each motor uses, worst first."""
        return utilisation(self.problem, self.peaks)

    @property
    def record(self) -> PlanRecord:
        """The plan as data: what :meth:`save` writes."""
        return self._measured_record if self._recorded is None else self._recorded

    @cached_property
    @one_thread
    def _measured_record(self) -> PlanRecord:
        peaks = self.peaks
        problem = self.problem
        return PlanRecord(
            **attributes(self, IN_FILE),
            problem=problem_to_dict(problem),
            robot=robot_record(self.robot),
            format=FORMAT if self.robot.in_plane else FORMAT_IN_SPACE,
            orientation=self.whole.orientation_at_ends,
            com=vars(self.ballistics),
            objective={"name": problem.motion.objective, "value": self.objective_value},
            torque_peak=peaks.torque,
            velocity_peak=peaks.velocity,
            clearance_min=peaks.clearance,
            motor_torque_peak=dict(zip(self.robot.motors, peaks.motor_torque.tolist(), strict=True)),
            warnings=tuple(warning.to_dict() for warning in self.warnings),
            utilisation=tuple(use.to_dict() for use in self.utilisation),
            out_of_plane_leak=self.out_of_plane_leak,
            floatplan=_version(),
            problem_file=problem.file_text,
        )

    @property
    def certificate(self) -> Certificate | None:
        """What was proved of the plan; None where nothing was."""
        return self._certificate

    def with_record(self, record: PlanRecord) -> Plan:
        """Return the same motion with the results of its checks, and with the status that the record gives it."""
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
        figure: dict[str, Figure] = output("figures")(self, compare=compare)
        return figure

    def __repr__(self) -> str:
        """A few lines: verdict, motion, peaks; nothing is computed for them that takes time."""
        proved = "" if self.certificate is None else f", {self.certificate.verdict}"
        return (
            f"Plan({self.status}{proved}, angular_momentum={in_line(self.angular_momentum, 6)} kg m^2/s,"
            f" degree {self.coefficients.shape[1] - 1})\n  {self.explanation[:300]}\n  {self.problem!r}"
        )


@cache
def _version() -> str:
    try:
        return version("floatplan")
    except PackageNotFoundError:
        return ""


@one_thread
def rebuild(record: PlanRecord, source: str | Path | None = None, urdf: str | Path | None = None) -> Plan:
    """Bring a record back to life; the URDF, elsewhere if ``urdf`` says so, must still be what it was.

    Raises
    ------
    InputError
        The URDF is missing or has changed, the record's problem does not fit it, or its certificate is none.
    """
    with naming(source):
        check_requested(record)
    robot = recorded_robot(record.robot, source, urdf)
    if record.asks_clearance:
        check_meshes(robot, record.robot, source)
    if (record.clearance_min is None) == bool(record.problem.get("obstacles")):
        fault = "is null although there are" if record.clearance_min is None else "is there without"
        raise InputError(f"{fault} obstacles", source=source, element="clearance_min")
    problem = problem_from_dict(dict(record.problem), robot, source, written=record.problem_file)
    com = record.com
    with naming(source):
        plan = Plan(
            problem=problem,
            ballistics=Ballistics(read_only(com["position0"]), read_only(com["velocity0"]), float(com["gravity"])),
            as_recorded=record,
            **attributes(record, IN_FILE),
        )
        if record.in_space:
            _check_stated(plan, record)
        return plan


def _check_stated(plan: Plan, record: PlanRecord) -> None:
    """Refuse what a file in space states of its motion where that is of another one."""
    problem = plan.problem
    peaks = plan.peaks
    h = plan.problem.flight.angular_momentum
    state = plan.at([0.0, plan.duration])
    at_ends: dict[str, dict[str, Array]] = {"start": {}, "goal": {}}
    for name in JOINT_VALUES:
        at_ends["start"][name], at_ends["goal"][name] = getattr(state, name)
    computed = {
        "problem": at_ends,
        "angular_momentum": record.angular_momentum if isinstance(h, str) else h,
        "com": vars(problem.path),
        "orientation": plan.whole.orientation_at_ends,
        "objective": {"value": plan.objective_value},
        "torque_peak": peaks.torque,
        "velocity_peak": peaks.velocity,
        "motor_torque_peak": dict(zip(plan.robot.motors, peaks.motor_torque, strict=True)),
    }
    for element in _unlike(vars(record), computed):
        raise InputError("is not that of the file's motion", element=element, advice="plan again")
    within_rates = (peaks.velocity <= problem.velocity_limits * (1 + SAME)).all()
    within_torques = (peaks.motor_torque <= problem.motor_torque_limits * (1 + SAME)).all()
    if record.ok and not (plan.whole.missed < SAME and within_rates and within_torques):
        raise InputError("is true, but the motion misses the goal or a limit", element="ok", advice="plan again")


def _unlike(stated: Any, computed: Mapping[str, Any], within: str = "") -> Iterator[str]:
    """Which numbers, by their keys, are not the computed ones; peaks are as near as a grid makes them."""
    for key, value in computed.items():
        element = within + key
        own = stated.get(key)
        if isinstance(value, Mapping):
            yield from _unlike(own or {}, value, f"{element}.")
        else:
            tolerance = 2e-3 if "peak" in element else SAME  # peaks are sampled on a grid
            if own is None or not np.allclose(own, value, rtol=tolerance, atol=SAME):
                yield element


def as_plan(plan: Plan | str | Path) -> Plan:
    """Return the plan that is a function's argument, or read its file; errors as :func:`load_plan`."""
    if isinstance(plan, Plan):
        return plan
    if not isinstance(plan, str | Path):
        raise InputError(f"{in_short(plan)} is neither a Plan nor the path of one", element="plan")
    return load_plan(plan)


@one_thread
def load_plan(path: str | Path, urdf: str | Path | None = None) -> Plan:
    """Read a plan file and the URDF that it names, or the same file elsewhere.

    Raises
    ------
    InputError
        Either is missing, damaged, or does not belong to the other.
    """
    path = as_path(path, "path")
    urdf = optional(as_path)(urdf, "urdf")
    return rebuild(load_record(path), path, urdf)
