"""Closed loop: perturbed robots fly a plan by forward dynamics, with corrections in flight and without them.

At 1 kHz each motor gets the reference's feed-forward torque and joint feedback, held for the period, up to its effort.
At the rate of the corrections a :class:`~floatplan.inflight.replanner.Replanner` gets what was measured, late.
"""

import contextlib
import math
import time as clock
from collections import Counter
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arguments import SEED, Outlined, optional, positive, whole
from floatplan.arrays import Array, read_only
from floatplan.errors import FloatplanError, InputError
from floatplan.files import plain
from floatplan.inflight.replanner import Replanner
from floatplan.motion.flight import LinkShapes
from floatplan.plans.plan import Plan, given_plan
from floatplan.plans.planned_motion import least_distances
from floatplan.pool import one_thread
from floatplan.robot.planar.model import BASE_COORDINATES as BASE
from floatplan.simulation import forward
from floatplan.simulation.forward import Accelerations, Engine, State
from floatplan.simulation.perturbation import OF_JUMPS, Drawn, Perturbation, given_perturbation
from floatplan.simulation.recorded_motion import RecordedMotion, ReducedModel, reduced_model
from floatplan.simulation.takeoff import perturbed_takeoff
from floatplan.tables import Range

PERIOD = 1e-3  # [s] of the joints' control
PERTURBED = "h=10%,inertia=5%,noise=0.1deg,delay=5ms"
FLIGHTS = 20
MOST_FLIGHTS = 10_000
MOST_PERIODS = 100_000  # [-] of a flight
BUDGET = 60.0  # [s]
BETWEEN_LOOKS = 100  # [-] periods between looks at the clock
MOST_RATE = 1000.0  # [Hz] corrections: one each period of the joints' control
TRACED = 24  # [-] flights whose paths are kept
TRACE_STEP = 5  # [-] periods between the points of a path


@dataclass(frozen=True, eq=False, repr=False)
class Landings(Outlined):
    """How F flights ended.

    Attributes
    ----------
    orientation : (F,) rad
        Orientation at landing less the goal.
    joints : (F,) rad
        The largest error of a joint at landing.
    torque_peak : (F, m) N m
        Largest magnitude of each moving joint's torque, feedback and noise included.
    clearance : (F,) m
        Least distance to an obstacle or the asked ground; infinite without any.
    """

    orientation: Array
    joints: Array
    torque_peak: Array
    clearance: Array

    @property
    def touched(self) -> int:
        """Number of flights that touched an obstacle."""
        return int((self.clearance < 0).sum())

    def to_dict(self) -> dict[str, Any]:
        """Return the errors of all flights, their medians and the worst."""
        off = np.abs(self.orientation)
        clearance = self.clearance[np.isfinite(self.clearance)]
        return {
            "orientation_error": self.orientation,
            "orientation_error_median": float(np.median(off)),
            "orientation_error_worst": float(off.max()),
            "joint_error_worst": float(self.joints.max()),
            "joint_error": self.joints,
            "torque_peak_median": np.median(self.torque_peak, axis=0),
            "torque_peak_worst": self.torque_peak.max(axis=0),
            "clearance_min": float(clearance.min()) if clearance.size else None,
            "touched": self.touched,
        }


@dataclass(frozen=True, eq=False)
class Trace:
    """A flight's points: times (N,) s, orientation (N,) rad, positions (N, n) rad; of its corrections when and by what.

    ``corrections`` (C, 3): time, predicted miss at once (rad), and whether the motion was changed (1 or 0).
    """

    times: Array
    orientation: Array
    positions: Array
    corrections: Array


