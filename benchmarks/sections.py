"""Measures floatplan, and its peers beside it, in one run, and prints tables.

Usage: ``python scripts/benchmark.py [--quick] [SECTION ...]``; sections: speed quality starts free random forward
obstacle witness growth startup; all of them where none is named. Needs the extra ``bench``.

Times are medians of runs that take turns, each turn begun by another, so that what disturbs the machine disturbs all
alike; ratios are medians of the ratios within each turn.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from itertools import islice, pairwise
from pathlib import Path

import free_problems
import long_chains
import numpy as np
import pinocchio as pin
import witness_benchmark
from forward_problems import GRADES, forward_problems
from generated_problems import random_problem, random_problems
from independent import INSTANTS, Worst, violations, worst_violation
from peers import NODES, Answer, Ipopt, Slsqp
from starts_problems import starts_problems

import floatplan as fp
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import powers_map
from floatplan.optimization import quadratic_program
from floatplan.planning.transcription.exchange import QUADRATURE_ERROR

ROOT = Path(__file__).resolve().parents[1]
PROBLEMS = ROOT / "problems"
CHAINS = (5, 8, 12, 20)
CALLS = 5  # of a function in its turn
LONG = 0.1  # s, after which there are no more of them
SCAN_BUDGET = 2.0  # s for each given h, most of which have no plan
WITHIN = 1.001  # of the scan's best objective
HOLDS = 1e-6  # of the natural unit: a constraint violated by no more holds
PIN_CALLS = ("computeCentroidalMap", "computeCentroidalMapTimeVariation", "rnea", "crba", "buildModelFromXML")


@dataclass(frozen=True)
class Counts:
    """How much is measured."""

    turns: int = 31
    slow_turns: int = 5
    generated: int = 300
    compared: int = 50
    witnesses: int = 400
    starts: int = 12
    repeated: int = 100
    free: int = 50
    scanned: int = free_problems.SCANNED
    subprocesses: int = 5
    instants: int = INSTANTS
    chains: tuple[int, ...] = CHAINS
    long_chains: tuple[int, ...] = long_chains.JOINTS


FULL = Counts()
QUICK = Counts(
    turns=5,
    slow_turns=2,
    generated=30,
    compared=6,
    witnesses=30,
    repeated=12,
    free=6,
    scanned=7,
    subprocesses=2,
    instants=4000,
)


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print rows in columns; numbers to the right."""
    texts = [list(header), *([_text(cell) for cell in row] for row in rows)]
    widths = [max(len(row[column]) for row in texts) for column in range(len(header))]
    numeric = [all(_is_number(row[column]) for row in texts[1:]) for column in range(len(header))]
    for row in texts:
        cells = (
            text.rjust(width) if right else text.ljust(width)
            for text, width, right in zip(row, widths, numeric, strict=True)
        )
        print("  " + "  ".join(cells).rstrip())
    print()


def _text(cell: object) -> str:
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def _is_number(text: str) -> bool:
    return text in ("", "-") or text.lstrip("-")[:1].isdigit() or text in ("inf", "nan")


def heading(text: str) -> None:
    """Print a section's title."""
    print(f"{text}\n{'-' * len(text)}", flush=True)


@dataclass(frozen=True)
class Timed:
    """What runs that took turns gave: seconds per turn and the last result, by name."""

    seconds: dict[str, list[float]]
    results: dict[str, object]

    def median_ms(self, name: str) -> float:
        """Median, ms."""
        return 1e3 * statistics.median(self.seconds[name])

    def ratio(self, name: str, other: str) -> float:
        """Median of the ratios within each turn."""
        pairs = zip(self.seconds[name], self.seconds[other], strict=True)
        return statistics.median(one / another for one, another in pairs)


def in_turns(runs: dict[str, Callable[[], object]], turns: int) -> Timed:
    """Time functions by turns, each turn begun by another: what runs after a big one finds the caches full of that.

    In its turn a function runs once without counting, then up to ``CALLS`` times; their median counts.
    """
    results: dict[str, object] = {}
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    order = list(runs)
    for _ in range(turns):
        for name in order:
            runs[name]()
            calls = []
            for _ in range(CALLS):
                began = time.perf_counter()
                results[name] = runs[name]()
                calls.append(time.perf_counter() - began)
                if sum(calls) > LONG:
                    break
            seconds[name].append(statistics.median(calls))
        order.append(order.pop(0))
    return Timed(seconds, results)


