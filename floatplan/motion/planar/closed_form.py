"""Momentum, orientation rate and torques of a planar tree in closed form, over many instants at once, with derivatives.

With E_k = exp(i sigma phi_k) for the absolute angles phi of the bodies, and K_kj = conj(E_k) C_kj E_j, the momentum is
``h = sum_kj Re(K_kj) phi_j' + sum_k I_k phi_k'`` and the moment that turns body k
``F_k = sum_j Re(K_kj (phi_j'' + i sigma phi_j'^2)) + I_k phi_k''``: the Appendix of the paper, (A.1), (A.4) and (A.5),
as corrected, for any tree. Joint torques gather F over the joint's subtree; the sum over all bodies vanishes in flight.
Gravity, the path of the centre of mass and the orientation do not enter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.motion.planar.momentum import centroidal_coupling, momentum_mapping
from floatplan.robot.planar.tree import PlanarTree


@dataclass(eq=False)  # not frozen, for its speed: there is one per evaluation
class BaseRate:
    """theta0' of (4) at N instants, and its derivatives by joint velocities and h; by joint positions when asked for.

    ``rate`` (N,) rad/s; ``by_position`` (N, n) 1/s; ``by_velocity`` (N, n); ``by_momentum`` (N,) 1/(kg m^2): the
    paper's g_0, and ``by_velocity`` its g_i, in the corrected form of (15).
    """

    rate: Array
    by_velocity: Array
    by_momentum: Array
    differentiate: Callable[[], Array]

    @cached_property
    def by_position(self) -> Array:
        """Derivatives (N, n) by joint positions, 1/s."""
        return self.differentiate()

    def __getitem__(self, instants: slice | IntArray) -> BaseRate:
        """The same at some of the instants."""
        return BaseRate(
            self.rate[instants],
            self.by_velocity[instants],
            self.by_momentum[instants],
            lambda: self.by_position[instants],
        )


@dataclass(frozen=True, eq=False)
class Torques:
    """Torques (N, r), N m; derivatives by positions, velocities, accelerations (N, r, n) and h (N, r)."""

    torques: Array
    by_position: Array
    by_velocity: Array
    by_acceleration: Array
    by_momentum: Array


@dataclass(frozen=True, eq=False)
class Moments:
    """Moments F (N, m) that turn the bodies, N m, and their derivatives (N, m, 3n + 1).

    The derivatives are by the n positions, velocities and accelerations, and by h.
    """

    values: Array
    derivatives: Array

    def gathered(self, turns: Array) -> Torques:
        """Torques on coordinates by which the bodies turn as ``turns`` (m, r) says."""
        total = turns.T @ self.derivatives
        n = (self.derivatives.shape[2] - 1) // 3
        return Torques(
            torques=self.values @ turns,
            by_position=total[..., :n],
            by_velocity=total[..., n : 2 * n],
            by_acceleration=total[..., 2 * n : 3 * n],
            by_momentum=total[..., 3 * n],
        )


class Dynamics:
    """A tree's dynamics, vectorised over instants."""

    def __init__(self, tree: PlanarTree) -> None:
        self._tree = tree
        self._turn = tree.turn
        self._turns = np.array(tree.turns)
        self._turns_transposed = self._turns.T.copy()
        self._of_bodies, self._of_joints = map(np.ones, self._turns.shape)  # products with them are faster than sums
        self._inertia = np.array(tree.inertia)
        self._coupling = centroidal_coupling(tree)
        self._coupling_transposed = self._coupling.T.copy()
        self._momentum_mapping = momentum_mapping(tree)

    @property
    def masses(self) -> tuple[ComplexArray, Array]:
        """C (m, m) and inertias (m,), kg m^2, of the bodies."""
        return self._coupling, self._inertia

    def adapted(self, coupling: ComplexArray, inertia: Array) -> Dynamics:
        """The same tree's with other masses: C (m, m) and inertias (m,), kg m^2, of the bodies."""
        other = Dynamics.__new__(Dynamics)
        vars(other).update(vars(self))  # a tenth of what copy() takes
        other._coupling, other._coupling_transposed, other._inertia = coupling, coupling.T.copy(), inertia
        other._momentum_mapping = self._momentum_mapping.adapted(coupling, inertia)
        return other

    def _rotations(self, positions: Array) -> ComplexArray:
        """E (N, m) at orientation 0, which is as good as any."""
        return self._tree.rotations(positions @ self._turns_transposed + self._tree.offsets)

    def momentum_map(self, positions: Array) -> Array:
        """D of (4): rows (D_0, D_1, ..., D_n), (N, n+1) kg m^2, at positions (N, n)."""
        return self._momentum_mapping(positions).rows

    def base_rate(self, positions: Array, velocities: Array, angular_momentum: float | Array) -> Array:
        """theta0' (N,) rad/s of (4), corrected (15), at positions and velocities (N, n)."""
        return self.base_rate_derivatives(positions, velocities, angular_momentum).rate

    def base_rate_derivatives(self, positions: Array, velocities: Array, angular_momentum: float | Array) -> BaseRate:
        """theta0' and its derivatives.

        With h held, ``d theta0' = -(dh/dq) / D_0``: dh/dq at the full velocity, which contains theta0'.
        """
        momentum_map = self._momentum_mapping(positions)
        by_momentum = 1 / momentum_map.rows[:, 0]
        per_momentum = -by_momentum[:, None]
        by_velocity = momentum_map.rows[:, 1:] * per_momentum
        rate = angular_momentum * by_momentum + (by_velocity * velocities) @ self._of_joints
        return BaseRate(
            rate,
            by_velocity,
            by_momentum,
            lambda: momentum_map.momentum_by_position(rate, velocities) * per_momentum,
        )

    def torques(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Joint torques (N, n) N m: generalised, of a leader and its followers together."""
        return np.asarray(self.moments(positions, velocities, accelerations, base_rate) @ self._turns)

    def moments(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Moments F (N, m) that turn the bodies, N m: without what their derivatives need."""
        rotations, relative = self._rotations(positions), accelerations @ self._turns_transposed
        body_rates = velocities @ self._turns_transposed + base_rate[:, None]
        back, turning = rotations.conj(), relative + (1j * self._turn) * (body_rates * body_rates)
        moments = (back * ((rotations * turning) @ self._coupling_transposed)).real + self._inertia * relative
        by_base = (back * (rotations @ self._coupling_transposed)).real + self._inertia
        base_acceleration = -(moments @ self._of_bodies) / (by_base @ self._of_bodies)
        return np.asarray(moments + base_acceleration[:, None] * by_base)

    def _moments(
        self, rotations: ComplexArray, velocities: Array, accelerations: Array, base_rate: Array
    ) -> tuple[Array, ComplexArray, Array, Array, Array]:
        """F (N, m); conj(E) C E (phi'' + i sigma phi'^2); phi', phi'' (N, m); and D_0 (N,)."""
        body_rates = velocities @ self._turns_transposed + base_rate[:, None]
        relative = accelerations @ self._turns_transposed
        centripetal = (1j * self._turn) * body_rates**2
        back = rotations.conj()
        gathered = back * ((rotations * (relative + centripetal)) @ self._coupling.T)
        by_base = back * (rotations @ self._coupling.T)
        locked_inertia = (by_base.real + self._inertia).sum(axis=1)
        base_acceleration = -(gathered.real + self._inertia * relative).sum(axis=1) / locked_inertia
        gathered += base_acceleration[:, None] * by_base
        body_accelerations = relative + base_acceleration[:, None]
        moments = gathered.real + self._inertia * body_accelerations
        return moments, gathered, body_rates, body_accelerations, locked_inertia

    def torque_derivatives(
        self, positions: Array, velocities: Array, accelerations: Array, base_rate: BaseRate
    ) -> Torques:
        """Joint torques and their derivatives."""
        return self.moment_derivatives(positions, velocities, accelerations, base_rate).gathered(self._turns)

    def moment_derivatives(
        self, positions: Array, velocities: Array, accelerations: Array, base_rate: BaseRate
    ) -> Moments:
        """Moments and derivatives; the base acceleration follows from the vanishing sum of the moments."""
        rotations = self._rotations(positions)
        moments, gathered, body_rates, body_accelerations, locked_inertia = self._moments(
            rotations, velocities, accelerations, base_rate.rate
        )
        kernel = rotations.conj()[:, :, None] * self._coupling * rotations[:, None, :]
        by_acceleration = kernel.real + np.diag(self._inertia)
        by_rate = (-2 * self._turn) * kernel.imag * body_rates[:, None, :]
        by_angle = -self._turn * kernel.imag * body_accelerations[:, None, :]
        by_angle -= kernel.real * body_rates[:, None, :] ** 2
        diagonal = np.arange(len(self._inertia))
        by_angle[:, diagonal, diagonal] += self._turn * gathered.imag
        by_base_rate = by_rate.sum(axis=2)
        n = positions.shape[1]
        direct = np.empty((*moments.shape, 3 * n + 1))
        direct[..., :n] = by_angle @ self._turns + by_base_rate[:, :, None] * base_rate.by_position[:, None, :]
        direct[..., n : 2 * n] = by_rate @ self._turns + by_base_rate[:, :, None] * base_rate.by_velocity[:, None, :]
        direct[..., 2 * n : 3 * n] = by_acceleration @ self._turns
        direct[..., 3 * n] = by_base_rate * base_rate.by_momentum[:, None]
        base_response = direct.sum(axis=1) / locked_inertia[:, None]
        direct -= by_acceleration.sum(axis=2)[:, :, None] * base_response[:, None, :]
        return Moments(moments, direct)