@dataclass(frozen=True, eq=False, repr=False)
class ClosedLoop(Outlined):
    """Result of :func:`closed_loop`.

    Attributes
    ----------
    engine, rate, seed, perturbation : as asked for; rate in Hz
    joints : names of the moving joints
    flights, asked : number of flights flown, and of those asked for: fewer where the budget ended
    corrected, uncorrected : Landings
        With corrections, and with the joints' control on the plan alone: the same robots, the same noise.
    statuses : how often a correction had which
    update_seconds : (U,) s
        Processor time of each call of ``update`` that corrected something.
    plan_torque_peak : (m,) N m of each moving joint
    effort : (m,) N m
        What its motor can; infinite where the URDF does not say.
    paths, uncorrected_paths : of the first flights
    seconds : s that all took
    """

    engine: Engine
    rate: float
    flights: int
    asked: int
    seed: int
    perturbation: Perturbation
    joints: tuple[str, ...]
    corrected: Landings
    uncorrected: Landings
    statuses: dict[str, int]
    update_seconds: Array
    plan_torque_peak: Array
    effort: Array
    paths: tuple[Trace, ...]
    uncorrected_paths: tuple[Trace, ...]
    seconds: float

    @property
    def touched(self) -> int:
        """Number of corrected flights that touched an obstacle."""
        return self.corrected.touched

    @property
    def update_milliseconds(self) -> tuple[float, float]:
        """Median and 99th percentile of the processor time of a correction, ms."""
        median, most = 1e3 * np.percentile(self.update_seconds, (50, 99)) if self.update_seconds.size else (0.0, 0.0)
        return float(median), float(most)

    def to_dict(self) -> dict[str, Any]:
        """Return what ``floatplan replay --replan --json`` prints."""
        facts: dict[str, Any] = plain(
            {
                "engine": self.engine,
                "replan": self.rate,
                "flights": self.flights,
                "asked": self.asked,
                "seed": self.seed,
                "perturbation": asdict(self.perturbation) | {"rate_noise": self.perturbation.noise_of_rates},
                "corrected": self.corrected.to_dict(),
                "uncorrected": self.uncorrected.to_dict(),
                "statuses": self.statuses,
                "update_milliseconds": dict(zip(("median", "p99"), self.update_milliseconds, strict=True)),
                "torque_joints": self.joints,
                "plan_torque_peak": self.plan_torque_peak,
                "seconds": self.seconds,
            }
        )
        return facts


@one_thread
def closed_loop(
    plan: Plan | str | Path,
    rate: float = 200.0,
    *,
    perturb: str | Perturbation = PERTURBED,
    flights: int = FLIGHTS,
    seed: int = 0,
    engine: Engine = "pinocchio",
    feedback: float = forward.BANDWIDTH,
    budget: float | None = BUDGET,
) -> ClosedLoop:
    """Fly perturbed robots, each with corrections in flight and without.

    Parameters
    ----------
    plan : Plan, or path of a plan file
    rate : float
        Corrections per second, Hz.
    perturb : str or Perturbation
    flights : int
    seed : int
        The same seed, the same flights.
    engine : "pinocchio" or "mujoco"
    feedback : float
        Bandwidth of the joints' control, rad/s.
    budget : float, optional
        Time, s, after which no more is flown: what is told is of the flights that ended in it. None: no end.

    Raises
    ------
    InputError
        The plan reaches no goal, a number is wrong, the flight takes more than ``MOST_PERIODS`` periods, or the engine
        is unknown or not installed.
    FloatplanError
        A flight cannot be integrated, or not one ended within the budget.
    """
    began = clock.perf_counter()
    forward.check_engine(engine)
    flights = whole(Range(1, MOST_FLIGHTS, ""))(flights, "flights")
    rate = positive(MOST_RATE, "Hz")(rate, "replan")
    feedback = positive(forward.FASTEST, "rad/s")(feedback, "feedback")
    seed, budget = SEED(seed, "seed"), optional(positive(unit="s"))(budget, "budget")
    perturbation = given_perturbation(perturb)
    perturbation.refuse(OF_JUMPS, "is for jumps")
    plan = given_plan(plan)
    if plan.duration > MOST_PERIODS * PERIOD:
        raise InputError(
            f"a flight of {plan.duration:g} s is too long for closed loops: at most {MOST_PERIODS * PERIOD:g} s"
        )
    loop = _Loop(plan, rate, perturbation, feedback, engine, math.inf if budget is None else began + budget)
    corrected: list[_Flight] = []
    uncorrected: list[_Flight] = []
    with contextlib.suppress(_OutOfTimeError):
        for flight in range(flights):
            pair = [loop.fly(seed, flight, correct) for correct in (True, False)]
            for ended, one in zip((corrected, uncorrected), pair, strict=True):
                ended.append(one)
    if not uncorrected:
        raise FloatplanError(
            f"not one flight ended within {budget:g} s: give it more time (budget), or fewer corrections a second"
        )
    return ClosedLoop(
        engine=engine,
        rate=rate,
        flights=len(uncorrected),
        asked=flights,
        seed=seed,
        perturbation=perturbation,
        joints=loop.reduced.joints,
        corrected=_landings(corrected),
        uncorrected=_landings(uncorrected),
        statuses=dict(sum((flight.statuses for flight in corrected), Counter[str]())),
        update_seconds=np.array([each for flight in corrected for each in flight.seconds]),
        plan_torque_peak=loop.plan_torque_peak,
        effort=loop.effort,
        paths=tuple(flight.path for flight in corrected[:TRACED]),
        uncorrected_paths=tuple(flight.path for flight in uncorrected[:TRACED]),
        seconds=clock.perf_counter() - began,
    )


