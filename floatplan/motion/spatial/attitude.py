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

from floatplan.arrays import Array, read_only
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.spatial.rotations import cross_matrix, exponential

SWEEPS = 12  # of Newton's method; more than it ever takes where it comes to an end
SETTLED = 1e-13  # [-] of |h|: a step of mu below which Newton's method has ended
LARGEST = 1e6  # [-] of |h|: beyond it the motion cannot be integrated in these cells


@dataclass(frozen=True, eq=False)
class Cells:
    """C cells of equal length, each with the same S Gauss stages.

    Attributes
    ----------
    count : C
    stages : (S,), in [0, 1] of a cell
    weights : (S,), for integrals over a cell
    integrals : (S, S), of Butcher: integrals from a cell's beginning to its stages
    """

    count: int
    stages: Array
    weights: Array
    integrals: Array

    @cached_property
    def s(self) -> Array:
        """All instants (C S,), fractions of the flight."""
        return read_only((np.arange(self.count)[:, None] + self.stages).ravel() / self.count)


@lru_cache(maxsize=16)
def cells(count: int, stages: int) -> Cells:
    """Return so many cells with so many stages each."""
    gauss = gauss_legendre(stages)
    return Cells(count, gauss.nodes, gauss.weights, read_only(gauss.integrals(gauss.nodes)))


class NotIntegrable(ArithmeticError):
    """A motion is too wild for the cells."""


