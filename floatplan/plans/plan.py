"""The answer, alive: a plan that is a motion, callable in time."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import InitVar, dataclass, field
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.motion.extrema import chebyshev_nodes, extremes, largest_magnitudes, least_by_grids, resolution
from floatplan.motion.flight_state import FlightState, Peaks
from floatplan.motion.planar.ballistics import Ballistics
from floatplan.motion.planar.clearance import LinkShapes, Segments, obstacle_distances
from floatplan.motion.planar.free_flyer import free_flyer
from floatplan.motion.planar.full_motion import FullMotion
from floatplan.motion.planar.pinocchio_dynamics import PinocchioDynamics
from floatplan.motion.quadrature import NODE_COUNTS, GaussLegendre, gauss_legendre
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.plans.measures import PlanWarning, Utilisation, measured_warnings, utilisation
from floatplan.plans.outputs import output
from floatplan.plans.record import PlanRecord, load_record
from floatplan.plans.recorded_robot import check_meshes, recorded_robot, robot_record
from floatplan.plans.schema import check_asked
from floatplan.plans.verdicts import Certificate
from floatplan.problem.file import problem_from_dict, problem_to_dict
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.leak import leak_along
from floatplan.robot.robot import Robot
from floatplan.tables import JOINT_LIMITS, OBJECTIVE_TABLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PEAK_NODES = (33, 65, 129, 257)
PEAK_RESOLUTION = 1e-10  # tail of the Chebyshev coefficients of torques and rates, relative to the largest value
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
    solver : mapping
        What the search took and how it was told to: iterations, evaluations, seconds, seed, ...
    as_recorded : PlanRecord, optional
        The plan as data, where it was read from a file or checked; left out, ``record`` is measured.
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
    as_recorded: InitVar[PlanRecord | None] = None
    _recorded: PlanRecord | None = field(init=False, repr=False)
    _certificate: Certificate | None = field(init=False, repr=False)

    def __post_init__(self, as_recorded: PlanRecord | None) -> None:
        """Keep the record; ``dataclasses.replace`` drops it, since what it changes is another plan."""
        content = None if as_recorded is None else as_recorded.certificate
        object.__setattr__(self, "_recorded", as_recorded)
        object.__setattr__(self, "_certificate", None if content is None else Certificate.from_dict(content))

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
        try:
            instants = np.atleast_1d(np.asarray(times, dtype=np.float64)).ravel()
        except (TypeError, ValueError):
            raise InputError("a time is not a number", element="times") from None
        slack = 1e-12 * self.duration
        if not ((instants >= -slack) & (instants <= self.duration + slack)).all():
            raise InputError(f"a time lies outside the flight, [0, {self.duration}] s", element="times")
        positions, velocities, accelerations = self.joint_motion(instants)
        momentum_map = self.dynamics.momentum_map(positions)
        joint_part = np.einsum("ki,ki->k", momentum_map[:, 1:], velocities)
        rate = (self.angular_momentum - joint_part) / momentum_map[:, 0]
        orientation = self.orientation(instants)
        forces = self.dynamics.full_forces(positions, velocities, accelerations, rate)
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
            torques=read_only(forces @ self.robot.selection),
            motor_torques=read_only(forces @ self.robot.transmission),
            com_position=read_only(com),
            com_velocity=read_only(self.ballistics.velocities(instants)),
            base_position=read_only(com + np.stack((base.real, base.imag), axis=1)),
            angular_momentum=read_only(momentum_map[:, 0] * rate + joint_part),
        )

    def full_motion(self, times: npt.ArrayLike) -> FullMotion:
        """Motion of every joint that the URDF has, and of the base in space, at times (N,); errors as of :meth:`at`."""
        return FullMotion(self.dynamics, self.at(times), self.ballistics.gravity)

    def q(self, times: npt.ArrayLike) -> Array:
        """Configuration (nq,) or (N, nq), m and rad, in the order of the free-flyer model of the file itself.

        That is ``pin.buildModelFromUrdf(file, pin.JointModelFreeFlyer())``: place of the root link, quaternion x y z w,
        all joints (``continuous`` ones as cos, sin); see :mod:`floatplan.motion.planar.free_flyer` for the world's
        axes, for what that model makes of q, v, a and tau, and for joints that floatplan had to turn into the plane.

        Parameters
        ----------
        times : number or (N,)
            s, within the flight.

        Raises
        ------
        InputError
            As of :meth:`at`; or a joint is called ``root_joint``, as Pinocchio calls the free flyer.
        """
        return self._in_file(times, free_flyer(self.robot).configurations)

    def v(self, times: npt.ArrayLike) -> Array:
        """Velocity (nv,) or (N, nv), m/s and rad/s: of the base in its own axes, linear then angular, and of joints."""
        return self._in_file(times, free_flyer(self.robot).velocities)

    def a(self, times: npt.ArrayLike) -> Array:
        """Acceleration (nv,) or (N, nv), m/s^2 and rad/s^2: the derivative of :meth:`v`, gravity's included."""
        return self._in_file(times, free_flyer(self.robot).accelerations)

    def tau(self, times: npt.ArrayLike) -> Array:
        """Torques (nv,) or (N, nv), N m: 0 on the base, then each joint's own, also of coupled and locked ones."""
        return self._in_file(times, free_flyer(self.robot).torques)

    def _in_file(self, times: npt.ArrayLike, quantity: Callable[[FullMotion], Array]) -> Array:
        """A quantity (N, size) at times of any shape, in that shape."""
        values = quantity(self.full_motion(times))
        return values.reshape(*np.shape(times), values.shape[1])

    @cached_property
    def _resolved(self) -> FlightState:
        """The state at as many Chebyshev nodes as torques and rates need."""
        for count in PEAK_NODES:
            state = self.at(chebyshev_nodes(count) * self.duration)
            if all(resolution(values) < PEAK_RESOLUTION for values in (state.motor_torques, state.velocities)):
                break
        return state

    @cached_property
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
    def warnings(self) -> tuple[PlanWarning, ...]:
        """What the motion does to the ground and to the URDF's limits that is no part of the verdict."""
        return measured_warnings(self)

    @property
    def utilisation(self) -> tuple[Utilisation, ...]:
        """How much of its limits each motor uses, worst first."""
        return utilisation(self.problem, self.peaks)

    def clearances(self, times: npt.ArrayLike, obstacles: Sequence[Obstacle] | None = None) -> Array:
        """Least distance (N,) m between any link and any obstacle that exists then; infinite where none does.

        ``obstacles`` are those of the problem where left out.
        """
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64))
        segments = self._segments(instants)
        least = np.full(len(instants), np.inf)
        for obstacle in self.problem.obstacles if obstacles is None else obstacles:
            distance = obstacle_distances(segments, obstacle, instants).values.min(axis=1)
            low, high = obstacle.window or (-np.inf, np.inf)
            least = np.minimum(least, np.where((instants >= low) & (instants <= high), distance, np.inf))
        return least

    def _segments(self, instants: Array) -> Segments:
        """The links' shapes at instants (N,)."""
        positions, _, _ = self.joint_motion(instants)
        angles = self.robot.tree.absolute_angles(self.orientation(instants), positions)
        com = self.ballistics.positions(instants)
        return LinkShapes(self.robot.tree, self.robot.shapes).place(com[:, 0] + 1j * com[:, 1], angles)

    def _least_clearance(self) -> float | None:
        """Least of :meth:`clearances` over the flight."""
        ends = [time for obstacle in self.problem.obstacles for time in obstacle.window or ()]
        least = least_by_grids(self.clearances, self.duration, ends)[0] if self.problem.obstacles else np.inf
        return least if np.isfinite(least) else None

    def least_height(self) -> tuple[float, float, str]:
        """Least height, m, of a link's surface over the ground's line; when, s; and which link's it is."""
        ground = self.problem.ground_plane
        height, instant = least_by_grids(lambda times: self.clearances(times, [ground]), self.duration, ())
        distances = obstacle_distances(self._segments(np.array([instant])), ground, np.array([instant])).values[0]
        shapes = self.robot.shapes
        return height, instant, shapes[int(np.argmin(distances)) % len(shapes)].link

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

    @property
    def record(self) -> PlanRecord:
        """The plan as data: what :meth:`save` writes."""
        return self._measured_record if self._recorded is None else self._recorded

    @cached_property
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
        )

    @cached_property
    def out_of_plane_leak(self) -> float:
        """Largest angular momentum that the motion makes out of the plane, over that in it."""
        state = self.at(chebyshev_nodes(PEAK_NODES[0]) * self.duration)
        return leak_along(self.robot, state.positions, state.velocities, state.orientation_rate, self.angular_momentum)

    @cached_property
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
        return self.record.save(path)

    def figures(self, compare: Plan | None = None) -> dict[str, Figure]:
        """Return the paper's figures, by name, as matplotlib figures; the curves of a plan to compare are dashed."""
        found: dict[str, Figure] = output("figures")(self, compare=compare)
        return found

    def animate(self, path: str | Path = "flight.gif", *, speed: float = 0.5) -> Path:
        """Write a film of the flight, ``.gif`` or ``.mp4``, and return its path; ``speed`` 0.5 is slow motion."""
        return Path(output("animate")(self, path, speed=speed))

    def show(self, path: str | Path = "report.html", *, browse: bool = True) -> Path:
        """Write the report, a page that plays the flight, and open it in the browser unless ``browse`` is false."""
        page = Path(output("write_report")(self, path))
        if browse:
            webbrowser.open(page.resolve().as_uri())
        return page

    def export(self, form: str, path: str | Path | None = None, rate: float | None = None) -> Path:
        """Write the plan in another format: "csv", "npz", "ros", "mujoco" or "unitree".

        Parameters
        ----------
        form : str
        path : path, optional
            The file; left out, the format's own name in the working directory.
        rate : float, optional
            Instants per second, Hz; left out, what suits the format.

        Raises
        ------
        InputError
            The format is unknown, or the rate is wrong.
        """
        return Path(output("export")(self, form, path, rate))

    def _repr_html_(self) -> str:
        """The report, as notebooks show it: it plays."""
        return str(output("notebook_frame")(self))


