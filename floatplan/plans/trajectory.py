"""A motion in time, whichever kind it is: the protocol that pictures and files read, and its samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from floatplan.arguments import Outlined
from floatplan.arrays import Array, BoolArray
from floatplan.errors import InputError
from floatplan.motion.dynamics import FlightState
from floatplan.motion.flight import FullMotion, free_flyer
from floatplan.plans.measures import PlanWarning
from floatplan.pool import one_thread
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot

MOST_ROWS = 100_000  # [-] instants of a sample: 100 s at 1 kHz


@dataclass(frozen=True)
class JumpPhase:
    """A time of a jump in which contacts do not change.

    Attributes
    ----------
    kind : "stance" or "flight"
    contacts : names of all points that stand, followers' too
    begin, end : s, from the jump's start
    """

    kind: str
    contacts: tuple[str, ...]
    begin: float
    end: float


class Trajectory(Protocol):
    """What a :class:`floatplan.Plan` and a :class:`floatplan.Jump` have in common: a motion of a robot in time."""

    @property
    def robot(self) -> Robot:
        """The robot that moves."""

    @property
    def duration(self) -> float:
        """How long it lasts, s; time begins at 0."""

    @property
    def problem(self) -> Problem:
        """What was requested."""

    @property
    def whole_problem(self) -> Problem:
        """The request, from the motion's first instant to its last: its ends, duration and obstacles are these."""

    @property
    def phases(self) -> Sequence[JumpPhase]:
        """Its phases in order of time; none where nothing ever stands."""

    @property
    def warnings(self) -> tuple[PlanWarning, ...]:
        """What it does in addition to the request."""

    @property
    def dynamics(self) -> Any:
        """The robot's rigid-body dynamics."""

    def state(self, times: npt.ArrayLike) -> FlightState:
        """Planned joints, orientation and centre of mass at times (N,), s."""

    def clearances(self, times: Array, obstacles: Sequence[Obstacle]) -> Array:
        """Least distance (N,), m, between the robot and obstacles that exist at times (N,), s."""

    def full_motion(self, times: npt.ArrayLike) -> FullMotion:
        """Base in space and every joint of the file at times (N,), s."""

    def forces(self, times: npt.ArrayLike) -> dict[str, Array]:
        """Forces (N, 3), N, by the names of the points that stand at some time."""

    def contact_points(self, times: npt.ArrayLike) -> dict[str, Array]:
        """Where those forces act (N, 3), m; NaN where a point does not stand."""


@dataclass(frozen=True, eq=False, repr=False)
class MotionSample(Outlined):
    """A motion at N instants, in the coordinates of :meth:`floatplan.Robot.free_flyer`.

    Attributes
    ----------
    times : (N,) s
    q : (N, nq) m and rad
        Position of the root link, its quaternion x y z w, joints (``continuous`` ones as cos, sin).
    v, a : (N, nv) m/s and rad/s, m/s^2 and rad/s^2
        Of the base in its own axes, linear then angular, and of joints.
    tau : (N, nv) N m
        0 on the base, then each joint's own.
    contacts : point's name -> (N,)
        Whether each point stands; at a change of contacts as before it. Empty of a flight, whose robot touches nothing.
    forces : point's name -> (N, 3) N, in the world's axes; zero where the point does not stand
    contact_points : point's name -> (N, 3) m, in the world, where the forces act; NaN where the point does not stand
    """

    times: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    contacts: dict[str, BoolArray]
    forces: dict[str, Array]
    contact_points: dict[str, Array]


@one_thread
def sampled(motion: Trajectory, times: Array) -> MotionSample:
    """Return a motion at times (N,), s; the last may be later than its end by rounding."""
    times = np.minimum(times, motion.duration)
    whole = motion.full_motion(times)
    flyer = free_flyer(whole.robot)
    forces = motion.forces(times)
    phase = phase_of(motion, times)
    return MotionSample(
        times=times,
        q=flyer.configurations(whole),
        v=flyer.velocities(whole),
        a=flyer.accelerations(whole),
        tau=flyer.torques(whole),
        contacts={name: np.array([name in single.contacts for single in motion.phases])[phase] for name in forces},
        forces=forces,
        contact_points=motion.contact_points(times),
    )


def phase_of(motion: Trajectory, times: Array) -> npt.NDArray[np.intp]:
    """Return the number (N,) of a motion's phase at times (N,), s; at a change of contacts the one before."""
    return np.searchsorted([phase.end for phase in motion.phases[:-1]], times)


def frame_times(duration: float, rate: float) -> Array:
    """Instants 0, 1/rate, 2/rate, ... up to the end, s, which is one of them if it is a whole number of steps.

    Raises
    ------
    InputError
        The rate is not positive and finite, or gives more than ``MOST_ROWS`` instants.
    """
    if not (rate > 0 and math.isfinite(rate)):
        raise InputError(f"{rate} Hz is not positive and finite", element="rate", advice="give rows per second")
    if duration * rate > MOST_ROWS:
        reason = f"{rate} Hz for {duration} s are more than {MOST_ROWS} rows"
        raise InputError(reason, element="rate", advice="give a lower rate")
    return np.arange(math.floor(duration * rate * (1 + 1e-12)) + 1) / rate


def sample_times(duration: float, rate: float) -> Array:
    """Instants of :func:`frame_times`, and the end itself, s; errors as there."""
    frames = frame_times(duration, rate)
    return np.append(frames[frames < duration * (1 - 1e-12)], duration)
