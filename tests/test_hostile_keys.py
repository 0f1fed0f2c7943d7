"""Whatever is wrong under any key of any file is refused in words that name its place: one table for all files."""

import tomllib
from pathlib import Path

import pytest
from hostile_keys import damaged
from proof_plans import example_b

from floatplan.errors import InputError
from floatplan.keys import in_files, read_tables
from floatplan.plans.reading import record_from_dict
from floatplan.plans.record import PlanRecord
from floatplan.problem.file import ProblemFile, RobotRequest
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Flight, Limits, Motion, Posture
from floatplan.studies.schema import PlanTable, StudyTables, with_sampling

EVERYTHING = Path(__file__).parent / "problem" / "cases" / "everything.toml"
STANCE = {"contacts": [["hand"]], "durations": [[0.1, 0.4]]}
MORE = {  # keys of tables that no one problem that is planned has together
    "robot": {
        "locked": {"q4": 5},
        "reference": "standing",
        "armature": {"q1": 0.1},
        "damping": 0.1,
        "balance_inertias": True,
        "payload": {"link": "body1", "mass": 1, "at": [0, 0, 0.1]},
        "base": "planar",
    },
    "goal": {"velocities": "landing", "accelerations": "free"},
    "motion": {"objective": "clip", "clip": {"from": 0.0, "to": 0.5, "positions": [[0.1, 0.2], [0.3, 0.4]]}},
    "jump": {
        "friction": 0.5,
        "margin": {"torque": 0.7},
        "fixed": ["duration"],
        "feet": "auto",
        "objective": "torque",
        "clearance": 0.04,
        "pitch_error": 4,
        "least_force": 0.05,
        "leeway": 20,
        "landing": {"to": "standing", "impact": 0.5, **STANCE},
        "takeoff": {
            "from": {"q1": 90},
            "height": 0.2,
            "com_velocity": [0.5, 0.0],
            "velocities": {"q1": 10},
            "orientation": 2,
            "orientation_rate": 3,
            **STANCE,
        },
        "edge": 0.3,
        "flights": [{"turns": 1, "repeat": 1, "duration": [0.3, 0.4]}],
    },
}
IN_SPACE = """
[robot]
mjcf = "arm.xml"
base = "free-flyer"
[start]
orientation = { quaternion_xyzw = [0, 0, 0, 1] }
positions = 0
[goal]
orientation = { angles = [0, 0, 1], axes = "xyz" }
positions = 1
[flight]
duration = 2
angular_momentum = [0, 0, 1]
horizontal_velocity = [0, 1]
takeoff = { frame = "base", position = [0, 0, 1] }
"""
STUDY = """
problem = "somersault.toml"
sampling = "grid"
samples = 5
seed = 1
[vary]
"flight.gravity" = [1.0, 2.0]
"flight.duration" = { from = 0.9, to = 1.4, count = 3 }
[plan]
starts = 2
prove = true
attempts = 3
search = true
jump = false
[result]
folder = "results"
map = ["flight.gravity", "flight.duration", "torque_peak"]
"""


def every_key():
    """A problem with something under every key of a file."""
    content = tomllib.loads(EVERYTHING.read_text(encoding="utf-8"))
    for table, more in MORE.items():
        content[table] = content.get(table, {}) | more
    return content | {"ground": False}


def read_problem(content):
    return read_tables(ProblemFile, content)


def read_study(content):
    return read_tables(StudyTables, with_sampling(content))


FILES = {
    "problem": (ProblemFile, every_key, read_problem, 1000),
    "problem in space": (ProblemFile, lambda: tomllib.loads(IN_SPACE), read_problem, 300),
    "study": (StudyTables, lambda: tomllib.loads(STUDY), read_study, 150),
    "plan": (PlanRecord, lambda: example_b().to_dict(), record_from_dict, 300),
}


def refusal(read, content):
    """What is said where content is refused; nothing where it is taken."""
    try:
        read(content)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("name", FILES)
def test_what_is_wrong_under_any_key_is_refused_with_its_place(name):
    part, content, read, least = FILES[name]
    sound = content()
    read(sound)
    tried = 0
    for place, wrong in damaged(part, sound):
        told = refusal(read, wrong)
        assert any(line.startswith((f"{place}:", f"{place}[", f"{place}.")) for line in told.splitlines()), (
            place,
            told,
        )
        assert all(line.isprintable() for line in told.splitlines())
        assert len(told) < 2000
        tried += 1
    assert tried >= least


def test_the_files_above_have_every_key():
    problem, study = every_key(), tomllib.loads(STUDY)
    assert ProblemFile.keys.keys() == problem.keys()
    assert StudyTables.keys.keys() == study.keys()
    assert RobotRequest.keys.keys() - problem["robot"].keys() == {"mjcf"}
    for name, part in (("start", Posture), ("flight", Flight), ("motion", Motion), ("limits", Limits)):
        assert problem[name].keys() == {in_files(key) for key in part.keys}
    assert problem["jump"].keys() == JumpRequest.keys.keys()
    assert study["plan"].keys() == PlanTable.keys.keys()
