"""Rates with which a frame is at rest, for many postures at once.

They are those of :func:`floatplan.motion.planar.contact_rates.least_rates`, whose docstring has the linear program, for
more than one joint, each with a limit, in general position: one joint is free, all others turn at the same share of
their limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array

NOTHING = 1e-12  # [-] of the whole: less is rounding


@dataclass(frozen=True, eq=False)
class EndRates:
    """Rates at K ends.

    Attributes
    ----------
    ratios : (K,) largest ``|rate| / limit``; infinite where no rates hold the frame at rest
    rates : (K, n) rad/s, of the planned joints; of no meaning where the ratio is infinite
    orientation_rates : (K,) rad/s
    """

    ratios: Array
    rates: Array
    orientation_rates: Array


def end_rates(matrix: Array, target: Array, limits: Array) -> EndRates:
    """Solve ``matrix @ (orientation rate, rates) = target`` with the least largest ``|rate| / limit``.

    Parameters
    ----------
    matrix : (K, 3, n+1), n above 1
    target : (K, 3)
    limits : (n,) rad/s, finite
    """
    size = np.abs(matrix).max(axis=2)
    size[:, 1:] = size[:, 1:].max(axis=1, keepdims=True)
    size[size == 0] = 1.0
    matrix, target = matrix / size[:, :, None], target / size
    base, joints = matrix[:, :, 0], matrix[:, :, 1:]
    across = _plane(base)
    reach, along = across @ (joints * limits), (across @ target[:, :, None])[:, :, 0]
    normals = np.stack((-reach[:, 1], reach[:, 0]), axis=1)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(lengths > NOTHING, lengths, 1.0)
    asked = (along[:, :, None] * normals).sum(axis=1)
    strengths = np.abs(normals.transpose(0, 2, 1) @ reach).sum(axis=2)
    asked[np.abs(asked) <= NOTHING * np.linalg.norm(target, axis=1, keepdims=True)] = 0.0
    shares = np.divide(np.abs(asked), strengths, out=np.where(asked == 0, 0.0, np.inf), where=strengths > NOTHING)
    free = shares.argmax(axis=1)
    every = np.arange(len(free))
    pulls = (normals[every, :, free][:, None] @ reach)[:, 0] * np.sign(asked[every, free])[:, None]
    ratios = shares[every, free]
    rates = np.where(np.isfinite(ratios), ratios, 0.0)[:, None] * np.sign(pulls) * limits
    rates[every, free] = 0.0
    rest = target - (joints @ rates[:, :, None])[:, :, 0]
    pair = np.stack((base, joints[every, :, free]), axis=2)
    orientation_rates, of_free = (np.linalg.pinv(pair) @ rest[:, :, None])[:, :, 0].T
    rates[every, free] = of_free
    return EndRates(ratios, rates, orientation_rates)


def _plane(normals: Array) -> Array:
    """Orthonormal vectors (K, 2, 3) perpendicular to vectors (K, 3)."""
    axes = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, axes)
    second = np.cross(normals, first)
    both = np.stack((first, second), axis=1)
    return np.asarray(both / np.linalg.norm(both, axis=2, keepdims=True))
