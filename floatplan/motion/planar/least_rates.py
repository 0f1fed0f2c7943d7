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
    columns : (3, k)
    target : (3,)
    limits : (k,)
        Positive; infinite where a rate costs nothing. These must leave at most two of the three equations.
    """
    scale = np.abs(columns).max(axis=1)
    scale[scale == 0] = 1.0
    columns, target = columns / scale[:, None], target / scale
    size = float(np.linalg.norm(target))
    limited = np.isfinite(limits)
    reach = columns * np.where(limited, limits, 0.0)
    lengths = np.linalg.norm(reach, axis=0)
    values, influence, ratio = np.zeros(len(limits)), np.zeros(len(limits)), 0.0
    basis = _complement(columns[:, ~limited])
    open_, rest, first = limited, target, True
    while basis.shape[1]:
        normal = basis @ _steepest(basis.T @ reach[:, open_], basis.T @ rest)
        asked, pulls = float(normal @ rest), np.where(open_, normal @ reach, 0.0)
        strength = float(np.abs(pulls).sum())
        if strength <= NOTHING * float(lengths.sum()):
            if first and abs(asked) > NOTHING * size:
                return LeastRates(np.inf, np.full(len(limits), np.nan), influence)
            asked, strength = 0.0, 1.0
        if first:
            ratio, influence, first = abs(asked) / strength, np.abs(pulls) / strength, False
        acting = np.abs(pulls) > NOTHING * lengths
        values[acting] = asked / strength * np.sign(pulls[acting]) * limits[acting]
        open_, rest = open_ & ~acting, target - columns[:, limited] @ values[limited]
        basis = basis @ _complement((basis.T @ normal)[:, None])
    values[~limited] = np.linalg.lstsq(columns[:, ~limited], rest, rcond=SAME)[0]
    return LeastRates(ratio, values, influence)


def _complement(columns: Array) -> Array:
    """Orthonormal basis (r, d) of what is perpendicular to all columns (r, k)."""
    lengths = np.linalg.norm(columns, axis=0)
    directions = columns[:, lengths > 0] / lengths[lengths > 0]
    left, singular, _ = np.linalg.svd(directions)
    return np.asarray(left[:, int((singular > SAME).sum()) :])


def _steepest(reach: Array, target: Array) -> Array:
    """Unit vector y (d,), d of 1 or 2, with the largest ``|target.y| / sum_i |reach_i.y|``."""
    if len(target) == 1:
        return np.ones(1)
    candidates = np.concatenate((np.stack((-reach[1], reach[0])), target[:, None]), axis=1)
    lengths = np.linalg.norm(candidates, axis=0)
    if not lengths.any():
        return np.array([1.0, 0.0])
    candidates = candidates[:, lengths > 0] / lengths[lengths > 0]
    asked = np.abs(target @ candidates)
    asked[asked <= NOTHING * np.linalg.norm(target)] = 0.0
    strength = np.maximum(np.abs(reach.T @ candidates).sum(axis=0), NOTHING * float(np.abs(reach).sum()))
    ratios = np.divide(asked, strength, out=np.where(asked > 0, np.inf, 0.0), where=strength > 0)
    return np.asarray(candidates[:, int(np.argmax(ratios))])
