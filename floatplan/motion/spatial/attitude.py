"""How the base turns in space: its attitude by Gauss collocation in cells, each from an attitude at its border.

With h the angular momentum in the world, ``[I(q) | A(q)]`` the angular momentum of the robot with its base at the
identity by the base's angular velocity and the joints' rates, the base turns in its own axes at

    omega = I^-1 (R^T h - A q'),    R' = R [omega]x,                                                               (S1)

and a small turn zeta of the world, ``delta R = [zeta]x R``, goes on as

    zeta' = M [h]x zeta + g,    M = R I^-1 R^T,    g = -R I^-1 (L dq + A dq') + M dh,                              (S2)

where L is the derivative of ``I omega + A q'`` by the joints' positions. In a cell ``R = B Y S``, with B at its border:
S is the motion for h = 0, a linear equation for a quaternion; ``mu = Y^T B^T h`` obeys ``mu' = mu x (J mu)`` with
``J = S I^-1 S^T``, which Newton's method solves; and Y follows from mu, again linearly. The kernel does that.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray, read_only
from floatplan.errors import FloatplanError
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct, doubles, enumeration, integers, layout
from floatplan.motion.quadrature import GaussLegendre, gauss_legendre
from floatplan.motion.spatial.rotations import cross_matrix, of_quaternions, unwrapped_angles
from floatplan.problem.attitude import Reorientation, tilt
from floatplan.tables import A_TURN_OFF, LARGEST_MIDDLE_ANGLE

LEVELS = ((8, 6), (16, 5), (16, 8), (32, 8), (64, 8))  # cells and stages of the search, by levels
TOLERANCES: dict[str, float] = {
    "sweeps": 12,  # of Newton's method; more than it takes where it comes to an end
    "settled": 1e-13,  # [-] of |h|: a step of mu below which Newton's method has ended
    "largest": 1e6,  # [-] of |h|: beyond it the motion cannot be integrated in these cells
}
OUT_OF_MEMORY = 2  # as the kernel says it
WEIGHT_OF_GROWTH = 1e-3  # [rad^2] of the objective "robust": 0.1 more in |z| brought |P| from 12..169 down to 2..16


class IntegrationError(FloatplanError, ArithmeticError):
    """A motion is too wild for the cells."""


@dataclass(frozen=True, eq=False)
class Cells:
    """C cells of equal length, with the same S Gauss stages.

    Attributes
    ----------
    count : int
    stages : int
    gauss : GaussLegendre
        Of one cell.
    s : (C S,)
        All stages, fractions of the flight.
    integrals : (S, S)
        Butcher's matrix: integrals from a cell's beginning to its stages.
    """

    count: int
    stages: int
    gauss: GaussLegendre
    s: Array
    integrals: Array

    def place(self, instants: Array) -> tuple[IntArray, Array]:
        """The cell of each instant (K,) of [0, 1], and the integrals (K, S) from its beginning to the instant."""
        cell = np.minimum((instants * self.count).astype(np.int64), self.count - 1)
        return cell, self.gauss.integrals(instants * self.count - cell)


@lru_cache(maxsize=16)
def cells(count: int, stages: int) -> Cells:
    """Return so many cells with so many stages."""
    gauss = gauss_legendre(stages)
    s = (np.arange(count)[:, None] + gauss.nodes).ravel() / count
    return Cells(count, stages, gauss, read_only(s), read_only(gauss.integrals(gauss.nodes)))


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
    spun : (C, S, 4), of each rotation that makes an attitude after that at the border
        Rates, by collocation, of a quaternion that begins at the identity.
    """

    cells: Cells
    duration: float
    angular_momentum: Array
    borders: Array
    inverse_inertia: Array
    attitudes: Array
    rates: Array
    ends: Array
    spun: tuple[Array, ...]

    def at(self, instants: Array) -> Array:
        """Attitudes (L, 3, 3) at instants (L,) of [0, 1]."""
        return attitudes_at(self.cells, self.duration, self.borders, self.spun, instants)

    @property
    def way(self) -> Array:
        """Attitudes (C S + 2, 3, 3) at takeoff, at all stages, and at landing."""
        return np.concatenate((self.borders[:1], self.attitudes, self.ends[-1:]))

    @cached_property
    def carried(self) -> tuple[Array, Array]:
        """How small turns go on in each cell: transitions (C, 3, 3), and weights (C, S, 3, 3) of g at the stages.

        A turn zeta at a cell's beginning becomes ``transition zeta + sum_j weight_j g_j`` at its end.
        """
        transitions = np.empty_like(self.borders)
        weights = np.empty_like(self.attitudes)
        _ask(
            "transitions",
            self.cells,
            self.duration,
            momentum=doubles(self.angular_momentum),
            inverse=self.inverse_inertia,
            attitudes=self.attitudes,
            transitions=transitions,
            turn_weights=weights,
        )
        return transitions, weights.reshape(self.cells.count, -1, 3, 3)

    def turns_by_momentum(self, instants: Array) -> Array:
        """Derivative (L, 3, 3) by h of the small rotation of the world at instants (L,) of [0, 1], 1/(kg m^2/s)."""
        cell, integrals = self.cells.place(instants)
        mobility = self.attitudes @ self.inverse_inertia @ np.swapaxes(self.attitudes, 1, 2)  # M of (S2)
        turns = np.empty((len(instants), 3, 3))
        _ask(
            "turns",
            self.cells,
            self.duration,
            momentum=doubles(self.angular_momentum),
            inverse=self.inverse_inertia,
            attitudes=self.attitudes,
            columns=3,
            instants=len(instants),
            cell=integers(cell),
            reached=doubles(integrals),
            drifts=doubles(mobility),
            turns=turns,
        )
        return turns

    def landing_by_momentum(self, onward: Array) -> Array:
        """Derivative (3, 3) by h of ``onward`` (3, 3) times a small turn of the world at landing.

        It is ``onward sum_j W_j M_j``, backwards through the cells, where W_j carries g of (S2) to landing.
        """
        transitions, weights = self.carried
        mobility = self.attitudes @ self.inverse_inertia @ np.swapaxes(self.attitudes, 1, 2)  # M of (S2)
        mobility = mobility.reshape(weights.shape)
        slope = np.zeros((3, 3))
        for cell in range(len(weights) - 1, -1, -1):
            slope += onward @ (weights[cell] @ mobility[cell]).sum(axis=0)
            onward = onward @ transitions[cell]
        return slope


