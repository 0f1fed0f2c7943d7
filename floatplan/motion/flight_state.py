"""What a flight is at its instants, and its extremes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from floatplan.arrays import Array
from floatplan.shown import Outlined


@dataclass(frozen=True, eq=False, repr=False)
class FlightState(Outlined):
    """The robot at instants of its flight: a number, or an array of any shape, which is the ``...`` of all others.

    Attributes
    ----------
    times : (...) s
    orientation, orientation_rate : (...) rad, rad/s
    positions, velocities, accelerations, torques : (..., n) rad, rad/s, rad/s^2, N m
        Torques are generalised: a leader's is the sum over its group, by ratio.
    motor_torques : (..., m) N m
        Each motor's own, in the order of ``robot.motors``.
    com_position, com_velocity : (..., 2) m, m/s; horizontal, vertical
    base_position : (..., 2) m
        Origin of the base link.
    angular_momentum : (...) kg m^2/s
        Computed from the state, not assumed.
    """

    times: Array
    orientation: Array
    orientation_rate: Array
    positions: Array
    velocities: Array
    accelerations: Array
    torques: Array
    motor_torques: Array
    com_position: Array
    com_velocity: Array
    base_position: Array
    angular_momentum: Array

    def shaped(self, shape: tuple[int, ...]) -> FlightState:
        """Return the same with as many instants in another shape."""
        if shape == self.times.shape:
            return self
        arrays = {name: values.reshape(shape + values.shape[1:])[()] for name, values in vars(self).items()}
        return FlightState(**arrays)


@dataclass(frozen=True, eq=False, repr=False)
class Peaks(Outlined):
    """Extremes over the flight, and the instants, s, of those that belong to one.

    Attributes
    ----------
    joints, joint_instants : key of a limit of the joints' motion -> (n,), in the unit of its row
        Largest magnitudes of what :data:`floatplan.tables.JOINT_LIMITS` limit.
    torque : (n,) N m; largest magnitudes of the generalised torques
    clearance : m; None without obstacles
    motor_torque : (m,) N m, of the motors' own torques
    position : (n, 2) rad, lowest and highest
    motor_torque_instant : (m,)
    """

    joints: Mapping[str, Array]
    joint_instants: Mapping[str, Array]
    torque: Array
    clearance: float | None
    motor_torque: Array
    position: Array
    motor_torque_instant: Array

    @property
    def velocity(self) -> Array:
        """Largest magnitudes (n,) of the joints' rates, rad/s."""
        return self.joints["velocity"]

    @property
    def velocity_instant(self) -> Array:
        """When they are reached (n,), s."""
        return self.joint_instants["velocity"]
