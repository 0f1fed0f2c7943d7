"""Corrections far from all limits, by the compiled kernel."""

from __future__ import annotations

from floatplan.inflight.outlook import Outlook, Views
from floatplan.kernel.library import kernel
from floatplan.kernel.rest import Rest, RestSolver
from floatplan.plans.plan import Plan


def rest_solver(plan: Plan, views: Views) -> RestSolver | None:
    """Return the compiled solver of a plan's corrections; None where there is no kernel."""
    found = kernel()
    if found is None:
        return None
    return RestSolver(found, plan.robot.tree, plan.centre, plan.amplitude, views.whitening, views.grid.nodes)


def rest_of(outlook: Outlook) -> Rest:
    """Return the rest of a flight as the kernel takes it."""
    motion, present = outlook.motion, outlook.present
    return Rest(
        motion.remaining, present.angular_momentum, outlook.change, motion.coefficients, *present.dynamics.masses
    )
