"""How the base turns in space: its attitude by Gauss collocation in cells, each from an attitude at its border.

With h the angular momentum in the world, ``[I(q) | A(q)]`` the angular momentum of the robot with its base at the
identity by the base's angular velocity and the joints' rates, the base turns in its own axes at

    omega = I^-1 (R^T h - A q'),    R' = R [omega]x,                                                               (S1)

and a small turn zeta of the world, ``delta R = [zeta]x R``, goes on as

    zeta' = M [h]x zeta + g,    M = R I^-1 R^T,    g = -R I^-1 (L dq + A dq') + M dh,                              (S2)

where L is the derivative of ``I omega + A q'`` by the joints' positions. Cells are integrated all at once. In a cell
``R = B Y S``: S is the motion for h = 0, a linear equation for a quaternion; ``mu = Y^T B^T h`` obeys
``mu' = mu x (J mu)`` with ``J = S I^-1 S^T``, which Newton's method solves; and Y follows from mu, again linearly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from floatplan.arrays import Array, IntArray, read_only
from floatplan.motion.quadrature import GaussLegendre, gauss_legendre
from floatplan.motion.spatial.rotations import cross_matrix, exponential

SWEEPS = 12  # of Newton's method; more than it takes where it comes to an end
SETTLED = 1e-13  # [-] of |h|: a step of mu below which Newton's method has ended
LARGEST = 1e6  # [-] of |h|: beyond it the motion cannot be integrated in these cells


class IntegrationError(ArithmeticError):
    """A motion is too wild for the cells."""


@dataclass(frozen=True, eq=False)
class Cells:
    """C cells of equal length, each with the same S Gauss stages."""

    count: int
    gauss: GaussLegendre

    @cached_property
    def stages(self) -> int:
        """Number S."""
        return len(self.gauss.nodes)

    @cached_property
    def s(self) -> Array:
        """All C S stages, fractions of the flight."""
        return read_only((np.arange(self.count)[:, None] + self.gauss.nodes).ravel() / self.count)

    @cached_property
    def integrals(self) -> Array:
        """Butcher's matrix (S, S): integrals from a cell's beginning to its stages."""
        return read_only(self.gauss.integrals(self.gauss.nodes))

    def place(self, instants: Array) -> tuple[IntArray, Array]:
        """The cell of each instant (K,) of [0, 1], and the integrals (K, S) from its beginning to the instant."""
        cell = np.minimum((instants * self.count).astype(np.int64), self.count - 1)
        return cell, self.gauss.integrals(instants * self.count - cell)


@lru_cache(maxsize=16)
def cells(count: int, stages: int) -> Cells:
    """Return so many cells with so many stages each."""
    return Cells(count, gauss_legendre(stages))


@dataclass(frozen=True, eq=False)
class Spun:
    """Rotations from the identity by collocation in each cell: quaternions' rates (C, S, 4), and what they lead to."""

    rates: Array
    step: float

    def after(self, cell: IntArray | slice, integrals: Array) -> Array:
        """Rotations (K, 3, 3) in cells, after integrals (K, S) from their beginnings."""
        quaternions = self.step * np.einsum("ks,ksa->ka", integrals, self.rates[cell])
        quaternions[:, 3] += 1.0
        unit = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
        across = cross_matrix(unit[:, :3])
        return np.asarray(np.eye(3) + 2 * unit[:, 3, None, None] * across + 2 * across @ across)


