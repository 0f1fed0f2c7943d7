"""Every problem file is answered as it was: ``scripts/references.py`` says how to change that on purpose."""

from __future__ import annotations

import json

import pytest
from references import REFERENCES, answer, problem_names

from floatplan.robot.example_robots import robots_folder

SAME = 1e-6  # relative; where the search ended at an optimum
ALIKE = 1e-2  # relative; where it ended at some feasible motion, which rounding decides

expected = json.loads(REFERENCES.read_text(encoding="utf-8"))


def test_every_problem_file_has_a_reference():
    assert sorted(expected) == problem_names()


@pytest.mark.parametrize("name", problem_names())
def test_answer_is_the_reference(name):
    if name.startswith("gallery/") and robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    found, wanted = answer(name), expected[name]
    words = ("status", "verdict")
    assert {key: found[key] for key in words} == {key: wanted[key] for key in words}
    tolerance = SAME if wanted["status"] == "optimal" else ALIKE
    for key in ("angular_momentum", "objective", "torque_peak", "velocity_peak"):
        assert found[key] == pytest.approx(wanted[key], rel=tolerance), key
    assert found["clearance_min"] == pytest.approx(wanted["clearance_min"], abs=1e-6)
