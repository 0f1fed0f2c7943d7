"""A plan's motion as a point of the program that the reference method solves."""

from dataclasses import replace

import numpy as np

import floatplan as fp
from floatplan.arrays import Array
from floatplan.method.program import Program
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.sine_polynomial import basis
from floatplan.plans.plans import PlanEntry


def at_motion(plan: fp.Plan) -> tuple[Program, Array]:
    """Return the program on the plan's branch of the arcsine, with the plan's h, and its x (m,)."""
    powers = plan.coefficients * plan.duration ** np.arange(plan.coefficients.shape[1])
    joints, degree = len(powers), powers.shape[1] - 1
    branch = np.floor(powers.sum(axis=1) / np.pi + 0.5).astype(np.int64)
    degrees = [degree] * joints if plan.problem.raises_degree else plan.problem.degrees
    flight = replace(plan.problem.flight, angular_momentum=plan.angular_momentum)
    program = Program(replace(plan.problem, flight=flight), np.array(degrees), branch)
    polynomials = program.polynomials
    free = np.linalg.solve(basis(polynomials.form).powers, powers.T)[CONDITIONS:].T
    own = np.arange(free.shape[1]) < np.array(polynomials.free)[:, None]
    x: Array = free[own].astype(np.float64)
    return program, x


def plan_there(program: Program, x: Array) -> fp.Plan:
    """Return the plan with the motion of an x (m,)."""
    h, b = program.momentum(x[:, None])[0, 0], program.b(x[:, None])[..., 0]
    return PlanEntry(status="feasible", angular_momentum=float(h), coefficients=b).plan(program.problem, seed=0)
