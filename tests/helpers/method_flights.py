"""A plan's motion as a point of the program that the reference method solves."""

from dataclasses import replace

import numpy as np

import floatplan as fp
from floatplan.arrays import Array
from floatplan.method.planner import solve
from floatplan.method.program import Program
from floatplan.method.sqp import Solution
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.sine_polynomial import basis


def at_motion(plan: fp.Plan) -> tuple[Program, Array]:
    """Return the program on the plan's branch of the arcsine, with the plan's h, and its x (m,)."""
    powers = plan.coefficients * plan.duration ** np.arange(plan.coefficients.shape[1])
    joints, degree = len(powers), powers.shape[1] - 1
    branch = np.floor(powers.sum(axis=1) / np.pi + 0.5).astype(np.int64)
    degrees = [degree] * joints if plan.problem.raises_degree else plan.problem.degrees
    flight = replace(plan.problem.flight, angular_momentum=plan.angular_momentum)
    program = Program(replace(plan.problem, flight=flight), degrees, branch)
    polynomials = program.motions.polynomials
    free = np.linalg.solve(basis(polynomials.form).powers, powers.T)[CONDITIONS:].T
    own = np.arange(free.shape[1]) < np.array(polynomials.free)[:, None]
    x: Array = free[own].astype(np.float64)
    return program, x


def from_there(plan: fp.Plan) -> tuple[Program, Solution]:
    """Return where the reference method ends from a plan's motion."""
    program, x = at_motion(plan)
    return program, solve(program, x)


def plan_there(program: Program, x: Array) -> fp.Plan:
    """Return the plan with the motion of an x (m,)."""
    motions = program.motions
    of_problem = (program.problem, motions.polynomials, motions.coefficients(x), motions.momentum(x))
    return fp.Plan.of_motion(*of_problem, status="feasible", ok=True, explanation="", solver={})
