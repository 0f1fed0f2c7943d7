"""How the joints move: sine functions of polynomials (12), which meet the conditions (13) whatever the variables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.motion.sine_polynomial import SinePolynomials, basis, boundary_arguments, powers_map
from floatplan.problem.problem import Problem

CONDITIONS = 6  # (13) of a joint: p, p', p'' at both ends


class Motions:
    """All motions (12) between a problem's ends that land on one branch of the arcsine.

    There (13) are six linear equations for the polynomial of a joint, with s = t / T:
    ``p = Hermite polynomials of (13) + s^3 (1 - s)^3 sum_k z_k J_k(s)``, with J_k that make a unit of z_k a root mean
    square of 1 rad. The variables z (m,) are those of all joints, in one row.
    """

    def __init__(self, problem: Problem, degrees: Sequence[int], branch: IntArray) -> None:
        low, high = problem.position_limits.T
        centre = (low + high) / 2
        amplitude = (high - low) / 2
        duration = problem.flight.duration
        conditions = []
        for state, on_branch in ((problem.initial, 0 * branch), (problem.final, branch)):
            at_end = state.positions, state.velocities, state.accelerations
            p, rate, curvature = boundary_arguments(*at_end, centre, amplitude, on_branch)
            conditions += [p, rate * duration, curvature * duration**2]
        free = tuple(degree + 1 - CONDITIONS for degree in degrees)
        self.polynomials = SinePolynomials(centre, amplitude, duration, np.transpose(conditions), free)
        self.size = sum(free)
        joint, power = np.divmod(self.polynomials.free_indices, self.polynomials.width)
        self.by_z = np.zeros((len(free), CONDITIONS + self.polynomials.width, self.size))
        self.by_z[joint, CONDITIONS + power, np.arange(self.size)] = 1

    def coefficients(self, z: Array) -> Array:
        """Of each joint's p (n, 6+width): its conditions (13), then its z."""
        return np.asarray(np.pad(self.polynomials.boundary, ((0, 0), (0, self.polynomials.width))) + self.by_z @ z)

    def free_part(self, z: Array) -> Array:
        """The z of each joint (n, width), with zeros where its degree is lower."""
        return self.coefficients(z)[:, CONDITIONS:]

    def b(self, z: Array) -> tuple[Array, Array]:
        """All b of (12), powers of seconds, whose norm is least in (17), and their derivatives by z."""
        powers = powers_map(self.polynomials.form, self.polynomials.duration)
        b = (self.coefficients(z) @ powers.T).ravel()
        return b, (powers @ self.by_z).reshape(len(b), self.size)

    def at(self, s: Array, z: Array) -> tuple[Array, Array]:
        """q, q', q'' (N, 3n) of (12) at instants s (N,) of [0, 1], and their derivatives (N, 3n, m) by z."""
        centre = self.polynomials.centre
        amplitude = self.polynomials.amplitude
        per_second = 1 / self.polynomials.duration
        coefficients = self.coefficients(z).T
        values = [per_second**order * value for order, value in enumerate(basis(self.polynomials.form).values(s))]
        p, p1, p2 = (value @ coefficients for value in values)
        dp, dp1, dp2 = (np.tensordot(value, self.by_z, (1, 1)) for value in values)
        sine = amplitude * np.sin(p)
        cosine = amplitude * np.cos(p)
        motion = np.hstack((centre + sine, cosine * p1, cosine * p2 - sine * p1**2))
        position = cosine[..., None] * dp
        velocity = cosine[..., None] * dp1 - (sine * p1)[..., None] * dp
        acceleration = cosine[..., None] * dp2 - (2 * sine * p1)[..., None] * dp1
        acceleration -= (sine * p2 + cosine * p1**2)[..., None] * dp
        return motion, np.concatenate((position, velocity, acceleration), axis=1)
