"""A plan flown without floatplan's motion: SciPy integrates (4), Pinocchio is called directly, p is numpy's."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy.polynomial import polynomial
from scipy.integrate import solve_ivp

import floatplan as fp
from floatplan.arrays import read_only
from floatplan.motion.planar.closed_form import ballistics


@lru_cache(maxsize=8)
def argument_powers(plan: fp.Plan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients of p, p' and p'' of (12), one column a joint."""
    powers = plan.coefficients.T
    return powers, polynomial.polyder(powers, axis=0), polynomial.polyder(powers, 2, axis=0)


def joint_state(plan: fp.Plan, time: float) -> np.ndarray:
    """Positions, velocities, accelerations (3, n) at one time, by (12)."""
    value, rate, curvature = (polynomial.polyval(time, powers) for powers in argument_powers(plan))
    sine, cosine = plan.amplitude * np.sin(value), plan.amplitude * np.cos(value)
    return np.stack((plan.centre + sine, cosine * rate, cosine * curvature - sine * rate**2))


def integrate_orientation(plan: fp.Plan, times: np.ndarray) -> np.ndarray:
    """Orientation (N,) at rising times from 0, by Dormand and Prince's method of order 8."""
    robot = plan.robot
    data = robot.model.createData()

    def rate(time, _):
        position, velocity, _ = joint_state(plan, time)
        full = robot.reference + robot.selection @ position
        row = robot.plane.normal @ pin.computeCentroidalMap(robot.model, data, full)[3:]
        return [(plan.angular_momentum - row @ (robot.selection @ velocity)) / row[2]]

    start = [plan.problem.initial.orientation]
    flown = solve_ivp(rate, (0, plan.duration), start, t_eval=times, method="DOP853", rtol=1e-12, atol=1e-12)
    return flown.y[0]


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
        ballistics=ballistics(problem),
        status="feasible",
        ok=True,
        explanation="",
        solver={},
    )


def random_coefficients(seed: int, joints: int, degree: int = 5, size: float = 0.5) -> np.ndarray:
    """Coefficients (joints, degree + 1) of polynomials of moderate size on [0, 1]."""
    return np.random.default_rng(seed).normal(scale=size, size=(joints, degree + 1))
