"""Motions as plans, made without a planner."""

import numpy as np

import floatplan as fp
from floatplan.arrays import read_only


def drawn_plan(
    robot: fp.Robot, coefficients: np.ndarray, angular_momentum: float, duration: float = 1.0, orientation: float = 0.0
) -> fp.Plan:
    """A motion as a plan, made without a planner; its goal is not where it ends."""
    n = len(robot.joints)
    still = fp.Posture(orientation, 0.0)
    problem = fp.Problem(robot, still, still, fp.Flight(duration), limits=fp.Limits(position="full"))
    return fp.Plan(
        problem=problem,
        centre=read_only(np.zeros(n)),
        amplitude=read_only(np.full(n, np.pi)),
        coefficients=read_only(coefficients),
        angular_momentum=angular_momentum,
        angular_momentum_bounds=(angular_momentum, angular_momentum),
        ballistics=problem.path,
        status="feasible",
        ok=True,
        explanation="",
        solver={},
    )


def random_coefficients(seed: int, joints: int, degree: int = 5, size: float = 0.5) -> np.ndarray:
    """Coefficients (joints, degree + 1) of polynomials of moderate size on [0, 1]."""
    return np.random.default_rng(seed).normal(scale=size, size=(joints, degree + 1))
