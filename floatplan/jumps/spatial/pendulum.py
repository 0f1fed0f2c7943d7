"""A robot on two feet: turned as a whole about the line through them, so that the moment about it vanishes.

With a motion of base and joints at hand, its feet at a and b, n along b - a and Q(d) the rotation by d about n, the
robot is where ``a + Q (x - a)`` is of its points x. Of its acceleration ``d''`` the moment about the line is affine:
two evaluations of the inverse dynamics give the differential equation of d, an inverted pendulum's.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.motion import hermite, values
from floatplan.jumps.spatial.coordinates import Mechanics, angles_of, turned
from floatplan.jumps.spatial.model import BASE

SUBSTEPS = 2  # [-] Runge-Kutta steps of a step of the grid


@dataclass(frozen=True, eq=False)
class Line:
    """The line through two feet: a point (3,) of it, m, and its direction (3,)."""

    point: Array
    direction: Array

    @classmethod
    def through(cls, places: dict[str, Array]) -> "Line":
        """Through the places of two feet."""
        first, second = places.values()
        along = second - first
        return cls(first, along / np.linalg.norm(along))

    def turned(self, axes: str, motion: Array, angle: Array) -> Array:
        """A motion (3, 6+n, N) turned by an angle with two derivatives (3, N)."""
        n = self.direction
        rotation, rate, rate_change = turned(axes, motion[:, 3:BASE])
        own = np.array([pin.exp3(n * one) for one in angle[0]])
        of_time = angle[:, :, None]

        def by_own(vectors: Array) -> Array:
            return np.asarray(np.einsum("nij,nj->ni", own, vectors))

        arm = by_own(motion[0, :3].T - self.point)
        velocity = by_own(motion[1, :3].T)
        acceleration = by_own(motion[2, :3].T)
        across = np.cross(n, arm)
        result = motion.copy()
        result[0, :3] = (self.point + arm).T
        result[1, :3] = (velocity + of_time[1] * across).T
        inwards = np.cross(n, across)
        coriolis = 2 * of_time[1] * np.cross(n, velocity)
        result[2, :3] = (acceleration + coriolis + of_time[2] * across + of_time[1] ** 2 * inwards).T
        turning = by_own(rate)
        rates = turning + of_time[1] * n
        changes = by_own(rate_change) + of_time[2] * n + of_time[1] * np.cross(n, turning)
        result[:, 3:BASE] = angles_of(axes, own @ rotation, rates, changes, motion[0, 3:BASE])
        return result

    def moment(self, mechanics: Mechanics, motion: Array) -> Array:
        """Moment (N,) about the line that a motion takes, N m."""
        wrench = mechanics.base_wrench(motion)
        arm = motion[0, :3].T - self.point
        return np.asarray((wrench[:, 3:] + np.cross(arm, wrench[:, :3])) @ self.direction)


def balanced(mechanics: Mechanics, line: Line, times: Array, motion: Array, near: int) -> Array:
    """The motion (3, 6+n, G) turned about a line by an angle that begins with nothing at one end, 0 or -1.

    Its moment about the line vanishes.
    """
    curve = hermite(times, motion)
    order = 1 if near == 0 else -1
    instants = times[::order]
    angle = np.zeros((3, len(times)))
    state = np.zeros(2)
    angle[2, 0] = _acceleration(mechanics, line, values(curve, instants[:1]), state)
    for index in range(len(instants) - 1):
        step = (instants[index + 1] - instants[index]) / SUBSTEPS
        for substep in range(SUBSTEPS):
            begin = instants[index] + substep * step
            stages = values(curve, np.clip([begin, begin + step / 2, begin + step], times[0], times[-1]))
            state = _runge_kutta(mechanics, line, stages, state, step)
        angle[:2, index + 1] = state
        at = values(curve, instants[index + 1 : index + 2])
        angle[2, index + 1] = _acceleration(mechanics, line, at, state)
    return line.turned(mechanics.axes, motion, angle[:, ::order])


def _runge_kutta(mechanics: Mechanics, line: Line, stages: Array, state: Array, step: float) -> Array:
    """Angle and rate (2,) after a step, from motions (3, 6+n, 3) at its begin, middle and end."""

    def slope(stage: int, at: Array) -> Array:
        return np.array([at[1], _acceleration(mechanics, line, stages[:, :, [stage]], at)])

    first = slope(0, state)
    second = slope(1, state + step / 2 * first)
    third = slope(1, state + step / 2 * second)
    fourth = slope(2, state + step * third)
    return np.asarray(state + step / 6 * (first + 2 * second + 2 * third + fourth))


def _acceleration(mechanics: Mechanics, line: Line, motion: Array, state: Array) -> float:
    """The angle's acceleration where the motion (3, 6+n, 1) is turned by ``state``, angle and rate."""
    moments = []
    for acceleration in (0.0, 1.0):
        angle = np.array([*state, acceleration])[:, None]
        moments.append(line.moment(mechanics, line.turned(mechanics.axes, motion, angle))[0])
    return float(-moments[0] / (moments[1] - moments[0]))
