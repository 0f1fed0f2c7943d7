"""D of (4) over many instants at once, and how the momentum changes with the joints; for any planar tree.

With the absolute angles phi of the bodies the momentum is

    h = sum_ij [Re(C_ij exp(i sigma (phi_j - phi_i))) + delta_ij I_j] phi_j',

(A.4) and (A.5) of the paper, as corrected, for any tree. Few bodies are evaluated by a cosine for each pair of them,
many by the rotation of each.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import NamedTuple, Protocol

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.robot.planar.tree import PlanarTree

FEW_BODIES = 4  # of more, the rotations are faster than the cosines


class MomentumMap(NamedTuple):
    """D at N instants.

    ``rows`` (N, n+1) kg m^2: D_0, ..., D_n. ``momentum_by_position`` gives dh/dq (N, n) for theta0' (N,), q' (N, n).
    """

    rows: Array
    momentum_by_position: Callable[[Array, Array], Array]


class MomentumMapping(Protocol):
    """A way to evaluate D."""

    def __call__(self, positions: Array) -> MomentumMap:
        """D at positions (N, n)."""

    def adapted(self, coupling: ComplexArray, inertia: Array) -> MomentumMapping:
        """The same tree's with other masses: C (m, m) and inertias (m,), kg m^2, of the bodies."""


def centroidal_coupling(tree: PlanarTree) -> ComplexArray:
    """The matrix C (m, m), kg m^2, Hermitian: ``W^H diag(mass) W``, W the weights of the bodies' centres of mass."""
    weights = tree.point_weights(np.arange(len(tree.mass)), tree.center)
    return np.asarray(weights.conj().T @ (tree.mass[:, None] * weights))


def body_rates(tree: PlanarTree) -> Array:
    """Derivatives (m, n+1) of the bodies' absolute angles by (orientation, planned positions)."""
    return np.concatenate((np.ones((len(tree.mass), 1)), tree.turns), axis=1)


class PairCosines:
    """``D = constant + sum_l cos(frequency_l . q + phase_l) amplitude_l``, l over the pairs of bodies.

    ``constant`` (n+1,), ``amplitude`` (L, n+1) in kg m^2, ``frequency`` (L, n), ``phase`` (L,).
    """

    def __init__(self, tree: PlanarTree) -> None:
        self._pairs = i, j = np.triu_indices(len(tree.mass), 1)
        self._turn, self._rates = tree.turn, body_rates(tree)
        self._pair_rates = self._rates[i] + self._rates[j]
        self._offsets = np.exp(1j * tree.turn * (tree.offsets[j] - tree.offsets[i]))
        self.frequency = tree.turns[j] - tree.turns[i]
        self._set(centroidal_coupling(tree), tree.inertia)

    def _set(self, coupling: ComplexArray, inertia: Array) -> None:
        phasor = coupling[self._pairs] * self._offsets
        self.constant = (inertia + coupling.diagonal().real) @ self._rates
        self.amplitude = np.abs(phasor)[:, None] * self._pair_rates
        self.phase = self._turn * np.angle(phasor)

    def adapted(self, coupling: ComplexArray, inertia: Array) -> PairCosines:
        """The same tree's with other masses."""
        other = copy(self)
        other._set(coupling, inertia)
        return other

    def __call__(self, positions: Array) -> MomentumMap:
        """D at positions (N, n)."""
        argument = positions @ self.frequency.T + self.phase

        def momentum_by_position(rate: Array, velocities: Array) -> Array:
            by_argument = velocities @ self.amplitude[:, 1:].T + rate[:, None] * self.amplitude[:, 0]
            return np.asarray(-((by_argument * np.sin(argument)) @ self.frequency))

        return MomentumMap(np.cos(argument) @ self.amplitude + self.constant, momentum_by_position)


class BodyRotations:
    """``D = sum_j [Re(conj(E) C)_j E_j + I_j] d phi_j'``, with E = exp(i sigma phi) of each body."""

    def __init__(self, tree: PlanarTree) -> None:
        self._tree = tree
        self._coupling, self._inertia = centroidal_coupling(tree), np.asarray(tree.inertia)
        self._rates = body_rates(tree)

    def adapted(self, coupling: ComplexArray, inertia: Array) -> BodyRotations:
        """The same tree's with other masses."""
        other = copy(self)
        other._coupling, other._inertia = coupling, inertia
        return other

    def __call__(self, positions: Array) -> MomentumMap:
        """D at positions (N, n)."""
        tree = self._tree
        rotations = tree.rotations(positions @ tree.turns.T + tree.offsets)
        back = rotations.conj()
        gathered = (back @ self._coupling) * rotations

        def momentum_by_position(rate: Array, velocities: Array) -> Array:
            rates = velocities @ tree.turns.T + rate[:, None]
            moving = back * ((rotations * rates) @ self._coupling.T)
            return np.asarray(tree.turn * ((moving.imag - rates * gathered.imag) @ tree.turns))

        return MomentumMap((gathered.real + self._inertia) @ self._rates, momentum_by_position)


def momentum_mapping(tree: PlanarTree) -> MomentumMapping:
    """Return the faster of the two for a tree."""
    return PairCosines(tree) if len(tree.mass) <= FEW_BODIES else BodyRotations(tree)