@dataclass(frozen=True, eq=False)
class Turning:
    """How the base turns in C cells of S stages; K = C S.

    Attributes
    ----------
    attitudes : (K, 3, 3)
    rates : (K, 3) rad/s
        omega, in the base's axes.
    ends : (C, 3, 3)
        Attitudes at the cells' ends.
    """

    cells: Cells
    duration: float
    angular_momentum: Array
    inverse_inertia: Array
    attitudes: Array
    rates: Array
    ends: Array

    @cached_property
    def mobility(self) -> Array:
        """M (K, 3, 3), 1/(kg m^2)."""
        return np.asarray(self.attitudes @ self.inverse_inertia @ np.swapaxes(self.attitudes, 1, 2))

    @cached_property
    def carried(self) -> tuple[Array, Array]:
        """How small turns go on in each cell: transitions (C, 3, 3), and weights (C, S, 3, 3) of g at the stages.

        A turn zeta at a cell's beginning becomes ``transition zeta + sum_j weight_j g_j`` at its end.
        """
        count, stages = self.cells.count, len(self.cells.stages)
        step = self.duration / count
        pulled = (self.mobility @ cross_matrix(self.angular_momentum)).reshape(count, stages, 3, 3)
        # weights = step b^T (1 - step K A)^-1 of the stages' equations zeta_j = zeta + step sum A_jk (K_k zeta_k + g_k)
        system = -step * np.einsum("cjab,jk->cjakb", pulled, self.cells.integrals)
        system = system.reshape(count, 3 * stages, 3 * stages)
        system += np.eye(3 * stages)
        right = np.kron(self.cells.weights[:, None], np.eye(3)) * step
        weights = np.linalg.solve(np.swapaxes(system, 1, 2), np.broadcast_to(right, (count, *right.shape)))
        weights = np.swapaxes(weights, 1, 2).reshape(count, 3, stages, 3).transpose(0, 2, 1, 3)
        return np.eye(3) + np.einsum("cjab,cjbd->cad", weights, pulled), weights


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
    NotIntegrable
        The motion is too wild for the cells.
    """
    shape = (cells.count, len(cells.stages))
    step = duration / cells.count
    inverse = np.linalg.inv(inertia)
    still = -np.einsum("kab,kb->ka", inverse, relative)
    swings, swung = _turned(cells, step, still.reshape(*shape, 3))
    attitudes, ends = borders[:, None] @ swings, borders @ swung
    carried = np.zeros((*shape, 3))
    if angular_momentum.any():
        seen = swings @ inverse.reshape(*shape, 3, 3) @ np.swapaxes(swings, 2, 3)
        momentum = _momentum(cells, step, seen, np.swapaxes(borders, 1, 2) @ angular_momentum)
        carried = np.einsum("csab,csb->csa", seen, momentum)
        drifts, drifted = _turned(cells, step, carried)
        attitudes, ends = borders[:, None] @ drifts @ swings, borders @ drifted @ swung
        carried = np.einsum("csba,csb->csa", swings, carried)
    rates = still + carried.reshape(-1, 3)
    return Turning(cells, duration, angular_momentum, inverse, attitudes.reshape(-1, 3, 3), rates, ends)


def _turned(cells: Cells, step: float, rates: Array) -> tuple[Array, Array]:
    """Rotations (C, S, 3, 3) at the stages and (C, 3, 3) at the end, from the identity, by body rates (C, S, 3)."""
    count, stages, _ = rates.shape
    x, y, z = np.moveaxis(rates, 2, 0) / 2
    zero = np.zeros_like(x)
    spin = np.stack((zero, z, -y, x, -z, zero, x, y, y, -x, zero, z, -x, -y, -z, zero), axis=-1)
    spin = spin.reshape(count, stages, 4, 4)  # p' = spin p of a quaternion x, y, z, w
    system = -step * np.einsum("jk,ckab->cjakb", cells.integrals, spin).reshape(count, 4 * stages, 4 * stages)
    system += np.eye(4 * stages)
    start = np.tile([0.0, 0.0, 0.0, 1.0], stages)
    inner = np.linalg.solve(system, np.broadcast_to(start[:, None], (count, 4 * stages, 1)))[..., 0]
    inner = inner.reshape(count, stages, 4)
    end = start[:4] + step * np.einsum("j,cjab,cjb->ca", cells.weights, spin, inner)
    return _matrices(inner), _matrices(end)


def _matrices(quaternions: Array) -> Array:
    """Rotations (..., 3, 3) of quaternions (..., 4) x, y, z, w of about unit length."""
    unit = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    across = cross_matrix(unit[..., :3])
    return np.asarray(np.eye(3) + 2 * unit[..., 3, None, None] * across + 2 * across @ across)


def _momentum(cells: Cells, step: float, seen: Array, start: Array) -> Array:
    """Solve mu' = mu x (J mu) in all cells: mu (C, S, 3) from J (C, S, 3, 3) and mu at their beginnings (C, 3)."""
    count, stages = seen.shape[:2]
    mu = np.repeat(start[:, None], stages, axis=1)
    size = np.linalg.norm(start, axis=1).max()
    eye = np.eye(3 * stages)
    for _ in range(SWEEPS):
        turning = np.einsum("csab,csb->csa", seen, mu)
        defect = mu - start[:, None] - step * np.einsum("jk,cka->cja", cells.integrals, np.cross(mu, turning))
        slope = cross_matrix(mu) @ seen - cross_matrix(turning)
        system = -step * np.einsum("jk,ckab->cjakb", cells.integrals, slope).reshape(count, 3 * stages, 3 * stages)
        change = np.linalg.solve(system + eye, defect.reshape(count, -1, 1)).reshape(mu.shape)
        mu = mu - change
        largest = float(abs(change).max())
        if largest < SETTLED * size:
            return mu
        if not largest < LARGEST * size:
            break
    raise NotIntegrable


def small_turns(transitions: Array, drifts: Array) -> Array:
    """Small turns (C + 1, 3, c) at the borders that c drifts (C, 3, c) of the cells make, from none at takeoff."""
    turns = np.zeros((len(drifts) + 1, *drifts.shape[1:]))
    for cell, (transition, drift) in enumerate(zip(transitions, drifts, strict=True)):
        turns[cell + 1] = transition @ turns[cell] + drift
    return turns


def moved(attitudes: Array, turns: Array) -> Array:
    """Attitudes (K, 3, 3) after turns (K, 3), rad, of the world's axes."""
    return np.asarray(exponential(turns) @ attitudes)
