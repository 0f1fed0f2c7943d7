"""Which angular momentum suits a flight in space: given, suggested by the joints' plain motion, or free about that.

There is no two-sided interval as (9) in space. What is suggested is the h with which the motion that has no free part
turns the base to the goal, by Newton's method with its exact derivative.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.sine_polynomial import SinePolynomials, basis, boundary_arguments
from floatplan.motion.spatial.attitude import LEVELS, IntegrationError, Turning, cells, turn
from floatplan.motion.spatial.dynamics import spatial_dynamics
from floatplan.motion.spatial.rotations import left_jacobian_inverse, logarithm, of_angles, unwrapped_angles
from floatplan.problem.problem import Problem
from floatplan.problem.reference import reference_at

ALONG, ACROSS = 0.4, 0.15  # [-] of a free h from the suggested one: along it and across
STEPS = 12  # [-] of Newton's method
LONGEST = 0.5  # [-] of |h|, a step of Newton's method
ENOUGH = 1e-10  # [rad]
SHORT = math.pi / 2  # [rad] of all angles: there the shortest rotation is the way to the goal
LEVEL = 2  # of the cells


@lru_cache(maxsize=8)
def spatial_momentum_set(problem: Problem) -> MomentumSet:
    """The h (3,) of a problem in space, kg m^2/s."""
    asked = problem.flight.angular_momentum
    if not isinstance(asked, str):
        given = asked if isinstance(asked, tuple) else (0.0, 0.0, 0.0)
        return MomentumSet(read_only(given), read_only(np.empty((3, 0))))
    suggested = suggested_momentum(problem)
    if asked != "free":
        return MomentumSet(read_only(suggested), read_only(np.empty((3, 0))))
    size = float(np.linalg.norm(suggested))
    if size == 0.0:
        reach = ALONG * np.trace(_PlainMotion(problem).mean_inertia_B) / 3 / problem.flight.duration
        return MomentumSet(read_only(suggested), read_only(np.eye(3) * reach))
    along = suggested / size
    beside = np.linalg.svd(along[None])[2][1:]
    axes = np.stack((ALONG * along, *(ACROSS * each for each in beside)), axis=1)
    return MomentumSet(read_only(suggested), read_only(size * axes))


def suggested_momentum(problem: Problem) -> Array:
    """The h (3,), kg m^2/s, with which the plain motion reaches the goal, or turns as often about its first axis.

    Where the goal's angles have turns about the third axis too, those are left to the joints; where they have them
    alone, h is along that.
    """
    plain = _PlainMotion(problem)
    goal = plain.reorientation.goal
    change = plain.reorientation.change
    if np.abs(change).max() < SHORT:
        turn = logarithm((plain.final_attitude @ plain.initial_attitude.T)[None])[0]
        return plain.reaching(plain.mean_inertia_W @ turn / problem.flight.duration)
    assert goal.axes is not None
    along = np.eye(3)[["xyz".index(letter) for letter in goal.axes]]
    if np.abs(change[:2]).max() < SHORT:
        inside = of_angles(goal.axes, np.array([[*plain.reorientation.start_angles[:2], 0.0]]))[0]
        return plain.turning(inside @ along[2], change, goal.axes, 2)
    h = plain.turning(along[0], change, goal.axes, 0)
    if abs(change[2]) > SHORT:
        return h
    found = plain.reaching(h)
    return found if np.linalg.norm(found - h) <= ALONG * np.linalg.norm(h) else h


class _PlainMotion:
    """The motion with no free part, or the recorded one of the objective "clip", as it turns the base for any h.

    ``mean_inertia_B`` (3, 3) is the mean over the flight in the base's axes, kg m^2; ``mean_inertia_W`` the same in the
    world's axes, at takeoff.
    """

    def __init__(self, problem: Problem) -> None:
        assert problem.reorientation is not None, "the robot flies in space"
        self.reorientation = problem.reorientation
        self.duration = problem.flight.duration
        self.initial_attitude = self.reorientation.start.matrix
        self.final_attitude = self.reorientation.goal.matrix
        self.cells = cells(*LEVELS[LEVEL])
        low, high = problem.position_limits.T
        centre, amplitude, duration = (low + high) / 2, (high - low) / 2, problem.flight.duration
        branch = np.zeros(len(centre), np.int64)
        ends = [
            (p, duration * rate, duration**2 * curvature)
            for state in (problem.initial, problem.final)
            for p, rate, curvature in [
                boundary_arguments(
                    state.positions, state.velocities, np.nan_to_num(state.accelerations), centre, amplitude, branch
                )
            ]
        ]
        if problem.reference is None:
            polynomials = SinePolynomials(centre, amplitude, duration, np.concatenate(ends).T, (0,) * len(centre))
            values = basis(polynomials.form).values(self.cells.s)
            joints = polynomials.motion(polynomials.no_free_part, values)
            positions, velocities = joints.positions, joints.velocities
        else:
            positions = reference_at(problem.reference, self.cells.s)
            velocities = reference_at(problem.reference, self.cells.s, 1) / duration
        inertia, joint_map = spatial_dynamics(problem.robot).momentum_maps(positions)
        self._inertia = inertia
        self._relative = np.einsum("kan,kn->ka", joint_map, velocities)
        self.mean_inertia_B = np.asarray(np.linalg.inv(np.linalg.inv(inertia).mean(axis=0)))
        self.mean_inertia_W = np.asarray(self.initial_attitude @ self.mean_inertia_B @ self.initial_attitude.T)

    def turned(self, h: Array) -> Turning:
        """Turn the base; errors as of :func:`turn`."""
        return turn(self.cells, self.duration, self._inertia, self._relative, h, self.initial_attitude)

    def residual(self, h: Array) -> tuple[Array, Array]:
        """Vector of rotation (3,), rad, from the attitude asked for at landing to that at landing.

        With its derivative (3, 3) by h, backwards through the cells; errors as of :func:`turn`.
        """
        turning = self.turned(h)
        residual = np.asarray(logarithm((self.final_attitude.T @ turning.ends[-1])[None])[0])
        transitions, weights = turning.carried
        mobility = turning.attitudes @ turning.inverse_inertia @ np.swapaxes(turning.attitudes, 1, 2)  # M of (S2)
        mobility = mobility.reshape(weights.shape)
        onward = left_jacobian_inverse(residual) @ self.final_attitude.T
        slope = np.zeros((3, 3))
        for cell in range(len(weights) - 1, -1, -1):
            slope += onward @ (weights[cell] @ mobility[cell]).sum(axis=0)
            onward = onward @ transitions[cell]
        return residual, slope

    def reaching(self, h: Array) -> Array:
        """The h from which the attitude at landing misses the goal least, by Newton's method from ``h`` on."""
        best, least = h, math.inf
        try:
            for _ in range(STEPS):
                residual, slope = self.residual(h)
                missed = float(np.linalg.norm(residual))
                if missed < least:
                    best, least = h, missed
                if missed < ENOUGH:
                    break
                step = -np.linalg.lstsq(slope, residual, rcond=1e-9)[0]
                longest = LONGEST * max(float(np.linalg.norm(h)), float(np.trace(self.mean_inertia_B)) / self.duration)
                h = h + step * min(1.0, longest / max(float(np.linalg.norm(step)), 1e-300))
        except IntegrationError:
            pass
        return best

    def turning(self, axis: Array, change: Array, axes: str, which: int) -> Array:
        """The h along an axis (3,) of the world with which one of the angles about axes changes as asked (3,), rad."""
        low, of_low = 0.0, 0.0
        angle = float(change[which])
        high = angle / self.duration * float(axis @ self.mean_inertia_W @ axis)
        try:
            for _ in range(STEPS):
                angles = unwrapped_angles(axes, self.turned(high * axis).way)
                of_high = float(angles[-1, which] - angles[0, which])
                if abs(of_high - angle) < 1e-6 or of_high == of_low:
                    break
                low, of_low, high = high, of_high, high + (angle - of_high) * (high - low) / (of_high - of_low)
        except IntegrationError:
            pass
        return np.asarray(high * axis)
