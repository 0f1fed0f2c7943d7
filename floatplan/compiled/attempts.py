"""What the kernel is given of flights in a plane to follow starts of problems with constraints: ``exchange.hpp``."""

from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.layout import Filled, structure_array
from floatplan.motion.dynamics import RatesAtEnds
from floatplan.motion.planar.end_rates import EndRates
from floatplan.motion.planar.flight import gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import Form, basis

COMPILED_LEVEL = 3  # of the grid that the kernel's solution is evaluated on; a finer one judges it where that is needed
CONSTRAINED_LEVEL = 2  # level of grids, at least, where constraints are watched
WATCHED_AT_MOST = 6  # level of grids
SMALLEST_STEP = 0.02  # [m] that a link may travel between two nodes even beside a smaller obstacle


@lru_cache(maxsize=32)
def nodes_of_levels(form: Form) -> Any:
    """Return the nodes of all levels, for motions of a form."""
    filled = []
    for count in NODE_COUNTS:
        grid = gauss_grid(count)
        value, first, second = (values.T for values in basis(form).values(grid.s))
        integrals = {"antiderivative": grid.quadrature.antiderivative, "tail": grid.quadrature.transform[-3:]}
        integrals |= {"integrals": grid.integrals[:count].T}
        filled.append(Filled("Nodes", grid, nodes=count, value=value, first=first, second=second, **integrals))
    return structure_array("Nodes", filled)


def knots(rates: RatesAtEnds, end: int) -> Array:
    """Return the h (K,), kg m^2/s, between which the rates at an end are straight; none where they are given."""
    return rates.curves[end].momenta if isinstance(rates, EndRates) and end in rates.curves else np.empty(0)