class _OutOfTimeError(Exception):
    """The budget is over."""


@dataclass(frozen=True, eq=False)
class _Flight:
    """One row of :class:`Landings`, the path, how often a correction had which status, and the seconds of each."""

    orientation: float
    joints: float
    torque_peak: Array
    clearance: float
    path: Trace
    statuses: Counter[str]
    seconds: list[float]


def _held(accelerations: Accelerations, forces: Array, reduced: ReducedModel, _: float, q: Array, v: Array) -> Array:
    """Accelerations under forces that are held, less what the joints lose."""
    return accelerations(q, v, np.concatenate((forces[:BASE], forces[BASE:] - reduced.lost(v[BASE:]))))


def _landings(flights: list[_Flight]) -> Landings:
    return Landings(*(read_only([getattr(flight, row.name) for flight in flights]) for row in fields(Landings)))


class _Loop:
    """A plan, its controller, and the robots that fly it."""

    def __init__(
        self, plan: Plan, rate: float, perturbation: Perturbation, feedback: float, engine: Engine, deadline: float
    ) -> None:
        self.plan, self.perturbation, self.engine, robot = plan, perturbation, engine, plan.robot
        self.deadline = deadline
        self.replanner = Replanner(plan, rate)
        self.every = max(1, round(1 / (rate * PERIOD)))
        self.reduced = reduced_model(robot, plan.ballistics.gravity)
        start = RecordedMotion(plan.record, self.reduced).joints(0.0)
        self.gains = forward.critical_gains(feedback, forward.joint_inertia(self.reduced.model, start.positions))
        self.selection, self.resting = self.reduced.selection[BASE:], self.reduced.reference[BASE:]
        self.to_planned = np.linalg.pinv(self.selection)
        names = self.reduced.joints
        self.motors = np.array([[float(name == motor) for motor in robot.motors] for name in names])
        limits = dict(zip(robot.motors, robot.motor_torque_limits.tolist(), strict=True))
        self.effort = np.array([limits.get(name, np.inf) for name in names])
        self.plan_torque_peak = self.motors @ plan.peaks.motor_torque
        problem = plan.problem
        self.obstacles = [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]
        hulls = problem.ground_shapes if problem.ground else ()
        self.shapes = LinkShapes(robot.tree, robot.shapes, hulls) if self.obstacles else None
        self.base_weights = robot.tree.point_weights(np.array([0]), np.array([0j]))[0]

    def fly(self, seed: int, flight: int, correct: bool) -> _Flight:
        """Fly one robot."""
        drawn = self.perturbation.drawn(seed, flight, len(self.reduced.joints), self.reduced.model.njoints)
        true = drawn.perturbed(self.reduced.model)
        model = (true, true.createData())
        accelerations = forward.accelerations_of(self.engine, self.plan.robot, self.reduced, drawn)
        replanner, delay = self.replanner, round(self.perturbation.delay / PERIOD)
        replanner.reset()
        statuses, seconds = Counter[str](), list[float]()
        measured: list[dict[str, Any]] = []
        corrections: list[tuple[float, float, float]] = []
        states = [perturbed_takeoff(self.plan.record, self.reduced, drawn)]
        peak = np.zeros(len(self.reduced.joints))
        while (now := len(measured) * PERIOD) < replanner.landing - 1e-9:
            tick = len(measured)
            if tick % BETWEEN_LOOKS == 0:
                self._look_at_the_clock()
            measurement, angles, rates = self._measured(now, states[-1], drawn, model)
            measured.append(measurement)
            if correct and tick % self.every == 0 and tick >= delay:
                began = clock.process_time()
                correction = replanner.update(**measured[tick - delay], now=now)
                seconds.append(clock.process_time() - began)
                statuses[correction.status] += 1
                changed = correction.status in ("applied", "limited")
                corrections.append((now, correction.predicted_miss, float(changed)))
            torques = self._torques(now, angles, rates)
            peak = np.maximum(peak, np.abs(torques))
            forces = np.concatenate((np.zeros(BASE), drawn.torque * torques))
            held = partial(_held, accelerations, forces, self.reduced)
            states.append(forward.runge_kutta_step(held, states[-1], 0.0, min(PERIOD, replanner.landing - now)))
            if not np.isfinite(states[-1][0]).all():
                raise FloatplanError(f"the flight cannot be integrated: it diverged {now:.3g} s after takeoff")
        positions = np.array([state[0] for state in states])
        times = np.append(PERIOD * np.arange(len(measured)), replanner.landing)
        planned = (positions[:, BASE:] - self.resting) @ self.to_planned.T
        shown = np.append(np.arange(0, len(times) - 1, TRACE_STEP), len(times) - 1)
        goal, orientation, landing = self.plan.problem.final, positions[:, BASE - 1], positions[-1]
        return _Flight(
            orientation=float(landing[BASE - 1] - goal.orientation),
            joints=max(float(off.max(initial=0.0)) for off in self.reduced.off_goal(landing[BASE:], goal.positions)),
            torque_peak=peak,
            clearance=self._clearance(times, positions, planned),
            path=Trace(times[shown], orientation[shown], planned[shown], np.array(corrections).reshape(-1, 3)),
            statuses=statuses,
            seconds=seconds,
        )

    def _look_at_the_clock(self) -> None:
        if clock.perf_counter() > self.deadline:
            raise _OutOfTimeError

    def _measured(self, now: float, state: State, drawn: Drawn, model: Any) -> tuple[dict[str, Any], Array, Array]:
        """Arguments of ``update`` but for ``now``; then angles and rates (m,) of all joints."""
        positions, velocities = state
        noise = drawn.noise.standard_normal((2, len(self.reduced.joints) + 1))
        angles = positions[BASE - 1 :] + self.perturbation.noise * noise[0]
        rates = velocities[BASE - 1 :] + self.perturbation.noise_of_rates * noise[1]
        measurement = {
            "t": now,
            "orientation": angles[0],
            "orientation_rate": rates[0],
            "positions": self.to_planned @ (angles[1:] - self.resting),
            "velocities": self.to_planned @ rates[1:],
        }
        if self.perturbation.rise:
            measurement["com_position"] = self.reduced.axes @ pin.centerOfMass(*model, positions, velocities)
            measurement["com_velocity"] = self.reduced.axes @ model[1].vcom[0]
        return measurement, angles[1:], rates[1:]

    def _torques(self, now: float, angles: Array, rates: Array) -> Array:
        reference = self.replanner.reference(now)
        positions = self.resting + self.selection @ reference.positions
        velocities = self.selection @ reference.velocities
        feedback = self.gains[0] * (positions - angles) + self.gains[1] * (velocities - rates)
        wanted = self.motors @ reference.motors + self.reduced.lost(velocities) + feedback
        return np.asarray(np.clip(wanted, -self.effort, self.effort))

    def _clearance(self, times: Array, positions: Array, planned: Array) -> float:
        """Least distance of the real links to an obstacle, m."""
        if self.shapes is None:
            return np.inf
        tree = self.plan.robot.tree
        angles = tree.absolute_angles(positions[:, BASE - 1], planned)
        com = positions[:, 0] + 1j * positions[:, 1] - tree.rotations(angles) @ self.base_weights
        segments = self.shapes.place(com, angles)
        least = np.inf
        for obstacle in self.obstacles:
            self._look_at_the_clock()
            least = min(least, float(least_distances(segments, obstacle, times).min()))
        return least
