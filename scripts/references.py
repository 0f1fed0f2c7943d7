"""Writes tests/references.json: what every problem file is answered with. Usage: ``python scripts/references.py``.

``tests/test_references.py`` compares: run this where an answer is meant to change, and say why in the commit.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import floatplan as fp
from floatplan.files import json_value

ROOT = Path(__file__).resolve().parents[1]
REFERENCES = ROOT / "tests" / "references.json"


def problem_names() -> list[str]:
    """Paths of all problem files below ``problems/``, without their ending."""
    folder = ROOT / "problems"
    return sorted(
        path.relative_to(folder).with_suffix("").as_posix()
        for path in folder.rglob("*.toml")
        if path.parent.name != "studies"
    )


def answer(plan: fp.Plan) -> dict[str, Any]:
    """What is compared of a plan."""
    record = plan.record
    return {
        "status": record.status,
        "verdict": None if plan.certificate is None else plan.certificate.verdict,
        "angular_momentum": record.angular_momentum,
        "objective": record.objective["value"],
        "torque_peak": record.torque_peak.tolist(),
        "velocity_peak": record.velocity_peak.tolist(),
        "clearance_min": record.clearance_min,
    }


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()  # it takes no arguments, and refuses any
    problems = {name: fp.load_problem(ROOT / "problems" / f"{name}.toml") for name in problem_names()}
    answers = json_value({name: answer(fp.plan(problem, prove=True)) for name, problem in problems.items()})
    REFERENCES.write_text(json.dumps(answers, indent=1) + "\n", encoding="utf-8")
