"""A plan's motion as a point of the program that the reference method solves."""

from __future__ import annotations

import numpy as np

import floatplan as fp
from floatplan.arrays import Array
from floatplan.method.motion import CONDITIONS, Motions
from floatplan.method.planner import solve
from floatplan.method.program import Program
from floatplan.method.sqp import Solution
from floatplan.motion.sine_polynomial import basis


def at_motion(plan: fp.Plan, reach: float = 0.0) -> tuple[Program, Array]:
    """Return the program on the plan's branch of the arcsine, and its x (m,); h is free where it has a reach."""
    powers = plan.coefficients * plan.duration ** np.arange(plan.coefficients.shape[1])
    joints, degree = len(powers), powers.shape[1] - 1
    branch = np.floor(powers.sum(axis=1) / np.pi + 0.5).astype(np.int64)
    degrees = [degree] * joints if plan.problem.raises_degree else plan.problem.degrees
    motions = Motions(plan.problem, degrees, branch)
    program = Program(plan.problem, motions, plan.angular_momentum, reach)
    free = np.linalg.solve(basis(motions.polynomials.form).powers, powers.T)[CONDITIONS:].T
    own = np.arange(free.shape[1]) < np.array(motions.polynomials.free)[:, None]
    x = np.zeros(program.size)
    x[: motions.size] = free[own]
    return program, x


def from_there(plan: fp.Plan, instants: int = 129) -> tuple[Program, Solution]:
    """Return where the reference method ends from a plan's motion, with inequalities at so many instants and more."""
    program, x = at_motion(plan)
    if plan.problem.has_inequalities:
        program.instants = np.linspace(0, 1, instants)[1:-1]
    return program, solve(program, x)
