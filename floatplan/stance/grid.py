"""A stance as data: orientation and joints on a grid of instants, quintics between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import BPoly

from floatplan.arrays import Array


@dataclass(frozen=True, eq=False)
class Grid:
    """A stance on G instants, quintics between them.

    Attributes
    ----------
    times : (G,) s, from the jump's start
    y, v, a : (n+1, G) orientation and joints with their derivatives
    ratios : (others, G) horizontal over vertical force of the contacts beside the anchor, linear between instants
    """

    times: Array
    y: Array
    v: Array
    a: Array
    ratios: Array

    @cached_property
    def curve(self) -> Any:
        """Piecewise polynomial of y."""
        return hermite(self.times, self.y, self.v, self.a)

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """y, y', y'' (n+1, N) at times (N,)."""
        return self.curve(times).T, self.curve.derivative()(times).T, self.curve.derivative(2)(times).T


def hermite(times: Array, y: Array, v: Array, a: Array) -> Any:
    """Quintics through values (rows, G), first and second derivatives."""
    return BPoly.from_derivatives(times, np.stack((y.T, v.T, a.T), axis=1))
