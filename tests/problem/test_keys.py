"""One record of the keys of problem files, which plan files follow."""

import floatplan as fp
from floatplan.plans.record import SHARED, problem_table
from floatplan.problem import parts


def test_plan_files_hold_the_keys_of_problem_files():
    """They are written a second time there: what proves a plan does not know what asked for it."""
    tables = problem_table(("q1",), ("q1",)).keys
    assert {"velocities_asked", "accelerations_asked"} == tables["start"].optional.keys()
    for name, part in (("start", fp.Posture), ("goal", fp.Posture), ("flight", fp.Flight), ("motion", fp.Motion)):
        optional = tables[name].optional.keys() - {"velocities_asked", "accelerations_asked"}
        assert tables[name].keys.keys() | optional == part.keys.keys()
    for name, part in (("takeoff", fp.Takeoff), ("landing", fp.Landing)):
        assert tables["flight"].keys[name].keys.keys() == part.keys.keys()
    limits = tables["limits"]
    assert {*limits.keys, *limits.optional} == {*fp.Limits.keys, "motor_torque"}
    assert limits.optional["motor"].optional["q1"].keys.keys() == fp.Motor.keys.keys()
    assert SHARED.keys() == parts.Obstacle.keys.keys()
