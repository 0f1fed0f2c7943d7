"""Plans without a search: a motion of a problem's class, its end made the goal; flights that obey (4) or (S1) alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import floatplan as fp
from floatplan.arrays import Array
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.flight import flight_of
from floatplan.planning.variables import decision_variables
from floatplan.problem.attitude import required


def forward_plan(problem: fp.Problem, seed: int = 0, size: float = 0.3) -> fp.Plan:
    """Return a plan of the problem with another goal: what a random motion of its class reaches."""
    rest = {"velocities": 0.0, "accelerations": 0.0, "settled": None}
    still = {end: replace(getattr(problem, end), **rest) for end in ("start", "goal")}
    problem = replace(problem, **still)
    momentum = flight_of(problem).momentum_set.centre
    branches = np.zeros((2, len(problem.robot.joints)), dtype=np.int64)
    given = MomentumSet(momentum, np.empty((len(momentum), 0)))
    polynomials = decision_variables(problem, problem.degrees, branches, given).polynomials
    z = size * np.random.default_rng(seed).standard_normal(polynomials.nominal_coefficients.shape)
    z.ravel()[np.setdiff1d(np.arange(z.size), polynomials.free_indices)] = 0.0
    answer: dict[str, Any] = {"status": "feasible", "ok": True, "explanation": "", "solver": {}}
    reached = fp.Plan.of_motion(problem, polynomials, z, momentum, **answer).final_orientation
    problem = replace(problem, goal=replace(problem.goal, orientation=reached))
    return fp.Plan.of_motion(problem, polynomials, z, momentum, **answer)


class Drifting:
    """A robot whose joints follow the replanner's reference exactly: its base turns by (4), Pinocchio's D."""

    def __init__(self, plan: fp.Plan, momentum: float) -> None:
        self.plan, self.momentum = plan, momentum
        self.time, self.orientation = 0.0, plan.problem.initial.orientation

    def state(self, replanner: fp.Replanner) -> tuple[float, float, float, Array, Array]:
        """Return the arguments of ``update`` for now."""
        positions, velocities, _ = replanner.motion.at(self.time)
        rate = self.plan.dynamics.base_rate(positions, velocities, self.momentum)[0]
        return self.time, self.orientation, float(rate), positions[0], velocities[0]

    def fly(self, replanner: fp.Replanner, until: float, parts: int = 8) -> tuple[Array, Array, Array]:
        """Fly on; times (N,), orientations (N,), positions (N, n) on the way, by the midpoint rule."""
        step = (until - self.time) / parts
        times = self.time + step * (np.arange(parts) + 0.5)
        positions, velocities, _ = replanner.motion.at(times)
        turned = np.asarray(step * np.cumsum(self.plan.dynamics.base_rate(positions, velocities, self.momentum)))
        orientations: Array = np.asarray(self.orientation + turned, dtype=np.float64)
        self.time, self.orientation = until, float(orientations[-1])
        ends = np.asarray(times + step / 2, dtype=np.float64)
        return ends, orientations, replanner.motion.at(ends)[0]


class DriftingInSpace:
    """The same in space: the base turns by (S1), Pinocchio's centroidal map, integrated by DOP853.

    It has an angular momentum (3,), kg m^2/s, and relative ``errors`` (2m,) of the masses and inertias of its bodies.
    """

    def __init__(self, plan: fp.Plan, momentum: Array, errors: Array | None = None) -> None:
        self.plan, self.momentum = plan, momentum
        self.time, self.attitude = 0.0, pin.Quaternion(plan.at(0.0).orientation).matrix()
        model = self.plan.robot.model.copy()
        if errors is not None:
            masses, inertias = np.split(1 + errors, 2)
            for body in range(1, model.njoints):
                own = model.inertias[body]
                inertia = inertias[body - 1] * own.inertia
                model.inertias[body] = pin.Inertia(masses[body - 1] * own.mass, own.lever, inertia)
        self.model, self.data = model, model.createData()

    def rate(self, positions: Array, velocities: Array, attitude: Array) -> Array:
        """Angular velocity (3,) in the base's axes."""
        robot, base = self.plan.robot, slice(3, 6)
        q = robot.reference.copy()
        q[7:] += robot.selection[6:] @ positions
        q[:7] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
        rows = pin.computeCentroidalMap(self.model, self.data, q)[3:]
        relative = rows[:, 6:] @ (robot.selection[6:] @ velocities)
        return np.asarray(np.linalg.solve(rows[:, base], attitude.T @ self.momentum - relative))

    def state(self, replanner: fp.Replanner) -> tuple[float, Array, Array, Array, Array]:
        """Return the arguments of ``update`` for now."""
        positions, velocities, _ = replanner.motion.at(self.time)
        rate = self.rate(positions[0], velocities[0], self.attitude)
        return self.time, pin.Quaternion(self.attitude).coeffs(), rate, positions[0], velocities[0]

    def fly(self, replanner: fp.Replanner, until: float, tolerance: float = 1e-8) -> None:
        """Fly on."""

        def growth(time: float, quaternion: Array) -> Array:
            positions, velocities, _ = replanner.motion.at(time)
            attitude = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).matrix()
            rate = self.rate(positions[0], velocities[0], attitude)
            vector, scalar = quaternion[:3], quaternion[3]
            return np.append(scalar * rate + np.cross(vector, rate), -vector @ rate) / 2

        start = pin.Quaternion(self.attitude).coeffs()
        flown = solve_ivp(growth, (self.time, until), start, "DOP853", rtol=tolerance, atol=tolerance / 10)
        end = flown.y[:, -1]
        self.attitude = pin.Quaternion(end / np.linalg.norm(end)).matrix()
        self.time = until

    @property
    def off(self) -> Array:
        """The rotation (3,) from the goal to its attitude, rad, in the goal's axes."""
        goal = required(self.plan.problem.final.attitude).matrix
        return np.asarray(pin.log3(goal.T @ self.attitude))