FILES = {"A": "new_configuration", "B": "handstand", "B, obstacle": "obstacle", "B, hard": "obstacle_hard"}


@cache
def example(name: str) -> fp.Problem:
    """Return a problem of ``problems/``, or a chain drawn at random."""
    if name in FILES:
        return fp.load_problem(PROBLEMS / f"{FILES[name]}.toml")
    return random_problem(0, int(name.split()[-1]))


@contextmanager
def stopwatch(holder: object, names: Sequence[str]) -> Iterator[dict[str, float]]:
    """Add up the seconds spent within functions of a module while the context lasts."""
    total = {"seconds": 0.0}

    def timed(function: Callable[..., object]) -> Callable[..., object]:
        def run(*args: object, **kwargs: object) -> object:
            began = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                total["seconds"] += time.perf_counter() - began

        return run

    kept = {name: getattr(holder, name) for name in names}
    for name, function in kept.items():
        setattr(holder, name, timed(function))
    try:
        yield total
    finally:
        for name, function in kept.items():
            setattr(holder, name, function)


def planner(problem: fp.Problem, turns: int) -> Callable[[], fp.Plan]:
    """Return a function that plans a copy of the problem at each call, so that nothing is remembered of an earlier one.

    For so many turns of :func:`in_turns`.
    """
    copies = iter([replace(problem) for _ in range((CALLS + 1) * turns)])
    return lambda: fp.plan(next(copies))


def final_nodes(plan: fp.Plan) -> int:
    """Quadrature nodes that floatplan settles on for a motion."""
    program = Slsqp(plan.problem).program
    b = plan.coefficients
    polynomials = program.variables.polynomials
    powers = powers_map(polynomials.width, polynomials.duration)
    z = np.linalg.lstsq(powers, b.T, rcond=None)[0].T[:, -polynomials.width :]
    x = program.variables.variables(z, plan.angular_momentum)
    return NODE_COUNTS[program.trajectory(x).flown.level_needed(QUADRATURE_ERROR)]


def speed(counts: Counts) -> None:
    """Time per plan beside the peers."""
    heading("speed: time per plan, in process, after the first")
    names = ["A", "B", *(f"chain of {n}" for n in counts.chains)]
    rows, norms, shares = [], [], []
    for name in names:
        problem = example(name)
        plan = fp.plan(problem)
        nodes = final_nodes(plan)
        peers = {
            "SLSQP 64": lambda problem=problem: Slsqp(problem).solve(),
            "SLSQP own": lambda problem=problem, nodes=nodes: Slsqp(problem, nodes).solve(),
            "IPOPT": Ipopt(problem).solve,
        }
        slow = name.startswith("chain") and int(name.split()[-1]) > 8
        turns = counts.slow_turns if slow else counts.turns
        runs = {"floatplan": planner(problem, turns)} | peers
        timed = in_turns(runs, turns)
        ratios = [timed.ratio("floatplan", key) for key in peers]
        rows.append([name, len(problem.robot.joints), nodes, *(timed.median_ms(key) for key in runs), *ratios])
        norms.append([name, f"{plan.objective_value:.4f}", *(_norm(timed.results[key]) for key in peers)])
        shares.append([name, *_shares(problem, counts.turns)])
    times = ["floatplan ms", "SLSQP 64 ms", "SLSQP own ms", "IPOPT ms"]
    table(["problem", "n", "nodes", *times, "/SLSQP 64", "/SLSQP own", "/IPOPT"], rows)
    print("  SLSQP: the same reduced program and gradients at 64 nodes, and at the nodes that floatplan ends with.")
    print("  floatplan and SLSQP go from the problem to b; IPOPT's expressions are built beforehand.")
    print("  IPOPT: all b free, (13) and (14) as equations, 64 nodes. /X: floatplan's time over X's.")
    print("  Bar: A in at most 4 ms, goal 1 ms; every ratio below 1.\n")
    print("  |b| reached; in brackets where the peer does not call it solved")
    table(["problem", "floatplan", "SLSQP 64", "SLSQP own", "IPOPT"], norms)
    print("  share of floatplan's time")
    table(
        ["problem", "in ProxQP %", "in Pinocchio %", "of loading, in Pinocchio %", "of reporting, in Pinocchio %"],
        shares,
    )
    print(
        "  The search evaluates momentum in closed form; Pinocchio builds the robot and gives the reported numbers.\n"
    )