def growth_of_errors(landing_by_momentum: Array, angular_momentum: Array) -> tuple[Array, Array]:
    """What errors at takeoff grow to until landing: small turns of the world, from their derivative (3, 3) by h (3,).

    Returns
    -------
    by_size : (3,) rad
        K, the turn at landing by ln |h|.
    by_attitude : (3, 3)
        P, the turn at landing by a small turn zeta at takeoff. To turn the robot but not h is to turn the world by
        zeta, and h in it back: ``h - zeta x h``.
    """
    by_size = landing_by_momentum @ angular_momentum
    by_attitude = np.eye(3) + landing_by_momentum @ cross_matrix(angular_momentum[None])[0]
    return by_size, by_attitude


def weighted_growth(landing_by_momentum: Array, angular_momentum: Array) -> Array:
    """K and P (12,), rad, weighted as the objective "robust" adds their squares to that of the motion's size."""
    by_size, by_attitude = growth_of_errors(landing_by_momentum, angular_momentum)
    return np.asarray(np.sqrt(WEIGHT_OF_GROWTH) * np.concatenate((by_size, by_attitude.ravel())))


def attitudes_at(cells: Cells, duration: float, borders: Array, spun: Iterable[Array], instants: Array) -> Array:
    """Attitudes (L, 3, 3) at instants (L,) of [0, 1], from borders (C, 3, 3) and the quaternions' rates after them."""
    cell, integrals = cells.place(instants)
    attitudes = borders[cell]
    for rates in spun:
        quaternions = duration / cells.count * np.einsum("ls,lsa->la", integrals, rates[cell])
        quaternions[:, 3] += 1.0
        attitudes = attitudes @ of_quaternions(quaternions)
    return np.asarray(attitudes)


def _ask(what: str, cells: Cells, duration: float, **members: Any) -> None:
    """Have the kernel write what it is called for; IntegrationError where it cannot."""
    compiled = kernel()
    counts = {"cells": cells.count, "stages": cells.stages, "duration": duration, **TOLERANCES}
    rules = {"integrals": doubles(cells.integrals), "weights": doubles(cells.gauss.weights)}
    struct = Struct("Turning", **(dict.fromkeys(layout("Turning").arrays) | counts | rules | members))
    failed = compiled.turn(struct.pointer, enumeration("Asked")[what], compiled.instructions)
    if failed == OUT_OF_MEMORY:
        raise MemoryError
    if failed:
        raise IntegrationError


def turn(
    cells: Cells, duration: float, inertia: Array, relative: Array, angular_momentum: Array, borders: Array
) -> Turning:
    """Integrate (S1) in all cells.

    Parameters
    ----------
    inertia : (K, 3, 3) kg m^2
        I at the stages.
    relative : (K, 3) kg m^2/s
        A q' there.
    angular_momentum : (3,) kg m^2/s
    borders : (C, 3, 3)
        Attitudes at the cells' beginnings; or (3, 3) at takeoff, from where each cell begins where the last one ended.

    Raises
    ------
    IntegrationError
        The motion is too wild for the cells.
    """
    count = len(inertia)
    stages = cells.stages
    begins = np.empty((cells.count, 3, 3))
    begins[: 1 if borders.ndim == 2 else None] = borders
    ends = np.empty_like(begins)
    inverse = np.empty((count, 3, 3))
    attitudes = np.empty((count, 3, 3))
    rates = np.empty((count, 3))
    spun = np.empty((2, cells.count, stages, 4))
    _ask(
        "attitudes",
        cells,
        duration,
        is_chained=borders.ndim == 2,
        momentum=doubles(angular_momentum),
        inertia=doubles(inertia),
        relative=doubles(relative),
        borders=begins,
        ends=ends,
        inverse=inverse,
        attitudes=attitudes,
        rates=rates,
        carried_rates=spun[0],
        still_rates=spun[1],
    )
    first = 0 if angular_momentum.any() else 1
    return Turning(cells, duration, angular_momentum, begins, inverse, attitudes, rates, ends, tuple(spun[first:]))


def wrong_way(reorientation: Reorientation, attitudes: Array) -> str:
    """What is wrong with the way (K, 3, 3) from takeoff to landing, its turns or its tilt; empty for nothing."""
    axes = reorientation.goal.axes
    if axes is None:
        return ""
    angles = unwrapped_angles(axes, attitudes)
    off = np.abs(angles[-1] - angles[0] - reorientation.change)
    if not off.max() < A_TURN_OFF:
        return "it makes other turns than are asked for"
    steepest = tilt(axes, angles[:, 1]).max()
    if steepest > LARGEST_MIDDLE_ANGLE:
        return f"it tilts by {np.degrees(steepest):.0f} degrees, near 90, where the other two angles are not defined"
    return ""
