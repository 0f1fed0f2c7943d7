"""Closed loop: perturbed robots fly a plan by forward dynamics, with corrections in flight and without them."""

import contextlib
import math
import time as clock
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from floatplan.arguments import SEED, optional, positive, whole
from floatplan.arrays import Array
from floatplan.errors import FloatplanError, InputError
from floatplan.inflight.replanner import Replanner
from floatplan.motion.dynamics import PlacedShapes
from floatplan.motion.flight import LinkShapes
from floatplan.motion.spatial.clearance import shapes_in_space
from floatplan.motion.spatial.kinematics import poses_about
from floatplan.plans.plan import Plan, as_plan
from floatplan.plans.planned_motion import least_distances
from floatplan.pool import one_thread
from floatplan.simulation.base_states import base_states
from floatplan.simulation.control_loop import Corrections, JointControl, Motors, Sensors
from floatplan.simulation.engines import FlyingRobot, check_engine, flying_robot
from floatplan.simulation.gains import BANDWIDTH, FASTEST, critical_gains, joint_inertia
from floatplan.simulation.integration import State, runge_kutta_step
from floatplan.simulation.limits import BUDGET, MOST_FLIGHTS, MOST_PERIODS
from floatplan.simulation.perturbation import WITH_CONTACT, Perturbation, given_perturbation
from floatplan.simulation.reduced_model import ReducedModel, reduced_model
from floatplan.simulation.results import ClosedLoop, PlanLandings, SimulatedRun, Trace
from floatplan.simulation.spatial_motion import perturbed_takeoff, plan_file_motion
from floatplan.tables import Engine, Range

PERIOD = 1e-3  # [s] of the joints' control