def _norm(answer: object) -> str:
    assert isinstance(answer, Answer)
    return f"{answer.norm:.4f}" if answer.solved else f"({answer.norm:.4f})"


def _shares(problem: fp.Problem, turns: int) -> list[str]:
    """ProxQP's and Pinocchio's shares of planning, and Pinocchio's of loading the robot and of the plan's numbers."""

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
            share(lambda: fp.plan(problem), quadratic_program, ["_proxqp"]),
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


NUMBERS_OF_STARTS = (1, 2, 4, 8)
SAME_NUMBER = 1e-9  # relative difference of objectives that are the same


def starts_section(counts: Counts) -> None:
    """More starts are never worse."""
    heading(f"starts: {counts.repeated} problems planned with {', '.join(map(str, NUMBERS_OF_STARTS))} starts")
    rows = []
    for problem in islice(starts_problems(), counts.repeated):
        plans = [fp.plan(problem, starts=starts) for starts in NUMBERS_OF_STARTS]
        values = [plan.objective_value if plan.ok else np.inf for plan in plans]
        worse = any(more > less * (1 + SAME_NUMBER) for less, more in pairwise(values))
        rows.append((problem.motion.objective, worse, plans[-1].ok and values[-1] < values[0] * (1 - 1e-6)))
    names = list(dict.fromkeys(name for name, _, _ in rows))
    table(
        ["objective", "problems", "worse with more starts", f"better with {NUMBERS_OF_STARTS[-1]} than with 1"],
        [[name, *(sum(column) for column in zip(*[(1, *row[1:]) for row in rows if row[0] == name], strict=True))]
         for name in names],
    )  # fmt: skip
    print("  Bar: none worse.\n")


def free_section(counts: Counts) -> None:
    """A free h beside a scan of given ones."""
    heading(f"free: {counts.free} problems that {counts.scanned} given h solve, planned with h free")
    compared: list[tuple[free_problems.Scan, free_problems.Timed]] = []
    unsolved = 0
    for problem in free_problems.free_problems():
        given = free_problems.scan(problem, counts.scanned, SCAN_BUDGET)
        unsolved += not given.solved
        if given.solved:
            compared.append((given, free_problems.timed(problem)))
        if len(compared) == counts.free:
            break
    lost = sum(not free.plan.ok for _, free in compared)
    as_good = sum(free.plan.ok and free.plan.objective_value <= WITHIN * given.best for given, free in compared)
    ratio = statistics.median(free.seconds / given.seconds for given, free in compared)
    print(f"  {unsolved} more problems have no solution that the scan finds")
    print(f"  not solved with h free: {lost} of {len(compared)}")
    print(f"  objective within 0.1 % of the scan's best, or better: {as_good} of {len(compared)}")
    print(f"  processor time over that of the median given-h plan: {ratio:.2f} (median)\n")
    print("  Bar: 0; 47 of 50; 3.\n")


def timed_plans(problems: Sequence[fp.Problem]) -> list[tuple[fp.Plan, float]]:
    """Plan each problem once by default settings: plans and seconds."""
    answers = []
    for problem in problems:
        began = time.perf_counter()
        plan = fp.plan(problem)
        answers.append((plan, time.perf_counter() - began))
    return answers


def random_section(counts: Counts) -> None:
    """Random flights without constraints, all of which should be solved."""
    heading(f"random: {counts.generated} random flights by default settings")
    answers = timed_plans(random_problems(counts.generated))
    checks = [violations(plan, 2) for plan, _ in answers if plan.ok]
    boundary = _worst_of(checks, "boundary")
    orientation = _worst_of(checks, "orientation")
    print(f"  solved {len(checks)} of {len(answers)}")
    print(f"  worst boundary error     {boundary.amount:.1e} {boundary.unit} ({boundary.label})")
    print(f"  worst orientation error  {orientation.amount:.1e} rad, by an independent integration\n")
    rows = []
    for n in sorted({len(plan.robot.joints) for plan, _ in answers}):
        seconds = [1e3 * spent for plan, spent in answers if len(plan.robot.joints) == n]
        solved = sum(plan.ok for plan, _ in answers if len(plan.robot.joints) == n)
        rows.append([n, f"{solved}/{len(seconds)}", statistics.median(seconds), max(seconds)])
    table(["n", "solved", "median ms", "worst ms"], rows)
    _list_unsolved(answers)


