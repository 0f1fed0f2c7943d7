"""What one writes with Pinocchio and SciPy: SLSQP on the reduced program, D and its derivatives by Pinocchio.

All but D is floatplan's and vectorised: joint motion, elimination of (13), whitened variables, chain rule. Pinocchio's
calls, from Python, are two for each node: the centroidal map for theta0', and, where a gradient is asked for, the
derivative of the momentum at the velocities with that theta0'. Nothing is computed twice at a point; model and data
are made once per robot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pinocchio as pin
from general_flight import BaseRate, GeneralDynamics, general_flight
from peers import MOST_ITERATIONS, NODES, Slsqp, reduced_program

import floatplan as fp
from floatplan.arrays import Array
from floatplan.robot.planar.model import BASE_COORDINATES


class PinocchioRate(GeneralDynamics):
    """theta0' of (4) and its derivatives by Pinocchio, instant by instant."""

    def __init__(self, robot: fp.Robot) -> None:
        super().__init__(robot.tree)
        self._model, self._data = robot.model, robot.model.createData()
        self._reference, self._selection = np.array(robot.reference), np.array(robot.selection)
        self._orientation = BASE_COORDINATES - 1
        self._at_rest = np.zeros(robot.model.nv)
        axis = int(np.argmax(np.abs(robot.plane.normal)))
        self._row = 3 + axis  # of the angular momentum about the plane's normal
        self._sign = float(np.sign(robot.plane.normal[axis]))

    def base_rate_derivatives(self, positions: Array, velocities: Array, angular_momentum: float | Array) -> BaseRate:
        """theta0' and its derivatives at N instants."""
        full = self._reference + positions @ self._selection.T
        rows = self._momentum_rows(full)
        by_momentum = self._sign / rows[:, self._orientation]
        by_velocity = (rows @ self._selection) / -rows[:, self._orientation, None]
        rate = angular_momentum * by_momentum + (by_velocity * velocities).sum(axis=1)
        return BaseRate(rate, by_velocity, by_momentum, self._by_position(full, velocities, rate, by_momentum))

    def _momentum_rows(self, full: Array) -> Array:
        """Rows (N, nv) of the centroidal map."""
        model, data, row = self._model, self._data, self._row
        rows = np.empty_like(full)
        for k, q in enumerate(full):
            rows[k] = pin.computeCentroidalMap(model, data, q)[row]
        return rows

    def _by_position(self, full: Array, velocities: Array, rate: Array, by_momentum: Array) -> Callable[[], Array]:
        def differentiate() -> Array:
            model, data, row, at_rest = self._model, self._data, self._row, self._at_rest
            full_velocities = velocities @ self._selection.T
            full_velocities[:, self._orientation] = rate
            rows = np.empty_like(full)
            for k, q in enumerate(full):
                rows[k] = pin.computeCentroidalDynamicsDerivatives(model, data, q, full_velocities[k], at_rest)[0][row]
            return np.asarray((rows @ self._selection) * (-self._sign * by_momentum)[:, None])

        return differentiate


@lru_cache(maxsize=64)
def pinocchio_rate(robot: fp.Robot) -> PinocchioRate:
    """Prepare a robot once for all of its flights."""
    return PinocchioRate(robot)


class PinocchioSlsqp(Slsqp):
    """SciPy's SLSQP on the reduced program, its momentum by Pinocchio."""

    def __init__(self, problem: fp.Problem, nodes: int = NODES, iterations: int = MOST_ITERATIONS) -> None:
        super().__init__(problem, nodes, iterations)
        flight = general_flight(problem, pinocchio_rate(problem.robot))
        self.program = replace(reduced_program(problem, nodes), flight=flight)
