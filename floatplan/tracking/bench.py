"""The bench: disturbed robots follow a motion by one fixed controller, and are counted where they land."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from floatplan.arguments import SEED, function, number, optional, whole
from floatplan.arrays import Array, read_only
from floatplan.clips.clip import Clip
from floatplan.clips.loading import load_clip
from floatplan.errors import InputError, naming
from floatplan.files import json_value
from floatplan.jumps.jump import Jump
from floatplan.jumps.reading import load_jump
from floatplan.pool import one_thread
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.robot.robot import Robot
from floatplan.simulation.contact.tracked_motion import PERIOD, TrackedMotion, tracked_jump
from floatplan.simulation.gains import Gains, uniform_gains
from floatplan.simulation.limits import MOST_FLIGHTS
from floatplan.simulation.motion_run import MotionControl
from floatplan.simulation.perturbation import OF_TAKEOFF, Perturbation, given_perturbation
from floatplan.simulation.results import JumpLandings, Runs
from floatplan.tables import Range
from floatplan.tracking.tracked_clip import tracked_clip


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Bench(Runs):
    """Result of :func:`floatplan.bench`: as ``Runs``.

    Attributes
    ----------
    source : the file, or the name of the motion
    robot : name of the robot
    torques : where feed-forward torques come from: "of the jump", or "inverse dynamics"
    friction : of the ground, before it is perturbed
    kp, kd : (J,) N m/rad, N m s/rad
    landings : JumpLandings
        One row a run. ``pitch`` is taken at the planned end of a flight, whenever the robot lands; of several flights
        it is the largest.
    """

    source: str
    robot: str
    torques: str
    friction: float
    kp: Array
    kd: Array
    landings: JumpLandings
    shown: ClassVar[tuple[str, ...]] = ("source", "robot", "landed", "clean", "flights", "seconds")

    @property
    def landed(self) -> int:
        """How many robots stand, rotated as planned, a second after the end (``JumpReplay.landed`` is a bool)."""
        return int(self.landings.stands.sum())

    @property
    def clean(self) -> int:
        """How many of the robots that stand touched the ground with nothing but their feet."""
        return int(self.landings.clean.sum())

    @property
    def ok(self) -> bool:
        """Whether nine of ten robots stand in the end."""
        enough = 0.9  # [-] of the robots: of 50 with masses 5 % off a few may fail without the motion being at fault
        return self.landed >= enough * self.flights

    def to_dict(self) -> dict[str, Any]:
        """Return what ``floatplan bench --json`` prints of a motion."""
        landings = self.landings
        facts: dict[str, Any] = json_value(
            {
                "motion": self.source,
                "robot": self.robot,
                "flights": self.flights,
                "landed": self.landed,
                "on_feet_alone": self.clean,
                "pitch_rms": landings.pitch_rms,
                "torque_over_limits": int((landings.torque > 1.0).sum()),
                "torque_worst": float(landings.torque.max()),
                "slid_median": float(np.median(landings.slid)),
                "links": dict(landings.links),
                "seed": self.seed,
                "friction": self.friction,
                "perturbation": self.perturbation_facts,
                "control": {
                    "rate": 1 / PERIOD,
                    "torques": self.torques,
                    "joints": self.joints,
                    "kp": self.kp,
                    "kd": self.kd,
                },
                "seconds": self.seconds,
            }
        )
        return facts


@one_thread
def bench(
    motion: Jump | Clip | str | Path,
    model: str | Path | Robot | None = None,
    *,
    flights: int = 50,
    seed: int = 0,
    perturb: str | Perturbation = "mass=5%,friction=20%,armature=0.005,noise=0.1deg,delay=4ms",
    friction: float = 0.8,
    gains: Gains = (None, None),
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Bench:
    """Let disturbed robots follow a motion in MuJoCo with contact by one fixed controller, and count who lands.

    Each motor gets the torque of the motion (a jump's own; of a recorded motion by inverse dynamics) and feedback of
    its joint, 500 times a second; nothing else balances the robot. It begins in the motion's first state, velocities
    included, and is judged a second after the motion's end.

    Parameters
    ----------
    motion : Jump, Clip, or the file of one
    model : path, or Robot with a free base
        URDF or MJCF of a recorded motion's robot; a jump has its own.
    flights : int
        Number of runs, each of one robot through the whole motion.
    seed : int
        The same seed, the same robots and the same noise.
    perturb : str or Perturbation
        What differs between the robots and the model: masses, friction of the ground, rotors that the model does not
        have, noise and delay of measurements.
    friction : float
        Of the ground, before it is perturbed.
    gains : two floats or mappings, optional
        Stiffness and damping of all joints or of some by name; what is left out is by one rule for all robots,
        :func:`floatplan.simulation.gains.uniform_gains`.
    progress : callable, optional
        Called with how many runs are done, and of how many.
    options : of :func:`floatplan.load_clip`

    Raises
    ------
    InputError
        There is no motion or no model, the motion does not fit a level floor, a number is wrong, or MuJoCo is not
        installed.
    """
    start_time = clock.perf_counter()
    flights = whole(Range(1, MOST_FLIGHTS, ""))(flights, "flights")
    seed = SEED(seed, "seed")
    friction = number("friction")(friction, "friction")
    progress = optional(function)(progress, "progress")
    perturbation = given_perturbation(perturb)
    perturbation.refuse(OF_TAKEOFF, "is for plans: a takeoff is what the stance makes of it", "leave it out")
    import_mujoco()
    loaded = _loaded(motion, model, options)
    source = motion if isinstance(motion, str | Path) else None
    with naming(source if source is not None else _name(loaded)):
        tracked = _tracked(loaded, friction)
        control = MotionControl(tracked, _gains(tracked, gains))
        landings = []
        for run in range(flights):
            landings.append(control.run_once(perturbation, friction, seed, run).landing)
            if progress is not None:
                progress(run + 1, flights)
    return Bench(
        flights=flights,
        asked=flights,
        seed=seed,
        perturbation=perturbation,
        joints=control.joints,
        statuses={},
        seconds=clock.perf_counter() - start_time,
        source=str(source) if source is not None else _name(loaded),
        robot=tracked.robot.name,
        torques="of the jump" if isinstance(loaded, Jump) else "inverse dynamics",
        friction=friction,
        kp=read_only(control.gains[0]),
        kd=read_only(control.gains[1]),
        landings=JumpLandings.of(landings),
    )


def _loaded(motion: Jump | Clip | str | Path, model: str | Path | Robot | None, options: dict[str, Any]) -> Jump | Clip:
    """The motion, or that of a file."""
    if isinstance(motion, str | Path):
        if Path(motion).suffix.lower() != ".json":
            if model is None:
                raise InputError("is needed for a recorded motion", element="model", advice="give its URDF or MJCF")
            return load_clip(motion, model=model, **options)
        motion = load_jump(motion)
    elif not isinstance(motion, Jump | Clip):
        raise InputError("must be a jump, a clip, or a file of one", element="motion")
    for name, value in {"model": model, **options}.items():
        if value is not None:
            raise InputError(
                "is for files of recorded motions: this one has its own", element=name, advice="leave it out"
            )
    return motion


def _name(motion: Jump | Clip) -> str:
    return motion.problem.name if isinstance(motion, Jump) else motion.path.name


def _tracked(motion: Jump | Clip, friction: float) -> TrackedMotion:
    """The motion as it is tracked; InputError where it cannot be."""
    if isinstance(motion, Clip):
        return tracked_clip(motion, friction)
    motion.refuse_unless_ok("follow")
    tracked, _ = tracked_jump(motion)
    return tracked


def _gains(tracked: TrackedMotion, requested: Gains) -> Array:
    """Gains (2, J) by the inertia of the robot at postures of its flights."""
    spans = [np.linspace(begin / PERIOD, end / PERIOD, 33).astype(int) for begin, end in tracked.flights]
    rows = np.unique(np.concatenate(spans))
    positions = tracked.positions
    weight = tracked.robot.mass * tracked.gravity
    return uniform_gains(tracked.robot, weight, tracked.begin_ground, positions[0], positions[rows], requested)
