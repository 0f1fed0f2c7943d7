"""Closed loop: perturbed robots fly a plan by forward dynamics, with corrections in flight and without them.

At 1 kHz each motor gets the reference's feed-forward torque and joint feedback, held for the period, up to its effort.
At the rate of the corrections a :class:`~floatplan.inflight.replanner.Replanner` gets what was measured, late.
"""

from __future__ import annotations

import contextlib
import math
import time as clock
from collections import Counter
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arguments import SEED, made, optional, positive, whole
from floatplan.arrays import Array, read_only
from floatplan.errors import FloatplanError, InputError
from floatplan.inflight.correction import Correction
from floatplan.inflight.replanner import Replanner
from floatplan.motion.planar.clearance import LinkShapes, obstacle_distances
from floatplan.plans.plan import Plan, given_plan
from floatplan.pool.threads import one_thread
from floatplan.robot.planar.model import BASE_COORDINATES as BASE
from floatplan.simulation.feedback import FASTEST, feedback_of
from floatplan.simulation.flights import ClosedLoop, Landings, Path
from floatplan.simulation.forward import (
    Accelerations,
    State,
    mujoco_accelerations,
    pinocchio_accelerations,
    runge_kutta_step,
)
from floatplan.simulation.mujoco_model import mujoco_model
from floatplan.simulation.perturbation import Drawn, Perturbation, parse_perturbation
from floatplan.simulation.recorded_motion import RecordedMotion, perturbed_takeoff
from floatplan.simulation.reduced_model import reduced_model
from floatplan.simulation.replay import Engine, check_engine
from floatplan.tables import Range

PERIOD = 1e-3  # [s] of the joints' control
BANDWIDTH = 100.0  # [rad/s] of their feedback
PERTURBED = "h=10%,inertia=5%,noise=0.1deg,delay=5ms"
FLIGHTS = 20
MOST_FLIGHTS = 10_000
MOST_PERIODS = 100_000  # [-] of a flight
BUDGET = 60.0  # [s]
BETWEEN_LOOKS = 100  # [-] periods between looks at the clock
MOST_RATE = 1000.0  # [Hz] corrections: one each period of the joints' control
TRACED = 24  # [-] flights whose paths are kept
TRACE_STEP = 5  # [-] periods between the points of a path


