"""Studies whose rows are whole jumps."""

import math

import numpy as np
import pytest
from jumps import backflip, roll

import floatplan as fp
from floatplan.errors import InputError
from floatplan.jumps.jump import Jump
from floatplan.studies import motions, rows
from floatplan.studies.file import load_study_file

JUMPS = """
[vary]
"jump.margin.torque" = [0.9, 0.8]
"jump.friction" = { from = 0.4, to = 0.6, count = 2 }

[plan]
jump = true
prove = true

[result]
map = ["jump.margin.torque", "jump.friction", "height"]
"""


def test_rows_are_jumps(study_file, tmp_path, monkeypatch):
    asked = []

    def slips_below_half(problem, **options):
        asked.append((problem, options))
        if problem.jump.friction > 0.5:
            return backflip()
        return Jump(problem, problem.jump, explanation="No jump was found.")

    for room in (rows, motions):
        monkeypatch.setattr(room, "jump", slips_below_half)
    path = study_file(JUMPS, "jumps/go2")
    done = fp.study(path, folder=tmp_path / "study", jobs=1)
    requests = [problem.jump for problem, _ in asked]
    assert [(each.margin["torque"], each.friction) for each in requests if each] == [
        *((0.9, 0.4), (0.9, 0.6), (0.8, 0.4), (0.8, 0.6))
    ]
    assert [each.margin["velocity"] for each in requests if each] == [0.88] * 4
    assert done.statuses == {"not_found": 2, "feasible": 2}
    row = done.table.slice(1, 1).to_pylist()[0]
    jump, figures = backflip(), backflip().check.figures
    assert jump.flight is not None
    times = np.linspace(0.0, jump.duration, 2001)
    joints = [*jump.problem.robot.model.names][4:]
    torques = jump.tau(times)[:, [6 + joints.index(name) for name in jump.problem.robot.motors]]
    assert row["torque_peak"] == pytest.approx(np.abs(torques).max(), rel=1e-3)
    assert row["objective"] == pytest.approx(np.trapezoid((torques**2).sum(axis=1), times), rel=1e-3)
    assert row["utilisation"] == max(figures[name] for name in ("torque", "torque_speed", "velocity"))
    assert (row["friction_used"], row["jump_duration"]) == (figures["friction"], jump.duration)
    assert row["height"] == jump.height
    assert row["verdict"] == "proved"
    again = done.jump(1)
    assert again is jump
    assert asked[-1][1] == asked[1][1]
    with pytest.raises(InputError, match="call jump"):
        done.plan(1)
    assert {path.name for path in done.files} == {"results.parquet", "map.png", "map.svg", "map.html"}
    count = len(asked)
    assert fp.study(path, folder=tmp_path / "study", jobs=1).table.equals(done.table)
    assert len(asked) == count


def test_keys_of_a_jump_vary(study_file):
    numbers = ('clearance" = [0.01, 0.02]', 'margin.velocity" = [0.5]', 'takeoff.from.RL_calf_joint" = [-60, -80]')
    varied = "\n".join(f'"jump.{each}' for each in numbers)
    asked = load_study_file(study_file(f"[vary]\n{varied}", "jumps/go2"))
    request = asked.family(3, 4)[0].jump
    assert (request.clearance, request.margin) == (0.02, {"torque": 0.85, "velocity": 0.5})
    assert request.takeoff.from_ == {"RL_calf_joint": math.radians(-80)}


IN_SPACE = """
[vary]
"goal.orientation.angles.2" = [0, 5]
"jump.landing.displacement.1" = [0.2]

[plan]
jump = true
prove = true

[result]
map = ["goal.orientation.angles.2", "jump.landing.displacement.1", "friction_used"]
"""


def test_rows_are_jumps_in_space(study_file, tmp_path, monkeypatch):
    """Those that are not found say what binds; the page has no motion to play."""
    asked = []

    def turns_straight(problem, **options):
        asked.append((problem, options))
        if problem.goal.orientation.angles[2]:
            return Jump(problem, problem.jump, explanation="No jump was found. In the way: friction of FL_foot.")
        return roll()

    for room in (rows, motions):
        monkeypatch.setattr(room, "jump", turns_straight)
    monkeypatch.setattr("floatplan.studies.maps.write_maps", lambda *_: [])  # which the study above draws
    path = study_file(IN_SPACE, "jumps/space/go2_diagonal")
    done = fp.study(path, folder=tmp_path / "study", jobs=1)
    problems = [problem for problem, _ in asked]
    assert [problem.goal.orientation.angles[2] for problem in problems] == [0.0, math.radians(5)]
    assert {problem.jump.landing.displacement[1] for problem in problems} == {0.2}
    assert all(options["helps"] for _, options in asked)
    found, missing = done.table.to_pylist()
    assert (found["status"], missing["status"]) == ("feasible", "not_found")
    assert "In the way: friction of FL_foot." in missing["explanation"]
    jump = roll()
    times = np.linspace(0.0, jump.duration, 2001)
    torques = jump.state(times).motor_torques
    assert found["torque_peak"] == pytest.approx(np.abs(torques).max(), rel=1e-3)
    assert found["objective"] == pytest.approx(np.trapezoid((torques**2).sum(axis=1), times), rel=1e-3)
    assert found["angular_momentum"] == pytest.approx(math.hypot(*jump.flight.angular_momentum))
    assert found["friction_used"] == jump.check.figures["friction"]
    assert found["verdict"] == "proved"
    assert done.jump(0) is jump


def test_a_study_of_flights_in_space_is_refused(study_file):
    text = '[vary]\n"flight.duration" = [0.4]'
    with pytest.raises(InputError, match=r"plan.jump: in space studies are of whole jumps.*set it to true"):
        load_study_file(study_file(text, "jumps/space/go2_diagonal"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('"jump.friction" = [0.0]', "vary.jump.friction"),
        ('"jump.margin.torque" = [1.5]', "vary.jump.margin.torque"),
        ('"jump.margin.friction" = [0.5]', "'friction'"),
        ('"jump.feet" = [1.0]', "is no number of a problem file"),
        ('"jump.takeoff.durations.0.1" = [1.0]', "is no number of a problem file"),
        ('"jump.friction" = [0.5]\n[plan]\njump = true\nsearch = true', "plan.search"),
        ('"jump.friction" = [0.5]\n[result]\nmap = ["jump.friction", "jump.clearance", "height"]', "does not vary"),
    ],
)
def test_what_cannot_vary_is_refused(study_file, text, said):
    with pytest.raises(InputError, match=said):
        load_study_file(study_file(f"[vary]\n{text}", "jumps/go2"))


@pytest.mark.long
def test_a_study_of_jumps_goes_on_where_it_ended(study_file, tmp_path):
    """Two processes plan what one plans, and nothing twice."""
    path = study_file('[vary]\n"jump.friction" = [0.5, 0.6]\n[plan]\njump = true', "jumps/high_jumper")
    done = fp.study(path, folder=tmp_path / "study", jobs=2)
    assert done.statuses == {"feasible": 2}
    jump = done.jump(0)
    assert done.table["jump_duration"][0].as_py() == jump.duration
    kept = sorted((tmp_path / "study" / "chunks").glob("*.parquet"))
    kept[1].unlink()
    before = kept[0].stat().st_mtime_ns
    again = fp.study(path, folder=tmp_path / "study", jobs=1)
    told = [name for name in done.table.column_names if name != "milliseconds"]
    assert again.table.select(told).equals(done.table.select(told))
    assert kept[0].stat().st_mtime_ns == before
