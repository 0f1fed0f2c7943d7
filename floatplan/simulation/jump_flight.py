"""One flight of a motion in MuJoCo with contact, by torques and by springs with dampers on the joints.

500 times a second each motor gets the motion's torque at that time and joint feedback. Feedback compares delayed
measurements with the target at their time. Of a jump, with corrections a replanner gets the same measurements while
the robot is in the air. The ground pushes as MuJoCo's contacts do.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.inflight.replanner import Replanner
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import JumpState
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.simulation.base_states import base_states
from floatplan.simulation.contact.model import ContactRobot
from floatplan.simulation.contact.tracked_motion import PERIOD, TrackedMotion, control_times, tracked_jump
from floatplan.simulation.control_loop import Corrections, Guide, JointControl, Sensors
from floatplan.simulation.perturbation import Perturbation, Sample
from floatplan.simulation.results import SimulatedFlight
from floatplan.simulation.simulated_jump import SimulatedJump, SimulatedSpatialJump


@dataclass(eq=False)
class FlightRecord:
    """What came of a flight: its ``landing``, by the fields of ``JumpLandings`` and ``tilt``, and its robot.

    ``rows`` are its states, accelerations, torques, forces and their points at each period, where they are recorded.
    """

    robot: ContactRobot
    landing: dict[str, Any] = field(default_factory=dict)
    rows: list[tuple[Array, ...]] = field(default_factory=list)


class MotionControl:
    """A motion, and what follows it: gains (2, J) of all joints."""

    def __init__(self, tracked: TrackedMotion, gains: Array) -> None:
        self.tracked = tracked
        self.gains = gains
        self.robot = tracked.robot
        self.reduced = tracked.reduced
        self.base = base_states(tracked.reduced)
        self.joints = tracked.reduced.joints
        self.motors = tracked.motors
        self.times = control_times(tracked.duration)
        of_positions, of_velocities = self.reduced.of_joints
        # Positions and rates (K, 2, J) of the joints.
        self.planned_joints = np.stack(
            (tracked.positions[:, of_positions], tracked.velocities[:, of_velocities]), axis=1
        )
        self.torques = tracked.torques + self.reduced.lost(self.planned_joints[:, 1])
        self.base_ends = tracked.base_ends
        self.flights = tracked.flights

    def sampled(self, perturbation: Perturbation, seed: int, number: int, **fixed: Any) -> Sample:
        """Sample one robot by a seed and its number, but for fixed factors."""
        sample = perturbation.sampled(seed, number, len(self.joints), self.robot.model.njoints)
        return replace(sample, **fixed)

    def fly(self, perturbation: Perturbation, friction: float, seed: int, number: int) -> FlightRecord:
        """Fly one robot, sampled by a seed and its number, on a ground of some friction."""
        sample = self.sampled(perturbation, seed, number)
        robot = ContactRobot(self.tracked, sample.friction * friction, sample)
        return self.track(robot, MotionGuide(self), perturbation, sample)

    def track(
        self,
        robot: ContactRobot,
        guide: "MotionGuide",
        perturbation: Perturbation,
        sample: Sample,
        record: bool = False,
    ) -> FlightRecord:
        """Let a robot follow a guide.

        Its landing also has the trunk's largest tilt, rad, from where it should be, from the landing on. In a motion
        that is recorded, the state at the beginning of each period stands beside accelerations and contacts of its end.
        """
        tracked = self.tracked
        robot.begin(tracked.base_ends[0], tracked.positions[0], tracked.begin_velocities)
        base = self.base
        sensors = Sensors(perturbation, sample, PERIOD, base)
        control = JointControl(guide, sensors, self.motors, sample.torque, sensors.delay)
        pitches: list[float] = []  # of each landing
        tilt = 0.0
        share = 0.0
        slid = np.zeros(len(robot.feet))
        result = FlightRecord(robot)
        for tick in control.fly(robot, PERIOD):
            share = max(share, self.motors.share(tick.requested, tick.state[1, base.size :]))
            while len(pitches) < len(self.flights) and tick.now >= guide.landing(len(pitches)):
                pitches.append(float(base.off(tick.state[:1], tracked.goals[len(pitches)])[0]))
            if pitches:
                planned = base.orientation(tracked.positions[[tick.number]])
                tilt = max(tilt, base.apart(base.orientation(tick.state), planned))
            if not tick.finite:
                tilt = np.inf
                break
            if tick.now < tracked.duration:
                slid += robot.slips() * PERIOD
            if record:
                torques = np.pad(sample.torque * tick.torques, (self.reduced.of_joints[1].start, 0))
                state = base.parts(tick.state)
                result.rows.append((*state, robot.accelerations(), torques, *robot.forces()))
        result.landing = {
            "stands": robot.stands(self.base_ends[1], base.orientation(tracked.positions[-1:])),
            "touched": robot.links(),
            "pitch": max(pitches, key=abs, default=np.nan),
            "torque": share,
            "slid": float(slid.max(initial=0.0)),
            "tilt": tilt,
        }
        return result


@dataclass(eq=False)
class MotionGuide(Guide):
    """A motion from its beginning until it has stood."""

    control: MotionControl

    @property
    def end(self) -> float:
        """When it has stood long enough, s."""
        return len(self.control.times) * PERIOD

    def landing(self, number: int) -> float:
        """When a flight should end, s."""
        return self.control.flights[number][1]

    def target(self, tick: int, now: float, sensors: Sensors) -> tuple[Array, Array]:
        """Positions and rates (2, J) of all joints, and feed-forward torques (J,)."""
        row = min(tick, len(self.control.times) - 1)
        return self.control.planned_joints[row], self.control.torques[row]

    def feedback(self, tick: int, now: float) -> Array:
        """Stiffness and damping (2, J)."""
        return self.control.gains


class JumpControl(MotionControl):
    """A jump, and what follows it: gains (2, J) of all joints, and corrections in flight at a rate, Hz, if any.

    ``phase_gains`` (P, 2, J) are those of each phase; left out, all have the same.
    """

    def __init__(self, jump: JumpMotion, gains: Array, rate: float | None, phase_gains: Array | None = None) -> None:
        assert jump.flight is not None
        self.jump = jump
        tracked, self.planned = tracked_jump(jump)
        super().__init__(tracked, gains)
        self.motor_joints = list(map(self.joints.index, self.robot.motors))
        self.motor_torques = self.planned.torques @ self.robot.transmission
        self.phase_gains = phase_gains
        begins = [phase.begin for phase in jump.phases]
        self.phases = np.searchsorted(begins, self.times, side="right") - 1  # (K,) of the planned motion's rows
        self.flight_phases = [number for number, phase in enumerate(jump.phases) if phase.kind == "flight"]
        self.shifts = [flight.shift for flight in jump.timed_flights]
        self.replanners: list[Replanner] = []
        if rate is not None:
            self.replanners = [Replanner(plan, rate) for plan in jump.flights]
        self._data = self.robot.model.createData()

    def fly_jump(
        self,
        perturbation: Perturbation,
        friction: float,
        seed: int,
        number: int,
        correct: bool,
        record: bool = False,
        **fixed: Any,
    ) -> SimulatedFlight[SimulatedJump]:
        """Fly one robot, sampled by a seed and its number but for fixed factors, on a ground of some friction."""
        sample = self.sampled(perturbation, seed, number, **fixed)
        robot = ContactRobot(self.tracked, sample.friction * friction, sample)
        for replanner in self.replanners:
            replanner.reset()
        guide = _JumpGuide(self, correct and bool(self.replanners), robot)
        result = self.track(robot, guide, perturbation, sample, record)
        return SimulatedFlight(
            landing=result.landing,
            motion=self._recorded(result.rows, robot),
            statuses=guide.statuses,
            balanced=robot.mujoco_robot.balanced,
        )

    def measured_com(self, origin: Array, state: Array, measured: Array) -> tuple[Array, Array]:
        """Position from an origin and velocity of the centre of mass, along the axes.

        They are of planned masses, from noisy joints.
        """
        pin.centerOfMass(self.robot.model, self._data, *self.base.parts(measured))
        return self.reduced.axes @ self._data.com[0] - origin, self.reduced.axes @ self._data.vcom[0]

    def origin(self, number: int, row: int, sensors: Sensors) -> Array:
        """Where the world of a flight, by its number, is as the robot takes off, along the axes, m.

        Stances before have moved it along the ground, which is no error of the flights that follow.
        """
        nowhere: Array = np.zeros(len(self.reduced.axes))
        if not number:
            return nowhere
        pin.centerOfMass(self.robot.model, self._data, self.planned.positions[row])
        planned = self.reduced.axes @ self._data.com[0]
        measured, _ = self.measured_com(nowhere, sensors.states[-1], sensors.measured[-1])
        drift: Array = measured - planned
        drift[-1] = 0.0
        origin: Array = drift + np.asarray(self.shifts[number])
        return origin

    def _recorded(self, rows: Sequence[tuple[Array, ...]], robot: ContactRobot) -> SimulatedJump:
        jump = self.jump
        state = None
        if rows:
            positions, velocities, accelerations, torques, forces, points = map(read_only, zip(*rows, strict=True))
            in_plane = forces @ self.reduced.axes.T
            state = JumpState(
                times=read_only(self.times[: len(rows)]),
                positions=positions,
                velocities=velocities,
                accelerations=accelerations,
                forces=dict(zip(robot.feet, in_plane.swapaxes(0, 1), strict=True)),
                torques=torques,
                points=dict(zip(robot.feet, points.swapaxes(0, 1), strict=True)),
            )
        simulated = SimulatedSpatialJump if isinstance(jump, SpatialJumpMotion) else SimulatedJump
        return simulated(jump.problem, jump.request, jump.flight, jump.before, jump.after, jump.more, recorded=state)


@dataclass(eq=False)
class _JumpGuide(MotionGuide):
    """A jump's motion from standing to standing, with corrections in its flights, if any.

    Attributes
    ----------
    control : JumpControl
    corrects : whether flights are corrected
    robot : ContactRobot
    presses : whether any foot did, at each tick
    corrections : of the flights that have begun
    early : periods by which it is ahead of the planned motion
    landed : number of flights that are over
    """

    control: JumpControl
    corrects: bool
    robot: ContactRobot
    presses: list[bool] = field(default_factory=list)
    corrections: list[Corrections] = field(default_factory=list)
    early: int = 0
    landed: int = 0

    def landing(self, number: int) -> float:
        """When a flight should end, s from the jump's start: as corrections expect it, else as planned."""
        if number < len(self.corrections):
            return self.corrections[number].landing
        return self.control.flights[number][1] - self.early * PERIOD

    def target(self, tick: int, now: float, sensors: Sensors) -> tuple[Array, Array]:
        """Positions and rates (2, J) of all joints, and feed-forward torques (J,)."""
        control = self.control
        self.presses.append(self.robot.presses())
        if not self._in_flight(tick, now, sensors):
            row = min(tick + self.early, len(control.times) - 1)
            return control.planned_joints[row], control.torques[row]
        corrections = self.corrections[-1]
        # What feet that press on the ground make of a flight is not corrected: they are felt as late as all else.
        if not self.presses[-1 - min(sensors.delay, len(self.presses) - 1)]:
            corrections.correct(tick, now, sensors)
        reference = corrections.replanner.reference(now - corrections.begin)
        # Joints without motors get the flight's planned torques, the others what their joints lose in it; in a flight
        # that lasts longer than planned the last ones: the rows that follow are of the stance.
        last_in_air = int(np.searchsorted(control.times, control.flights[self.landed][1])) - 1
        row = min(tick + self.early, last_in_air)
        torques = control.torques[row].copy()
        torques[control.motor_joints] += reference.motors - control.motor_torques[row]
        corrected = np.stack((reference.positions, reference.velocities))
        return control.reduced.resting + corrected @ control.reduced.joint_selection.T, torques

    def feedback(self, tick: int, now: float) -> Array:
        """Stiffness and damping (2, J) of the phase; a flight lasts until the landing that is expected."""
        control = self.control
        if control.phase_gains is None:
            return control.gains
        phase = int(control.phases[min(tick + self.early, len(control.times) - 1)])
        if self.corrects and self.landed < len(control.flights):
            phase = min(phase, control.flight_phases[self.landed])
        if self.landed:
            phase = max(phase, control.flight_phases[self.landed - 1] + 1)
        return np.asarray(control.phase_gains[phase])

    @property
    def statuses(self) -> Counter[str]:
        """How often a correction had which status."""
        counts = Counter[str]()
        for corrections in self.corrections:
            counts += corrections.statuses
        return counts

    def _in_flight(self, tick: int, now: float, sensors: Sensors) -> bool:
        """Whether a flight is corrected; what follows it begins as much earlier or later as the robot lands."""
        control = self.control
        if len(self.corrections) > self.landed and now >= self.corrections[-1].landing:
            planned = control.flights[self.landed][1]
            self.early = round((planned - self.corrections[-1].landing) / PERIOD)
            self.landed += 1
        if not self.corrects or self.landed == len(control.flights):
            return False
        begin = control.flights[self.landed][0] - self.early * PERIOD
        if now < begin:
            return False
        if len(self.corrections) == self.landed:
            row = min(tick + self.early, len(control.times) - 1)
            com = partial(control.measured_com, control.origin(self.landed, row, sensors))
            replanner = control.replanners[self.landed]
            self.corrections.append(Corrections(replanner, control.reduced, PERIOD, com, begin))
        return True
