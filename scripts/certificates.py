"""Plans all of problems/, proves every plan with default settings, and prints a table of the certificates.

Usage: ``python scripts/certificates.py [NAME ...]``: with names, only the problems whose file is named so. After the
table come the times of the proofs that have a limit: examples A and B of the paper, a Go2, a chain of ten links with
torque limits. Exit 1 where a plan is not proved. Seconds are those of the processor, the best of three proofs.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import floatplan as fp
from floatplan.robot.urdf.tree import robots_folder

ROOT = Path(__file__).resolve().parents[1]
COLUMNS = ("problem", "verdict", "clearance, m", "torque / limit", "orientation ball, rad", "intervals", "proved in, s")
CIRCLE = fp.Circle(center=(1.485, 3.342), radius=0.2, margin=0.02)
REPEATS = 3


def main(names: list[str]) -> int:
    """Print the table, then the times."""
    rows, unproved = [list(COLUMNS), ["---", "---", *["---:"] * (len(COLUMNS) - 2)]], 0
    for path in paths(names):
        plan = fp.plan(fp.load_problem(path), prove=True)
        unproved += not (plan.ok and plan.certificate and plan.certificate.proved)
        rows.append(row(path.stem, plan))
    print("\n".join(f"| {' | '.join(cells)} |" for cells in rows))
    if not names:
        print()
        for name, plan, limit in timed():
            print(f"{name}: {fp.certify(plan).verdict} in {1e3 * seconds(plan):.0f} ms, limit {1e3 * limit:.0f} ms")
    return 1 if unproved else 0


def paths(names: list[str]) -> list[Path]:
    """The problem files, those of the gallery where its robots are installed."""
    folders = [ROOT / "problems", *([ROOT / "problems" / "gallery"] if robots_folder() else [])]
    found = [path for folder in folders for path in sorted(folder.glob("*.toml"))]
    return [path for path in found if not names or path.stem in names]


def row(name: str, plan: fp.Plan) -> list[str]:
    """Cells of the table, under ``COLUMNS``."""
    if plan.certificate is None:
        return [name, "no plan", *["-"] * (len(COLUMNS) - 2)]
    certificate = fp.certify(plan)
    limits, goal = plan.problem.motor_torque_limits, plan.problem.final.orientation
    limited = np.isfinite(limits)
    peaks = np.array(list(certificate.motor_torque_peak.values()))
    share = (peaks / limits)[limited].max() if limited.any() else None
    ball = max(abs(end - goal) for end in certificate.orientation_end)
    clearance = certificate.clearance_min
    return [
        name,
        certificate.verdict,
        "no obstacle" if clearance is None else f"{clearance:z.5f}",
        "no limit" if share is None else f"{share:.7f}",
        f"{ball:.0e}",
        f"{certificate.subintervals}",
        f"{seconds(plan):.3f}",
    ]


def seconds(plan: fp.Plan) -> float:
    """Processor seconds of a proof, the best of some."""
    taken = []
    for _ in range(REPEATS):
        began = time.process_time()
        fp.certify(plan)
        taken.append(time.process_time() - began)
    return min(taken)


def timed() -> Iterator[tuple[str, fp.Plan, float]]:
    """Plans whose proofs have a limit of time, s."""
    yield "example A", fp.plan(fp.load_problem(ROOT / "problems" / "new_configuration.toml")), 0.05
    handstand = fp.load_problem(ROOT / "problems" / "handstand.toml")
    yield "example B with an obstacle", fp.plan(replace(handstand, obstacles=(CIRCLE,))), 0.1
    if robots_folder():
        yield "Go2", fp.plan(fp.load_problem(ROOT / "problems" / "gallery" / "go2.toml")), 1.0
    yield "chain of ten links with torque limits", fp.plan(chain_problem()), 3.0


def chain_problem() -> fp.Problem:
    """A chain of ten joints unrolls."""
    robot = fp.Robot.from_urdf(ROOT / "urdf" / "chain10.urdf")
    n = len(robot.joints)
    return fp.Problem(
        robot,
        start=fp.Posture(orientation=0.3, positions=[0.25] * n),
        goal=fp.Posture(orientation=0.0, positions=[-0.1] * n),
        flight=fp.Flight(duration=1.0),
        limits=fp.Limits(position="full", torque=500.0),
        name="chain",
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