@dataclass(frozen=True, eq=False)
class Turning:
    """How the base turns in C cells of S stages; K = C S.

    Attributes
    ----------
    borders, ends : (C, 3, 3)
        Attitudes at the cells' beginnings and ends.
    attitudes : (K, 3, 3), at the stages
    inverse_inertia : (K, 3, 3), 1/(kg m^2)
    rates : (K, 3) rad/s
        omega, in the base's axes.
    angular_momentum : (3,) kg m^2/s
    """

    cells: Cells
    duration: float
    angular_momentum: Array
    borders: Array
    inverse_inertia: Array
    attitudes: Array
    rates: Array
    ends: Array
    spun: tuple[Spun, ...]

    def at(self, instants: Array) -> Array:
        """Attitudes (L, 3, 3) at instants (L,) of [0, 1]."""
        cell, integrals = self.cells.place(instants)
        attitudes = self.borders[cell]
        for spun in self.spun:
            attitudes = attitudes @ spun.after(cell, integrals)
        return np.asarray(attitudes)

    @property
    def way(self) -> Array:
        """Attitudes (C S + 2, 3, 3) at takeoff, at all stages, and at landing."""
        return np.concatenate((self.borders[:1], self.attitudes, self.ends[-1:]))

    @cached_property
    def mobility(self) -> Array:
        """M (K, 3, 3), 1/(kg m^2)."""
        return np.asarray(self.attitudes @ self.inverse_inertia @ np.swapaxes(self.attitudes, 1, 2))

    @cached_property
    def pulled(self) -> Array:
        """M [h]x (C, S, 3, 3), 1/s."""
        shape = (self.cells.count, self.cells.stages, 3, 3)
        return np.asarray((self.mobility @ cross_matrix(self.angular_momentum)).reshape(shape))

    @cached_property
    def _system(self) -> Array:
        """Matrices (C, 3 S, 3 S) of the stages' equations ``zeta_j - step sum_k A_jk pulled_k zeta_k = ..``."""
        size = 3 * self.cells.stages
        system = -self.step * np.einsum("jk,ckab->cjakb", self.cells.integrals, self.pulled)
        return np.asarray(system.reshape(-1, size, size) + np.eye(size))

    @property
    def step(self) -> float:
        """Length of a cell, s."""
        return self.duration / self.cells.count

    @cached_property
    def carried(self) -> tuple[Array, Array]:
        """How small turns go on in each cell: transitions (C, 3, 3), and weights (C, S, 3, 3) of g at the stages.

        A turn zeta at a cell's beginning becomes ``transition zeta + sum_j weight_j g_j`` at its end.
        """
        count, stages = self.cells.count, self.cells.stages
        integrals, weights = self.cells.integrals, self.cells.gauss.weights
        ended = np.einsum("j,cjab->cajb", weights, self.pulled).reshape(count, 3, 3 * stages)
        through = np.swapaxes(np.linalg.solve(np.swapaxes(self._system, 1, 2), np.swapaxes(ended, 1, 2)), 1, 2)
        through = through.reshape(count, 3, stages, 3)
        of_g = self.step**2 * np.einsum("cajb,jk->ckab", through, integrals)
        of_g += self.step * weights[:, None, None] * np.eye(3)
        return np.eye(3) + self.step * through.sum(axis=2), of_g

    def transport(self, drifts: Array, cell: IntArray, integrals: Array) -> Array:
        """Small turns (L, 3, c) in cells, after integrals (L, S), that c drifts (K, 3, c) at the stages make."""
        count, stages = self.cells.count, self.cells.stages
        transitions, weights = self.carried
        drifts = drifts.reshape(count, stages, 3, -1)
        borders = small_turns(transitions, np.einsum("csab,csbd->cad", weights, drifts))
        right = self.step * np.einsum("jk,ckad->cjad", self.cells.integrals, drifts) + borders[:-1, None]
        inner = np.linalg.solve(self._system, right.reshape(count, 3 * stages, -1)).reshape(drifts.shape)
        growth = drifts + self.pulled @ inner
        return np.asarray(borders[cell] + self.step * np.einsum("ls,lsad->lad", integrals, growth[cell]))


def turn(
    cells: Cells, duration: float, inertia: Array, relative: Array, angular_momentum: Array, borders: Array
) -> Turning:
    """Integrate (S1) in all cells at once.

    Parameters
    ----------
    inertia : (K, 3, 3) kg m^2
        I at the stages.
    relative : (K, 3) kg m^2/s
        A q' there.
    angular_momentum : (3,) kg m^2/s
    borders : (C, 3, 3)
        Attitudes at the cells' beginnings.

    Raises
    ------
    IntegrationError
        The motion is too wild for the cells.
    """
    count, stages, step = cells.count, cells.stages, duration / cells.count
    inverse: Array = np.asarray(np.linalg.inv(inertia), dtype=np.float64)
    still = -np.einsum("kab,kb->ka", inverse, relative)
    spun: tuple[Spun, ...] = (_spun(cells, step, still.reshape(count, stages, 3)),)
    swings, swung = _ended(cells, spun[0])
    attitudes, ends, rates = borders[:, None] @ swings, borders @ swung, still
    if angular_momentum.any():
        seen = swings @ inverse.reshape(count, stages, 3, 3) @ np.swapaxes(swings, 2, 3)
        momentum = _momentum(cells, step, seen, np.swapaxes(borders, 1, 2) @ angular_momentum)
        carried = np.einsum("csab,csb->csa", seen, momentum)
        spun = (_spun(cells, step, carried), *spun)
        drifts, drifted = _ended(cells, spun[0])
        attitudes, ends = borders[:, None] @ drifts @ swings, borders @ drifted @ swung
        rates = still + np.einsum("csba,csb->csa", swings, carried).reshape(-1, 3)
    attitudes = attitudes.reshape(-1, 3, 3)
    return Turning(cells, duration, angular_momentum, borders, inverse, attitudes, rates, ends, spun)


