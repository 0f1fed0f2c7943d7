"""The same flights, planned by others: for the benchmark.

SLSQP of SciPy solves floatplan's reduced program, with floatplan's gradients. IPOPT by way of CasADi solves the paper's
full formulation: all coefficients b of (12) free, (13) and (14) as equations, (17) as the objective. Both keep the
constraints at their quadrature nodes, from the same guess, the motion with no free part.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from general_flight import general_flight
from kernel_program import KernelProgram
from reduced_program import AnyEvaluation, FlightProgram, objective
from sampled_flight import sample_nodes
from scipy.optimize import minimize

import floatplan as fp
from floatplan.motion.flight import flight_of
from floatplan.motion.planar.flight import PlanarFlight, gauss_grid, planar_flight
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.planning.search import Search
from floatplan.planning.spec import FlightSpec
from floatplan.planning.variables import decision_variables

NODES = 64
ACCEPTED = 1e-6  # largest violation at the nodes of what counts as solved
MOST_ITERATIONS = 300
MOST_SECONDS = 20.0  # of IPOPT


@dataclass(frozen=True, eq=False)
class Answer:
    """What a peer found: whether it says so and the nodes agree, b (n, k+1), and the seconds it took."""

    solved: bool
    coefficients: np.ndarray
    seconds: float

    @property
    def norm(self) -> float:
        """|b| of (17)."""
        return float(np.linalg.norm(self.coefficients))

    def as_plan(self, plan: fp.Plan) -> fp.Plan:
        """Put this motion in the place of a plan's."""
        return replace(plan, coefficients=self.coefficients)


def reduced_program(problem: fp.Problem, nodes: int) -> FlightProgram:
    """Return floatplan's program at a fixed number of nodes, arcsine branches 0, with derivatives in NumPy."""
    flight = general_flight(problem)
    branches = np.zeros((2, len(problem.robot.joints)), dtype=np.int64)
    variables = decision_variables(problem, problem.degrees, branches, flight_of(problem).momentum_set)
    sampling = sample_nodes(gauss_grid(nodes), variables.polynomials.form)
    aim = objective(problem, flight, variables, sampling)
    return FlightProgram(flight, variables, sampling, aim, FlightSpec(problem).constraints)


class Slsqp:
    """SciPy's SLSQP on the reduced program."""

    def __init__(self, problem: fp.Problem, nodes: int = NODES, iterations: int = MOST_ITERATIONS) -> None:
        self._variables = Search(problem).plain_start.variables
        self.program: FlightProgram | KernelProgram = KernelProgram(problem, NODE_COUNTS.index(nodes))
        self._iterations = iterations
        self._at: bytes = b""

    def _evaluation(self, x: np.ndarray) -> AnyEvaluation:
        """The program at x: evaluated once for objective and constraints, and once for their derivatives if asked."""
        if x.tobytes() != self._at:
            self._last, self._at = self.program.evaluate(x.copy()), x.tobytes()
        return self._last

    def solve(self) -> Answer:
        """Solve from the plain motion."""
        self._at = b""
        began = time.perf_counter()
        at, variables = self._evaluation, self._variables
        options: Any = {"maxiter": self._iterations, "ftol": 1e-9}
        rules: list[Any] = [{"type": "eq", "fun": lambda x: at(x).equality, "jac": lambda x: at(x).equality_jacobian}]
        if len(at(variables.plain_motion).inequality):
            rules.append(
                {"type": "ineq", "fun": lambda x: at(x).inequality, "jac": lambda x: at(x).inequality_jacobian}
            )
        found = minimize(  # type: ignore[call-overload]  # its stubs know no Jacobian of a constraint
            lambda x: at(x).objective,
            variables.plain_motion,
            jac=lambda x: at(x).gradient,
            method="SLSQP",
            constraints=rules,
            options=options,
        )
        seconds = time.perf_counter() - began
        solved = bool(found.success) and at(found.x).worst_violation <= ACCEPTED
        b = variables.polynomials.powers_of_seconds(variables.free_coefficients(found.x))
        return Answer(solved, b, seconds)


