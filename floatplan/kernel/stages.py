"""How a plan is approached in stages, compiled or not, and when the nodes are enough: these numbers are shared."""

from __future__ import annotations

from dataclasses import replace

from floatplan.optimization.nonlinear_program import Settings

QUADRATURE_ERROR = 1e-13  # rad, of the attitude at landing, at which the nodes are enough
NEARLY_RESOLVED = 1e-6  # rad, error of the attitude at landing that nodes may leave before the last stage
COARSELY_RESOLVED = 0.02  # what the nodes may miss of the motion, relative to its size
UNRESOLVED = 1e-6  # the same of a plan: its square is lost
MOST_ROUNDS = 24
MOST_ITERATIONS = 240  # in all rounds together
HOPELESS = 0.1  # of violation after the coarse search: then the fine one would be wasted
COARSE = Settings(feasibility=1e-6, optimality=1e-5, iterations=50, polish=False)
ROUGH = replace(COARSE, feasibility=1e-2, optimality=1e-1)
FINE = Settings(feasibility=1e-9, optimality=1e-9, iterations=80)
EASY_ITERATIONS = 40  # [-] of a plain start: with fewer of them other starts promise little
WANTED_AFTER_FAILURE = 4  # [-] solutions to choose from where the plain start did not converge quickly
SPREADS = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)  # of random motions


def nearly_resolved(settings: Settings) -> Settings:
    """Return the settings of the stage before the last."""
    return replace(settings, feasibility=NEARLY_RESOLVED, polish=False)


SECANT_STEPS = 4  # towards a start that meets (14), between two motions