def turn_from(
    cells: Cells, duration: float, inertia: Array, relative: Array, angular_momentum: Array, start: Array
) -> Turning:
    """Integrate (S1) from an attitude (3, 3) at takeoff on: cells without gaps; otherwise as :func:`turn`."""
    count, stages, step = cells.count, cells.stages, duration / cells.count
    inverse: Array = np.asarray(np.linalg.inv(inertia), dtype=np.float64)
    still = -np.einsum("kab,kb->ka", inverse, relative)
    spun: tuple[Spun, ...] = (_spun(cells, step, still.reshape(count, stages, 3)),)
    swings, swung = _ended(cells, spun[0])
    before = _products(swung)
    attitudes, ends, rates, borders = before[:-1, None] @ swings, before[1:], still, before[:-1]
    if angular_momentum.any():
        seen = attitudes @ inverse.reshape(count, stages, 3, 3) @ np.swapaxes(attitudes, 2, 3)
        momentum = _chained_momentum(cells, step, seen, start.T @ angular_momentum)
        carried = np.einsum("csab,csb->csa", seen, momentum)
        rates = still + np.einsum("csba,csb->csa", attitudes, carried).reshape(-1, 3)
        spun = (_spun(cells, step, np.einsum("cba,csb->csa", borders, carried)), *spun)
        drifts, drifted = _ended(cells, spun[0])
        borders = _products(drifted @ swung)[:-1]
        attitudes, ends = borders[:, None] @ drifts @ swings, borders @ drifted @ swung
    borders, attitudes, ends = start @ borders, start @ attitudes.reshape(-1, 3, 3), start @ ends
    return Turning(cells, duration, angular_momentum, borders, inverse, attitudes, rates, ends, spun)


def _products(rotations: Array) -> Array:
    """Products (C + 1, 3, 3) of the first rotations (C, 3, 3), one after the other: of none, of one, ..."""
    products = np.empty((len(rotations) + 1, 3, 3))
    products[0] = np.eye(3)
    for k, rotation in enumerate(rotations):
        np.matmul(products[k], rotation, out=products[k + 1])
    return products


def _chained_momentum(cells: Cells, step: float, seen: Array, start: Array) -> Array:
    """Solve mu' = mu x (J mu) over all cells: mu (C, S, 3) from J (C, S, 3, 3) and mu at takeoff (3,).

    All at once; where the guess is too far off for that, cell after cell.
    """
    try:
        return _momentum_at_once(cells, step, seen, start)
    except IntegrationError:
        mu = np.empty(seen.shape[:3])
        for cell, inertia in enumerate(seen):
            mu[cell] = _momentum(cells, step, inertia[None], start[None])[0]
            growth = np.cross(mu[cell], np.einsum("sab,sb->sa", inertia, mu[cell]))
            start = start + step * cells.gauss.weights @ growth
        return mu


