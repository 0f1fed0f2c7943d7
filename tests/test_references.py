"""Every problem file is answered as it was: ``scripts/references.py`` says how to change that on purpose."""

from __future__ import annotations

import json

import pytest
from references import REFERENCES, answer, problem_names

from floatplan.robot.urdf.example_robots import robots_folder

SAME = 1e-6  # relative, of objectives and h; where the search ended at an optimum
ALIKE = 1e-2  # relative, of all; where it ended at some feasible motion, which rounding decides
FLAT = 1e-3  # relative, of peaks: near an optimum they change far more than the objective does

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
    optimal = wanted["status"] == "optimal"
    for key in ("angular_momentum", "objective"):
        assert found[key] == pytest.approx(wanted[key], rel=SAME if optimal else ALIKE), key
    for key in ("torque_peak", "velocity_peak"):
        tolerance = FLAT if optimal else ALIKE
        assert sorted(found[key]) == pytest.approx(sorted(wanted[key]), rel=tolerance), key  # mirrored is as good
    assert found["clearance_min"] == pytest.approx(wanted["clearance_min"], abs=1e-6)
