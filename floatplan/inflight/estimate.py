"""The robot's state in flight, from measurements: orientation, place of the centre of mass, momentum and masses.

Between measurements the orientation goes on by (4) along the joints' reference, the centre of mass on its parabola.
What is measured beside that corrects them: orientation, momentum and masses by a Kalman filter; of the place of the
centre of mass the first measurements are averaged, later ones weigh as ``dt / PLACE_TIME``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight.identification import Identification
from floatplan.inflight.measurement import Measurement
from floatplan.motion.planar.ballistics import Ballistics

PLACE_TIME = 0.02  # [s] time constant of the low-pass filter


@dataclass
class Estimate:
    """At ``time``: orientation with the joints on their reference, h and masses; place and velocity of the CM.

    ``placed`` counts measurements of the centre of mass.
    """

    time: float
    inertial: Identification
    com_position: Array
    com_velocity: Array
    gravity: float
    placed: int = 0

    def place(self, time: float) -> tuple[Array, Array]:
        """Place and velocity (2,) of the centre of mass at a time."""
        dt = time - self.time
        fall = np.array([0.0, self.gravity * dt])
        return self.com_position + dt * (self.com_velocity - fall / 2), self.com_velocity - fall

    def path(self, time: float) -> Ballistics:
        """Path of the centre of mass from a time on."""
        return Ballistics(*self.place(time), self.gravity)

    @property
    def orientation(self) -> float:
        """With the joints on their reference, rad."""
        return self.inertial.orientation

    @property
    def angular_momentum(self) -> float:
        """About the centre of mass, kg m^2/s."""
        return self.inertial.angular_momentum

    def learn(
        self, measured: Measurement, turn: float, aside: float, rate: float, positions: Array, velocities: Array
    ) -> None:
        """Take in a measurement, until which the base has turned by ``turn``, rad.

        Then its rate is ``rate``, rad/s, with the joints (n,) on their reference, from where it would stand ``aside``,
        rad, with the joints as they are measured.
        """
        dt = measured.time - self.time
        self.com_position, self.com_velocity = self.place(measured.time)
        self.time = measured.time
        self.inertial.state[0] += turn
        self.inertial.learn(
            measured.orientation - aside,
            np.array([rate, measured.orientation_rate]),
            np.stack((positions, measured.positions)),
            np.stack((velocities, measured.velocities)),
            dt,
        )
        if measured.com_position is not None and measured.com_velocity is not None:
            self.placed += 1
            weight = max(1 / self.placed, 1 - math.exp(-dt / PLACE_TIME))  # their mean at first
            self.com_position = self.com_position + weight * (measured.com_position - self.com_position)
            self.com_velocity = self.com_velocity + weight * (measured.com_velocity - self.com_velocity)

    def landing(self, height: float) -> float | None:
        """Time at which the centre of mass comes down to a height, m; None where it does not."""
        climb, speed = height - self.com_position[1], self.com_velocity[1]
        reach = speed * speed - 2 * self.gravity * climb
        if self.gravity <= 0 or reach < 0:
            return None
        return self.time + float((speed + math.sqrt(reach)) / self.gravity)