def _worst_of(checks: Sequence[Sequence[Worst]], label: str) -> Worst:
    chosen = (worst for check in checks for worst in check if worst.label.startswith(label))
    return max(chosen, key=lambda worst: worst.amount, default=Worst("none", 0.0, "", 0.0))


def _list_unsolved(answers: Sequence[tuple[fp.Plan, float]]) -> None:
    for plan, spent in answers:
        if not plan.ok:
            print(f"  not solved, after {spent:.1f} s: {plan.problem.name}: {plan.explanation}")
    print()


def forward(counts: Counts) -> None:
    """Problems that are known to be feasible."""
    heading(f"forward: {counts.generated} problems known to be feasible, by default settings")
    answers = timed_plans(forward_problems(counts.generated))
    worst = {plan.problem.name: worst_violation(plan, counts.instants) for plan, _ in answers if plan.ok}
    rows = []
    for grade in (*GRADES, ""):
        mine = [(plan, spent) for plan, spent in answers if f"_{grade}" in plan.problem.name]
        if not mine:
            continue
        seconds = [spent for _, spent in mine]
        here = [worst[plan.problem.name] for plan, _ in mine if plan.ok]
        least = max(here, key=lambda one: one.amount, default=None)
        solved = sum(plan.ok for plan, _ in mine)
        rows.append(
            [grade or "all", f"{solved}/{len(mine)}", 1e3 * statistics.median(seconds), max(seconds), least or "-"]
        )
    table(["grade", "solved", "median ms", "worst s", f"worst violation at {counts.instants} instants"], rows)
    for name, one in worst.items():
        if one.amount > HOLDS:
            print(f"  called solved, but violated: {name}: {one}")
    _list_unsolved(answers)


def obstacle(counts: Counts) -> None:
    """Example B with its obstacle, the hard one, and generated problems beside the peers."""
    heading("obstacle: example B with its obstacle, and the hard one")
    rows = []
    for name in ("B, obstacle", "B, hard"):
        problem = example(name)
        plan = fp.plan(problem)
        runs = {"floatplan": planner(problem, counts.slow_turns)}
        runs |= {"SLSQP": Slsqp(problem).solve, "IPOPT": Ipopt(problem).solve}
        timed = in_turns(runs, counts.slow_turns)
        for key in runs:
            motion = plan if key == "floatplan" else timed.results[key].as_plan(plan)
            solved = plan.ok if key == "floatplan" else timed.results[key].solved
            lost = _lost_clearance(motion, counts.instants)
            rows.append(
                [name, key, timed.median_ms(key), "yes" if solved else "no", motion.objective_value, 1e3 * lost]
            )
    table(["problem", "by", "ms", "solved", "|b|", "cut into the margin mm"], rows)
    print("  Bar: 50 ms and |b| at most 29.48 with the obstacle, goal 10 ms; 1 s for the hard one.\n")
    _compared(counts)


def witness(counts: Counts) -> None:
    """Problems over all features together."""
    heading(f"witness: {counts.witnesses} problems drawn around a motion that solves them")
    witness_benchmark.main(counts.witnesses, instants=min(counts.instants, witness_benchmark.INSTANTS))
    print("  Bar: 98 % within 5 s of processor time each.\n")


def _lost_clearance(plan: fp.Plan, instants: int) -> float:
    """By how much a motion comes nearer to an obstacle than it may, m."""
    checks = violations(plan, instants)
    return max(0.0, *(worst.amount for worst in checks if worst.label.startswith("clearance")))


def _compared(counts: Counts) -> None:
    """How many generated problems each solves, and what it loses between its nodes."""
    problems = forward_problems(counts.compared)
    lost: dict[str, list[Worst]] = {"floatplan": [], "SLSQP": [], "IPOPT": []}
    seconds: dict[str, list[float]] = {key: [] for key in lost}
    for problem in problems:
        ((plan, spent),) = timed_plans([problem])
        seconds["floatplan"].append(spent)
        if plan.ok:
            lost["floatplan"].append(worst_violation(plan, counts.instants))
        for key, make in (("SLSQP", Slsqp), ("IPOPT", Ipopt)):
            answer = make(problem).solve()
            seconds[key].append(answer.seconds)
            if answer.solved:
                lost[key].append(worst_violation(answer.as_plan(plan), counts.instants))
    rows = []
    for key, worst in lost.items():
        amounts = [max(0.0, one.amount) for one in worst]
        holding = sum(amount <= HOLDS for amount in amounts)
        rows.append(
            [key, len(worst), holding, 1e3 * statistics.median(seconds[key]), max(seconds[key]),
             statistics.median(amounts or [0.0]), max(amounts, default=0.0)]
        )  # fmt: skip
    print(f"  {len(problems)} generated problems, from the same guess; the peers keep the constraints at {NODES} nodes")
    header = ["by", "solved", "and holding between", "median ms", "worst s", "median violation", "worst violation"]
    table(header, rows)
    print("  Violations between the nodes in m, N m or rad/s, of what each calls solved.\n")


