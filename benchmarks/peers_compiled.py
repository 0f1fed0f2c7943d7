"""The strongest peer: the whole solver as compiled C that CasADi writes.

The reduced program without constraints (free coefficients after elimination of (13), whitened, |x|^2 / 2 subject to
(14) at fixed nodes) is stated in CasADi and solved by its SQP method: ``sqpmethod`` with damped BFGS, QPs by ``qrqp``.
All of it, iterations and QPs included, is written as C and compiled by ``gcc -O3 -march=native``, with the problem's
numbers as constants: another problem is compiled anew. theta0' takes one pass over the tree, its gradient is CasADi's
reverse mode in the same loop over the nodes, and Python only hands over pointers.

CasADi's other ways, measured on the problems of the section ``speed`` at the same nodes, are left out: ``sqpmethod``
with exact Hessians takes 1.4 to 10 times as long and fails on the chains of 8 and 20; IPOPT with compiled functions
takes 2 to 16 times as long; the same program unrolled in SX gains a fifth in A, for 2.5 times the time of compilation.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from general_flight import GeneralFlight
from peers import ACCEPTED, MOST_ITERATIONS, NODES, Answer, reduced_program
from reduced_program import CoefficientNorm

import floatplan as fp
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.robot.planar.tree import PlanarTree

COMPILE = ("gcc", "-O3", "-march=native", "-fPIC", "-shared")
PRIMAL = 1e-9  # rad, of (14)
DUAL = 1e-6  # CasADi's own
STATIONARY = 1e-5  # largest derivative of the Lagrangian by x of what counts as solved
SILENT = {"print_time": False, "print_header": False, "print_iteration": False, "print_status": False}
SILENT_QP = {"print_iter": False, "print_header": False, "print_info": False}


def can_compile() -> bool:
    """Whether there is a gcc."""
    return shutil.which(COMPILE[0]) is not None


def orientation_rate(tree: PlanarTree, momentum: float) -> ca.Function:
    """theta0' of (4) from q and q', at orientation 0, in one pass from the base to the tips."""
    joints = tree.turns.shape[1]
    q, qd = ca.SX.sym("q", joints), ca.SX.sym("qd", joints)
    turns = tree.turn * ca.sparsify(ca.DM(tree.turns))
    angle, rate = turns @ q + tree.turn * tree.offsets, turns @ qd
    cosine, sine = ca.cos(angle), ca.sin(angle)

    def rotated(body: int, point: complex) -> ca.SX:
        c, s = cosine[body], sine[body]
        return ca.vertcat(point.real * c - point.imag * s, point.real * s + point.imag * c)

    def across(arm: ca.SX) -> ca.SX:
        return ca.vertcat(-arm[1], arm[0])

    origins, speeds = [ca.SX(2, 1)], [ca.SX(2, 1)]
    static, linear, angular, inertia = ca.SX(2, 1), ca.SX(2, 1), ca.SX(0), ca.SX(0)
    for body in range(len(tree.mass)):
        if body:
            parent = int(tree.parent[body])
            arm = rotated(parent, complex(tree.anchor[body]))
            origins.append(origins[parent] + arm)
            speeds.append(speeds[parent] + rate[parent] * across(arm))
        arm = rotated(body, complex(tree.center[body]))
        place, speed = origins[body] + arm, speeds[body] + rate[body] * across(arm)
        mass, own = float(tree.mass[body]), float(tree.inertia[body])
        static, linear = static + mass * place, linear + mass * speed
        angular += mass * ca.dot(across(place), speed) + own * rate[body]
        inertia += mass * ca.dot(place, place) + own
    total = float(tree.mass.sum())
    angular -= ca.dot(across(static), linear) / total
    inertia -= ca.dot(static, static) / total
    return ca.Function("rate", [q, qd], [(momentum - tree.turn * angular) / inertia])


class CompiledSqp:
    """CasADi's SQP method on the reduced program without constraints, all of it compiled.

    ``compiling_seconds`` is the time that gcc took, ``converged`` whether the first answer fulfils the conditions of
    first order; the same code from the same start finds the same again.
    """

    def __init__(self, problem: fp.Problem, nodes: int = NODES) -> None:
        self._program = program = reduced_program(problem, nodes)
        variables = program.variables
        if variables.momentum.axes.size or program.constraints or not isinstance(program.objective, CoefficientNorm):
            raise TypeError("only (17) with a given h and without constraints is written out for compilation")
        polynomials = variables.polynomials

        def written(x: np.ndarray) -> np.ndarray:
            return polynomials.powers_of_seconds(variables.free_coefficients(x))

        self._b_at_origin = written(np.zeros(variables.size))
        self._b_by_x = np.stack([written(x) - self._b_at_origin for x in np.eye(variables.size)], axis=-1)
        self._bind(self._compiled())
        self._run()
        self.converged = self._fulfils_first_order_conditions()

    def _statement(self) -> tuple[ca.MX, ca.MX, ca.MX, ca.Function]:
        """Return x, objective, (14), and a function of x that gives both with their derivatives in one pass."""
        program = self._program
        flight, variables, sampling = program.flight, program.variables, program.sampling
        assert isinstance(flight, GeneralFlight), "only flight in the plane is written out"
        polynomials = variables.polynomials
        n, width, duration = len(polynomials.free), polynomials.width, polynomials.duration
        spread = np.zeros((n * width, variables.size))
        spread[polynomials.free_indices] = variables.scaling
        scaling = ca.sparsify(ca.DM(spread))
        offset = variables.free_coefficients(np.zeros(variables.size))
        value, derivative = (part[:, CONDITIONS:] for part in sampling.values[:2])
        plain = [
            part[:, :CONDITIONS] @ polynomials.boundary.T + part[:, CONDITIONS:] @ offset.T
            for part in sampling.values[:2]
        ]

        p, p_rate = ca.SX.sym("p", n), ca.SX.sym("p_rate", n)
        positions = polynomials.centre + polynomials.amplitude * ca.sin(p)
        velocities = polynomials.amplitude * ca.cos(p) * p_rate / duration
        rate = orientation_rate(flight.tree, variables.momentum.centre.item())(positions, velocities)
        gradient: list[Any] = [ca.gradient(rate, p), ca.gradient(rate, p_rate)]
        at_node = ca.Function("at_node", [p, p_rate], [rate], {"cse": True})
        with_gradient = ca.Function("with_gradient", [p, p_rate], [rate, *gradient], {"cse": True})

        x = ca.MX.sym("x", variables.size)
        z = ca.reshape(scaling @ x, width, n).T
        states = z @ value.T + plain[0].T, z @ derivative.T + plain[1].T
        weights = ca.DM(duration * sampling.grid.weights)
        turned = at_node.map(sampling.grid.nodes)(*states) @ weights
        rates, by_p, by_rate = with_gradient.map(sampling.grid.nodes)(*states)
        of_nodes = duration * sampling.grid.weights[:, None]
        weighted_value, weighted_derivative = (
            of_nodes * part[: sampling.grid.nodes, CONDITIONS:] for part in sampling.values[:2]
        )
        by_z = by_p @ weighted_value + by_rate @ weighted_derivative
        jacobian = ca.vec(by_z.T).T @ scaling
        aim = ca.dot(x, x) / 2
        derivatives = ca.Function(
            "nlp_jac_fg",
            [x, ca.MX.sym("p", 0)],
            [aim, x, rates @ weights - flight.change, jacobian],
            ["x", "p"],
            ["f", "grad_f_x", "g", "jac_g_x"],
        )
        return x, aim, turned - flight.change, derivatives

    def _compiled(self) -> ca.Function:
        x, aim, turned, derivatives = self._statement()
        options: dict[str, Any] = {
            "hessian_approximation": "limited-memory",
            "jac_fg": derivatives,
            "max_iter": MOST_ITERATIONS,
            "tol_pr": PRIMAL,
            "tol_du": DUAL,
            "qpsol": "qrqp",
            "qpsol_options": SILENT_QP,
            **SILENT,
        }
        program: dict[str, Any] = {"x": x, "f": aim, "g": turned}
        solver = ca.nlpsol("solver", "sqpmethod", program, options)
        with tempfile.TemporaryDirectory() as folder:
            generator = ca.CodeGenerator("solver.c")
            generator.add(solver)
            generator.generate(f"{folder}/")
            library = Path(folder) / "solver.so"
            began = time.perf_counter()
            subprocess.run([*COMPILE, str(library.with_suffix(".c")), "-o", str(library), "-lm"], check=True)
            self.compiling_seconds = time.perf_counter() - began
            return ca.external("solver", str(library))

    def _bind(self, solver: ca.Function) -> None:
        """Hand the solver pointers to its inputs and outputs, once: what CasADi's own call costs is not C's."""
        size, start = self._program.variables.size, self._program.variables.plain_motion
        inputs = {
            "x0": start,
            "lbx": np.full(size, -np.inf),
            "ubx": np.full(size, np.inf),
            "lbg": np.zeros(1),
            "ubg": np.zeros(1),
            "lam_x0": np.zeros(size),
            "lam_g0": np.zeros(1),
        }
        self._outputs = {"x": np.zeros(size), "g": np.zeros(1), "lam_g": np.zeros(1)}
        buffer: Any
        buffer, self._run = solver.buffer()
        for name, numbers in inputs.items():
            buffer.set_arg(solver.index_in(name), numbers.data)
        for name, numbers in self._outputs.items():
            buffer.set_res(solver.index_out(name), numbers.data)
        self._pointed_to = solver, buffer, inputs

    def _fulfils_first_order_conditions(self) -> bool:
        """By floatplan's own derivatives: compiled code does not say how it ended."""
        at = self._program.evaluate(self._outputs["x"].copy())
        lagrangian = at.gradient + at.equality_jacobian.T @ self._outputs["lam_g"]
        return bool(np.abs(lagrangian).max() <= STATIONARY) and at.worst_violation <= ACCEPTED

    def solve(self) -> Answer:
        """Solve from the plain motion."""
        began = time.perf_counter()
        self._run()
        b = self._b_at_origin + self._b_by_x @ self._outputs["x"]
        seconds = time.perf_counter() - began
        return Answer(self.converged and abs(float(self._outputs["g"][0])) <= ACCEPTED, b, seconds)
