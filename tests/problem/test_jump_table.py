"""The table [jump] of problem files: read, refused, saved; flights of such problems are planned alone."""

import math
from dataclasses import replace

import pytest

import floatplan as fp
from floatplan.plans.reading import record_from_dict
from floatplan.problem.file import problem_from_dict, problem_to_dict
from floatplan.problem.jump import ONLY_THE_FLIGHT

JUMP = """
[jump]
friction = 0.5
margin = { torque = 0.7 }
fixed = ["duration"]
[jump.takeoff]
from = { q1 = 90 }
contacts = [["hand"]]
durations = [[0.1, 0.4]]
[jump.landing]
contacts = [["hand"]]
"""
ASKED = fp.JumpRequest(
    0.5,
    {"torque": 0.7},
    ["duration"],
    fp.JumpTakeoff([["hand"]], [(0.1, 0.4)], from_={"q1": math.pi / 2}),
    fp.JumpLanding([["hand"]]),
)


@pytest.fixture
def text(root):
    return f"""angles = "deg"
[robot]
urdf = "{root / "urdf" / "gymnast.urdf"}"
[start]
orientation = 72
positions = [18, -45]
[goal]
orientation = -90
positions = 0
[flight]
duration = 1.4
takeoff = {{ frame = "foot" }}
"""


def read(folder, text):
    path = folder / "file.toml"
    path.write_text(text)
    return fp.load_problem(path)


def test_it_is_read(tmp_path, text):
    jump = read(tmp_path, text + JUMP).jump
    assert jump == ASKED
    assert jump.margin == {"torque": 0.7, "velocity": 0.88}
    assert jump.landing.to == "standing"
    assert read(tmp_path, text).jump is None
    assert read(tmp_path, text + "[jump]\n").jump == fp.JumpRequest()


def test_it_is_the_same_after_saving_and_in_plain_data(tmp_path, text):
    problem = read(tmp_path, text + JUMP)
    assert fp.load_problem(fp.save_problem(problem, tmp_path / "again.toml")).jump == ASKED
    assert problem_from_dict(problem_to_dict(problem), problem.robot).jump == ASKED
    assert "jump" not in problem_to_dict(replace(problem, jump=None))


REFUSED = {
    "no such key": ("frictions = 1", "jump.frictions: unknown key; did you mean 'friction'"),
    "friction 0": ("friction = 0", "jump.friction: 0.* is not positive"),
    "a margin of what is no limit": ("margin = { speed = 0.5 }", "jump.margin: 'speed' is not a margin"),
    "a margin above 1": ("margin = { torque = 1.5 }", r"jump.margin.torque: 1.5 is outside"),
    "a word that is not known": (
        'fixed = ["gravity"]',
        r"jump.fixed\[0\]: must be 'duration', 'angular_momentum', 'start' or 'goal', not 'gravity'",
    ),
    "unknown frame": ('takeoff = { contacts = [["paw"]] }', r"jump.takeoff.contacts\[0\]: the robot has no frame"),
    "not a planned joint": ("takeoff = { from = { knee = 0 } }", "jump.takeoff.from: 'knee' is not a planned joint"),
    "a foot that leaves and returns": (
        'takeoff = { contacts = [["foot", "hand"], ["foot"], ["foot", "hand"]] }',
        "jump.takeoff.contacts: 'hand' would leave the ground and return",
    ),
    "a foot that comes before takeoff": (
        'takeoff = { contacts = [["foot"], ["hand"]] }',
        "jump.takeoff.contacts: 'hand' would come to the ground before takeoff",
    ),
    "a foot that leaves after landing": (
        'landing = { contacts = [["foot"], ["hand"]] }',
        "jump.landing.contacts: 'foot' would leave the ground after it has landed",
    ),
    "three phases": ('landing = { contacts = [["foot"], ["foot"], ["foot"]] }', "must be one or two phases"),
    "nothing stands": ("landing = { contacts = [[]] }", "must be one or two phases"),
    "durations the wrong way round": (
        "takeoff = { durations = [[0.3, 0.2]] }",
        r"jump.takeoff.durations\[0\]: low 0.3 s is above high 0.2 s",
    ),
    "durations of other phases": (
        'takeoff = { contacts = [["foot"]], durations = [[0.1, 0.2], [0.1, 0.2]] }',
        "jump.takeoff.durations: 2 given for 1 phases",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_refused_with_file_key_and_reason(tmp_path, text, name):
    table, reason = REFUSED[name]
    with pytest.raises(fp.InputError, match=reason) as caught:
        read(tmp_path, f"{text}[jump]\n{table}\n")
    assert "file.toml" in str(caught.value)


def test_its_flight_is_planned_alone_proved_and_read_again(tmp_path, text):
    plan = fp.plan(read(tmp_path, text + JUMP), prove=True)
    assert plan.ok
    assert plan.explanation.endswith(ONLY_THE_FLIGHT)
    assert plan.certificate.proved
    again = fp.load_plan(plan.save(tmp_path / "plan.json"))
    assert again.problem.jump == ASKED
    assert fp.certify(tmp_path / "plan.json").proved
    assert record_from_dict(plan.record.to_dict()).problem["jump"]["friction"] == 0.5
