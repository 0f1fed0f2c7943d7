"""An attitude that is close to the true one: polynomials of a quaternion on each cell, by doubles and without a proof.

What is proved in :mod:`~floatplan.certificate.spatial.bound` holds for any approximation. This one is a power series
about the middle of each cell: from the attitude there, ``mu = R^T h`` and the quaternion Q follow from

    omega = I^-1 (mu - A q'),    mu' = mu x omega,    Q' = Q o omega / 2,                                          (S1)

coefficient by coefficient, so that even the last ones have small joint_momentum errors, and so has the residual. The
attitudes in the middles are unknowns: Newton's method closes the gaps between cells, and how much a turn of a middle
turns both ends is a power series too. Quaternions are x, y, z, w.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.certificate.cells import ORDER, TimeCells
from floatplan.certificate.spatial.bodies import BodyMotion
from floatplan.certificate.spatial.models import cross_matrices, inverted

Quaternion: TypeAlias = tuple[float, float, float, float]

SIGNS = (-1.0) ** np.arange(ORDER)  # powers of u at the beginning of a cell, where it is -1
STEPS = 4  # [-] of Runge and Kutta's method in a cell, from whose result Newton's method begins
MORE_STEPS = 16  # [-] where that leads nowhere
FAR = 1e-9  # [rad] of a gap where Newton's method came to no end
SWEEPS = 8  # [-] of Newton's method at most
CLOSED = 2e-15  # [rad] of a gap between cells that is rounding


@dataclass(frozen=True, eq=False)
class Approximation:
    """Quaternions (cells, K, 4) of the attitude as polynomials of u, and transitions (cells, K, 3, 3).

    A small turn y of the base in its own axes in the middle of a cell becomes ``transitions y`` at u.
    """

    quaternions: Array
    transitions: Array


def approximate(
    motion: BodyMotion, cells: TimeCells, momentum: Array, start: Array, middles: Array | None
) -> Approximation:
    """Integrate the attitude from ``start`` (4,); ``middles`` (cells, 4) are first guesses, where there are any."""
    half = cells.half.mid
    inverse, joint_momentum = motion.inverse.c[:, 0], motion.joint_momentum.c[:, 0, :, :, 0]
    if middles is None:
        middles = _integrated(inverse, joint_momentum, half, momentum, start, STEPS)
    approximation, gap = _by_newton(inverse, joint_momentum, half, momentum, start, middles)
    if gap > FAR:
        middles = _integrated(inverse, joint_momentum, half, momentum, start, MORE_STEPS)
        again, gap_again = _by_newton(inverse, joint_momentum, half, momentum, start, middles)
        if gap_again < gap:
            return again
    return approximation


def _by_newton(
    inverse: Array, joint_momentum: Array, half: Array, momentum: Array, start: Array, middles: Array
) -> tuple[Approximation, float]:
    """The approximation to which Newton's method leads from middles (cells, 4), and its largest gap, rad."""
    least = math.inf
    best = None
    for _ in range(SWEEPS):
        quaternions, transitions = _series(inverse, joint_momentum, half, momentum, middles)
        first, last = (np.einsum("k,ckx->cx", sign, quaternions) for sign in (SIGNS, np.ones(ORDER)))
        gaps = _turn(np.concatenate([start[None], last[:-1]]), first)
        largest = float(np.abs(gaps).max())
        if not largest < least:
            break
        least, best = largest, Approximation(quaternions, transitions)
        if largest < CLOSED:
            break
        middles = _closed(quaternions, transitions, gaps)
    return best or Approximation(quaternions, transitions), least


def _closed(quaternions: Array, transitions: Array, gaps: Array) -> Array:
    """Middles (cells, 4), turned so that the gaps (cells, 3) before the cells close to first order."""
    middles = quaternions[:, 0]
    in_middle = rotation(middles)

    def turned_at_end(powers: Any) -> Array:
        """How a small turn of the world in the middle of each cell turns the end where u has these powers (K,)."""
        attitude = rotation(np.einsum("k,ckx->cx", powers, quaternions))
        return np.asarray(attitude @ np.einsum("k,ckab->cab", powers, transitions) @ in_middle.swapaxes(1, 2))

    backward = turned_at_end(SIGNS)
    onward = turned_at_end(np.ones(ORDER))
    back = inverted(backward)
    turns = np.empty_like(gaps)
    carried = np.zeros(3)
    for cell, gap in enumerate(gaps):
        turns[cell] = back[cell] @ (carried + gap)
        carried = onward[cell] @ turns[cell]
    length = np.linalg.norm(turns, axis=1, keepdims=True)
    by = np.concatenate([turns * np.sinc(length / (2 * np.pi)) / 2, np.cos(length / 2)], axis=1)
    return np.asarray(product(by, middles) / np.linalg.norm(middles, axis=1, keepdims=True))


