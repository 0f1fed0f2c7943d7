"""One run of a motion in MuJoCo with contact: a robot tracks a jump or a clip by torques and by feedback of its joints.

500 times a second each motor gets the motion's torque at that time and joint feedback, as of a spring and a damper.
Feedback compares delayed measurements with the target at their time. The ground pushes as MuJoCo's contacts do.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.simulation.base_states import base_states
from floatplan.simulation.contact.model import ContactRobot
from floatplan.simulation.contact.tracked_motion import PERIOD, TrackedMotion, control_times
from floatplan.simulation.control_loop import Guide, JointControl, Sensors
from floatplan.simulation.perturbation import Perturbation, Sample


@dataclass(frozen=True, eq=False)
class RunRecord:
    """What came of one run.

    Attributes
    ----------
    landing : the fields of ``JumpLandings``, and ``tilt``, rad: the largest angle between the base and its planned
        attitude, whole turns included, from the first landing on, later flights included
    rows : states, accelerations, torques, forces and their points at each period, where they are recorded
    """

    landing: dict[str, Any]
    rows: list[tuple[Array, ...]]


class MotionControl:
    """A motion and its controller: gains (2, J) of all joints."""

    def __init__(self, tracked: TrackedMotion, gains: Array) -> None:
        self.tracked = tracked
        self.gains = gains
        self.robot = tracked.robot
        self.reduced = tracked.reduced
        self.base = base_states(tracked.reduced)
        self.joints = tracked.reduced.joints
        self.times = control_times(tracked.duration)
        of_positions, of_velocities = self.reduced.of_joints
        # Positions and rates (K, 2, J) of the joints.
        self.planned_joints = np.stack(
            (tracked.positions[:, of_positions], tracked.velocities[:, of_velocities]), axis=1
        )
        self.torques = tracked.torques + self.reduced.lost(self.planned_joints[:, 1])
        self.flights = tracked.flights

    def sampled(self, perturbation: Perturbation, seed: int, number: int, **fixed: Any) -> Sample:
        """Sample one robot by a seed and its number, but for fixed factors."""
        sample = perturbation.sampled(seed, number, len(self.joints), self.robot.model.njoints)
        return replace(sample, **fixed)

    def run_once(self, perturbation: Perturbation, friction: float, seed: int, number: int) -> RunRecord:
        """Run one robot, sampled by a seed and its number, on a ground of some friction."""
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
    ) -> RunRecord:
        """Let a robot track the motion, its joints by a guide.

        With ``record``, rows have the state at the beginning of each period beside accelerations and contacts of its
        end.
        """
        tracked = self.tracked
        robot.begin(tracked.base_ends[0], tracked.positions[0], tracked.velocities[0])
        base = self.base
        sensors = Sensors(perturbation, sample, PERIOD, base)
        joint_control = JointControl(guide, sensors, tracked.motors, sample.torque, sensors.delay)
        pitches: list[float] = []  # of each landing
        first_landing = len(self.times)  # number of the period
        diverged = False
        share = 0.0
        slid = np.zeros(len(robot.feet))
        rows: list[tuple[Array, ...]] = []
        for tick in joint_control.periods(robot, PERIOD):
            share = max(share, tracked.motors.share(tick.requested, tick.state[1, base.size :]))
            while len(pitches) < len(self.flights) and tick.now >= guide.landing(len(pitches)):
                first_landing = min(first_landing, tick.number)
                pitches.append(float(base.off(tick.state[:1], tracked.goals[len(pitches)])[0]))
            diverged = not tick.finite
            if diverged:
                break
            if tick.now < tracked.duration:
                slid += robot.slips() * PERIOD
            if record:
                torques = np.pad(sample.torque * tick.torques, (self.reduced.of_joints[1].start, 0))
                state = base.parts(tick.state)
                rows.append((*state, robot.accelerations(), torques, *robot.forces()))
        positions = np.array([state[0] for state in sensors.states])
        apart = base.apart(positions, tracked.positions[: len(positions)])
        landing = {
            "stands": robot.stands(tracked.base_ends[1], float(apart[-1])),
            "touched": robot.links(),
            "pitch": max(pitches, key=abs, default=np.nan),
            "torque": share,
            "slid": float(slid.max(initial=0.0)),
            "tilt": np.inf if diverged else float(apart[first_landing:].max(initial=0.0)),
        }
        return RunRecord(landing, rows)


@dataclass(eq=False)
class MotionGuide(Guide):
    """A motion from its beginning until the robot has stood at its end."""

    control: MotionControl

    @property
    def end(self) -> float:
        """When the robot has stood long enough, s."""
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
