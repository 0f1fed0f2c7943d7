"""One flight of a whole jump in MuJoCo with contact, by torques and by springs with dampers on the joints.

500 times a second each motor gets the jump's torque at that time and joint feedback. Feedback compares delayed
measurements with the target at their time. With corrections a replanner gets the same measurements while the robot is
in the air. The ground pushes as MuJoCo's contacts do.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.inflight.replanner import Replanner
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import JumpState
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.simulation.base_states import base_states
from floatplan.simulation.contact_model import ContactRobot
from floatplan.simulation.control_loop import Corrections, JointControl, Motors, Sensors
from floatplan.simulation.perturbation import Perturbation
from floatplan.simulation.reduced_model import reduced_model
from floatplan.simulation.results import SimulatedFlight
from floatplan.simulation.simulated_jump import STANDING, SimulatedJump, SimulatedSpatialJump

PERIOD = 2e-3  # [s] of the joints' control


class JumpControl:
    """A jump, and what follows it: gains (2, J) of all joints, and corrections in flight at a rate, Hz, if any.

    ``phase_gains`` (P, 2, J) are those of each phase; left out, all have the same.
    """

    def __init__(self, jump: JumpMotion, gains: Array, rate: float | None, phase_gains: Array | None = None) -> None:
        assert jump.flight is not None
        self.jump = jump
        self.gains = gains
        self.phase_gains = phase_gains
        robot = jump.problem.robot
        self.robot = robot
        self.reduced = reduced_model(robot, jump.problem.flight.gravity, rigid=())
        self.base = base_states(self.reduced)
        self.times = np.arange(int((jump.duration + STANDING) / PERIOD) + 1) * PERIOD
        planned = jump.at(np.minimum(self.times, jump.duration))
        self.planned = replace(planned, positions=self.base.continuous(planned.positions))
        of_positions, of_velocities = self.reduced.of_joints
        # Positions and rates (N, 2, J) of the joints.
        self.planned_joints = np.stack(
            (self.planned.positions[:, of_positions], self.planned.velocities[:, of_velocities]), axis=1
        )
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
        self.torques = self.planned.torques[:, of_velocities] + self.reduced.lost(self.planned_joints[:, 1])
        self.motor_torques = self.planned.torques @ robot.transmission
        self.takeoff = jump.takeoff_time
        self.landing = jump.takeoff_time + jump.flight.duration
        begins = [phase.begin for phase in jump.phases]
        self.phases = np.searchsorted(begins, self.times, side="right") - 1  # (N,) of the planned motion's rows
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
            corrections = Corrections(self.replanner, self.reduced, PERIOD, self.measured_com, self.takeoff)
        base = self.base
        sensors = Sensors(perturbation, sample, PERIOD, base)
        guide = _JumpGuide(self, corrections, robot)
        control = JointControl(guide, sensors, self.motors, sample.torque, sensors.delay)
        goal = base.goal(self.jump.flight.problem)
        pitch = np.nan
        tilt = 0.0
        share = 0.0
        slid = np.zeros(len(robot.feet))
        rows = []
        for tick in control.fly(robot, PERIOD):
            share = max(share, self.motors.share(tick.requested, tick.state[1, base.size :]))
            if tick.now >= guide.landing:
                if np.isnan(pitch):
                    pitch = float(base.off(tick.state[:1], goal)[0])
                planned = base.orientation(self.planned.positions[[tick.number]])
                tilt = max(tilt, base.apart(base.orientation(tick.state), planned))
            if not tick.finite:
                tilt = np.inf
                break
            if tick.now < self.jump.duration:
                slid += robot.slips * PERIOD
            if record:
                torques = np.pad(sample.torque * tick.torques, (self.reduced.of_joints[1].start, 0))
                rows.append((*base.parts(tick.state), robot.accelerations(), torques, robot.forces, robot.points))
        return SimulatedFlight(
            landing={
                "stands": robot.stands(self.base_ends[1], base.orientation(self.planned.positions[-1:])),
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


@dataclass(frozen=True, eq=False)
class _JumpGuide:
    """A jump's motion from standing to standing, with corrections in flight where there are any."""

    control: JumpControl
    corrections: Corrections | None
    robot: ContactRobot
    presses: list[bool] = field(default_factory=list)  # whether any foot did, at each tick

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
        self.presses.append(self.robot.presses())
        if self.corrections is None or not self._in_flight(now):
            row = self._row(tick, now)
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

    def feedback(self, tick: int, now: float) -> Array:
        """Stiffness and damping (2, J): those of flight from the planned takeoff to the landing that is expected."""
        control = self.control
        if control.phase_gains is None:
            return control.gains
        phase = int(control.phases[self._row(tick, now)])
        flight = int(control.phases[control.last_in_air])
        if self._in_flight(now):
            phase = flight
        elif now >= control.takeoff:
            phase = max(phase, flight + 1)
        return np.asarray(control.phase_gains[phase])

    def _in_flight(self, now: float) -> bool:
        """Whether the robot should be in the air."""
        return self.control.takeoff <= now < self.landing

    def _row(self, tick: int, now: float) -> int:
        """Of the planned motion, what is due on the ground: what follows the flight begins as the robot lands."""
        control = self.control
        early = 0 if now < control.takeoff else round((control.landing - self.landing) / PERIOD)
        return min(tick + early, len(control.times) - 1)
