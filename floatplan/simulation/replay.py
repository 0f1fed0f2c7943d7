"""Replay: forward dynamics under a plan's torques, gravity on. Does the robot land where the plan says?

:func:`replay` reads a plan's record and its robot, and nothing of the planner: the joints' paths come from the record's
coefficients, the torques from inverse dynamics along them, and the landing from forward dynamics under only these
torques. The base is free, each joint that moves gets its own torque, and locked joints are rigid. With ``feedback``
joints also track their paths; on MuJoCo's free base, gains keep locked and coupled joints at their positions.
"""

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arguments import SEED, html_table, made, optional, outline, positive, short, shortened
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.files import json_value
from floatplan.plans.reading import Recorded, recorded, recorded_robot
from floatplan.plans.record import PlanRecord
from floatplan.pool import one_thread
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot
from floatplan.simulation.engines import FlyingRobot, JointTorques, check_engine, flying_robot
from floatplan.simulation.free_flight import SpatialLanding, fly_with_free_base
from floatplan.simulation.gains import FASTEST, critical_gains, joint_inertia
from floatplan.simulation.integration import (
    LOOSE,
    MOST_STEPS,
    TIGHT,
    Dynamics,
    State,
    fly_finely,
    fly_in_steps,
    whole_step,
)
from floatplan.simulation.mujoco_model import STEP, balanced_in_words
from floatplan.simulation.perturbation import MEASURED, WITH_CONTACT, Perturbation, given_perturbation
from floatplan.simulation.plan_motion import PlanFileMotion
from floatplan.simulation.reduced_model import reduced_model
from floatplan.simulation.spatial_motion import perturbed_takeoff, plan_file_motion
from floatplan.tables import Engine

TOLERANCE = 1e-6  # [rad] of orientation and joints at the landing


@dataclass(frozen=True, eq=False)
class Growth:
    """Errors along the flight at the ends of its quarters, (4,) each, from the path that the plan states.

    ``joints`` is the largest over all joints that move; s, rad, rad, m.
    """

    times: Array
    orientation: Array
    joints: Array
    com: Array


@dataclass(frozen=True, eq=False, repr=False)
class Replay:
    """Result of a replay: where forward dynamics lands under a plan's torques.

    Attributes
    ----------
    engine : "pinocchio" or "mujoco"
    orientation_error : rad
        Distance of the orientation at the end from the goal.
    position_error : (n,) rad
        The same of each planned joint, or of a joint coupled to it where that is further off.
    com_error : m
        Distance of the centre of mass from its parabola at the end.
    momentum_drift : kg m^2/s
        Largest change of the angular momentum about the centre of mass since takeoff.
    orientation_sensitivity : 1/(kg m^2)
        d orientation(T) / d h, with the joints on their paths: the integral of ``1 / D_0``.
    growth : Growth
    perturbation : Perturbation
    feedback : rad/s
        Bandwidth with which joints were made to track their paths; None: open loop.
    step : s
        Of fixed steps; None where the engine chooses its own.
    seconds : time that the replay took
    spatial : SpatialLanding, optional
        Of a plan in a plane the engine "mujoco" also flies the robot with its base free: how far it rolls and yaws.
    balanced : bodies whose inertia no body can have, so that MuJoCo refuses it, by first link
        The largest change of a principal moment, kg m^2.
    """

    engine: Engine
    orientation_error: float
    position_error: Array
    com_error: float
    momentum_drift: float
    orientation_sensitivity: float
    growth: Growth
    perturbation: Perturbation
    feedback: float | None
    step: float | None
    seconds: float
    spatial: SpatialLanding | None = None
    balanced: Mapping[str, float] = field(default_factory=dict)

    @property
    def landed(self) -> bool:
        """Whether orientation and joints arrive at the goal within ``TOLERANCE``."""
        errors = np.array([self.orientation_error, *self.position_error])
        return bool((errors <= TOLERANCE).all())

    @property
    def disturbed(self) -> bool:
        """Whether there is a perturbation."""
        return self.perturbation.any

    def __repr__(self) -> str:
        """A line for each result."""
        return outline(f"Replay({'landed' if self.landed else 'landed elsewhere'})", self.rows())

    def _repr_html_(self) -> str:
        """A table, as notebooks show it."""
        return html_table(f"replay, {'landed' if self.landed else 'landed elsewhere'}", self.rows())

    def rows(self) -> list[tuple[str, str]]:
        """Return names with texts: how it flew, and how far off it landed."""
        control = "open loop" if self.feedback is None else f"joints tracked at {self.feedback:g} rad/s"
        rows = [
            ("how", ", ".join([self.engine, control, *self.perturbation.in_words()])),
            ("orientation", f"off by {short(self.orientation_error)} rad"),
            ("joints", f"off by {shortened(self.position_error)} rad"),
            ("CM", f"off by {short(self.com_error)} m"),
            ("momentum", f"drifts by {short(self.momentum_drift)} kg m^2/s"),
            ("sensitivity", f"{short(self.orientation_sensitivity)} rad per kg m^2/s of h"),
        ]
        if self.spatial is not None:
            landing = self.spatial
            off = max(landing.orientation_error, *landing.position_error)
            count = len(landing.held)
            gains = f", {count} joint{'s' if count > 1 else ''} held by gains" if count else ""
            rotation = f"roll {math.degrees(landing.roll):+.3g} deg, yaw {math.degrees(landing.yaw):+.3g} deg"
            rows.append(("in space", f"{rotation}; in the plane off by {short(off)} rad{gains}"))
        if self.balanced:
            rows.append(("inertias", balanced_in_words(self.balanced)))
        return rows

    def to_dict(self) -> dict[str, Any]:
        """Return what ``floatplan replay --json`` prints; numbers that are not finite are null."""
        values = asdict(self)
        values["disturbance"] = values.pop("perturbation")
        facts: dict[str, Any] = json_value(values)
        return {**facts, "landed": self.landed, "tolerance": TOLERANCE}


