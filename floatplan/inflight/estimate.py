"""The robot's state in flight, from measurements: orientation, place of the centre of mass, momentum and masses.

Between measurements the orientation goes on by (4) along the joints' reference, the centre of mass on its parabola.
What is measured beside that corrects them: orientation, momentum and masses by a Kalman filter; of the place of the
centre of mass the first measurements are averaged, later ones weigh as ``dt / PLACE_TIME``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight.identification import Identification
from floatplan.inflight.measurement import Measurement
from floatplan.motion.planar.ballistics import Ballistics

PLACE_TIME = 0.02  # [s] time constant of the low-pass filter


@dataclass
class Estimate:
    """At ``time``: orientation with the joints on their reference, h and masses.

    Place and velocity of the centre of mass are those at ``com_time``; ``placed`` counts its measurements.
    """

    time: float
    inertial: Identification
    com_position: Array
    com_velocity: Array
    gravity: float
    com_time: float = 0.0
    placed: int = 0

    def place(self, time: float) -> tuple[Array, Array]:
        """Place and velocity (2,) of the centre of mass at a time."""
        return _fallen(time - self.com_time, self.com_position, self.com_velocity, self.gravity)

    def path_from(self, time: float) -> Callable[[], Ballistics]:
        """Return what gives the path of the centre of mass from a time on, as it is known by now, also later."""
        return partial(_path, time - self.com_time, self.com_position, self.com_velocity, self.gravity)

    @property
    def orientation(self) -> float:
        """With the joints on their reference, rad."""
        return self.inertial.orientation

    @property
    def angular_momentum(self) -> float:
        """About the centre of mass, kg m^2/s."""
        return self.inertial.angular_momentum

    def take_in(self, measured: Measurement) -> None:
        """Take in when was measured, and where the centre of mass is."""
        self.time = measured.time
        if measured.com_position is None or measured.com_velocity is None:
            return
        dt = measured.time - self.com_time
        position, velocity = self.place(measured.time)
        self.com_time = measured.time
        self.placed += 1
        weight = max(1 / self.placed, 1 - math.exp(-dt / PLACE_TIME))  # their mean at first
        self.com_position = position + weight * (measured.com_position - position)
        self.com_velocity = velocity + weight * (measured.com_velocity - velocity)

    def landing(self, height: float) -> float | None:
        """Time at which the centre of mass comes down to a height, m; None where it does not."""
        climb, speed = height - self.com_position[1], self.com_velocity[1]
        reach = speed * speed - 2 * self.gravity * climb
        if self.gravity <= 0 or reach < 0:
            return None
        return self.com_time + float((speed + math.sqrt(reach)) / self.gravity)


def _fallen(dt: float, position: Array, velocity: Array, gravity: float) -> tuple[Array, Array]:
    fall = np.array([0.0, gravity * dt])
    return position + dt * (velocity - fall / 2), velocity - fall


def _path(dt: float, position: Array, velocity: Array, gravity: float) -> Ballistics:
    return Ballistics(*_fallen(dt, position, velocity, gravity), gravity)
