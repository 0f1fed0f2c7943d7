"""Every problem file is answered as it was: ``scripts/references.py`` says how to change that on purpose."""

import json

import pytest
from long_cases import cases
from references import REFERENCES, answer, problem_names

SAME = 1e-6  # relative, of objectives, and of h where it is given; where the search ended at an optimum
FREE = 1e-4  # relative, of h where it is free: it moves as the square root of what it changes of the objective
ALIKE = 1e-2  # relative, of all; where it ended at some feasible motion, which rounding decides
FLAT = 2e-3  # relative, of peaks: they move as the square root of SAME, and with the set of instructions (A1: 1e-3)
STILL = 1e-6  # [N m; rad/s] peaks of joints that do not move are rounding

TINY = 1e-3  # [kg m^2/s; rad] in space, of components of h, and of what next to no motion of the joints is
expected = json.loads(REFERENCES.read_text(encoding="utf-8"))


def test_every_problem_file_has_a_reference():
    assert sorted(expected) == problem_names()


NAMES = problem_names()
OF_OTHERS = {  # flights of jumps in space that are as those of the Go2
    name for name in NAMES if name.startswith("jumps/space/") and not name.startswith("jumps/space/go2")
}
OF_OTHERS |= {f"jumps/{name}" for name in ("a1", "anymal", "b1", "boxes/a1_box", "go1", "hyq", "solo12")}
OF_OTHERS |= {"jumps/talos_hop"}  # as that of the G1
TWISTS = {"jumps/space/go2_half_flip_half_twist", "jumps/space/go2_backflip_half_twist"}  # as that of problems/space
TWISTS |= {"space/go2_half_twist_clear"}  # as the same without links that keep apart
TURNS = {"jumps/space/go2_half_turn", "jumps/space/go2_diagonal"}  # as the quarter turn, and the jump to a side
GROUNDS = {name for name in NAMES if name.startswith("jumps/space/go2_down")}  # flights that know no ground
GROUNDS |= {"jumps/space/go2_up", "jumps/boxes/go2_box", "jumps/sequences/go2_flips_periodic"}
LARGE = {"jumps/g1", "space/diver_full_twist", "space/free_panda", "jumps/space/go2_side", *TURNS}  # of many joints
LARGE |= {"jumps/space/go2_quarter_turn", *(f"gallery/{name}" for name in ("g1", "human", "solo12", "talos"))}


@pytest.mark.parametrize("name", cases(NAMES, {*OF_OTHERS, *TWISTS, *LARGE, *GROUNDS}))
def test_answer_is_the_reference(planned, name):
    plan, wanted = planned(name), expected[name]
    found = answer(plan)
    words = ("status", "verdict")
    assert {key: found[key] for key in words} == {key: wanted[key] for key in words}
    optimal = wanted["status"] == "optimal"
    falls = name.startswith("jumps/boxes/")  # flights that take no torque
    tiny = TINY if falls or name.startswith("space/") else None
    is_free = plan.problem.flight.angular_momentum == "free"
    for key, same in (("angular_momentum", FREE if is_free else SAME), ("objective", SAME)):
        assert found[key] == pytest.approx(wanted[key], rel=same if optimal else ALIKE, abs=tiny), key
    for key in ("torque_peak", "velocity_peak"):
        tolerance = FLAT if optimal else ALIKE
        assert sorted(found[key]) == pytest.approx(sorted(wanted[key]), rel=tolerance, abs=STILL), key  # mirrored
    assert found["clearance_min"] == pytest.approx(wanted["clearance_min"], abs=1e-6)