@one_thread
def closed_loop(
    plan: Plan | str | FilePath,
    rate: float = 200.0,
    *,
    perturb: str | Perturbation = PERTURBED,
    flights: int = FLIGHTS,
    seed: int = 0,
    engine: Engine = "pinocchio",
    feedback: float = BANDWIDTH,
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
    check_engine(engine)
    flights = whole(Range(1, MOST_FLIGHTS, ""))(flights, "flights")
    rate = positive(MOST_RATE, "Hz")(rate, "replan")
    feedback = positive(FASTEST, "rad/s")(feedback, "feedback")
    seed, budget = SEED(seed, "seed"), optional(positive(unit="s"))(budget, "budget")
    perturbation = parse_perturbation(perturb) if isinstance(perturb, str) else made(Perturbation)(perturb, "perturb")
    plan = given_plan(plan)
    if plan.duration > MOST_PERIODS * PERIOD:
        raise InputError(
            f"a flight of {plan.duration:g} s is too long for closed loops: at most {MOST_PERIODS * PERIOD:g} s"
        )
    loop = _Loop(plan, rate, perturbation, feedback, engine, math.inf if budget is None else began + budget)
    with_corrections: list[_Flown] = []
    without: list[_Flown] = []
    statuses, seconds = Counter[str](), list[float]()
    with contextlib.suppress(_OutOfTimeError):
        for flight in range(flights):
            corrected, tried, took = loop.fly(seed, flight, correct=True)
            without.append(loop.fly(seed, flight, correct=False)[0])
            with_corrections.append(corrected)
            statuses += tried
            seconds += took
    if not without:
        raise FloatplanError(
            f"not one flight ended within {budget:g} s: give it more time (budget), or fewer corrections a second"
        )
    return ClosedLoop(
        engine,
        rate,
        len(without),
        flights,
        seed,
        perturbation,
        loop.names,
        _gathered(with_corrections),
        _gathered(without),
        dict(statuses),
        np.array(seconds),
        loop.plan_torque_peak,
        loop.effort,
        tuple(flown.path for flown in with_corrections[:TRACED]),
        tuple(flown.path for flown in without[:TRACED]),
        clock.perf_counter() - began,
    )


class _OutOfTimeError(Exception):
    """The budget is over."""


@dataclass(frozen=True, eq=False)
class _Flown:
    orientation: float
    joints: float
    torque_peak: Array
    clearance: float
    path: Path


def _gathered(flown: list[_Flown]) -> Landings:
    return Landings(
        read_only([one.orientation for one in flown]),
        read_only([one.joints for one in flown]),
        read_only([one.torque_peak for one in flown]),
        read_only([one.clearance for one in flown]),
    )


def _held(accelerations: Accelerations, state: State, torques: Array, duration: float) -> State:
    """Where a state leads in a duration, s, under torques (m,) that are held."""
    forces = np.concatenate((np.zeros(BASE), torques))
    return runge_kutta_step(lambda _, q, v: accelerations(q, v, forces), state, 0.0, duration)


def _updated(replanner: Replanner, now: float, measured: tuple[Any, ...]) -> Correction:
    t, orientation, rate, positions, velocities, place, speed = measured[:7]
    return replanner.update(t, orientation, rate, positions, velocities, now, place, speed)


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
        self.nominal = RecordedMotion(plan.record, self.reduced)
        self.names = tuple(self.reduced.model.names)[BASE + 1 :]
        start = self.nominal.joints(0.0)
        self.control = feedback_of(self.reduced, start.positions, feedback)
        self.selection = self.reduced.selection[BASE:]
        self.resting = self.reduced.reference[BASE:]
        self.to_planned = np.linalg.pinv(self.selection)
        self.motors = np.array([[float(name == motor) for motor in robot.motors] for name in self.names])
        limits = dict(zip(robot.motors, robot.motor_torque_limits.tolist(), strict=True))
        self.effort = np.array([limits.get(name, np.inf) for name in self.names])
        self.plan_torque_peak = self.motors @ plan.peaks.motor_torque
        problem = plan.problem
        self.obstacles = [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]
        hulls = problem.ground_shapes if problem.ground else ()
        self.shapes = LinkShapes(robot.tree, robot.shapes, hulls) if self.obstacles else None
        self.base_weights = robot.tree.point_weights(np.array([0]), np.array([0j]))[0]

    def fly(self, seed: int, flight: int, correct: bool) -> tuple[_Flown, Counter[str], list[float]]:
        """Fly one robot; also how often a correction had which status, and the seconds that each took."""
        statuses, seconds = Counter[str](), list[float]()
        drawn = self.perturbation.drawn(seed, flight, len(self.names), self.reduced.model.njoints)
        true = drawn.perturbed(self.reduced.model)
        model = (true, true.createData())
        state = perturbed_takeoff(self.plan.record, self.reduced, drawn)
        accelerations = self._accelerations(drawn, true)
        replanner, delay = self.replanner, round(self.perturbation.delay / PERIOD)
        replanner.reset()
        measured: list[tuple[Any, ...]] = []
        states, corrections = [state], []
        peak = np.zeros(len(self.names))
        tick = 0
        while tick * PERIOD < replanner.landing - 1e-9:
            now = tick * PERIOD
            if tick % BETWEEN_LOOKS == 0:
                self._look_at_the_clock()
            measured.append(self._measurement(now, state, drawn, model))
            if correct and tick % self.every == 0 and tick >= delay:
                began = clock.process_time()
                correction = _updated(replanner, now, measured[tick - delay])
                seconds.append(clock.process_time() - began)
                statuses[correction.status] += 1
                changed = correction.status in ("applied", "limited")
                corrections.append((now, correction.predicted_miss, float(changed)))
            torques = self._torques(now, measured[-1])
            peak = np.maximum(peak, np.abs(torques))
            left = min(PERIOD, replanner.landing - now)
            state = _held(accelerations, state, drawn.torque * torques, left)
            if not np.isfinite(state[0]).all():
                raise FloatplanError(f"the flight cannot be integrated: it diverged {now:.3g} s after takeoff")
            states.append(state)
            tick += 1
        return self._ended(states, peak, corrections), statuses, seconds

    def _look_at_the_clock(self) -> None:
        if clock.perf_counter() > self.deadline:
            raise _OutOfTimeError

    def _accelerations(self, drawn: Drawn, true: Any) -> Accelerations:
        if self.engine == "pinocchio":
            return pinocchio_accelerations(true)
        return mujoco_accelerations(*mujoco_model(self.plan.robot, self.reduced, drawn.mass, drawn.inertia))

    def _measurement(self, now: float, state: tuple[Array, Array], drawn: Drawn, model: Any) -> tuple[Any, ...]:
        """Arguments of ``update`` but for ``now``; then positions and velocities of all joints."""
        positions, velocities = state
        size = len(self.names) + 1
        noise = drawn.noise.standard_normal((2, size))
        angles = positions[BASE - 1 :] + self.perturbation.noise * noise[0]
        rates = velocities[BASE - 1 :] + self.perturbation.noise_of_rates * noise[1]
        com: tuple[Array | None, Array | None] = (None, None)
        if self.perturbation.rise:
            place = pin.centerOfMass(*model, positions, velocities)
            com = (self.reduced.axes @ place, self.reduced.axes @ model[1].vcom[0])
        planned = self.to_planned @ (angles[1:] - self.resting)
        return now, angles[0], rates[0], planned, self.to_planned @ rates[1:], *com, angles[1:], rates[1:]

    def _torques(self, now: float, measured: tuple[Any, ...]) -> Array:
        reference = self.replanner.reference(now)
        positions = self.resting + self.selection @ reference.positions
        velocities = self.selection @ reference.velocities
        torques = self.motors @ reference.motors + self.control.torques(
            positions - measured[7], velocities - measured[8]
        )
        return np.clip(torques, -self.effort, self.effort)

    def _ended(
        self, states: list[tuple[Array, Array]], peak: Array, corrections: list[tuple[float, float, float]]
    ) -> _Flown:
        positions = np.array([state[0] for state in states])
        goal, landing = self.plan.problem.final, positions[-1]
        joints = np.abs(landing[BASE:] - self.resting - self.selection @ goal.positions).max()
        times = np.append(PERIOD * np.arange(len(states) - 1), self.replanner.landing)
        chosen = np.append(np.arange(0, len(states) - 1, TRACE_STEP), len(states) - 1)
        planned = (positions[:, BASE:] - self.resting) @ self.to_planned.T
        path = Path(
            times[chosen],
            positions[chosen, BASE - 1],
            planned[chosen],
            np.array(corrections).reshape(-1, 3),
        )
        return _Flown(
            float(landing[BASE - 1] - goal.orientation), float(joints), peak, self._clearance(times, positions), path
        )

    def _clearance(self, times: Array, positions: Array) -> float:
        """Least distance of the real links to an obstacle, m."""
        if self.shapes is None:
            return np.inf
        tree = self.plan.robot.tree
        planned = (positions[:, BASE:] - self.resting) @ self.to_planned.T
        angles = tree.absolute_angles(positions[:, BASE - 1], planned)
        com = positions[:, 0] + 1j * positions[:, 1] - tree.rotations(angles) @ self.base_weights
        segments = self.shapes.place(com, angles)
        least = np.inf
        for obstacle in self.obstacles:
            self._look_at_the_clock()
            low, high = obstacle.window or (-np.inf, np.inf)
            distances = obstacle_distances(segments, obstacle, times).values[(times >= low) & (times <= high)]
            least = min(least, float(distances.min(initial=np.inf)))
        return least
