"""How the joints move: sine functions of polynomials (12), which meet the conditions (13) whatever the variables."""

from collections.abc import Sequence

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.sine_polynomial import SinePolynomials, basis, boundary_arguments, powers_map
from floatplan.problem.problem import Problem


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
        T = problem.flight.duration
        conditions = []
        for state, on_branch in ((problem.initial, 0 * branch), (problem.final, branch)):
            at_end = state.positions, state.velocities, state.accelerations
            p, rate, curvature = boundary_arguments(*at_end, centre, amplitude, on_branch)
            conditions += [p, rate * T, curvature * T**2]
        free = tuple(degree + 1 - CONDITIONS for degree in degrees)
        self.polynomials = SinePolynomials(centre, amplitude, T, np.transpose(conditions), free)
        self.size = sum(free)
        n = len(free)
        width = self.polynomials.width
        self.by_z = np.eye(n * width)[:, self.polynomials.free_indices].reshape(n, width, self.size)

    def coefficients(self, z: Array) -> Array:
        """The free coefficients (n, width) of each joint's p, with zeros where its degree is lower."""
        return np.asarray(self.by_z @ z)

    def b(self, z: Array) -> tuple[Array, Array]:
        """All b of (12), powers of seconds, whose norm is least in (17), and their derivatives by z."""
        powers = powers_map(self.polynomials.form, self.polynomials.duration)
        b = (np.hstack((self.polynomials.boundary, self.coefficients(z))) @ powers.T).ravel()
        return b, (powers[:, CONDITIONS:] @ self.by_z).reshape(len(b), self.size)

    def at(self, s: Array, z: Array) -> tuple[Array, Array]:
        """q, q', q'' (N, 3n) of (12) at instants s (N,) of [0, 1], and their derivatives (N, 3n, m) by z."""
        columns = basis(self.polynomials.form).values(s)
        motion = self.polynomials.motion(self.coefficients(z), columns)
        p_by_z, p1_by_z, p2_by_z = (
            np.tensordot(column[:, CONDITIONS:], self.by_z, (1, 1)) / self.polynomials.duration**order
            for order, column in enumerate(columns)
        )
        p1 = (motion.p_rate / self.polynomials.duration)[..., None]
        p2 = (motion.p_curvature / self.polynomials.duration**2)[..., None]
        sine = motion.sine[..., None]
        cosine = motion.cosine[..., None]
        q_by_z = cosine * p_by_z
        v_by_z = cosine * p1_by_z - sine * p1 * p_by_z
        a_by_z = cosine * p2_by_z - 2 * sine * p1 * p1_by_z - (sine * p2 + cosine * p1**2) * p_by_z
        joints = np.hstack((motion.positions, motion.velocities, motion.accelerations))
        return joints, np.concatenate((q_by_z, v_by_z, a_by_z), axis=1)
