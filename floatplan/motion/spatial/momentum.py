"""Which angular momentum suits a flight in space: fixed, suggested by the joints' nominal motion, or free about that.

There is no two-sided interval as (9) in space. The suggested h is that with which the motion without free coefficients
turns the base to the goal, by Newton's method with its exact derivative.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.sine_polynomial import SinePolynomials, basis
from floatplan.motion.spatial.attitude import LEVELS, IntegrationError, Turning, cells, turn
from floatplan.motion.spatial.dynamics import spatial_dynamics
from floatplan.motion.spatial.rotations import left_jacobian_inverse, logarithm, of_angles, unwrapped_angles
from floatplan.problem.problem import Problem
from floatplan.problem.reference import reference_at

ALONG = 0.4  # [-] of a free h from the suggested one: along it
STEPS = 12  # [-] of Newton's method
SHORT = math.pi / 2  # [rad] of all angles: there the shortest rotation is the way to the goal


@lru_cache(maxsize=8)
def spatial_momentum_set(problem: Problem) -> MomentumSet:
    """The h (3,) of a problem in space, kg m^2/s."""
    requested = problem.flight.angular_momentum
    if not isinstance(requested, str):
        fixed = requested if isinstance(requested, tuple) else (0.0, 0.0, 0.0)
        return MomentumSet(read_only(fixed), read_only(np.empty((3, 0))))
    suggested = suggested_momentum(problem)
    if requested != "free":
        return MomentumSet(read_only(suggested), read_only(np.empty((3, 0))))
    size = float(np.linalg.norm(suggested))
    if size == 0.0:
        reach = ALONG * np.trace(_NominalMotion(problem).mean_inertia_B) / 3 / problem.flight.duration
        return MomentumSet(read_only(suggested), read_only(np.eye(3) * reach))
    along = suggested / size
    across = np.linalg.svd(along[None])[2][1:]
    # Across the suggested h a free one is no farther from it than 0.15 of its size.
    axes = np.column_stack((ALONG * along, 0.15 * across.T))
    return MomentumSet(read_only(suggested), read_only(size * axes))


def suggested_momentum(problem: Problem) -> Array:
    """The h (3,), kg m^2/s, with which the nominal motion reaches the goal, or turns as often about its first axis.

    Where the goal's angles have turns about the third axis too, those are left to the joints; where they have no
    others, h is along that.
    """
    nominal = _NominalMotion(problem)
    goal = nominal.reorientation.goal
    change = nominal.reorientation.change
    if np.abs(change).max() < SHORT:
        rotation = logarithm((nominal.final_attitude @ nominal.initial_attitude.T)[None])[0]
        return nominal.reaching(nominal.mean_inertia_W @ rotation / problem.flight.duration)
    assert goal.axes is not None
    along = np.eye(3)[list(map("xyz".index, goal.axes))]
    if np.abs(change[:2]).max() < SHORT:
        inside = of_angles(goal.axes, np.array([[*nominal.reorientation.start_angles[:2], 0.0]]))[0]
        return nominal.turning(inside @ along[2], change, goal.axes, 2)
    h = nominal.turning(along[0], change, goal.axes, 0)
    if abs(change[2]) > SHORT:
        return h
    reached_h = nominal.reaching(h)
    return reached_h if np.linalg.norm(reached_h - h) <= ALONG * np.linalg.norm(h) else h


class _NominalMotion:
    """The motion without free coefficients, or the recorded one of the objective "clip", and how it turns the base.

    ``mean_inertia_B`` (3, 3) is the mean over the flight in the base's axes, kg m^2; ``mean_inertia_W`` the same in the
    world's axes, at takeoff.
    """

    def __init__(self, problem: Problem) -> None:
        assert problem.reorientation is not None, "the robot flies in space"
        self.reorientation = problem.reorientation
        self.duration = problem.flight.duration
        self.initial_attitude = self.reorientation.start.matrix
        self.final_attitude = self.reorientation.goal.matrix
        self.cells = cells(*LEVELS[2])  # the coarsest of eight stages
        if problem.reference is None:
            none_free = np.zeros(len(problem.robot.joints), np.int64)
            polynomials = SinePolynomials.between_ends(problem, none_free.tolist(), np.zeros_like(none_free))
            values = basis(polynomials.form).values(self.cells.s)
            joints = polynomials.motion(polynomials.nominal_coefficients, values)
            positions = joints.positions
            velocities = joints.velocities
        else:
            positions = reference_at(problem.reference, self.cells.s)
            velocities = reference_at(problem.reference, self.cells.s, 1) / self.duration
        inertia, joint_map = spatial_dynamics(problem.robot).momentum_maps(positions)
        self._inertia = inertia
        self._relative = np.einsum("kan,kn->ka", joint_map, velocities)
        self.mean_inertia_B = np.asarray(np.linalg.inv(np.linalg.inv(inertia).mean(axis=0)))
        self.mean_inertia_W = np.asarray(self.initial_attitude @ self.mean_inertia_B @ self.initial_attitude.T)

    def turned(self, h: Array) -> Turning:
        """Rotate the base; errors as of :func:`turn`."""
        return turn(self.cells, self.duration, self._inertia, self._relative, h, self.initial_attitude)

    def residual(self, h: Array) -> tuple[Array, Array]:
        """Vector of rotation (3,), rad, from the requested attitude at landing to that at landing.

        With its derivative (3, 3) by h, backwards through the cells; errors as of :func:`turn`.
        """
        turning = self.turned(h)
        residual = np.asarray(logarithm((self.final_attitude.T @ turning.ends[-1])[None])[0])
        return residual, turning.landing_by_momentum(left_jacobian_inverse(residual) @ self.final_attitude.T)

    def reaching(self, h: Array) -> Array:
        """The h from which the attitude at landing misses the goal least, by Newton's method from ``h`` on."""
        best = h
        least = math.inf
        try:
            for _ in range(STEPS):
                residual, slope = self.residual(h)
                miss = float(np.linalg.norm(residual))
                if miss < least:
                    best = h
                    least = miss
                if miss < 1e-10:  # [rad] hardly more than rounding
                    break
                step = -np.linalg.lstsq(slope, residual, rcond=1e-9)[0]
                # A step is no longer than half of h, or half of what would turn the robot by about a radian.
                longest = 0.5 * max(float(np.linalg.norm(h)), float(np.trace(self.mean_inertia_B)) / self.duration)
                h = h + step * min(1.0, longest / max(float(np.linalg.norm(step)), 1e-300))
        except IntegrationError:
            pass
        return best

    def turning(self, axis: Array, change: Array, axes: str, which: int) -> Array:
        """The h along an axis (3,) of the world with which one of the angles about axes has its change (3,), rad."""
        low = 0.0
        of_low = 0.0
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
