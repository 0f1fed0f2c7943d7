"""Time per plan beside the peers, its growth with the number of joints, and the optimum that each reaches."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import long_chains
import numpy as np
import pinocchio as pin
from generated_problems import random_problem
from measuring import Counts, example, heading, in_turns, planner, stopwatch, table
from peers import NODES, Answer, Ipopt, Slsqp, reduced_program
from peers_compiled import CompiledSqp, can_compile
from peers_pinocchio import PinocchioSlsqp

import floatplan as fp
from floatplan.kernel.tolerances import FINE
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import powers_map

PIN_CALLS = ("computeCentroidalMap", "computeCentroidalMapTimeVariation", "rnea", "crba", "buildModelFromXML")


def final_nodes(plan: fp.Plan) -> int:
    """Quadrature nodes that floatplan settles on for a motion."""
    program = reduced_program(plan.problem, NODES)
    b = plan.coefficients
    polynomials = program.variables.polynomials
    powers = powers_map(polynomials.form, polynomials.duration)
    z: Any = np.linalg.lstsq(powers, b.T, rcond=None)[0].T[:, -polynomials.width :]
    x = program.variables.variables(z, plan.angular_momentum)
    return NODE_COUNTS[program.trajectory(x).flown.level_needed(FINE.quadrature_error)]


def slsqp(problem: fp.Problem, nodes: int = NODES, how: type[Slsqp] = Slsqp) -> Answer:
    """Build SLSQP's program for a problem, and solve it."""
    return how(problem, nodes).solve()


def speed(counts: Counts) -> None:
    """Time per plan beside the peers."""
    heading("speed: time per plan, in process, after the first")
    names = ["A", "B", *(f"chain of {n}" for n in counts.chains)]
    labels = ["SLSQP 64", "SLSQP own", "SLSQP Pinocchio", "IPOPT", *(["CasADi C"] if can_compile() else [])]
    times, ratios, norms, shares, compiling = [], [], [], [], []
    for name in names:
        problem = example(name)
        plan = fp.plan(problem)
        nodes = final_nodes(plan)
        peers: dict[str, Callable[[], object]] = {
            "SLSQP 64": partial(slsqp, problem),
            "SLSQP own": partial(slsqp, problem, nodes),
            "SLSQP Pinocchio": partial(slsqp, problem, nodes, PinocchioSlsqp),
            "IPOPT": Ipopt(problem).solve,
        }
        if can_compile():
            compiled = CompiledSqp(problem, nodes)
            compiling.append(compiled.compiling_seconds)
            peers["CasADi C"] = compiled.solve
        slow = name.startswith("chain") and int(name.split()[-1]) > 8
        turns = counts.slow_turns if slow else counts.turns
        runs = {"floatplan": planner(problem, turns)} | peers
        timed = in_turns(runs, turns)
        size = [name, len(problem.robot.joints), nodes]
        times.append([*size, *(timed.median_ms(key) for key in runs)])
        ratios.append([name, *(timed.ratio("floatplan", key) for key in labels)])
        norms.append([name, f"{plan.objective_value:.4f}", *(_norm(timed.results[key]) for key in labels)])
        shares.append([name, *_shares(problem, counts.turns)])
    table(["problem", "n", "nodes", "floatplan ms", *(f"{label} ms" for label in labels)], times)
    print("  floatplan's time over the peer's")
    table(["problem", *(f"/{label}" for label in labels)], ratios)
    print("  SLSQP: the same reduced program and gradients at 64 nodes, and at the nodes that floatplan ends with;")
    print("  the latter also with D and its derivatives by Pinocchio, called from Python at each node.")
    print("  floatplan and SLSQP go from the problem to b; IPOPT's expressions are built beforehand.")
    print("  IPOPT: all b free, (13) and (14) as equations, 64 nodes.")
    if compiling:
        print("  CasADi C: the reduced program at floatplan's nodes, its SQP solver and all as C with the problem's")
        print(f"  numbers in it; gcc took {min(compiling):.1f} to {max(compiling):.1f} s for each beforehand.")
    else:
        print("  CasADi C: left out, there is no gcc on the path.")
    print("  Bar: A in at most 4 ms, goal 1 ms; every ratio to SLSQP and IPOPT below 1.\n")
    print("  |b| reached; in brackets where the peer does not call it solved")
    table(["problem", "floatplan", *labels], norms)
    print("  share of floatplan's time")
    table(
        ["problem", "in Pinocchio %", "of loading, in Pinocchio %", "of reporting, in Pinocchio %"],
        shares,
    )
    print(
        "  The search evaluates momentum in closed form; Pinocchio builds the robot and gives the reported numbers.\n"
    )


def _norm(answer: object) -> str:
    assert isinstance(answer, Answer)
    return f"{answer.norm:.4f}" if answer.solved else f"({answer.norm:.4f})"


def _shares(problem: fp.Problem, turns: int) -> list[str]:
    """Pinocchio's shares of planning, of loading the robot and of the plan's numbers."""

    def share(run: Callable[[], object], holder: object, names: Sequence[str]) -> str:
        began = time.perf_counter()
        with stopwatch(holder, names) as inside:
            for _ in range(turns):
                run()
        return f"{100 * inside['seconds'] / (time.perf_counter() - began):.1f}"

    plans = [fp.plan(problem) for _ in range(turns)]
    with tempfile.TemporaryDirectory() as folder:
        urdf = Path(folder) / "robot.urdf"
        urdf.write_text(problem.robot.xml, encoding="utf-8")
        return [
            share(lambda: fp.plan(problem), pin, PIN_CALLS),
            share(lambda: fp.Robot.from_urdf(urdf), pin, PIN_CALLS),
            share(lambda: plans.pop().record, pin, PIN_CALLS),
        ]


def growth(counts: Counts) -> None:
    """How time grows with the number of joints."""
    heading("growth: time per plan over the number of joints n, three problems of each")
    sizes = [2, *counts.chains]
    rows = []
    for n in sizes:
        problems = [random_problem(seed, n) for seed in range(3)]
        runs = {problem.name: planner(problem, counts.slow_turns) for problem in problems}
        timed = in_turns(runs, counts.slow_turns)
        milliseconds = [timed.median_ms(name) for name in runs]
        evaluations = [plan.solver["evaluations"] for plan in timed.results.values()]
        each = [one / count for one, count in zip(milliseconds, evaluations, strict=True)]
        rows.append([n, statistics.median(milliseconds), statistics.median(evaluations), statistics.median(each)])
    table(["n", "ms", "evaluations", "ms per evaluation"], rows)
    for label, column in (("time", 1), ("time per evaluation", 3)):
        exponent = np.polyfit(np.log(sizes), np.log([row[column] for row in rows]), 1)[0]
        print(f"  {label} grows as n^{exponent:.2f}")
    print("\n  chains that uncurl, without limits")
    long_chains.main(counts.long_chains)
    print()


def quality(counts: Counts) -> None:
    """The optimum of (17) that each reaches."""
    heading("quality: |b| of (17)")
    rows = []
    for name, known in (("A", 25.0411), ("B", 27.5311)):
        problem = example(name)
        slsqp, ipopt = Slsqp(problem).solve(), Ipopt(problem).solve()
        quick, careful = fp.plan(problem), fp.plan(problem, starts=counts.starts)
        norms = (f"{plan.objective_value:.4f}" for plan in (quick, careful))
        rows.append([name, f"{known:.4f}", *norms, _norm(slsqp), _norm(ipopt)])
    table(["problem", "best known", "floatplan", f"--starts {counts.starts}", "SLSQP", "IPOPT"], rows)
