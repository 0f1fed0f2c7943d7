"""D of (4) over many instants at once, and how the momentum changes with the joints; for any planar tree.

With the absolute angles phi of the bodies the momentum is

    h = sum_ij [Re(C_ij exp(i sigma (phi_j - phi_i))) + delta_ij I_j] phi_j',

(A.4) and (A.5) of the paper, as corrected, for any tree. Bodies whose angles differ by a constant, as the legs of a
quadruped that is coupled left to right, are one here. Few bodies are evaluated by a cosine for each pair of them, many
by the rotation of each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.robot.planar.tree import PlanarTree, rotations_of

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


@dataclass(frozen=True, eq=False)
class TurningBodies:
    """The g bodies of a tree that turn differently.

    ``turns`` (g, n) as of the tree; ``coupling`` (g, g) kg m^2, C for angles that are 0 at planned positions 0, with
    the moments of inertia on its diagonal; ``turn`` the tree's; ``rotations`` (m, g) of the tree's bodies by these.
    """

    turns: Array
    coupling: ComplexArray
    turn: float
    rotations: ComplexArray

    @classmethod
    def of(cls, tree: PlanarTree) -> TurningBodies:
        """Put together what turns alike: rotations are the same there but for a constant."""
        known: dict[tuple[float, ...], int] = {}
        group = [known.setdefault(row, len(known)) for row in map(tuple, (tree.turns + 0.0).tolist())]
        rotations = tree.rotations(tree.offsets)[:, None] * np.eye(len(known))[group]
        turns = np.array(list(known)).reshape(len(known), -1)
        coupling = _put_together(centroidal_coupling(tree), tree.inertia, rotations)
        return cls(turns, coupling, tree.turn, rotations)

    def adapted(self, coupling: ComplexArray, inertia: Array) -> TurningBodies:
        """The same with other masses: C (m, m) and inertias (m,), kg m^2, of all bodies of the tree."""
        return TurningBodies(self.turns, _put_together(coupling, inertia, self.rotations), self.turn, self.rotations)

    @property
    def rates(self) -> Array:
        """Derivatives (g, n+1) of the absolute angles by (orientation, planned positions)."""
        return np.concatenate((np.ones((len(self.turns), 1)), self.turns), axis=1)


def _put_together(coupling: ComplexArray, inertia: Array, rotations: ComplexArray) -> ComplexArray:
    coupling = coupling.copy()
    coupling.flat[:: len(inertia) + 1] += inertia
    return np.asarray(rotations.conj().T @ coupling @ rotations)


class PairCosines:
    """``D = constant + sum_l cos(frequency_l . q + phase_l) amplitude_l``, l over the pairs of bodies.

    ``constant`` (n+1,), ``amplitude`` (L, n+1) in kg m^2, ``frequency`` (L, n), ``phase`` (L,).
    """

    def __init__(self, bodies: TurningBodies) -> None:
        i, j = self._pairs = np.triu_indices(len(bodies.turns), 1)
        self._rates = bodies.rates
        self._together = self._rates[i] + self._rates[j]
        self.frequency = bodies.turns[j] - bodies.turns[i]
        self._weigh(bodies)

    def _weigh(self, bodies: TurningBodies) -> None:
        phasor = bodies.coupling[self._pairs]
        self._bodies = bodies
        self.constant = bodies.coupling.diagonal().real @ self._rates
        self.amplitude = np.abs(phasor)[:, None] * self._together
        self.phase = bodies.turn * np.arctan2(phasor.imag, phasor.real)

    def adapted(self, coupling: ComplexArray, inertia: Array) -> PairCosines:
        """The same tree's with other masses."""
        other = PairCosines.__new__(PairCosines)
        vars(other).update(vars(self))  # a fifth of what copy() takes
        other._weigh(self._bodies.adapted(coupling, inertia))
        return other

    def __call__(self, positions: Array) -> MomentumMap:
        """D at positions (N, n)."""
        argument = positions @ self.frequency.T + self.phase

        def momentum_by_position(rate: Array, velocities: Array) -> Array:
            by_argument = velocities @ self.amplitude[:, 1:].T + rate[:, None] * self.amplitude[:, 0]
            return np.asarray(-((by_argument * np.sin(argument)) @ self.frequency))

        return MomentumMap(np.cos(argument) @ self.amplitude + self.constant, momentum_by_position)


class BodyRotations:
    """``D = sum_j Re(conj(E) C)_j E_j d phi_j'``, with E = exp(i sigma phi) of each body, at orientation 0."""

    def __init__(self, bodies: TurningBodies) -> None:
        self._bodies = bodies
        self._turns_transposed = bodies.turns.T.copy()
        self._coupling_transposed = bodies.coupling.T.copy()
        self._rates = bodies.rates

    def adapted(self, coupling: ComplexArray, inertia: Array) -> BodyRotations:
        """The same tree's with other masses."""
        other = BodyRotations.__new__(BodyRotations)
        vars(other).update(vars(self))  # a fifth of what copy() takes
        other._bodies = self._bodies.adapted(coupling, inertia)
        other._coupling_transposed = other._bodies.coupling.T.copy()
        return other

    def __call__(self, positions: Array) -> MomentumMap:
        """D at positions (N, n)."""
        bodies = self._bodies
        rotations = rotations_of(positions @ self._turns_transposed, bodies.turn)
        back = rotations.conj()
        gathered = (back @ bodies.coupling) * rotations

        def momentum_by_position(rate: Array, velocities: Array) -> Array:
            rates = velocities @ self._turns_transposed + rate[:, None]
            moving = back * ((rotations * rates) @ self._coupling_transposed)
            return np.asarray(bodies.turn * ((moving.imag - rates * gathered.imag) @ bodies.turns))

        return MomentumMap(gathered.real @ self._rates, momentum_by_position)


def momentum_mapping(tree: PlanarTree) -> MomentumMapping:
    """Return the faster of the two for a tree."""
    bodies = TurningBodies.of(tree)
    return PairCosines(bodies) if len(bodies.turns) <= FEW_BODIES else BodyRotations(bodies)
