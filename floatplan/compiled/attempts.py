"""What the kernel is given of flights in a plane to follow starts of problems with constraints: ``exchange.hpp``."""

from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled.batch import Rows
from floatplan.kernel.layout import Filled, structure_array
from floatplan.motion.dynamics import FlightDynamics, RatesAtEnds
from floatplan.motion.planar.end_rates import EndRates
from floatplan.motion.planar.flight import PlanarFlight, gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import Form, SinePolynomials, basis

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
        value, first, second = _basis_at_nodes(form, count)
        integrals = {"antiderivative": grid.quadrature.antiderivative, "tail": grid.quadrature.transform[-3:]}
        integrals |= {"integrals": grid.integrals[:count].T}
        filled.append(Filled("Nodes", grid, nodes=count, value=value, first=first, second=second, **integrals))
    return structure_array("Nodes", filled)


@lru_cache(maxsize=32)
def _basis_at_nodes(form: Form, count: int) -> tuple[Array, ...]:
    """Columns of the basis and their first two derivatives by s, (columns, count) each."""
    return tuple(values.T for values in basis(form).values(gauss_grid(count).s))


def watching_levels(
    flight: FlightDynamics, motions: SinePolynomials, rows: Rows, places: tuple[Array, Array, Array]
) -> IntArray:
    """Levels (N,) of grids for the constraints of N problems: no link may jump over an obstacle between two nodes.

    The plain motions tell how far the links travel, with the joint ranges and degrees of ``motions``. ``places`` are
    the orientations (N,) rad at takeoff, the paths (N, 5) of the centre of mass, and the least thickness (N,) of
    obstacles, m.
    """
    assert isinstance(flight, PlanarFlight), "the kernel's flights are in a plane"
    orientation, path, thickness = places
    if not np.isfinite(thickness).any():
        return np.full(len(thickness), CONSTRAINED_LEVEL)
    grid, duration = gauss_grid(NODE_COUNTS[COMPILED_LEVEL]), rows.duration[:, None]
    value, slope, _ = (each[: rows.boundary.shape[2]] for each in _basis_at_nodes(motions.form, len(grid.s)))
    p, n, amplitude = rows.boundary @ value, rows.boundary.shape[1], motions.amplitude[:, None]
    positions = (motions.centre[:, None] + amplitude * np.sin(p)).swapaxes(1, 2).reshape(-1, n)
    rates = amplitude * np.cos(p) * (rows.boundary @ slope) / rows.duration[:, None, None]
    momenta = np.repeat(rows.momentum, len(grid.s))
    turned = flight.equations.base_rate(positions, rates.swapaxes(1, 2).reshape(-1, n), momenta).reshape(len(p), -1)
    attitude, times = orientation[:, None] + duration * (turned @ grid.integrals.T), duration * grid.s
    x0, y0, vx, vy, gravity = path.T[..., None]
    com = x0 + vx * times + 1j * (y0 + vy * times - gravity * times**2 / 2)
    placed = flight.link_shapes.place(com.ravel(), flight.tree.absolute_angles(attitude.ravel(), positions))
    ends = np.concatenate((placed.start, placed.end), axis=1).reshape(*times.shape, -1)
    way = np.abs(np.diff(ends, axis=1)).sum(axis=1).max(axis=1)
    levels = np.searchsorted(NODE_COUNTS, way / np.maximum(thickness, SMALLEST_STEP))
    return np.where(levels < len(NODE_COUNTS), np.maximum(levels, CONSTRAINED_LEVEL), WATCHED_AT_MOST)


def orientations(flight: FlightDynamics) -> dict[str, float]:
    """Return the orientation at takeoff, and by how much it is to change, rad."""
    assert isinstance(flight, PlanarFlight), "the kernel's flights are in a plane"
    return {"orientation": flight.initial_orientation, "change": flight.change}


def knots(rates: RatesAtEnds, end: int) -> Array:
    """Return the h (K,), kg m^2/s, between which the rates at an end are straight; none where they are given."""
    return rates.curves[end].momenta if isinstance(rates, EndRates) and end in rates.curves else np.empty(0)
