"""The paper's Appendix for three links (n = 2): as corrected, and as printed where that differs; see errata.md.

Positions are (N, 2); matrices and vectors come one per row of them.
"""

from dataclasses import dataclass

import numpy as np

TABLE_1 = {"l": (0.2, 0.2, 0.15), "r": (0.2, 0.2, 0.15), "m": (3.0, 2.5, 1.0), "I": (0.16, 0.107, 0.053)}


@dataclass(frozen=True)
class ThreeLinks:
    """Lengths l, r (m), masses m (kg) and inertias I (kg m^2) of the bodies 0, 1, 2: a row of Table I each."""

    l: tuple[float, float, float]  # noqa: E741
    r: tuple[float, float, float]
    m: tuple[float, float, float]
    I: tuple[float, float, float]  # noqa: E741

    @property
    def d(self) -> np.ndarray:
        """d_1 to d_9 of (A.5), corrected, at the indices 1 to 9."""
        (_, l1, l2), (r0, r1, _), (m0, m1, m2) = self.l, self.r, self.m
        M = m0 + m1 + m2  # (A.6)
        d1 = self.I[0] + m0 * (m1 + m2) * r0**2 / M
        d2 = m0 * r0 * ((m1 + m2) * l1 + m2 * r1) / M
        d3 = m0 * r0 * m2 * l2 / M
        d4 = self.I[1] + (m0 * m1 * l1**2 + m1 * m2 * r1**2 + m0 * m2 * (l1 + r1) ** 2) / M
        d6 = m2 * l2 * (m0 * (l1 + r1) + m1 * r1) / M
        d7 = self.I[2] + m2 * (m0 + m1) * l2**2 / M
        return np.array([np.nan, d1, d2, d3, d4, d2, d6, d7, d6, d3])

    def D(self, q: np.ndarray, d: np.ndarray | None = None) -> np.ndarray:
        """(A.4): D_0, D_1, D_2 (N, 3), of the given d or of those that hold."""
        d = self.d if d is None else d
        c1, c2, c12 = np.cos(q[:, 0]), np.cos(q[:, 1]), np.cos(q.sum(axis=1))
        return np.stack(
            (
                d[1] + d[4] + d[7] + 2 * (d[2] * c1 + d[6] * c2 + d[3] * c12),
                d[4] + d[7] + d[5] * c1 + (d[6] + d[8]) * c2 + d[9] * c12,
                d[7] + d[8] * c2 + d[9] * c12,
            ),
            axis=1,
        )

    def D_by_position(self, q: np.ndarray) -> np.ndarray:
        """Derivatives (N, 3, 2) of (A.4)."""
        d = self.d
        s1, s2, s12 = np.sin(q[:, 0]), np.sin(q[:, 1]), np.sin(q.sum(axis=1))
        by_first = (-2 * (d[2] * s1 + d[3] * s12), -d[5] * s1 - d[9] * s12, -d[9] * s12)
        by_second = (-2 * (d[6] * s2 + d[3] * s12), -(d[6] + d[8]) * s2 - d[9] * s12, -d[8] * s2 - d[9] * s12)
        return np.stack((np.stack(by_first, axis=1), np.stack(by_second, axis=1)), axis=2)

    def H(self, q: np.ndarray) -> np.ndarray:
        """(A.2), corrected: (N, 2, 2)."""
        D = self.D(q)
        return self._joint_inertia(q) - D[:, 1:, None] * D[:, None, 1:] / D[:, 0, None, None]

    def printed_H(self, q: np.ndarray) -> np.ndarray:
        """(A.2) as printed, with D_1 + D_2 where D_1 belongs."""
        D = self.D(q)
        row = np.stack((D[:, 1] + D[:, 2], D[:, 2]), axis=1)
        return self._joint_inertia(q) - row[:, :, None] * row[:, None, :] / D[:, 0, None, None]

    def _joint_inertia(self, q: np.ndarray) -> np.ndarray:
        """Inertia (N, 2, 2) of the joints while the base does not turn."""
        d, c2 = self.d, np.cos(q[:, 1])
        first, mixed, second = d[4] + 2 * d[6] * c2 + d[7], d[7] + d[6] * c2, np.full_like(c2, d[7])
        return np.moveaxis(np.array([[first, mixed], [mixed, second]]), 2, 0)

    def H_by_position(self, q: np.ndarray) -> np.ndarray:
        """Derivatives (N, 2, 2, 2) of H, by position last."""
        D, dD = self.D(q), self.D_by_position(q)
        joint = np.zeros((len(q), 2, 2, 2))
        bend = -self.d[6] * np.sin(q[:, 1])
        joint[:, 0, 0, 1], joint[:, 0, 1, 1], joint[:, 1, 0, 1] = 2 * bend, bend, bend
        product = np.einsum("nik,nj->nijk", dD[:, 1:], D[:, 1:])
        product = product + product.swapaxes(1, 2)
        base = D[:, 0, None, None, None]
        square = np.einsum("ni,nj,nk->nijk", D[:, 1:], D[:, 1:], dD[:, 0])
        return joint - product / base + square / base**2

    def coriolis(self, q: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """C* q' of (A.1) as far as it follows from H alone: Christoffel's symbols, (N, 2)."""
        dH = self.H_by_position(q)
        christoffel = (dH + dH.swapaxes(2, 3) - np.moveaxis(dH, 3, 1)) / 2
        return np.einsum("nijk,nj,nk->ni", christoffel, velocity, velocity)

    def gyroscopic(self, q: np.ndarray, velocity: np.ndarray, h: float) -> np.ndarray:
        """What (A.1) lacks in print: ``h (d(D_i/D_0)/dq_j - d(D_j/D_0)/dq_i) q_j'``, (N, 2)."""
        D, dD = self.D(q), self.D_by_position(q)
        base = D[:, 0, None, None]
        slope = dD[:, 1:] / base - D[:, 1:, None] * dD[:, :1] / base**2
        return h * np.einsum("nij,nj->ni", slope - slope.swapaxes(1, 2), velocity)

    def momentum_term(self, q: np.ndarray, h: float) -> np.ndarray:
        """G* of (A.3) without its term in gravity: ``h^2 / 2 d(1/D_0)/dq``, (N, 2)."""
        D, dD = self.D(q), self.D_by_position(q)
        return -(h**2) / 2 * dD[:, 0] / D[:, :1] ** 2

    def printed_gravity_term(self, orientation: float, q: np.ndarray, gravity: float) -> np.ndarray:
        """The term in gravity of (A.3), (N, 2)."""
        first = (self.l[1] * self.m[1] + self.l[2] * self.m[2]) * np.cos(orientation + q[:, 0])
        second = self.l[2] * self.m[2] * np.cos(orientation + q.sum(axis=1))
        return -gravity * np.stack((first, second), axis=1)

    def torques(self, q: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, h: float) -> np.ndarray:
        """(A.1), corrected: (N, 2)."""
        inertial = np.einsum("nij,nj->ni", self.H(q), acceleration)
        return inertial + self.coriolis(q, velocity) + self.gyroscopic(q, velocity, h) + self.momentum_term(q, h)

    @property
    def A(self) -> np.ndarray:
        """(A.7), corrected: A_0, A_1, A_2, m."""
        L = np.add(self.l, self.r)
        l, m, M = self.l, self.m, sum(self.m)  # noqa: E741
        return np.array([l[0] * m[0] + L[0] * (m[1] + m[2]), l[1] * m[1] + L[1] * m[2], l[2] * m[2]]) / M

    @property
    def printed_A(self) -> np.ndarray:
        """(A.7) as printed: without parentheses about what M divides."""
        L = np.add(self.l, self.r)
        l, m, M = self.l, self.m, sum(self.m)  # noqa: E741
        return np.array([l[0] * m[0] + L[0] * (m[1] + m[2]) / M, l[1] * m[1] + L[1] * m[2] / M, l[2] * m[2] / M])