def _series(inverse: Array, joint_momentum: Array, half: Array, momentum: Array, middles: Array) -> tuple[Array, Array]:
    """Power series of the quaternion (cells, K, 4) and of the transitions (cells, K, 3, 3)."""
    cells = len(half)
    mu = np.zeros((cells, ORDER, 3))
    omega = np.zeros_like(mu)
    quaternions = np.zeros((cells, ORDER, 4))
    transitions = np.zeros((cells, ORDER, 3, 3))
    generator = np.zeros_like(transitions)
    mu[:, 0] = momentum @ rotation(middles)
    quaternions[:, 0] = middles
    transitions[:, 0] = np.eye(3)
    across = cross_matrices(mu)
    for k in range(ORDER):
        omega[:, k] = np.einsum("ciab,cib->ca", inverse[:, : k + 1], (mu - joint_momentum)[:, k::-1])
        across[:, k] = cross_matrices(mu[:, k])
        generator[:, k] = np.einsum("ciab,cibd->cad", inverse[:, : k + 1], across[:, k::-1]) - cross_matrices(
            omega[:, k]
        )
        if k + 1 == ORDER:
            break
        step = (half / (k + 1))[:, None]
        mu[:, k + 1] = step * np.einsum("ciab,cib->ca", across[:, : k + 1], omega[:, k::-1])
        turned = product(quaternions[:, : k + 1], np.pad(omega[:, k::-1], ((0, 0), (0, 0), (0, 1))))
        quaternions[:, k + 1] = step / 2 * turned.sum(axis=1)
        transitions[:, k + 1] = step[:, None] * np.einsum(
            "ciab,cibd->cad", generator[:, : k + 1], transitions[:, k::-1]
        )
    return quaternions, transitions


def _integrated(inverse: Array, joint_momentum: Array, half: Array, momentum: Array, start: Array, steps: int) -> Array:
    """Attitudes (cells, 4) in the cells' middles, by so many steps of Runge and Kutta's method of fourth order."""
    powers = np.linspace(-1.0, 1.0, 2 * steps + 1)[:, None] ** np.arange(ORDER)
    mobility = np.einsum("mk,ckab->cmab", powers, inverse)
    drift = np.einsum("cmab,cmb->cma", mobility, np.einsum("mk,cka->cma", powers, joint_momentum))
    mobility *= half[:, None, None, None]
    drift *= half[:, None, None]
    h = tuple(momentum.tolist())
    q = tuple((start / np.linalg.norm(start)).tolist())
    middles = []
    du = 2.0 / steps
    for matrices, drifts in zip(mobility.tolist(), drift.tolist(), strict=True):
        for step in range(steps):
            if 2 * step == steps:
                middles.append(q)
            instants = [(matrices[2 * step + m], drifts[2 * step + m]) for m in range(3)]
            first = _rate(q, h, *instants[0])
            second = _rate(_moved(q, first, du / 2), h, *instants[1])
            third = _rate(_moved(q, second, du / 2), h, *instants[1])
            fourth = _rate(_moved(q, third, du), h, *instants[2])
            rates = zip(first, second, third, fourth, strict=True)
            q = _moved(q, [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in rates], du)
    return np.array(middles)


def _rate(
    q: Sequence[float], h: Sequence[float], mobility: Sequence[Sequence[float]], drift: Sequence[float]
) -> Quaternion:
    """``Q o omega / 2`` of a unit quaternion, with ``omega = mobility R^T h - drift``, in plain numbers."""
    x, y, z, w = q
    hx, hy, hz = h
    cx, cy, cz = y * hz - z * hy, z * hx - x * hz, x * hy - y * hx
    mx = hx + 2 * (y * cz - z * cy - w * cx)
    my = hy + 2 * (z * cx - x * cz - w * cy)
    mz = hz + 2 * (x * cy - y * cx - w * cz)
    ox, oy, oz = (a * mx + b * my + c * mz - d for (a, b, c), d in zip(mobility, drift, strict=True))
    return (
        (w * ox + y * oz - z * oy) / 2,
        (w * oy + z * ox - x * oz) / 2,
        (w * oz + x * oy - y * ox) / 2,
        -(x * ox + y * oy + z * oz) / 2,
    )


def _moved(q: Sequence[float], rate: Sequence[float], step: float) -> Quaternion:
    """The unit quaternion nearest to ``q + step rate``."""
    x, y, z, w = (a + step * b for a, b in zip(q, rate, strict=True))
    length = math.sqrt(x * x + y * y + z * z + w * w)
    return x / length, y / length, z / length, w / length


def product(a: Array, b: Array) -> Array:
    """Products (..., 4) of quaternions."""
    ax, ay, az, aw = (a[..., k] for k in range(4))
    bx, by, bz, bw = (b[..., k] for k in range(4))
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by + ay * bw + az * bx - ax * bz
    z = aw * bz + az * bw + ax * by - ay * bx
    return np.stack([x, y, z, aw * bw - ax * bx - ay * by - az * bz], axis=-1)


def rotation(quaternions: Array) -> Array:
    """Rotations (..., 3, 3) of quaternions (..., 4) of any length."""
    v = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    across = cross_matrices(v[..., :3])
    return np.asarray(np.eye(3) + 2 * v[..., 3, None, None] * across + 2 * across @ across)


def _turn(after: Array, before: Array) -> Array:
    """Vectors of rotation (..., 3) in the world from the attitudes ``before`` to those ``after``."""
    conjugate = before * [-1.0, -1.0, -1.0, 1.0]
    off = product(after, conjugate)
    off = np.where(off[..., 3:] < 0, -off, off)
    length = np.linalg.norm(off[..., :3], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(length, off[..., 3:])
    return np.asarray(off[..., :3] * np.where(length > 0, angle / np.where(length > 0, length, 1.0), 0.0))
