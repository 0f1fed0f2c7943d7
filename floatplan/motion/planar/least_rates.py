"""Rates that satisfy up to three linear equations with the least largest ratio to their limits, in closed form.

The linear program ``min r: C x = b, |x_i| <= limit_i r`` has the dual ``max b.y: sum_i limit_i |C_i.y| <= 1`` with
``C_k.y = 0`` for every column k without a limit. A flight's equations are three and its base has no limit, so y lies in
a plane, and the best is perpendicular to one of the columns there: as many candidates as columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array

NOTHING = 1e-12  # [-] of the whole: less is rounding
SAME = 1e-9  # [-] relative: what differs by less is equal


@dataclass(frozen=True, eq=False)
class LeastRates:
    """The rates, and what holds them back.

    Attributes
    ----------
    ratio : the largest ``|x_i| / limit_i``; infinite where no rates satisfy the equations
    values : (k,) the rates x; NaN where there are none
    influence : (k,)
        By which share ``ratio`` falls as a limit grows by its own share; the sum is 1, or 0 where nothing holds back.
    """

    ratio: float
    values: Array
    influence: Array


def least_rates(columns: Array, target: Array, limits: Array) -> LeastRates:
    """Solve ``columns @ x = target`` with the least largest ``|x_i| / limit_i``, then the next largest, and so on.

    That makes x unique, whatever the order of the columns and their signs.

    Parameters
    ----------
    columns : (3, k), the equations of comparable size: what is ``NOTHING`` beside the rest of a column is rounding
    target : (3,)
    limits : (k,)
        Positive; infinite where a rate costs nothing. These must leave at most two of the three equations.
    """
    size = float(np.linalg.norm(target))
    limited = np.isfinite(limits)
    reach = columns * np.where(limited, limits, 0.0)
    values, influence, ratio = np.zeros(len(limits)), np.zeros(len(limits)), 0.0
    basis = _complement(columns[:, ~limited])
    open_, rest, first = limited, target, True
    while basis.shape[1]:
        normal = basis @ _steepest(basis, reach * open_, rest)
        asked = float(normal @ rest) if abs(normal @ rest) > NOTHING * size else 0.0
        pulls = _pulls(normal, reach * open_)
        strength = float(np.abs(pulls).sum())
        if first and asked and not strength:
            return LeastRates(np.inf, np.full(len(limits), np.nan), influence)
        acting = pulls != 0
        if strength:
            values[acting] = asked / strength * np.sign(pulls[acting]) * limits[acting]
        if first and strength:
            ratio, influence = abs(asked) / strength, np.abs(pulls) / strength
        open_, rest, first = open_ & ~acting, target - columns[:, limited] @ values[limited], False
        basis = basis @ _complement((basis.T @ normal)[:, None])
    values[~limited] = np.linalg.lstsq(columns[:, ~limited], rest, rcond=SAME)[0]
    return LeastRates(ratio, values, influence)


def _complement(columns: Array) -> Array:
    """Orthonormal basis (r, d) of what is perpendicular to all columns (r, k)."""
    lengths = np.linalg.norm(columns, axis=0)
    directions = columns[:, lengths > 0] / lengths[lengths > 0]
    left, singular, _ = np.linalg.svd(directions)
    return np.asarray(left[:, int((singular > SAME).sum()) :])


def _pulls(normals: Array, reach: Array) -> Array:
    """How far each column of ``reach`` (3, k) goes along unit normals (.., 3): 0 where that is rounding."""
    pulls = normals @ reach
    pulls[np.abs(pulls) <= NOTHING * np.linalg.norm(reach, axis=0)] = 0.0
    return np.asarray(pulls)


def _steepest(basis: Array, reach: Array, target: Array) -> Array:
    """Unit vector y (d,), d of 1 or 2, in the basis (3, d), with the largest ``|target.y| / sum_i |reach_i.y|``."""
    if basis.shape[1] == 1:
        return np.ones(1)
    across, along = basis.T @ reach, basis.T @ target
    candidates = np.concatenate((np.stack((-across[1], across[0])), along[:, None]), axis=1)
    lengths = np.linalg.norm(candidates, axis=0)
    if not lengths.any():
        return np.array([1.0, 0.0])
    candidates = candidates[:, lengths > 0] / lengths[lengths > 0]
    asked = np.abs(along @ candidates)
    asked[asked <= NOTHING * np.linalg.norm(target)] = 0.0
    strength = np.abs(_pulls((basis @ candidates).T, reach)).sum(axis=1)
    ratios = np.divide(asked, strength, out=np.where(asked > 0, np.inf, 0.0), where=strength > 0)
    return np.asarray(candidates[:, int(np.argmax(ratios))])