def _momentum_at_once(cells: Cells, step: float, seen: Array, start: Array) -> Array:
    """As :func:`_chained_momentum`, by Newton's method over all cells."""
    count, stages = seen.shape[:2]
    mu: Array = np.repeat(_guessed(step, seen[:, stages // 2], start)[:, None], stages, axis=1)
    size, eye, weights = float(np.linalg.norm(start)), np.eye(3 * stages), step * cells.gauss.weights
    ones = np.broadcast_to(np.tile(np.eye(3), (stages, 1)), (count, 3 * stages, 3))
    for _ in range(SWEEPS):
        turning = np.einsum("csab,csb->csa", seen, mu)
        growth, slope = np.cross(mu, turning), cross_matrix(mu) @ seen - cross_matrix(turning)
        system = -step * np.einsum("jk,ckab->cjakb", cells.integrals, slope).reshape(count, 3 * stages, 3 * stages)
        behind = step * np.einsum("jk,cka->cja", cells.integrals, growth) - mu
        right = np.concatenate((behind.reshape(count, -1, 1), ones), axis=2)
        moves = np.linalg.solve(system + eye, right).reshape(count, stages, 3, 4)
        grown = np.einsum("j,cjab,cjbd->cad", weights, slope, moves)
        grown[..., 0] += np.einsum("j,cja->ca", weights, growth)
        starts = np.empty((count, 3))
        at = start
        for cell in range(count):
            starts[cell] = at
            at = at + grown[cell, :, 0] + grown[cell, :, 1:] @ at
        change = moves[..., 0] + np.einsum("csab,cb->csa", moves[..., 1:], starts)
        mu = mu + change
        if _settled(change, size):
            return mu
    raise IntegrationError


def _settled(change: Array, size: float) -> bool:
    """Whether the last change of mu is lost in rounding; raises IntegrationError where it is beyond all bounds."""
    largest = float(abs(change).max())
    if not largest < LARGEST * size:
        raise IntegrationError
    return largest < SETTLED * size


def _guessed(step: float, seen: Array, start: Array) -> Array:
    """Mu (C, 3) in the middle of each cell, by J (C, 3, 3) there, cell after cell by the midpoint rule."""
    middles = np.empty((len(seen), 3))
    mu = start
    for cell, inertia in enumerate(seen):
        middles[cell] = _rotation(-step / 2 * (inertia @ mu)) @ mu
        mu = _rotation(-step * (inertia @ middles[cell])) @ mu
    return middles


def _rotation(turn: Array) -> Array:
    """Rotation (3, 3) by a vector (3,), rad: Cayley's, whose error is of third order."""
    x, y, z = (turn / 2).tolist()
    scale = 2 / (1 + x * x + y * y + z * z)
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + scale * (across + across @ across))


def _spun(cells: Cells, step: float, rates: Array) -> Spun:
    """Rotations from the identity, in each cell, by body rates (C, S, 3): a linear equation for the quaternion."""
    count, stages, _ = rates.shape
    x, y, z = np.moveaxis(rates, 2, 0) / 2
    zero = np.zeros_like(x)
    spin = np.stack((zero, z, -y, x, -z, zero, x, y, y, -x, zero, z, -x, -y, -z, zero), axis=-1)
    spin = spin.reshape(count, stages, 4, 4)  # p' = spin p of a quaternion x, y, z, w
    system = -step * np.einsum("jk,ckab->cjakb", cells.integrals, spin).reshape(count, 4 * stages, 4 * stages)
    system += np.eye(4 * stages)
    start = np.broadcast_to(np.tile([0.0, 0.0, 0.0, 1.0], stages)[:, None], (count, 4 * stages, 1))
    inner = np.linalg.solve(system, start).reshape(count, stages, 4, 1)
    return Spun((spin @ inner)[..., 0], step)


def _ended(cells: Cells, spun: Spun) -> tuple[Array, Array]:
    """Rotations (C, S, 3, 3) at the stages, and (C, 3, 3) at the cells' ends."""
    rows = np.concatenate((cells.integrals, cells.gauss.weights[None]))
    cell = np.repeat(np.arange(cells.count), len(rows))
    rotations = spun.after(cell, np.tile(rows, (cells.count, 1))).reshape(cells.count, len(rows), 3, 3)
    return rotations[:, :-1], rotations[:, -1]


def _momentum(cells: Cells, step: float, seen: Array, start: Array) -> Array:
    """Solve mu' = mu x (J mu) in all cells: mu (C, S, 3) from J (C, S, 3, 3) and mu at their beginnings (C, 3)."""
    count, stages = seen.shape[:2]
    mu: Array = np.repeat(start[:, None], stages, axis=1)
    size, eye = float(np.linalg.norm(start, axis=1).max()), np.eye(3 * stages)
    for _ in range(SWEEPS):
        turning = np.einsum("csab,csb->csa", seen, mu)
        defect = mu - start[:, None] - step * np.einsum("jk,cka->cja", cells.integrals, np.cross(mu, turning))
        slope = cross_matrix(mu) @ seen - cross_matrix(turning)
        system = -step * np.einsum("jk,ckab->cjakb", cells.integrals, slope).reshape(count, 3 * stages, 3 * stages)
        change = np.linalg.solve(system + eye, defect.reshape(count, -1, 1)).reshape(mu.shape)
        mu = mu - change
        if _settled(change, size):
            return mu
    raise IntegrationError


def small_turns(transitions: Array, drifts: Array) -> Array:
    """Small turns (C + 1, 3, c) at the borders that c drifts (C, 3, c) of the cells make, from none at takeoff."""
    turns = np.zeros((len(drifts) + 1, *drifts.shape[1:]))
    for cell, (transition, drift) in enumerate(zip(transitions, drifts, strict=True)):
        turns[cell + 1] = transition @ turns[cell] + drift
    return turns


def moved(attitudes: Array, turns: Array) -> Array:
    """Attitudes (K, 3, 3) after turns (K, 3), rad, of the world's axes."""
    return np.asarray(exponential(turns) @ attitudes)
