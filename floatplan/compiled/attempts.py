"""What the kernel is given of flights in a plane to follow starts, but for their problems: nodes, powers, numbers."""

from dataclasses import replace
from fractions import Fraction
from functools import cache, lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.structs import Struct, StructArray, doubles, enumeration
from floatplan.kernel.tolerances import CONSTRAINED_SETTINGS, SETTINGS
from floatplan.motion.dynamics import FlightDynamics, RatesAtEnds
from floatplan.motion.exact_polynomials import CONDITIONS, basis_columns, compensations
from floatplan.motion.planar.end_rates import EndRates
from floatplan.motion.planar.flight import PlanarFlight
from floatplan.motion.quadrature import NODE_COUNTS, gauss_legendre
from floatplan.motion.sine_polynomial import Form, basis
from floatplan.tables import ORIENTATION

INFEASIBLE, FEASIBLE, OPTIMAL = enumeration("Status")
STATUS: dict[int, str] = {INFEASIBLE: "infeasible", FEASIBLE: "feasible", OPTIMAL: "optimal"}


@lru_cache(maxsize=32)
def nodes_of_levels(form: Form) -> StructArray:
    """Return the nodes of all levels, for motions of a form."""
    levels = []
    for count in NODE_COUNTS:
        rule = gauss_legendre(count)
        value, first, second = basis(form).values(rule.nodes)
        nodes = Struct(
            "Nodes",
            nodes=count,
            s=doubles(rule.nodes),
            weights=doubles(rule.weights),
            tail=doubles(rule.transform[-3:]),
            value=doubles(value.T),
            first=doubles(first.T),
            second=doubles(second.T),
            integrals=doubles(rule.integrals(rule.nodes).T),
            antiderivative=doubles(rule.antiderivative),
        )
        levels.append(nodes)
    return StructArray("Nodes", levels)


def knots(rates: RatesAtEnds, end: int) -> Array:
    """Return the h (K,), kg m^2/s, between which the rates at an end are straight; none where they are given."""
    return rates.curves[end].momenta if isinstance(rates, EndRates) and end in rates.curves else np.empty(0)


@cache
def powers_of_basis(width: int) -> Struct:
    """Return what b is written with, of motions with so many free polynomials."""
    columns, columns_low = _doubles(basis_columns(width))
    lost, lost_low = _doubles(compensations(CONDITIONS + width))
    return Struct("Powers", columns=columns, columns_low=columns_low, lost=lost, lost_low=lost_low)


def _doubles(fractions: Any) -> tuple[Array, Array]:
    """Fractions as sums of two doubles."""
    high = fractions.astype(np.float64)
    exact = np.array([Fraction(value) for value in high.ravel().tolist()], dtype=object).reshape(high.shape)
    return high, (fractions - exact).astype(np.float64)


@cache
def search_settings(constrained: bool, levels: int = len(NODE_COUNTS)) -> Struct:
    """Return every number of a search, with inequalities or without, on so many levels of grids."""
    settings = CONSTRAINED_SETTINGS if constrained else SETTINGS
    return Struct.of_numbers(replace(settings, tolerance=ORIENTATION, levels=levels))


def is_planar(flight: FlightDynamics) -> bool:
    """Whether a flight is one in a plane, as the kernel's are."""
    return isinstance(flight, PlanarFlight)
