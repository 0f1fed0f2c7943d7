"""The legs of a robot: from the hip over the knee to the foot; how they bend, and whether they can step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import compress

import numpy as np

from floatplan.arrays import Array
from floatplan.robot.robot import Robot
from floatplan.robot.standing import FLAT, SOLE, Spot, corners, may_roll, out_of_round, positions_from_com

NO_LENGTH = 0.05  # [-] of a leg's length: joints that are no farther from each other coincide


@dataclass(frozen=True, eq=False)
class Leg:
    """A limb on which a robot stands.

    Attributes
    ----------
    robot : Robot
    foot : the frame on which it stands
    posture : (n,) rad, the robot's reference posture, which tells the sole of a foot from its upper side
    """

    robot: Robot
    foot: str
    posture: Array

    @cached_property
    def bodies(self) -> list[int]:
        """Bodies from the hip's to the foot's; empty where the foot is on the base."""
        upwards: list[int] = []
        body = self.robot.frames[self.foot].body
        while body > 0:
            upwards.append(body)
            body = int(self.robot.tree.parent[body])
        return upwards[::-1]

    @cached_property
    def joints(self) -> list[int]:
        """Indices of the planned joints that move the foot against the base."""
        return np.flatnonzero(self.robot.tree.turns[self.robot.frames[self.foot].body]).tolist()

    @cached_property
    def corners(self) -> list[Spot]:
        """Corners of the foot's shape; the frame's origin where it has none."""
        link = self.robot.contact_link(self.robot.frames[self.foot].link)
        home = self.robot.frames[self.foot]
        return corners(self.robot.link_hulls[link]) if link else [Spot(home.body, home.local)]

    @cached_property
    def sole(self) -> tuple[Spot, Spot] | None:
        """Both ends of the foot's sole, which is below the line from the first to the second.

        It is the side of the foot on which it stands, as flat as soles are, that is longest and faces away from the
        shank. A foot that is fixed to the shank has none: it stands on its tip; and neither has a wheel, or what has no
        geometry.
        """
        if not self.robot.stands_on_geometry(self.robot.frames[self.foot].link):
            return None
        y = np.append(0.0, self.posture)
        home = self.robot.frames[self.foot]
        radius = max(abs(corner.place - home.local) + corner.radius for corner in self.corners)
        if may_roll(out_of_round(self.robot, self.foot, Spot(home.body, home.local), radius, y), radius):
            return None
        origins = self._distinct(y)
        if len(origins) < 3 or origins[-1] != Spot(self.bodies[-1], 0j):
            return None
        knee, ankle = positions_from_com(self.robot, origins[-2:], y)
        shank = (ankle - knee) / abs(ankle - knee)
        positions = positions_from_com(self.robot, self.corners, y)
        radii = np.array([corner.radius for corner in self.corners])
        best = None
        longest = 0.0
        most = np.radians(70)
        for lean in np.linspace(-most, most, 141):  # of the sole away from square to its shank
            over_ground = positions * np.conj(shank * np.exp(1j * lean)) * -1j  # as if the ground were there
            under = over_ground.imag - radii
            low = np.flatnonzero(under < under.min() + FLAT)
            first = low[over_ground.real[low].argmin()]
            second = low[over_ground.real[low].argmax()]
            length = float(over_ground.real[second] - over_ground.real[first])
            if length > SOLE and length * np.cos(lean) > longest:
                best = (self.corners[first], self.corners[second])
                longest = length * np.cos(lean)
        return best

    @property
    def support(self) -> tuple[Spot, ...]:
        """What may be on the ground where the robot stands: the ends of the sole, or all corners of the foot."""
        return self.sole or tuple(self.corners)

    @cached_property
    def bend_spots(self) -> list[Spot]:
        """Hip, knee and end of the leg, in the order from the base; fewer where it has no knee.

        The knee is the joint with the longest bones: that between thigh and shank, whatever else a leg has.
        """
        y = np.append(0.0, self.posture)
        spots = self._distinct(y)
        if self.sole is None:
            ends = positions_from_com(self.robot, self.corners, y)
            last = positions_from_com(self.robot, spots[-1:], y)[0] if spots else 0j
            farthest = int(np.abs(ends - last).argmax())
            if spots and abs(ends[farthest] - last) > NO_LENGTH * self._length(y):
                spots = [*spots, self.corners[farthest]]
        if len(spots) < 3:
            return spots
        bones = np.abs(np.diff(positions_from_com(self.robot, spots, y)))
        knee = 1 + int(np.minimum(bones[:-1], bones[1:]).argmax())
        return spots[knee - 1 : knee + 2]

    def bend(self, y: Array) -> float:
        """Angle of the knee in a posture y (n+1,), rad: 0 where the leg is straight, positive counterclockwise."""
        hip, knee, end = positions_from_com(self.robot, self.bend_spots, y)
        return float(np.angle((end - knee) / (knee - hip)))

    def height(self, y: Array) -> float:
        """Of the hip over the end of the leg in a posture y (n+1,), m."""
        hip, _, end = positions_from_com(self.robot, self.bend_spots, y)
        return float(hip.imag - end.imag)

    @cached_property
    def has_knee(self) -> bool:
        """Whether it is a leg of thigh and shank."""
        return len(self.bend_spots) == 3

    @cached_property
    def steps(self) -> bool:
        """Whether it can lift its foot by bending."""
        least = 0.15  # of its length: one that only sways does not shorten
        return len(self.joints) > 1 and self.shortens() > least

    def shortens(self) -> float:
        """By what share of its greatest length the foot can come nearer to the first joint of the leg."""
        if not self.bodies:
            return 0.0
        robot = self.robot
        low, high = robot.position_limits.T
        low = np.maximum(low, self.posture - np.pi)  # of joints without a range
        high = np.minimum(high, self.posture + np.pi)
        count = 128  # postures
        sampled = np.random.default_rng(0).uniform(low, high, (count, len(low)))
        y = np.column_stack((np.zeros(count), sampled)).T
        hip, foot = positions_from_com(robot, [Spot(self.bodies[0], 0j), self._end], y).T
        length = np.abs(foot - hip)
        return float(1 - length.min() / length.max()) if length.max() > 0 else 0.0

    @cached_property
    def _end(self) -> Spot:
        """The ankle of a foot that has one, else the tip of the leg: rotating a sole does not shorten the leg."""
        return self.bend_spots[-1] if self.bend_spots else self.corners[0]

    def _distinct(self, y: Array) -> list[Spot]:
        """Origins of the leg's joints from the hip on, of those that coincide the last."""
        spots = [Spot(body, 0j) for body in self.bodies]
        if not spots:
            return []
        distances = np.abs(np.diff(positions_from_com(self.robot, spots, y)))
        least = NO_LENGTH * self._length(y)
        return [*compress(spots, distances > least), spots[-1]]

    @cached_property
    def length(self) -> float:
        """Sum of its bones in the reference posture, m."""
        return self._length(np.append(0.0, self.posture))

    def _length(self, y: Array) -> float:
        """Sum of the leg's bones, m."""
        spots = [*(Spot(body, 0j) for body in self.bodies), self.corners[0]]
        return float(np.abs(np.diff(positions_from_com(self.robot, spots, y))).sum())