def startup(counts: Counts) -> None:
    """Processes from their beginning to their end, imports, and certificates."""
    heading("startup: whole processes")
    program = [sys.executable, "-m", "floatplan"]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        plan_it = ["plan", str(PROBLEMS / "new_configuration.toml"), "--json", "--no-figures", "-o", folder]
        for label, arguments in (("floatplan --help", ["--help"]), ("floatplan plan .. --json --no-figures", plan_it)):
            spent = [_run(program + arguments) for _ in range(counts.subprocesses)]
            rows.append([label, *(statistics.median(one[index] for one in spent) for index in (0, 1))])
    table(["command", "wall s", "processor s"], rows)
    print("  Bar: --help in 0.2 s, a plan in 1 s.\n")
    _imports()
    _certificates(counts)


def _run(command: Sequence[str]) -> tuple[float, float]:
    """Wall and processor seconds of a process."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=_environment())
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _environment() -> dict[str, str]:
    """Environment of this process, with the floatplan that is imported here in front."""
    home = str(Path(fp.__file__).resolve().parents[1])
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, (home, os.environ.get("PYTHONPATH"))))}


def _imports() -> None:
    """Seconds of the dearest packages that planning from a file imports, each with what only it brings."""
    code = "import floatplan.planning.planner, floatplan.problem.file, floatplan.cli.results"
    command = [sys.executable, "-X", "importtime", "-c", code]
    report = subprocess.run(command, check=True, capture_output=True, text=True, env=_environment()).stderr
    spent: dict[str, float] = {}
    for line in report.splitlines():
        own, _, name = (part.strip() for part in line.removeprefix("import time:").split("|"))
        if own.isdigit():
            package = name.split(".")[0]
            spent[package] = spent.get(package, 0.0) + int(own) / 1e3
    dearest = sorted(spent.items(), key=lambda pair: -pair[1])[:10]
    table(["imported package", "own ms"], [*dearest, ("all", sum(spent.values()))])


def _certificates(counts: Counts) -> None:
    from floatplan.certificate.certificate import certify

    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, bar in (("A", 50), ("B, obstacle", 100)):
            plan = fp.plan(example(name))
            record, urdf = plan.record, plan.robot.path or Path(folder)
            timed = in_turns({"certify": lambda record=record, urdf=urdf: certify(record, urdf)}, counts.slow_turns)
            rows.append([name, timed.results["certify"].verdict, timed.median_ms("certify"), bar])
    table(["certificate", "verdict", "ms", "bar ms"], rows)


SECTIONS: dict[str, Callable[[Counts], None]] = {
    "speed": speed,
    "quality": quality,
    "starts": starts_section,
    "free": free_section,
    "random": random_section,
    "forward": forward,
    "obstacle": obstacle,
    "witness": witness,
    "growth": growth,
    "startup": startup,
}


def machine() -> str:
    """Return one line on the machine and the versions."""
    packages = ("numpy", "scipy", "pin", "proxsuite", "casadi")
    versions = ", ".join(f"{package} {version(package)}" for package in packages)
    load = os.getloadavg()[0]
    processor = _processor() or platform.machine()
    return f"{processor}, {os.cpu_count()} cores, load {load:.1f}; Python {platform.python_version()}, {versions}"


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if not information.exists():
        return platform.processor()
    lines = information.read_text(encoding="utf-8").splitlines()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the sections asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"of: {' '.join(SECTIONS)}")
    parser.add_argument("--quick", action="store_true", help="fewer turns and problems")
    asked = parser.parse_args(arguments)
    unknown = [name for name in asked.sections if name not in SECTIONS]
    if unknown:
        parser.error(f"unknown section: {' '.join(unknown)}; there are: {' '.join(SECTIONS)}")
    print(f"{machine()}\n")
    for name in asked.sections or SECTIONS:
        SECTIONS[name](QUICK if asked.quick else FULL)


if __name__ == "__main__":
    main()
