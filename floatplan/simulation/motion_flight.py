"""One flight of a motion in MuJoCo with contact, by torques and by springs with dampers on the joints.

500 times a second each motor gets the motion's torque at that time and joint feedback. Feedback compares delayed
measurements with the target at their time. The ground pushes as MuJoCo's contacts do.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.simulation.base_states import base_states
from floatplan.simulation.contact_model import ContactRobot
from floatplan.simulation.control_loop import Guide, JointControl, Sensors
from floatplan.simulation.followed_motion import PERIOD, FollowedMotion, control_times
from floatplan.simulation.perturbation import Perturbation, Sample


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

    def __init__(self, followed: FollowedMotion, gains: Array) -> None:
        self.followed = followed
        self.gains = gains
        self.robot = followed.robot
        self.reduced = followed.reduced
        self.base = base_states(followed.reduced)
        self.joints = followed.reduced.joints
        self.motors = followed.motors
        self.times = control_times(followed.duration)
        of_positions, of_velocities = self.reduced.of_joints
        # Positions and rates (K, 2, J) of the joints.
        self.planned_joints = np.stack(
            (followed.positions[:, of_positions], followed.velocities[:, of_velocities]), axis=1
        )
        self.torques = followed.torques + self.reduced.lost(self.planned_joints[:, 1])
        self.base_ends = followed.base_ends
        self.takeoff = followed.takeoff
        self.landing = followed.landing

    def sampled(self, perturbation: Perturbation, seed: int, number: int, **fixed: Any) -> Sample:
        """Sample one robot by a seed and its number, but for fixed factors."""
        sample = perturbation.sampled(seed, number, len(self.joints), self.robot.model.njoints)
        return replace(sample, **fixed)

    def fly(self, perturbation: Perturbation, friction: float, seed: int, number: int) -> FlightRecord:
        """Fly one robot, sampled by a seed and its number, on a ground of some friction."""
        sample = self.sampled(perturbation, seed, number)
        robot = ContactRobot(self.followed, sample.friction * friction, sample)
        return self.followed_by(robot, MotionGuide(self), perturbation, sample)

    def followed_by(
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
        followed = self.followed
        robot.begin(followed.base_ends[0], followed.positions[0], followed.begin_velocities)
        base = self.base
        sensors = Sensors(perturbation, sample, PERIOD, base)
        control = JointControl(guide, sensors, self.gains, self.motors, sample.torque, sensors.delay)
        pitch = np.nan
        tilt = 0.0
        share = 0.0
        slid = np.zeros(len(robot.feet))
        result = FlightRecord(robot)
        for tick in control.fly(robot, PERIOD):
            share = max(share, self.motors.share(tick.requested, tick.state[1, base.size :]))
            if tick.now >= guide.landing:
                if np.isnan(pitch):
                    pitch = float(base.off(tick.state[:1], followed.goal)[0])
                planned = base.orientation(followed.positions[[tick.number]])
                tilt = max(tilt, base.apart(base.orientation(tick.state), planned))
            if not tick.finite:
                tilt = np.inf
                break
            if tick.now < followed.duration:
                slid += robot.slips * PERIOD
            if record:
                torques = np.pad(sample.torque * tick.torques, (self.reduced.of_joints[1].start, 0))
                state = base.parts(tick.state)
                result.rows.append((*state, robot.accelerations(), torques, robot.forces, robot.points))
        result.landing = {
            "stands": robot.stands(self.base_ends[1], base.orientation(followed.positions[-1:])),
            "touched": robot.links(),
            "pitch": pitch,
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

    @property
    def landing(self) -> float:
        """When the last flight should end, s."""
        return self.control.landing

    def target(self, tick: int, now: float, sensors: Sensors) -> tuple[Array, Array]:
        """Positions and rates (2, J) of all joints, and feed-forward torques (J,)."""
        row = min(tick, len(self.control.times) - 1)
        return self.control.planned_joints[row], self.control.torques[row]
