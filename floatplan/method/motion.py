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

    On it (13) are six linear equations for the b of a joint: ``b = b_0 + C z``, with b_0 of a quintic. For ``C = Q R``
    and ``w = R z + Q^T b_0`` the |b|^2 of (17) is |w|^2 and a constant. Variables are the w (m,) of all joints, in a
    ``unit`` that is the largest of which none changes p by a root mean square of more than 1 rad.
    """

    def __init__(self, problem: Problem, degrees: Sequence[int], branch: IntArray) -> None:
        low, high = problem.position_limits.T
        self.centre = (low + high) / 2
        self.amplitude = (high - low) / 2
        self.duration = problem.flight.duration
        conditions = []
        for end, on_branch in ((problem.initial, 0 * branch), (problem.final, branch)):
            state = end.positions, end.velocities, end.accelerations
            arguments = boundary_arguments(*state, self.centre, self.amplitude, on_branch)
            conditions += [part * self.duration**order for order, part in enumerate(arguments)]  # by s = t / T
        free = tuple(degree + 1 - CONDITIONS for degree in degrees)
        boundary = np.transpose(conditions)
        self.polynomials = SinePolynomials(self.centre, self.amplitude, self.duration, boundary, free)
        self.size = sum(free)
        powers = powers_map(self.polynomials.form, self.duration)
        self.at_zero = np.zeros((len(low), powers.shape[1]))  # the polynomials' coefficients at w = 0, with boundary
        self.by_w = np.zeros((len(low), powers.shape[1], self.size))  # and their derivatives by w
        self.R = np.zeros((self.size, self.size))
        self.quintics = np.zeros(self.size)  # w of these
        first = 0
        for joint, own_free in enumerate(free):
            own = slice(first, first + own_free)
            columns = slice(CONDITIONS, CONDITIONS + own_free)
            Q, self.R[own, own] = np.linalg.qr(powers[:, columns])
            self.quintics[own] = Q.T @ powers[:, :CONDITIONS] @ boundary[joint]
            self.by_w[joint, columns, own] = np.linalg.inv(self.R[own, own])
            self.at_zero[joint, :CONDITIONS] = boundary[joint]
            self.at_zero[joint] -= self.by_w[joint] @ self.quintics
            first += own_free
        self.unit = 1 / np.linalg.norm(self.by_w.reshape(-1, self.size), 2) if self.size else 1.0
        self.R /= self.unit
        self.quintics /= self.unit
        self.by_w *= self.unit

    def free_part(self, w: Array) -> Array:
        """The z (n, width): a unit is a root mean square of 1 rad of p."""
        return np.asarray((self.at_zero + self.by_w @ w)[:, CONDITIONS:])

    def at(self, s: Array, w: Array) -> tuple[Array, Array]:
        """q, q', q'' (N, 3n) of (12) at instants s (N,) of [0, 1], and their derivatives (N, 3n, m) by w."""
        coefficients = (self.at_zero + self.by_w @ w).T
        values = basis(self.polynomials.form).values(s)
        per_second = [value / self.duration**order for order, value in enumerate(values)]
        p, p1, p2 = (value @ coefficients for value in per_second)
        dp, dp1, dp2 = (np.tensordot(value, self.by_w, (1, 1)) for value in per_second)
        sine = self.amplitude * np.sin(p)
        cosine = self.amplitude * np.cos(p)
        motion = np.hstack((self.centre + sine, cosine * p1, cosine * p2 - sine * p1**2))
        position = cosine[..., None] * dp
        velocity = cosine[..., None] * dp1 - (sine * p1)[..., None] * dp
        acceleration = cosine[..., None] * dp2 - (2 * sine * p1)[..., None] * dp1
        acceleration -= (sine * p2 + cosine * p1**2)[..., None] * dp
        return motion, np.concatenate((position, velocity, acceleration), axis=1)