def rebuild(record: PlanRecord, source: str | Path | None = None, urdf: str | Path | None = None) -> Plan:
    """Bring a record back to life; the URDF, elsewhere if ``urdf`` says so, must still be what it was.

    Raises
    ------
    InputError
        The URDF is missing or has changed, the record's problem does not fit it, or its certificate is none.
    """
    check_asked(record)
    robot = recorded_robot(record.robot, source, urdf)
    if record.asks_clearance:
        check_meshes(robot, record.robot, source)
    if (record.clearance_min is None) == bool(record.problem.get("obstacles")):
        reason = (
            "is null although there are obstacles" if record.clearance_min is None else "is given without obstacles"
        )
        raise InputError(reason, source=source, element="clearance_min")
    problem = problem_from_dict(dict(record.problem), robot, source)
    path = Ballistics(
        read_only(record.com["position0"]), read_only(record.com["velocity0"]), float(record.com["gravity"])
    )
    try:
        return Plan(
            problem=problem,
            centre=record.centre,
            amplitude=record.amplitude,
            coefficients=record.coefficients,
            angular_momentum=record.angular_momentum,
            angular_momentum_bounds=record.angular_momentum_bounds,
            ballistics=path,
            status=record.status,
            ok=record.ok,
            explanation=record.explanation,
            solver=record.solver,
            as_recorded=record,
        )
    except InputError as error:
        raise error.within(source=source) from None


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
