"""One record of the keys of problem files: checks, tables, options and plan files follow it."""

import floatplan as fp
from floatplan.cli.common import OPTIONS
from floatplan.plans.record import SHARED, problem_table
from floatplan.problem import parts
from floatplan.problem.file import TABLES


def test_options_stand_for_keys():
    for option in OPTIONS.values():
        place, _, name = (key := option.key).rpartition(".")
        assert key in TABLES if not place else name in TABLES[place][0].keys


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