@one_thread
def closed_loop(
    plan: Plan | str | Path,
    rate: float = 200.0,
    *,
    perturb: str | Perturbation = "h=10%,inertia=5%,noise=0.1deg,delay=5ms",
    flights: int = 20,
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
        Corrections per second, Hz, at most: they are whole periods of 1 ms apart.
    perturb : str or Perturbation
    flights : int
    seed : int
        The same seed, the same flights.
    engine : "pinocchio" or "mujoco"
    feedback : float
        Bandwidth of the joints' control, rad/s.
    budget : float, optional
        Time, s, after which no flight goes on: results are of the flights that landed before. None: no end.

    Raises
    ------
    InputError
        The plan reaches no goal or is too long, a number is wrong, or the engine is unknown or not installed.
    FloatplanError
        A flight cannot be integrated, or not one landed within the budget.
    """
    start_time = clock.perf_counter()
    check_engine(engine)
    flights = whole(Range(1, MOST_FLIGHTS, ""))(flights, "flights")
    rate = positive(1 / PERIOD, "Hz")(rate, "replan")
    feedback = positive(FASTEST, "rad/s")(feedback, "feedback")
    seed = SEED(seed, "seed")
    budget = optional(positive(unit="s"))(budget, "budget")
    perturbation = given_perturbation(perturb)
    perturbation.refuse(WITH_CONTACT, "is for jumps")
    plan = as_plan(plan)
    most = MOST_PERIODS * PERIOD
    if plan.duration > most:
        raise InputError(f"a flight of {plan.duration:g} s is too long for closed loops: at most {most:g} s")
    deadline = math.inf if budget is None else start_time + budget
    loop = _Loop(plan, rate, perturbation, feedback, engine, deadline)
    shown = 24  # flights whose paths are in the result
    corrected: list[SimulatedRun[Trace]] = []
    uncorrected: list[SimulatedRun[Trace]] = []
    with contextlib.suppress(_OutOfTimeError):
        for flight in range(flights):
            with_corrections = loop.fly(seed, flight, correct=True)
            uncorrected.append(loop.fly(seed, flight, correct=False))
            corrected.append(with_corrections)
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
        corrected=PlanLandings.of([run.landing for run in corrected]),
        uncorrected=PlanLandings.of([run.landing for run in uncorrected]),
        statuses=dict(sum((flight.statuses for flight in corrected), Counter[str]())),
        update_seconds=np.concatenate([flight.seconds for flight in corrected]),
        plan_torque_peak=loop.plan_torque_peak,
        effort=loop.motors.effort,
        paths=tuple(flight.motion for flight in corrected[:shown]),
        uncorrected_paths=tuple(flight.motion for flight in uncorrected[:shown]),
        seconds=clock.perf_counter() - start_time,
    )


class _OutOfTimeError(Exception):
    """The budget is over."""


class _Loop:
    """A plan, its control, and the robots that fly it."""

    def __init__(
        self, plan: Plan, rate: float, perturbation: Perturbation, feedback: float, engine: Engine, deadline: float
    ) -> None:
        self.plan = plan
        self.perturbation = perturbation
        self.engine = engine
        self.deadline = deadline
        self.replanner = Replanner(plan, rate)
        self.reduced = reduced_model(plan.robot, plan.ballistics.gravity)
        self.base = base_states(self.reduced)
        self.goal = self.base.goal(plan.problem)
        start = plan_file_motion(plan.record, self.reduced).joints(0.0)
        self.gains = critical_gains(feedback, joint_inertia(self.reduced.model, start.positions))
        robot = plan.robot
        names = self.reduced.joints
        self.motor_columns = (np.array(names)[:, None] == np.array(robot.motors)).astype(np.float64)
        limits = dict(zip(robot.motors, robot.motor_torque_limits.tolist(), strict=True))
        unlimited = np.full(len(names), np.inf)
        self.motors = Motors(
            effort=np.array([limits.get(name, np.inf) for name in names]), stall=unlimited, slope=np.zeros(len(names))
        )
        self.plan_torque_peak = self.motor_columns @ plan.peaks.motor_torque

    def fly(self, seed: int, number: int, correct: bool) -> SimulatedRun[Trace]:
        """Fly one robot."""
        reduced = self.reduced
        sample = self.perturbation.sampled(seed, number, len(reduced.joints), reduced.model.njoints)
        true = sample.perturbed(reduced.model)
        data = true.createData()

        def measured_com(state: Array, measured: Array) -> tuple[Array, Array]:
            """The exact centre of mass of the real robot: noise and wrong masses are left out."""
            position = reduced.axes @ pin.centerOfMass(true, data, *self.base.parts(state))
            return position, reduced.axes @ data.vcom[0]

        # Of all that is perturbed, the rise alone changes when the robot lands, which a centre of mass is measured for.
        com = measured_com if self.perturbation.rise else None
        self.replanner.reset()
        corrections = Corrections(self.replanner, reduced, PERIOD, com)
        guide = _PlanGuide(corrections, self.motor_columns, self.gains, correct)
        sensors = Sensors(self.perturbation, sample, PERIOD, self.base)
        control = JointControl(guide, sensors, self.motors, sample.torque)
        takeoff = perturbed_takeoff(self.plan.record, reduced, sample)
        flying = flying_robot(self.engine, self.plan.robot, reduced, sample)
        robot = _FallingRobot(flying, reduced, flying.own_state(*takeoff))
        peak = np.zeros(len(reduced.joints))
        for tick in control.periods(robot, PERIOD):
            if not tick.finite:
                raise FloatplanError(f"the flight cannot be integrated: it diverged {tick.now:.3g} s after takeoff")
            if tick.number % 100 == 0:  # reading the clock takes time
                self._stop_after_deadline()
            peak = np.maximum(peak, np.abs(tick.torques))
        landed, _ = robot.state()
        positions = np.array([*(state[0] for state in sensors.states), landed])
        times = np.append(PERIOD * np.arange(len(sensors.states)), corrections.landing)
        joints = positions[:, self.base.size :]
        planned = (joints - reduced.resting[0]) @ reduced.planned_of_joints.T
        shown = np.append(np.arange(0, len(times) - 1, 5), len(times) - 1)
        log = np.array(corrections.log).reshape(-1, 3)
        posture = self.plan.problem.final.positions
        return SimulatedRun(
            landing={
                "orientation": float(self.base.off(positions[-1:], self.goal)[0]),
                "joints": max(float(off.max(initial=0.0)) for off in reduced.off_goal(joints[-1], posture)),
                "torque_peak": peak,
                "clearance": self._clearance(times, positions, planned),
            },
            motion=Trace(times[shown], self.base.trace(positions[shown], self.goal), planned[shown], log),
            statuses=corrections.statuses,
            seconds=corrections.seconds,
        )

    def _stop_after_deadline(self) -> None:
        if clock.perf_counter() > self.deadline:
            raise _OutOfTimeError

    def _clearance(self, times: Array, positions: Array, planned: Array) -> float:
        """Least distance of the real links to an obstacle, m."""
        problem = self.plan.problem
        obstacles = [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]
        if not obstacles:
            return np.inf
        segments: PlacedShapes = self._segments(positions, planned)
        least = np.inf
        for obstacle in obstacles:
            self._stop_after_deadline()
            least = min(least, float(least_distances(segments, obstacle, times).min()))
        return least

    def _segments(self, positions: Array, planned: Array) -> PlacedShapes:
        """The links' shapes at N positions (N, B + J), with planned joints (N, n)."""
        plan = self.plan
        robot = plan.robot
        attitudes = self.base.attitudes(positions)
        if attitudes.ndim > 1:
            data = self.reduced.model.createData()
            com = np.array([pin.centerOfMass(self.reduced.model, data, row) for row in positions])
            return shapes_in_space(robot, plan.problem.ground).place(poses_about(robot, attitudes, planned, com))
        tree = robot.tree
        angles = tree.absolute_angles(attitudes, planned)
        base_weights = tree.point_weights(np.array([0]), np.array([0j]))[0]
        com_in_plane = positions[:, 0] + 1j * positions[:, 1] - tree.rotations(angles) @ base_weights
        shapes = LinkShapes(tree, robot.shapes, plan.problem.ground_shapes if plan.problem.ground else ())
        return shapes.place(com_in_plane, angles)


@dataclass(eq=False)
class _FallingRobot:
    """A robot in the air whose torques are constant in a step of the Runge-Kutta method, less what its joints lose."""

    engine: FlyingRobot
    reduced: ReducedModel
    own_state: State

    def state(self) -> State:
        """Configuration and velocity of the reduced model, the base's entries first."""
        return self.engine.reduced_state(*self.own_state)

    def move(self, torques: Array, duration: float) -> bool:
        """Take one step, s, under torques (m,), N m; whether the state is finite."""
        joints = self.engine.velocities

        def accelerations(_: float, q: Array, v: Array) -> Array:
            forces = np.zeros_like(v)
            forces[joints] = torques - self.reduced.lost(v[joints])
            return self.engine.accelerations(q, v, forces)

        self.own_state = runge_kutta_step(accelerations, self.engine.moved, self.own_state, 0.0, duration)
        return bool(np.isfinite(self.own_state[0]).all())


@dataclass(frozen=True, eq=False)
class _PlanGuide:
    """A plan's motion, corrected or not, and gains; ``motor_columns`` (m, motors) say which joints motors move."""

    corrections: Corrections
    motor_columns: Array
    gains: Array
    correct: bool

    @property
    def end(self) -> float:
        """When the robot lands, s."""
        return self.corrections.landing

    def target(self, tick: int, now: float, sensors: Sensors) -> tuple[Array, Array]:
        """Positions and rates (2, m) of the joints at a tick, and feed-forward torques (m,)."""
        if self.correct:
            self.corrections.correct(tick, now, sensors)
        reference = self.corrections.replanner.reference(now)
        reduced = self.corrections.reduced
        planned = np.stack((reference.positions, reference.velocities))
        target = reduced.resting + planned @ reduced.joint_selection.T
        return target, self.motor_columns @ reference.motors + reduced.lost(target[1])

    def feedback(self, tick: int, now: float) -> Array:
        """Stiffness and damping (2, m), which do not change."""
        return self.gains
