"""The robot's state in flight, from measurements: orientation, place of the centre of mass, momentum and masses.

Between measurements the orientation goes on by (4) along the joints' reference, the centre of mass on its parabola.
What is measured beside that corrects them: the first measurements are averaged, later ones weigh as
``dt / time constant``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight.identification import Identification
from floatplan.inflight.measurement import Measurement
from floatplan.motion.planar.ballistics import Ballistics

ORIENTATION_TIME = 0.01  # [s] time constants of the low-pass filters
PLACE_TIME = 0.02


@dataclass
class Estimate:
    """Orientation, rad, with the joints on their reference, at ``time``; place and velocity of the CM; h and masses.

    ``seen`` and ``placed`` count measurements, of the centre of mass the latter.
    """

    time: float
    orientation: float
    inertial: Identification
    com_position: Array
    com_velocity: Array
    gravity: float
    seen: int = 0
    placed: int = 0

    def place(self, time: float) -> tuple[Array, Array]:
        """Place and velocity (2,) of the centre of mass at a time."""
        dt = time - self.time
        fall = np.array([0.0, self.gravity * dt])
        return self.com_position + dt * (self.com_velocity - fall / 2), self.com_velocity - fall

    def path(self, time: float) -> Ballistics:
        """Path of the centre of mass from a time on."""
        return Ballistics(*self.place(time), self.gravity)

    def advance(self, time: float, turn: float) -> None:
        """Go on to a time, at which the base has turned by ``turn``, rad."""
        self.com_position, self.com_velocity = self.place(time)
        self.orientation += turn
        self.time = time

    @property
    def angular_momentum(self) -> float:
        """About the centre of mass, kg m^2/s."""
        return self.inertial.angular_momentum

    def learn(self, measured: Measurement, dt: float, orientation: float) -> None:
        """Take in a measurement made at the estimate's time, ``dt`` s after the last."""
        self.seen += 1
        self.inertial.learn(measured.positions, measured.velocities, measured.orientation_rate, dt)
        self.orientation += _weight(self.seen, dt, ORIENTATION_TIME) * (orientation - self.orientation)
        if measured.com_position is not None and measured.com_velocity is not None:
            self.placed += 1
            weight = _weight(self.placed, dt, PLACE_TIME)
            self.com_position = self.com_position + weight * (measured.com_position - self.com_position)
            self.com_velocity = self.com_velocity + weight * (measured.com_velocity - self.com_velocity)

    def landing(self, height: float) -> float | None:
        """Time at which the centre of mass comes down to a height, m; None where it does not."""
        climb, speed = height - self.com_position[1], self.com_velocity[1]
        reach = speed * speed - 2 * self.gravity * climb
        if self.gravity <= 0 or reach < 0:
            return None
        return self.time + float((speed + math.sqrt(reach)) / self.gravity)


def _weight(seen: int, dt: float, constant: float) -> float:
    """Weight of the last of so many measurements: their mean at first, then a low-pass filter."""
    return max(1 / seen, 1 - math.exp(-dt / constant))
