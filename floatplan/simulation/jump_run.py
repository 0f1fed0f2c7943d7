"""One run of a jump in MuJoCo with contact, with corrections in its flights and without.

A replanner gets the measurements that the joints' feedback gets, while the robot is in the air.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.inflight.replanner import Replanner
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import JumpState
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.simulation.contact.model import ContactRobot
from floatplan.simulation.contact.tracked_motion import PERIOD, tracked_jump
from floatplan.simulation.control_loop import Corrections, Sensors
from floatplan.simulation.motion_run import MotionControl, MotionGuide
from floatplan.simulation.perturbation import Perturbation
from floatplan.simulation.results import SimulatedRun
from floatplan.simulation.simulated_jump import SimulatedJump, SimulatedSpatialJump


class JumpControl(MotionControl):
    """A jump and its controller: gains (2, J) of all joints, and corrections in flight at a rate, Hz, if any.

    ``phase_gains`` (P, 2, J) are the gains of each phase; left out, all phases have the same.
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

    def run_jump(
        self,
        perturbation: Perturbation,
        friction: float,
        seed: int,
        number: int,
        correct: bool,
        record: bool = False,
        **fixed: Any,
    ) -> SimulatedRun[SimulatedJump]:
        """Run one robot, sampled by a seed and its number but for fixed factors, on a ground of some friction."""
        sample = self.sampled(perturbation, seed, number, **fixed)
        robot = ContactRobot(self.tracked, sample.friction * friction, sample)
        for replanner in self.replanners:
            replanner.reset()
        guide = _JumpGuide(self, correct and bool(self.replanners), robot)
        result = self.track(robot, guide, perturbation, sample, record)
        return SimulatedRun(
            landing=result.landing,
            motion=self._recorded(result.rows, robot),
            statuses=guide.statuses,
            balanced=robot.mujoco_robot.balanced,
        )

    def measured_com(self, origin: Array, state: Array, measured: Array) -> tuple[Array, Array]:
        """Position from an origin and velocity of the centre of mass, along the axes.

        Both are computed with the planned masses, from noisy joints.
        """
        pin.centerOfMass(self.robot.model, self._data, *self.base.parts(measured))
        return self.reduced.axes @ self._data.com[0] - origin, self.reduced.axes @ self._data.vcom[0]

    def origin(self, number: int, row: int, sensors: Sensors) -> Array:
        """Origin of a flight, by its number, as the robot takes off, along the axes, m.

        Stances before the flight may have moved the robot along the ground, which is no error of the flight.
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
    """A jump's motion until it has stood, with corrections in its flights, if any.

    Attributes
    ----------
    control : JumpControl
    corrects : whether flights are corrected
    robot : ContactRobot
    presses : at each tick, whether any foot pressed on the ground
    corrections : of the flights that have begun
    early : periods by which the robot is ahead of the planned motion
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
        if not self._advance(tick, now, sensors):
            row = min(tick + self.early, len(control.times) - 1)
            return control.planned_joints[row], control.torques[row]
        corrections = self.corrections[-1]
        # While feet press on the ground no flight is corrected; the controller learns of that as late as of all else.
        if not self.presses[-1 - min(sensors.delay, len(self.presses) - 1)]:
            corrections.correct(tick, now, sensors)
        reference = corrections.replanner.reference(now - corrections.begin)
        # To the torques of the corrected motion come those that joints lose; joints without motors get the planned
        # ones. A flight that lasts longer than planned goes on with its last row: the next rows are of the stance.
        last_in_air = int(np.searchsorted(control.times, control.flights[self.landed][1])) - 1
        row = min(tick + self.early, last_in_air)
        torques = control.torques[row].copy()
        torques[control.motor_joints] += reference.motors - control.motor_torques[row]
        corrected = np.stack((reference.positions, reference.velocities))
        return control.reduced.resting + corrected @ control.reduced.joint_selection.T, torques

    def feedback(self, tick: int, now: float) -> Array:
        """Stiffness and damping (2, J) of the phase; a corrected flight lasts until its expected landing."""
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

    def _advance(self, tick: int, now: float, sensors: Sensors) -> bool:
        """End the flight whose landing is due, begin the one whose takeoff is; whether a flight is corrected now.

        What follows a flight begins as much earlier or later than planned as the robot lands.
        """
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
