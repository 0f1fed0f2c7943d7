"""A problem as a search takes it: what it fixes of every motion, the rows that are watched, and the variables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.dynamics import FlightDynamics, MomentumSet
from floatplan.motion.flight import PlanarFlight, flight_of
from floatplan.planning.constraints import Constraint, clearance, limit
from floatplan.planning.kernel_input.rows import KernelRows, PlanarRows
from floatplan.planning.variables import DecisionVariables, Start, decision_variables, scaled_variables
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.tables import OBJECTIVE_TABLE


@dataclass(frozen=True, eq=False)
class FlightSpec:
    """A problem as a search takes it; searches of one problem may share it.

    Attributes
    ----------
    problem : Problem
    fixed_momentum : MomentumSet, optional
        The angular momenta h to choose from; left out, those of the problem.
    """

    problem: Problem
    fixed_momentum: MomentumSet | None = None

    @cached_property
    def momentum(self) -> MomentumSet:
        """The angular momenta h to choose from."""
        return self.fixed_momentum or self.flight.momentum_set

    @cached_property
    def flight(self) -> FlightDynamics:
        """What the problem fixes of every motion."""
        return flight_of(self.problem)

    @cached_property
    def constraints(self) -> tuple[Constraint, ...]:
        """All inequalities that do not hold by construction."""
        problem = self.problem
        if not problem.has_inequalities:
            return ()
        flight = self.flight
        duration = problem.flight.duration
        obstacles: list[tuple[str, Obstacle]] = []
        for index, obstacle in enumerate(problem.obstacles):
            obstacles.append((f"obstacle {index} ({obstacle.kind})", obstacle))
        if problem.ground:
            obstacles.append(("the ground", problem.ground_plane))
        blocks: list[Constraint] = []
        for name, obstacle in obstacles:
            low, high = obstacle.window or (0.0, duration)
            window = max(low / duration, 0.0), min(high / duration, 1.0)  # as far as the flight lasts
            labels = [f"clearance of {link} to {name}" for link in flight.links_measured(obstacle)]
            blocks.append(clearance(obstacle, obstacle.margin, labels, "the obstacle covers the {end} posture", window))
        links = np.array(flight.links if problem.self_clearances else ())
        for pair in problem.self_clearances:
            first = tuple(np.flatnonzero(links == pair.links[0]).tolist())
            second = tuple(np.flatnonzero(links == pair.links[1]).tolist())
            labels = [f"clearance of {pair.links[0]} to {pair.links[1]}"] * (len(first) * len(second))
            blocks.append(clearance((first, second), pair.margin, labels, "it follows from the {end}'s positions"))
        blocks += [limit(shares, flight) for shares in problem.limit_shares]
        return tuple(blocks)

    @cached_property
    def rows(self) -> KernelRows:
        """Their rows for the kernel, with the quantity that the objective is about."""
        quantity = OBJECTIVE_TABLE[self.problem.motion.objective].quantity or ""
        if self.problem.robot.in_plane:
            if not self.constraints:
                return PlanarRows(self.problem.robot.tree, (), quantity)
            flight = self.flight
            assert isinstance(flight, PlanarFlight), "the robot flies in its plane"
            blocks = [constraint.rows for constraint in self.constraints]
            return PlanarRows(self.problem.robot.tree, blocks, quantity, flight)
        from floatplan.motion.spatial.flight import SpatialFlight  # here, because flights in a plane do without
        from floatplan.planning.kernel_input.space import SpatialRows

        assert isinstance(self.flight, SpatialFlight), "the robot flies in space"
        return SpatialRows(self.flight, [constraint.rows for constraint in self.constraints], quantity)

    def raised(self, lower: DecisionVariables, x: Array, degrees: tuple[int, ...]) -> Start:
        """Return the motion x of some variables as a start at higher degrees."""
        rise = zip(lower.polynomials.free, degrees, lower.degrees, strict=True)
        polynomials = replace(lower.polynomials, free=tuple(free + new - old for free, new, old in rise))
        variables = scaled_variables(self.problem, polynomials, self.momentum, lower.following)
        z = lower.free_coefficients(x)
        padded = np.pad(z, ((0, 0), (0, polynomials.width - z.shape[1])))
        return Start(variables, variables.variables(padded, lower.angular_momentum(x)))


spec_of = lru_cache(maxsize=8)(FlightSpec)  # that of a problem is made once: searches with other seeds share it


@lru_cache(maxsize=8)
def nominal_start(spec: FlightSpec, degrees: tuple[int, ...]) -> Start:
    """Return the motion with no free part, of such degrees."""
    variables = decision_variables(spec.problem, degrees, None, spec.momentum)
    return Start(variables, variables.nominal_motion, at_once=True)