@one_thread
def replay(
    plan: Recorded | PlanRecord | str | Path,
    robot: Robot | None = None,
    *,
    engine: Engine = "pinocchio",
    perturb: str | Perturbation = "",
    feedback: float | None = None,
    step: float = STEP,
    seed: int = 0,
) -> Replay:
    """Fly a plan by forward dynamics.

    Parameters
    ----------
    plan : Plan, PlanRecord, or path of a plan file
    robot : Robot, optional
        Left out, the plan's; of a record, the one that it names.
    engine : "pinocchio" or "mujoco"
        The articulated-body algorithm and a Runge-Kutta method of order 8 at a tolerance of 1e-12; or MuJoCo's
        accelerations, on a free joint, by the same method; of a plan in a plane by one of order 4 at fixed steps, in
        the plane and also free in space.
    perturb : str or Perturbation
        As :class:`Perturbation`, such as ``"h=1%,mass=2%,torque=1%"``, but for what is of jumps or measured.
        Nothing is measured here: noise and delay are for :func:`floatplan.closed_loop`.
    feedback : float, optional
        Bandwidth, rad/s, of joint feedback that tracks the plan; left out, torques are applied open loop.
    step : float
        Longest fixed step, s, of MuJoCo in a plane; no other flight uses it.
    seed : int
        Of the random signs of errors.

    Raises
    ------
    InputError
        The robot is missing or another; the engine is unknown or not installed; a number is wrong.
    """
    start_time = clock.perf_counter()
    check_engine(engine)
    step = positive(1e3, "s")(step, "step")
    feedback = optional(positive(FASTEST, "rad/s"))(feedback, "feedback")
    perturbation = given_perturbation(perturb)
    seed = SEED(seed, "seed")
    record, file, own = recorded(plan)
    robot = own if robot is None else made(Robot)(robot, "robot")
    in_steps = engine == "mujoco" and not record.in_space
    if in_steps and record.duration / step > MOST_STEPS:
        raise InputError(f"{step} s makes more than {MOST_STEPS} steps", element="step", advice="give a longer one")
    if robot is None:
        robot = recorded_robot(record.robot, file)
    perturbation.refuse(WITH_CONTACT, "is for jumps")
    perturbation.refuse(MEASURED, "is for flights with corrections", "add --replan")
    reduced = reduced_model(robot, float(record.com["gravity"]))
    sample = perturbation.sampled(seed, 0, len(reduced.joints), reduced.model.njoints)
    motion = plan_file_motion(record, reduced)
    takeoff = perturbed_takeoff(record, reduced, sample)
    gains = None if feedback is None else critical_gains(feedback, joint_inertia(reduced.model, takeoff[0]))
    flying = flying_robot(engine, robot, reduced, sample)
    dynamics = JointTorques(motion, sample.torque, gains).dynamics(flying)
    quarters = 4
    times = record.duration * np.arange(1, quarters + 1) / quarters
    whole = whole_step(record.duration, step, quarters) if in_steps else None
    states = _states(flying, dynamics, takeoff, times, whole, LOOSE if perturbation.any else TIGHT)
    spatial = fly_with_free_base(robot, record, perturbation, seed, feedback, step) if in_steps else None
    growth, sensitivity = _growth(motion, np.array([q for q, _ in states]), times)
    landed = states[-1][0]
    return Replay(
        engine=engine,
        orientation_error=motion.off_goal(landed),
        position_error=reduced.off_goal(landed[reduced.of_joints[0]], record.problem["goal"]["positions"])[0],
        com_error=float(growth.com[-1]),
        momentum_drift=_momentum_drift(sample.perturbed(reduced.model), [takeoff, *states]),
        orientation_sensitivity=sensitivity,
        growth=growth,
        perturbation=perturbation,
        feedback=feedback,
        step=step if in_steps else None,
        seconds=clock.perf_counter() - start_time,
        spatial=spatial,
        balanced=flying.balanced if spatial is None else spatial.balanced,
    )