@dataclass(frozen=True, eq=False)
class SymbolicFlight:
    """The flight at one instant as CasADi expressions, after (A.1) and (A.4) with (A.5) for any tree, corrected."""

    model: PlanarFlight
    momentum: float

    @property
    def joints(self) -> int:
        """Number n of joints."""
        return int(self.model.tree.turns.shape[1])

    @cached_property
    def coupling(self) -> tuple[np.ndarray, np.ndarray]:
        """Magnitude and angle of C."""
        c = self.model.tree.coupling
        return np.abs(c), np.angle(c)

    def cosines(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Real and imaginary parts (m, m) of conj(E) C E, each cosine and sine formed once per pair."""
        tree = self.model.tree
        size, angle = self.coupling
        phi = ca.DM(tree.turns) @ q + tree.offsets
        bodies = len(tree.mass)
        real, imaginary = ca.SX.zeros(bodies, bodies), ca.SX.zeros(bodies, bodies)
        for i in range(bodies):
            real[i, i] = size[i, i]
            for j in range(i):
                argument = tree.turn * (phi[j] - phi[i]) + angle[i, j]
                real[i, j] = real[j, i] = size[i, j] * ca.cos(argument)
                imaginary[i, j] = size[i, j] * ca.sin(argument)
                imaginary[j, i] = -imaginary[i, j]
        return real, imaginary

    @cached_property
    def rate(self) -> ca.Function:
        """theta0' of (4) from q and q'."""
        q, qd = ca.SX.sym("q", self.joints), ca.SX.sym("qd", self.joints)
        inertia = self.cosines(q)[0] + ca.diag(ca.DM(self.model.tree.inertia))
        columns = ca.sum1(inertia).T
        rate = (self.momentum - ca.dot(columns, ca.DM(self.model.tree.turns) @ qd)) / ca.sum1(columns)
        return ca.Function("rate", [q, qd], [rate])

    @cached_property
    def torques(self) -> ca.Function:
        """Joint torques from q, q', q'' and theta0': the moments of the bodies, gathered over each joint's subtree."""
        tree = self.model.tree
        q, qd, qdd, rate = (ca.SX.sym(name, size) for name, size in zip("abcd", (*[self.joints] * 3, 1), strict=True))
        real, imaginary = self.cosines(q)
        inertia = real + ca.diag(ca.DM(tree.inertia))
        turns = ca.DM(tree.turns)
        relative = turns @ qdd
        moments = inertia @ relative - tree.turn * imaginary @ (turns @ qd + rate) ** 2
        columns = ca.sum2(inertia)
        moments -= columns * ca.sum1(moments) / ca.sum1(columns)
        return ca.Function("torques", [q, qd, qdd, rate], [turns.T @ moments])

    @cached_property
    def ends(self) -> ca.Function:
        """Ends (2, 2 S) of the links' segments relative to the centre of mass, from q and theta0."""
        tree, shapes = self.model.tree, self.model.link_shapes
        q, orientation = ca.SX.sym("q", self.joints), ca.SX.sym("o")
        angle = tree.turn * (orientation + ca.DM(tree.turns) @ q + tree.offsets)
        cosine, sine = ca.cos(angle), ca.sin(angle)
        weights = np.concatenate(shapes.weights)
        real, imaginary = ca.DM(weights.real), ca.DM(weights.imag)
        places = ca.horzcat(real @ cosine - imaginary @ sine, real @ sine + imaginary @ cosine).T
        return ca.Function("ends", [q, orientation], [places])

    def clearance(self, circle: fp.Circle) -> ca.Function:
        """Clearances (S,) of the segments of a moved circle, less its margin, from q, theta0 and centre less CM."""
        q, orientation, center = ca.SX.sym("q", self.joints), ca.SX.sym("o"), ca.SX.sym("c", 2)
        ends = self.ends(q, orientation)
        count = ends.shape[1] // 2
        clearances = []
        for index in range(count):
            start, end = ends[:, index], ends[:, index + count]
            along = end - start
            share = ca.fmin(ca.fmax(ca.dot(along, center - start) / ca.dot(along, along), 0), 1)
            clearances.append(ca.norm_2(start + share * along - center) - circle.radius - circle.margin)
        return ca.Function("clearance", [q, orientation, center], [ca.vertcat(*clearances)])


class Ipopt:
    """CasADi and IPOPT on the full formulation."""

    def __init__(self, problem: fp.Problem, nodes: int = NODES) -> None:
        began = time.perf_counter()
        self._problem = problem
        self._reduced = reduced_program(problem, nodes)
        self._planar = planar_flight(problem)
        self._flight = SymbolicFlight(self._planar, self._reduced.variables.momentum.centre.item())
        self._rows: list[ca.MX] = []
        self._low: list[np.ndarray] = []
        self._high: list[np.ndarray] = []
        polynomials = self._reduced.variables.polynomials
        self._guess = polynomials.powers_of_seconds(polynomials.no_free_part)
        self._b = ca.MX.sym("b", *self._guess.shape)
        self._state()
        self._ends()
        self._limits()
        self._obstacles()
        self._solver = ca.nlpsol(
            "solver",
            "ipopt",
            {"x": ca.vec(self._b), "f": ca.sumsqr(self._b), "g": ca.vertcat(*self._rows)},
            {
                "ipopt": {
                    "print_level": 0,
                    "sb": "yes",
                    "max_iter": MOST_ITERATIONS,
                    "max_wall_time": MOST_SECONDS,
                    "tol": 1e-9,
                },
                "print_time": False,
                "verbose_init": False,
            },
        )
        self.building_seconds = time.perf_counter() - began

    def _require(self, row: ca.MX, low: float | np.ndarray, high: float | np.ndarray) -> None:
        row = ca.vec(row)
        self._rows.append(row)
        self._low.append(np.broadcast_to(low, row.shape[0]))
        self._high.append(np.broadcast_to(high, row.shape[0]))

    def _at(self, times: np.ndarray) -> tuple[ca.MX, ca.MX, ca.MX]:
        """q, q', q'' (n, K) by (12)."""
        problem = self._problem
        low, high = problem.position_limits.T
        centre, amplitude = ca.DM((low + high) / 2), ca.DM((high - low) / 2)
        powers = np.arange(self._guess.shape[1])[:, None]
        p = self._b @ ca.DM(times**powers)
        rate = self._b @ ca.DM(powers * times ** np.maximum(powers - 1, 0))
        curvature = self._b @ ca.DM(powers * (powers - 1) * times ** np.maximum(powers - 2, 0))
        wide = ca.DM.ones(1, len(times))
        swing, sway = (amplitude @ wide) * ca.sin(p), (amplitude @ wide) * ca.cos(p)
        return centre @ wide + swing, sway * rate, sway * curvature - swing * rate**2

    def _state(self) -> None:
        sampling, model = self._reduced.sampling, self._planar
        duration, count = self._problem.flight.duration, self._reduced.sampling.grid.nodes
        self._times = duration * sampling.grid.s
        self._q, self._qd, self._qdd = self._at(self._times)
        self._rate = self._flight.rate.map(count)(self._q, self._qd)
        self._orientation = model.initial_orientation + duration * self._rate @ ca.DM(
            gauss_grid(sampling.grid.nodes).integrals.T
        )
        final = model.initial_orientation + duration * self._rate @ ca.DM(sampling.grid.weights)
        self._require(final, model.final_orientation, model.final_orientation)

    def _ends(self) -> None:
        """(13)."""
        problem = self._problem
        states = zip(
            *((s.positions, s.velocities, s.accelerations) for s in (problem.initial, problem.final)), strict=True
        )
        for given, wanted in zip(self._at(np.array([0.0, problem.flight.duration])), states, strict=True):
            fixed = np.array(wanted).ravel()
            self._require(given, fixed, fixed)

    def _limits(self) -> None:
        """Torques, velocities and the orientation rate, at the nodes."""
        problem, count = self._problem, self._reduced.sampling.grid.nodes
        if np.isfinite(problem.torque_limits).any():
            torques = self._flight.torques.map(count)(self._q, self._qd, self._qdd, self._rate)
            self._bound(torques, np.repeat(problem.torque_limits[None, :], count, axis=0))
        if np.isfinite(problem.velocity_limits).any():
            self._bound(self._qd, np.repeat(problem.velocity_limits[None, :], count, axis=0))
        if problem.limits.orientation_rate is not None:
            self._bound(self._rate, np.full((count, 1), problem.limits.orientation_rate))

    def _bound(self, rows: ca.MX, limits: np.ndarray) -> None:
        """``|rows| <= limits`` (K, r)."""
        self._require(rows, -limits.ravel(), limits.ravel())

    def _obstacles(self) -> None:
        count = self._reduced.sampling.grid.nodes
        com = self._planar.ballistics.positions(self._times)
        for obstacle in self._problem.obstacles:
            if not isinstance(obstacle, fp.Circle) or obstacle.window or any(obstacle.velocity):
                raise TypeError("only circles at rest are written out for IPOPT")
            centers = ca.DM((np.array(obstacle.center) - com).T)
            clearance = self._flight.clearance(obstacle).map(count)(self._q, self._orientation, centers)
            self._require(clearance, 0.0, np.inf)

    def solve(self) -> Answer:
        """Solve from the plain motion."""
        low, high = np.concatenate(self._low), np.concatenate(self._high)
        began = time.perf_counter()
        found = self._solver(x0=self._guess.ravel(order="F"), lbg=low, ubg=high)
        seconds = time.perf_counter() - began
        rows = np.asarray(found["g"]).ravel()
        missed = float(np.maximum(low - rows, rows - high).max())
        solved = bool(self._solver.stats()["success"]) and missed <= ACCEPTED
        return Answer(solved, np.asarray(found["x"]).reshape(self._guess.shape, order="F"), seconds)
