"""Problems with obstacles and limits: how many are solved, and whether the constraints hold between the nodes."""

from __future__ import annotations

import statistics
from collections.abc import Callable

import witness_benchmark
from forward_problems import GRADES, forward_problems
from independent import Worst, violations, worst_violation
from measuring import HOLDS, Counts, example, heading, in_turns, list_unsolved, planner, table, timed_plans
from peers import NODES, Ipopt, Slsqp

import floatplan as fp


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
    list_unsolved(answers)


def obstacle(counts: Counts) -> None:
    """Example B with its obstacle, the hard one, and generated problems beside the peers."""
    heading("obstacle: example B with its obstacle, and the hard one")
    rows = []
    for name in ("B, obstacle", "B, hard"):
        problem = example(name)
        plan = fp.plan(problem)
        runs: dict[str, Callable[[], object]] = {"floatplan": planner(problem, counts.slow_turns)}
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
