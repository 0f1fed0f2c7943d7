"""A plan sampled for its curves, and what tells two plans apart."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.flight_state import FlightState
from floatplan.plans.plan import Plan

SAMPLES = 241  # [-] of a curve


@dataclass(frozen=True, eq=False)
class SampledPlan:
    """A plan and its states at the instants of the curves."""

    plan: Plan
    state: FlightState

    @classmethod
    def of(cls, plan: Plan) -> SampledPlan:
        """Sample a plan."""
        return cls(plan, plan.at(np.linspace(0, plan.duration, SAMPLES)))

    @property
    def times(self) -> Array:
        """Instants (N,) of the curves, s."""
        return self.state.times

    @cached_property
    def inertia(self) -> Array:
        """D (N, n+1) of (4), kg m^2."""
        return self.plan.dynamics.momentum_map(self.state.positions)


def plan_names(plan: Plan, compare: Plan) -> tuple[str, str]:
    """Return names that distinguish two plans: with and without obstacles, or their problems' names."""
    many, few = len(plan.problem.obstacles), len(compare.problem.obstacles)
    if (many > 0) != (few > 0):
        names = "with obstacle", "without obstacle"
        return names if many else (names[1], names[0])
    if plan.problem.name != compare.problem.name:
        return plan.problem.name, compare.problem.name
    return "this plan", "other plan"
