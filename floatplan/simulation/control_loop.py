"""The control loop of a simulated robot: at a fixed period it is measured, corrected, controlled and moved.

Each motor gets feed-forward torque and joint feedback, constant in the period, up to its limits. Corrections in flight
are computed by a :class:`~floatplan.inflight.replanner.Replanner`, from delayed measurements.
"""

import math
import time as clock
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Protocol

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight.replanner import Replanner
from floatplan.simulation.base_states import BaseStates
from floatplan.simulation.perturbation import Perturbation, Sample
from floatplan.simulation.reduced_model import ReducedModel


class SimulatedRobot(Protocol):
    """A robot of J joints in a simulation."""

    def state(self) -> tuple[Array, Array]:
        """Configuration and velocity, the base's numbers first."""
        ...

    def move(self, torques: Array, duration: float) -> bool:
        """Move for a duration, s, under torques (J,), N m; whether the state is finite."""
        ...


class Guide(Protocol):
    """What the joints are to do in the course of a run."""

    @property
    def end(self) -> float:
        """When control ends, s."""
        ...

    def target(self, tick: int, now: float, sensors: "Sensors") -> tuple[Array, Array]:
        """Positions and rates (2, J) of the joints at a tick, and feed-forward torques (J,)."""
        ...

    def feedback(self, tick: int, now: float) -> Array:
        """Stiffness and damping (2, J) at a tick."""
        ...


@dataclass(frozen=True, eq=False)
class Motors:
    """Largest torque of each joint (J,): ``effort``, N m, and at a speed v no more than ``stall - slope |v|``."""

    effort: Array
    stall: Array
    slope: Array

    def limited(self, torques: Array, velocities: Array) -> Array:
        """Torques (J,), limited to what motors can give at velocities (J,)."""
        most = np.minimum(self.effort, np.maximum(self.stall - self.slope * np.abs(velocities), 0.0))
        return np.asarray(np.clip(torques, -most, most))

    def share(self, torques: Array, velocities: Array) -> float:
        """The largest ratio of a torque to what its motor can give at its speed."""
        size = np.abs(torques)
        slowed = self.slope * np.abs(velocities)
        return float(np.maximum(size / self.effort, (size + slowed) / self.stall).max())


class Sensors:
    """All states of a run so far, (2, B + J) each: ``states`` without noise, ``measured`` with noise.

    ``delay`` is the number of periods after which a controller has a measurement.
    """

    def __init__(self, perturbation: Perturbation, sample: Sample, period: float, base: BaseStates) -> None:
        self.base = base
        self.delay = round(perturbation.delay / period)
        self.states: list[Array] = []
        self.measured: list[Array] = []
        self._deviations = np.array([[perturbation.noise], [perturbation.noise_of_rates]])
        self._random = sample.noise

    def measure(self, state: Array) -> None:
        """Measure orientation, joints and their rates with noise; the base's position without."""
        measured = state.copy()
        base = self.base
        count = base.rotations + state.shape[1] - base.size
        noise = self._deviations * self._random.standard_normal((2, count))
        base.disturb(measured, noise[:, : base.rotations])
        measured[:, base.size :] += noise[:, base.rotations :]
        self.states.append(state)
        self.measured.append(measured)


class Corrections:
    """Corrections of a flight, from delayed measurements, by a replanner that was reset.

    A correction is due every few whole periods: at the replanner's rate where that is possible, else less often.

    Attributes
    ----------
    statuses : status -> number of corrections that had it
    seconds : processor time of each correction
    log : of each correction its time, s, the predicted miss (in space its size), rad, and whether the motion was
        changed (1 or 0)
    """

    def __init__(
        self,
        replanner: Replanner,
        reduced: ReducedModel,
        period: float,
        com: Callable[[Array, Array], tuple[Array, Array]] | None,
        begin: float = 0.0,
    ) -> None:
        """Corrections of a flight that takes off at ``begin``, s.

        ``com`` measures position and velocity of the centre of mass, in a plane along its axes, from a state without
        noise and with noise.
        """
        self.replanner = replanner
        self.reduced = reduced
        self.period = period
        self.com = com
        self.begin = begin
        # Rounded upwards: at a call that comes too early a replanner learns only.
        rounding = 1e-9  # [-] of the periods between corrections
        self.every = math.ceil(1 / (replanner.rate * period) - rounding)
        self.statuses = Counter[str]()
        self.seconds: list[float] = []
        self.log: list[tuple[float, float, float]] = []

    @property
    def landing(self) -> float:
        """When the flight should end, s, as its corrections expect."""
        return self.begin + self.replanner.landing

    def correct(self, tick: int, now: float, sensors: Sensors) -> None:
        """Correct the motion at a tick, where that is due."""
        late = tick - sensors.delay
        if tick % self.every or late * self.period < self.begin or now >= self.landing:
            return
        measured = sensors.measured[late]
        base = sensors.base
        positions, velocities = (measured[:, base.size :] - self.reduced.resting) @ self.reduced.planned_of_joints.T
        com = (None, None) if self.com is None else self.com(sensors.states[late], measured)
        start_time = clock.process_time()
        correction = self.replanner.update(
            late * self.period - self.begin,
            base.orientation(measured),
            base.rate(measured),
            positions,
            velocities,
            now - self.begin,
            *com,
        )
        self.seconds.append(clock.process_time() - start_time)
        self.statuses[correction.status] += 1
        changed = correction.status in ("applied", "limited")
        miss = correction.predicted_miss
        self.log.append((now, miss if isinstance(miss, float) else float(np.linalg.norm(miss)), float(changed)))


@dataclass(frozen=True, eq=False)
class Tick:
    """One period of a run.

    Attributes
    ----------
    number, now : number of the period, and its beginning, s
    state : (2, B + J), at its beginning
    requested, torques : (J,) N m, before and after the motors' limits
    finite : whether the state at its end is finite
    """

    number: int
    now: float
    state: Array
    requested: Array
    torques: Array
    finite: bool


@dataclass(eq=False)
class JointControl:
    """Control of a robot's joints: a guide's targets, feedback with its gains, and motors of some strength (J,).

    ``feedback_delay`` is the number of periods after which feedback has a measurement; ``errors`` (2, J) are those of
    positions and rates in each period so far.
    """

    guide: Guide
    sensors: Sensors
    motors: Motors
    strength: Array
    feedback_delay: int = 0
    errors: list[Array] = field(default_factory=list)

    def periods(self, robot: SimulatedRobot, period: float) -> Iterator[Tick]:
        """Control a robot until the guide's end, or it diverges, and yield each period; the last may be shorter."""
        rounding = 1e-9  # [s] before the end, from which on no other period begins
        for number in count():
            now = number * period
            if now >= self.guide.end - rounding:
                return
            base = self.sensors.base
            state = base.joined(*robot.state())
            self.sensors.measure(state)
            target, torques = self.guide.target(number, now, self.sensors)
            self.errors.append(target - self.sensors.measured[-1][:, base.size :])
            if number >= self.feedback_delay:
                torques = torques + (self.guide.feedback(number, now) * self.errors[number - self.feedback_delay]).sum(
                    axis=0
                )
            limited = self.motors.limited(torques, state[1, base.size :])
            finite = robot.move(self.strength * limited, min(period, self.guide.end - now))
            yield Tick(number, now, state, torques, limited, finite)
            if not finite:
                return
