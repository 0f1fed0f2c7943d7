"""What a flight is at its instants, and its extremes."""

from __future__ import annotations

from dataclasses import dataclass

from floatplan.arrays import Array


@dataclass(frozen=True, eq=False)
class FlightState:
    """The robot at N instants of its flight.

    Attributes
    ----------
    times : (N,) s
    orientation, orientation_rate : (N,) rad, rad/s
    positions, velocities, accelerations, torques : (N, n) rad, rad/s, rad/s^2, N m
    com_position, com_velocity : (N, 2) m, m/s; horizontal, vertical
    base_position : (N, 2) m
        Origin of the base link.
    angular_momentum : (N,) kg m^2/s
        Computed from the state, not assumed.
    """

    times: Array
    orientation: Array
    orientation_rate: Array
    positions: Array
    velocities: Array
    accelerations: Array
    torques: Array
    com_position: Array
    com_velocity: Array
    base_position: Array
    angular_momentum: Array


@dataclass(frozen=True, eq=False)
class Peaks:
    """Extremes over the flight: |torque| and |velocity| per joint (n,), N m and rad/s, and the least clearance, m."""

    torque: Array
    velocity: Array
    clearance: float | None
