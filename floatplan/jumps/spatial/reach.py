"""How high the legs that stand carry a robot's centre of mass, and how fast they lift it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.spatial.standing import Foot, Kinematics


@dataclass(frozen=True)
class LegReach:
    """What legs reach while all feet stand where they are and the base is not rotated; other joints are still.

    Attributes
    ----------
    tallest : m, the greatest height of the centre of mass over the ground
    fastest : m/s, the greatest speed upwards of the centre of mass at any height, within the joints' rates
    """

    tallest: float
    fastest: float


def leg_reach(
    kinematics: Kinematics,
    feet: Sequence[Foot],
    places: Mapping[str, Array],
    rotation: Array,
    standing: Array,
    ranges: Array,
    rates: Array,
) -> LegReach:
    """Lift and lower a robot from where it stands by steps of 1 % of its height, as far as its legs reach.

    Parameters
    ----------
    kinematics : of the robot
    feet : that stand
    places : (3,) m, of their points, by their names; the centre of mass is above the origin
    rotation : (3, 3) of the base
    standing : (1+n,) height of the centre of mass, m, and joints, where the robot stands
    ranges : (n, 2) rad, of joints
    rates : (n,) rad/s, that joints may have
    """
    deepest = 0.6  # [-] of the height where it stands: lower no robot crouches to jump
    step = 0.01  # [-] of it
    height = float(standing[0])
    tallest = height
    fastest = 0.0
    for direction in (1.0, -1.0):
        legs = _StandingLegs(kinematics, feet, places, rotation, standing[1:], ranges)
        reached = height
        while reached >= deepest * height and legs.carry(reached):
            tallest = max(tallest, reached)
            fastest = max(fastest, legs.speed(rates))
            reached += direction * step * height
    return LegReach(tallest, fastest)


class _StandingLegs:
    """A robot whose feet stand, in a configuration that follows the height of its centre of mass."""

    def __init__(
        self,
        kinematics: Kinematics,
        feet: Sequence[Foot],
        places: Mapping[str, Array],
        rotation: Array,
        joints: Array,
        ranges: Array,
    ) -> None:
        robot = kinematics.robot
        self.kinematics = kinematics
        self.feet = feet
        self.places = np.concatenate([places[foot.name] for foot in feet])
        self.q = kinematics.pose(np.zeros(3), rotation, joints)
        self.q[:3] -= pin.centerOfMass(kinematics.model, kinematics.data, self.q)
        self.q[2] += self.places[2] - kinematics.point(feet[0].body, feet[0].local)[2]
        model = kinematics.model
        in_legs = {number for foot in feet for number in model.supports[foot.body]}
        planned = [(index, model.getJointId(name)) for index, name in enumerate(robot.joints)]
        self.joints = [index for index, number in planned if number in in_legs]
        numbers = [number for _, number in planned if number in in_legs]
        self.columns = [0, 1, 2, *(model.joints[number].idx_v for number in numbers)]
        self.coordinates = [model.joints[number].idx_q for number in numbers]
        self.ranges = ranges[self.joints]

    def carry(self, height: float) -> bool:
        """Bring the centre of mass to a height, m, above the origin; return whether the legs reach that far."""
        close = 1e-4  # [m]
        longest = 0.2  # [rad, m] of a step of Newton's method
        model = self.kinematics.model
        required = np.concatenate(([0.0, 0.0, height], self.places))
        for _ in range(30):
            positions, jacobian = self._points()
            gap = required - positions
            if np.abs(gap).max() < close:
                return True
            change = np.linalg.lstsq(jacobian, gap, rcond=1e-6)[0]
            motion = np.zeros(model.nv)
            motion[self.columns] = change * min(1.0, longest / np.abs(change).max())
            self.q = pin.integrate(model, self.q, motion)
            self.q[self.coordinates] = np.clip(self.q[self.coordinates], *self.ranges.T)
        return False

    def speed(self, rates: Array) -> float:
        """How fast the legs lift the centre of mass here, m/s, with joints (n,) as fast as they may be, rad/s."""
        _, jacobian = self._points()
        upwards = np.zeros(len(jacobian))
        upwards[2] = 1.0
        shares = np.abs(np.linalg.lstsq(jacobian, upwards, rcond=1e-6)[0][3:])
        return float((rates[self.joints] / np.maximum(shares, 1e-9)).min())

    def _points(self) -> tuple[Array, Array]:
        """The centre of mass and the feet's points (3+3F,), m, and their derivatives by the base and the legs."""
        model = self.kinematics.model
        data = self.kinematics.data
        pin.forwardKinematics(model, data, self.q)
        pin.computeJointJacobians(model, data, self.q)
        rows = [pin.jacobianCenterOfMass(model, data, self.q)]
        positions = [data.com[0].copy()]
        for foot in self.feet:
            of_joint = pin.getJointJacobian(model, data, foot.body, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            arm = data.oMi[foot.body].rotation @ np.array(foot.local)
            rows.append(of_joint[:3] - pin.skew(arm) @ of_joint[3:])
            positions.append(self.kinematics.point(foot.body, foot.local))
        return np.concatenate(positions), np.vstack(rows)[:, self.columns]
