"""What the kernel is given of flights in a plane to follow starts of problems with constraints: ``exchange.hpp``."""

from functools import lru_cache

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.structs import Struct, StructArray, doubles
from floatplan.motion.dynamics import RatesAtEnds
from floatplan.motion.planar.end_rates import EndRates
from floatplan.motion.planar.flight import gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import Form, basis


@lru_cache(maxsize=32)
def nodes_of_levels(form: Form) -> StructArray:
    """Return the nodes of all levels, for motions of a form."""
    levels = []
    for count in NODE_COUNTS:
        grid = gauss_grid(count)
        value, first, second = basis(form).values(grid.s)
        nodes = Struct(
            "Nodes",
            nodes=count,
            s=doubles(grid.s),
            weights=doubles(grid.weights),
            tail=doubles(grid.quadrature.transform[-3:]),
            value=doubles(value.T),
            first=doubles(first.T),
            second=doubles(second.T),
            integrals=doubles(grid.integrals[:count].T),
            antiderivative=doubles(grid.quadrature.antiderivative),
        )
        levels.append(nodes)
    return StructArray("Nodes", levels)


def knots(rates: RatesAtEnds, end: int) -> Array:
    """Return the h (K,), kg m^2/s, between which the rates at an end are straight; none where they are given."""
    return rates.curves[end].momenta if isinstance(rates, EndRates) and end in rates.curves else np.empty(0)