def _states(
    flying: FlyingRobot, dynamics: Dynamics, takeoff: State, times: Array, step: float | None, tolerance: float
) -> list[State]:
    """States of the reduced model at times (N,), s: by fixed steps, s, or where there are none to a tolerance."""
    state = flying.own_state(*takeoff)
    if step is not None:
        states = fly_in_steps(dynamics, flying.moved, state, times, step)
    else:
        states = fly_finely(dynamics, flying.rate, state, times, tolerance)
    return [flying.reduced_state(*state) for state in states]


def replays(
    plan: Recorded,
    flights: int,
    seed: int,
    budget: float,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> list[Replay]:
    """Fly a plan so many times, each with the next seed; none begins after ``budget`` seconds; see :func:`replay`.

    ``progress`` is called with how many are done, and of how many.
    """
    start_time = clock.perf_counter()
    results: list[Replay] = []
    while len(results) < flights and (not results or clock.perf_counter() - start_time < budget):
        results.append(replay(plan, seed=seed + len(results), **options))
        if progress is not None:
            progress(len(results), flights)
    return results


def landing_rows(results: Sequence[Replay]) -> list[tuple[str, str, str]]:
    """Return rows of (what is off at landing, its median, the worst) of many replays, for reading."""
    errors = (
        ("orientation", np.degrees([result.orientation_error for result in results]), "deg"),
        ("joints", np.degrees([result.position_error.max(initial=0.0) for result in results]), "deg"),
        ("CM", np.array([1e3 * result.com_error for result in results]), "mm"),
    )
    return [(name, f"{np.median(values):.3g} {unit}", f"{values.max():.3g} {unit}") for name, values, unit in errors]


def _growth(motion: PlanFileMotion, configurations: Array, times: Array) -> tuple[Growth, float]:
    """Errors of configurations at times along the flight, and the sensitivity of the orientation."""
    reduced = motion.reduced
    data = reduced.model.createData()
    off, sensitivity = motion.off_path(times, configurations)
    joints = []
    com = []
    for time, q in zip(times, configurations, strict=True):
        joint_errors = np.abs(motion.joints(float(time)).positions - q)[reduced.of_joints[0]]
        joints.append(joint_errors.max(initial=0.0))
        com_position = reduced.axes @ pin.centerOfMass(reduced.model, data, q)
        com.append(np.linalg.norm(com_position - motion.com_position(float(time))))
    return Growth(read_only(times), read_only(off), read_only(joints), read_only(com)), sensitivity


def _momentum_drift(model: Any, states: Any) -> float:
    """Largest change of the angular momentum about the centre of mass, in a plane about the base's axis, kg m^2/s."""
    data = model.createData()
    if model.nq > model.nv:
        vectors = np.array([pin.computeCentroidalMomentum(model, data, *state).angular for state in states])
        return float(np.linalg.norm(vectors - vectors[0], axis=1).max())
    pin.computeJointJacobians(model, data, np.zeros(model.nq))
    axis = pin.getJointJacobian(model, data, BASE_COORDINATES, pin.LOCAL)[3:, BASE_COORDINATES - 1].copy()
    momenta = []
    for positions, velocities in states:
        angular = pin.computeCentroidalMomentum(model, data, positions, velocities).angular
        momenta.append(angular @ data.oMi[BASE_COORDINATES].rotation @ axis)
    return float(np.abs(np.array(momenta) - momenta[0]).max())
