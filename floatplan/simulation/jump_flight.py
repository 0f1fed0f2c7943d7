"""One flight of a whole jump in MuJoCo with contact, by torques and by springs with dampers on the joints.

500 times a second each motor gets the jump's torque at that time and joint feedback. Feedback compares delayed
measurements with the target at their time. With corrections a replanner gets the same measurements while the robot is
in the air. The ground pushes as MuJoCo's contacts do.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.inflight.replanner import Replanner
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import JumpState
from floatplan.robot.planar.model import BASE_COORDINATES as BASE
from floatplan.simulation.base_states import base_states
from floatplan.simulation.contact_model import ContactRobot, least_heights
from floatplan.simulation.control_loop import Corrections, JointControl, Motors, Sensors
from floatplan.simulation.perturbation import Perturbation
from floatplan.simulation.reduced_model import reduced_model
from floatplan.simulation.results import SimulatedFlight
from floatplan.simulation.simulated_jump import STANDING, SimulatedJump

PERIOD = 2e-3  # [s] of the joints' control


class JumpControl:
    """A jump, and what follows it: gains (2, J) of all joints, and corrections in flight at a rate, Hz, if any."""

    def __init__(self, jump: JumpMotion, gains: Array, rate: float | None) -> None:
        assert jump.flight is not None
        self.jump = jump
        self.gains = gains
        robot = jump.problem.robot
        self.robot = robot
        self.reduced = reduced_model(robot, jump.problem.flight.gravity, rigid=())
        self.times = np.arange(int((jump.duration + STANDING) / PERIOD) + 1) * PERIOD
        self.planned = jump.at(np.minimum(self.times, jump.duration))
        # Quaternions with w first, as MuJoCo has them.
        self.base_ends = jump.q(np.array([0.0, jump.duration]))[:, [0, 1, 2, 6, 3, 4, 5]]
        self.joints = self.reduced.joints
        self.motor_joints = list(map(self.joints.index, robot.motors))
        self.motors = Motors(
            effort=np.array([robot.joint_tree.joint[name].effort for name in self.joints]),
            stall=np.full(len(self.joints), np.inf),
            slope=np.zeros(len(self.joints)),
        )
        self.motors.effort[self.motor_joints] = jump.problem.motor_torque_limits
        self.motors.stall[self.motor_joints] = jump.problem.motor_stall
        self.motors.slope[self.motor_joints] = jump.problem.motor_slope
        self.torques = self.planned.torques[:, BASE:] + self.reduced.lost(self.planned.velocities[:, BASE:])
        self.motor_torques = self.planned.torques @ robot.transmission
        self.takeoff = jump.takeoff_time
        self.landing = jump.takeoff_time + jump.flight.duration
        flying = (self.times >= self.takeoff) & (self.times < self.landing)
        heights = least_heights(jump, self.planned.positions[flying])
        least = 5e-3  # [m] as planned: a lower foot of a robot that is not as planned may touch the ground
        clear = self.times[flying][heights > least]
        # When all feet are clear of the ground, s, and how long before the landing one no longer is.
        self.clear_from = float(clear[0]) if len(clear) else self.takeoff
        self.clear_until_before_landing = float(self.landing - clear[-1]) if len(clear) else 0.0
        self.last_in_air = int(np.searchsorted(self.times, self.landing)) - 1  # row of the planned motion
        self.replanner = None if rate is None else Replanner(jump.flight, rate)
        self._data = robot.model.createData()

    def fly(
        self,
        perturbation: Perturbation,
        friction: float,
        seed: int,
        number: int,
        correct: bool,
        record: bool = False,
        **fixed: Any,
    ) -> SimulatedFlight[SimulatedJump]:
        """Fly one robot, sampled by a seed and its number but for fixed factors, on a ground of some friction.

        Its landing also has the trunk's largest tilt, rad, from where it should be, from the landing on. In a motion
        that is recorded, the state at the beginning of each period stands beside accelerations and contacts of its end.
        """
        assert self.jump.flight is not None
        sample = replace(perturbation.sampled(seed, number, len(self.joints), self.robot.model.njoints), **fixed)
        robot = ContactRobot(self.jump, self.reduced, sample.friction * friction, sample)
        robot.begin(self.base_ends[0], self.planned.positions[0])
        corrections = None
        if correct and self.replanner is not None:
            self.replanner.reset()
            clear = (self.clear_from, self.clear_until_before_landing)
            corrections = Corrections(self.replanner, self.reduced, PERIOD, self.measured_com, self.takeoff, clear)
        sensors = Sensors(perturbation, sample, PERIOD, base_states(self.reduced))
        guide = _JumpGuide(self, corrections)
        control = JointControl(guide, sensors, self.gains, self.motors, sample.torque, sensors.delay)
        goal = self.jump.flight.problem.final.orientation
        pitch = np.nan
        tilt = 0.0
        share = 0.0
        slid = np.zeros(len(robot.feet))
        rows = []
        for tick in control.fly(robot, PERIOD):
            orientation = float(tick.state[0, BASE - 1])
            share = max(share, self.motors.share(tick.requested, tick.state[1, BASE:]))
            if tick.now >= guide.landing:
                if np.isnan(pitch):
                    pitch = orientation - goal
                tilt = max(tilt, abs(orientation - float(self.planned.positions[tick.number, BASE - 1])))
            if not tick.finite:
                tilt = np.inf
                break
            if tick.now < self.jump.duration:
                slid += robot.slips * PERIOD
            if record:
                torques = np.append(np.zeros(BASE), sample.torque * tick.torques)
                rows.append((*tick.state, robot.accelerations(), torques, robot.forces, robot.points))
        return SimulatedFlight(
            landing={
                "stands": robot.stands(self.base_ends[1], self.planned.positions[-1, BASE - 1]),
                "touched": robot.links(),
                "pitch": pitch,
                "torque": share,
                "slid": float(slid.max()),
                "tilt": tilt,
            },
            motion=self._recorded(rows, robot),
            statuses=Counter() if corrections is None else corrections.statuses,
            balanced=robot.mujoco_robot.balanced,
        )

    def measured_com(self, state: Array, measured: Array) -> tuple[Array, Array]:
        """Position and velocity (2,) of the centre of mass, m and m/s: of the planned masses, from noisy joints."""
        pin.centerOfMass(self.robot.model, self._data, *measured)
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
        return SimulatedJump(jump.problem, jump.request, jump.flight, jump.before, jump.after, recorded=state)


@dataclass(frozen=True, eq=False)
class _JumpGuide:
    """A jump's motion from standing to standing, with corrections in flight where there are any."""

    control: JumpControl
    corrections: Corrections | None

    @property
    def end(self) -> float:
        """When it has stood long enough, s."""
        return len(self.control.times) * PERIOD

    @property
    def landing(self) -> float:
        """When the flight should end, s from the jump's start: as corrections expect it, else as planned."""
        return self.control.landing if self.corrections is None else self.corrections.landing

    def target(self, tick: int, now: float, sensors: Sensors) -> tuple[Array, Array]:
        """Positions and rates (2, J) of all joints, and feed-forward torques (J,)."""
        control = self.control
        planned = control.planned
        if self.corrections is None or not control.takeoff <= now < self.landing:
            # What follows the flight begins as much earlier or later as the robot lands.
            early = 0 if now < control.takeoff else round((control.landing - self.landing) / PERIOD)
            row = min(tick + early, len(control.times) - 1)
            target = np.stack((planned.positions[row, BASE:], planned.velocities[row, BASE:]))
            return target, control.torques[row]
        self.corrections.correct(tick, now, sensors)
        reference = self.corrections.replanner.reference(now - control.takeoff)
        # Joints without motors get the flight's planned torques, the others what their joints lose in it; in a flight
        # that lasts longer than planned the last ones: the rows that follow are of the stance.
        row = min(tick, control.last_in_air)
        torques = control.torques[row].copy()
        torques[control.motor_joints] += reference.motors - control.motor_torques[row]
        corrected = np.stack((reference.positions, reference.velocities))
        return control.reduced.resting + corrected @ control.reduced.joint_selection.T, torques
