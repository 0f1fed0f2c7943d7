"""Flight of a planar tree in closed form, over many instants at once.

With E_k = exp(i sigma phi_k) for the absolute angles phi of the bodies, and K_kj = conj(E_k) C_kj E_j, the momentum is
``h = sum_kj Re(K_kj) phi_j' + sum_k I_k phi_k'`` and the moment that turns body k
``F_k = sum_j Re(K_kj (phi_j'' + i sigma phi_j'^2)) + I_k phi_k''``: the Appendix of the paper, (A.1), (A.4) and (A.5),
as corrected, for any tree. Joint torques gather F over the joint's subtree; the sum over all bodies vanishes in flight.
Where motors have rotors, what turns those (:attr:`~floatplan.robot.PlanarTree.rotors`) is part of F, and so of torques.
Gravity, the path of the centre of mass and the orientation do not enter. Derivatives are the kernel's, ``tree.hpp``.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.problem.parts import JointState
from floatplan.robot.planar.inertia import TurningBodies
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import Frame, Robot


class Dynamics:
    """A tree's dynamics, vectorised over instants; C (m, m) and inertias (m,), kg m^2, may be those of other masses."""

    def __init__(self, tree: PlanarTree, coupling: ComplexArray | None = None, inertia: Array | None = None) -> None:
        self._tree = tree
        self._turn = tree.turn
        self._turns = np.array(tree.turns)
        self._turns_transposed = self._turns.T.copy()
        self._of_bodies, self._of_joints = map(np.ones, self._turns.shape)  # products with them are faster than sums
        self._distinct = TurningBodies.of(tree, coupling, inertia)
        self._distinct_turns_transposed = self._distinct.turns.T.copy()
        self._rates = self._distinct.rates
        self._inertia = np.array(tree.inertia if inertia is None else inertia)
        self._coupling_transposed = (tree.coupling if coupling is None else coupling).T.copy()

    def momentum_map(self, positions: Array) -> Array:
        """D of (4): rows (D_0, D_1, ..., D_n), (N, n+1) kg m^2, at positions (N, n)."""
        rotations = self._tree.rotations(positions @ self._distinct_turns_transposed)
        gathered = (rotations.conj() @ self._distinct.coupling) * rotations
        return np.asarray(gathered.real @ self._rates)

    def base_rate(self, positions: Array, velocities: Array, angular_momentum: float | Array) -> Array:
        """theta0' (N,) rad/s of (4), corrected (15), at positions and velocities (N, n)."""
        rows = self.momentum_map(positions)
        by_momentum = 1 / rows[:, 0]
        by_velocity = rows[:, 1:] * -by_momentum[:, None]
        return np.asarray(angular_momentum * by_momentum + (by_velocity * velocities) @ self._of_joints)

    def torques(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Joint torques (N, n) N m: generalised, of a leader and its followers together."""
        return np.asarray(self.moments(positions, velocities, accelerations, base_rate) @ self._turns)

    def moments(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Moments F (N, m) that turn the bodies, N m.

        The base's acceleration follows from the vanishing sum of the moments. Orientation 0 is as good as any.
        """
        rotations = self._tree.rotations(positions @ self._turns_transposed + self._tree.offsets)
        body_rates = velocities @ self._turns_transposed + base_rate[:, None]
        relative = accelerations @ self._turns_transposed
        back = rotations.conj()
        turning = relative + (1j * self._turn) * (body_rates * body_rates)
        gathered = back * ((rotations * turning) @ self._coupling_transposed)
        by_base = back * (rotations @ self._coupling_transposed)
        locked_inertia = (by_base.real + self._inertia) @ self._of_bodies
        base_acceleration = -((gathered.real + self._inertia * relative) @ self._of_bodies) / locked_inertia
        gathered += base_acceleration[:, None] * by_base
        moments = np.asarray(gathered.real + self._inertia * (relative + base_acceleration[:, None]))
        return moments if self._tree.rotors is None else moments + accelerations @ self._tree.rotors.T


@lru_cache(maxsize=64)
def tree_dynamics(tree: PlanarTree) -> Dynamics:
    """Return a tree's dynamics, prepared once."""
    return Dynamics(tree)


def frame_from_com(robot: Robot, frame: Frame, state: JointState) -> complex:
    """Place of a frame relative to the centre of mass, (6), m, as a complex number."""
    return complex(robot.tree.places_from_com(frame.weights, np.array(state.orientation), state.positions))
