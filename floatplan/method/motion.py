"""How the joints move: sine functions of polynomials (12) that meet the conditions (13) whatever the variables are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.motion.sine_polynomial import SinePolynomials, basis, boundary_arguments, powers_map
from floatplan.problem.problem import Problem

CONDITIONS = 6  # per joint, (13): p, p', p'' at both ends


class Motions:
    """All motions (12) between a problem's ends that land on one branch of the arcsine.

    Given the branch, (13) are six linear equations for the polynomial p_i of a joint. They are met by a quintic, to
    which any multiple of polynomials that vanish at both ends, with two derivatives, may be added: its coefficients
    are ``b = b_0 + C z``, powers of t in seconds. With ``C = Q R`` and ``w = R z + Q^T b_0`` the square of their
    length, (17), is that of w and a constant, so that its Hessian is the identity. Variables are the w of all joints.
    """

    def __init__(self, problem: Problem, degrees: Sequence[int], branch: IntArray) -> None:
        low, high = problem.position_limits.T
        self.duration = problem.flight.duration
        self.centre = (low + high) / 2
        self.amplitude = (high - low) / 2
        ends = []
        for state, on_branch in ((problem.initial, 0 * branch), (problem.final, branch)):
            given = state.positions, state.velocities, state.accelerations
            p, rate, curvature = boundary_arguments(*given, self.centre, self.amplitude, on_branch)
            ends += [p, rate * self.duration, curvature * self.duration**2]  # derivatives by s = t/T
        free = tuple(degree - CONDITIONS + 1 for degree in degrees)
        boundary = np.transpose(ends)
        self.polynomials = SinePolynomials(self.centre, self.amplitude, self.duration, boundary, free)
        self.size = sum(free)  # variables
        self._whiten(boundary)

    def _whiten(self, boundary: Array) -> None:
        """Find the coefficients of the basis at w = 0 (n, 6+width), and how w (m,) changes them (n, 6+width, m)."""
        powers = powers_map(self.polynomials.form, self.duration)
        joints = len(boundary)
        self.at_zero = np.zeros((joints, powers.shape[1]))
        self.by_variables = np.zeros((joints, powers.shape[1], self.size))
        self.plain = np.zeros(self.size)
        self.scaling = np.zeros((self.size, self.size))
        self.constant = 0.0  # |b|^2 less |w|^2
        first = 0
        for joint, free in enumerate(self.polynomials.free):
            own = slice(first, first + free)
            columns = slice(CONDITIONS, CONDITIONS + free)
            b_0 = powers[:, :CONDITIONS] @ boundary[joint]
            Q, R = np.linalg.qr(powers[:, columns])
            self.plain[own] = Q.T @ b_0
            self.scaling[own, own] = R
            self.at_zero[joint, :CONDITIONS] = boundary[joint]
            self.at_zero[joint, columns] = -np.linalg.solve(R, Q.T @ b_0)
            self.by_variables[joint, columns, own] = np.linalg.inv(R)
            self.constant += b_0 @ b_0 - self.plain[own] @ self.plain[own]
            first += free

    def variables(self, z: Array) -> Array:
        """Variables w (m,) of free coefficients z (m,), joint after joint; of the quintics alone where these are 0."""
        return np.asarray(self.plain + self.scaling @ z)

    def free_part(self, w: Array) -> Array:
        """Coefficients z (n, width) of the polynomials that vanish at both ends: root mean squares of p, rad."""
        return np.asarray((self.at_zero + self.by_variables @ w)[:, CONDITIONS:])

    def at(self, s: Array, w: Array) -> tuple[Array, Array]:
        """q, q', q'' (N, 3n) of (12) at instants s (N,) of [0, 1], and their derivatives (N, 3n, m) by w."""
        T = self.duration
        values, first, second = basis(self.polynomials.form).values(s)
        coefficients = self.at_zero + self.by_variables @ w
        p, p_by_w = values @ coefficients.T, np.tensordot(values, self.by_variables, (1, 1))
        p1, p1_by_w = first @ coefficients.T / T, np.tensordot(first, self.by_variables, (1, 1)) / T
        p2, p2_by_w = second @ coefficients.T / T**2, np.tensordot(second, self.by_variables, (1, 1)) / T**2
        sine = self.amplitude * np.sin(p)
        cosine = self.amplitude * np.cos(p)
        motion = np.hstack((self.centre + sine, cosine * p1, cosine * p2 - sine * p1**2))
        position = cosine[..., None] * p_by_w
        velocity = cosine[..., None] * p1_by_w - (sine * p1)[..., None] * p_by_w
        acceleration = cosine[..., None] * p2_by_w - (2 * sine * p1)[..., None] * p1_by_w
        acceleration -= (sine * p2 + cosine * p1**2)[..., None] * p_by_w
        return motion, np.concatenate((position, velocity, acceleration), axis=1)
