"""One flight of a whole jump in MuJoCo with contact, followed as any motion is, and corrected in flight.

With corrections a replanner gets the same measurements as the joints' feedback while the robot is in the air.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.inflight.replanner import Replanner
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import JumpState
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.simulation.contact_model import ContactRobot
from floatplan.simulation.control_loop import Corrections, Sensors
from floatplan.simulation.followed_motion import PERIOD, followed_jump
from floatplan.simulation.motion_flight import MotionControl, MotionGuide
from floatplan.simulation.perturbation import Perturbation
from floatplan.simulation.results import SimulatedFlight
from floatplan.simulation.simulated_jump import SimulatedJump, SimulatedSpatialJump


class JumpControl(MotionControl):
    """A jump, and what follows it: gains (2, J) of all joints, and corrections in flight at a rate, Hz, if any."""

    def __init__(self, jump: JumpMotion, gains: Array, rate: float | None) -> None:
        assert jump.flight is not None
        self.jump = jump
        followed, self.planned = followed_jump(jump)
        super().__init__(followed, gains)
        self.motor_joints = list(map(self.joints.index, self.robot.motors))
        self.motor_torques = self.planned.torques @ self.robot.transmission
        self.last_in_air = int(np.searchsorted(self.times, self.landing)) - 1  # row of the planned motion
        self.replanner = None if rate is None else Replanner(jump.flight, rate)
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
        robot = ContactRobot(self.followed, sample.friction * friction, sample)
        corrections = None
        if correct and self.replanner is not None:
            self.replanner.reset()
            corrections = Corrections(self.replanner, self.reduced, PERIOD, self.measured_com, self.takeoff)
        guide = _JumpGuide(self, corrections, robot)
        flown = self.followed_by(robot, guide, perturbation, sample, record)
        return SimulatedFlight(
            landing=flown.landing,
            motion=self._recorded(flown.rows, robot),
            statuses=Counter() if corrections is None else corrections.statuses,
            balanced=robot.mujoco_robot.balanced,
        )

    def measured_com(self, state: Array, measured: Array) -> tuple[Array, Array]:
        """Position and velocity of the centre of mass, along the axes: of planned masses, from noisy joints."""
        pin.centerOfMass(self.robot.model, self._data, *self.base.parts(measured))
        return self.reduced.axes @ self._data.com[0], self.reduced.axes @ self._data.vcom[0]

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
        return simulated(jump.problem, jump.request, jump.flight, jump.before, jump.after, recorded=state)


@dataclass(eq=False)
class _JumpGuide(MotionGuide):
    """A jump's motion from standing to standing, with corrections in flight where there are any."""

    control: JumpControl
    corrections: Corrections | None
    robot: ContactRobot
    presses: list[bool] = field(default_factory=list)  # whether any foot did, at each tick

    @property
    def landing(self) -> float:
        """When the flight should end, s from the jump's start: as corrections expect it, else as planned."""
        return self.control.landing if self.corrections is None else self.corrections.landing

    def target(self, tick: int, now: float, sensors: Sensors) -> tuple[Array, Array]:
        """Positions and rates (2, J) of all joints, and feed-forward torques (J,)."""
        control = self.control
        self.presses.append(self.robot.presses())
        if self.corrections is None or not control.takeoff <= now < self.landing:
            # What follows the flight begins as much earlier or later as the robot lands.
            early = 0 if now < control.takeoff else round((control.landing - self.landing) / PERIOD)
            row = min(tick + early, len(control.times) - 1)
            return control.planned_joints[row], control.torques[row]
        # What feet that press on the ground make of a flight is not corrected: they are felt as late as all else.
        if not self.presses[-1 - min(sensors.delay, len(self.presses) - 1)]:
            self.corrections.correct(tick, now, sensors)
        reference = self.corrections.replanner.reference(now - control.takeoff)
        # Joints without motors get the flight's planned torques, the others what their joints lose in it; in a flight
        # that lasts longer than planned the last ones: the rows that follow are of the stance.
        row = min(tick, control.last_in_air)
        torques = control.torques[row].copy()
        torques[control.motor_joints] += reference.motors - control.motor_torques[row]
        corrected = np.stack((reference.positions, reference.velocities))
        return control.reduced.resting + corrected @ control.reduced.joint_selection.T, torques
