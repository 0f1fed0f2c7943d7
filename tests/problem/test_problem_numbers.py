"""Every number of a problem file: none may be infinite or NaN, though TOML has words for both."""

from __future__ import annotations

import copy
import tomllib

import pytest
import tomli_w
from robot_samples import URDF_FOLDER

import floatplan as fp
from floatplan.errors import InputError

EVERY_NUMBER = f"""
[robot]
urdf = "{URDF_FOLDER / "chain10.urdf"}"
coupled = {{ q3 = {{ leader = "q1", ratio = -0.7, offset = 0.2 }} }}
locked = {{ q4 = 0.1, q5 = 0.1, q6 = 0.1, q7 = 0.1, q8 = 0.1, q9 = 0.1, q10 = 0.1 }}
[start]
orientation = 0.0
positions = [0.0, 0.0]
velocities = 0.0
accelerations = {{ q1 = 0.0 }}
[goal]
orientation = 0.1
positions = {{ q1 = 0.1, q2 = 0.2 }}
[flight]
duration = 1.0
angular_momentum = 0.1
takeoff = {{ frame = "foot", position = [0.0, 0.0] }}
landing = {{ frame = "hand", height = 0.1 }}
horizontal_velocity = 0.0
gravity = 9.81
[motion]
degree = [7, 7]
[limits]
position = {{ q1 = [-3.0, 3.0] }}
velocity = {{ q1 = 9.0 }}
torque = [9.0, 9.0]
motor = {{ q1 = {{ stall = 9.0, slope = 0.1 }} }}
orientation_rate = 100.0
[[obstacles]]
kind = "circle"
center = [9.0, 9.0]
radius = 0.1
margin = 0.1
velocity = [0.1, 0.1]
window = [0.1, 0.9]
[[obstacles]]
kind = "half-plane"
point = [0.0, -99.0]
normal = [0.0, 1.0]
[[obstacles]]
kind = "capsule"
start = [8.0, 9.0]
end = [9.0, 9.0]
radius = 0.1
[[self_clearance]]
links = ["body0", "body2"]
margin = 0.001
"""


def numbers(content, path=()):
    """Paths of all numbers in plain data."""
    if isinstance(content, dict):
        return [leaf for key, value in content.items() for leaf in numbers(value, (*path, key))]
    if isinstance(content, list):
        return [leaf for index, value in enumerate(content) for leaf in numbers(value, (*path, index))]
    return [] if isinstance(content, str) else [path]


def written(folder, content):
    path = folder / "problem.toml"
    path.write_text(content if isinstance(content, str) else tomli_w.dumps(content))
    return path


def changed(path, value):
    content = copy.deepcopy(tomllib.loads(EVERY_NUMBER))
    where = content
    for part in path[:-1]:
        where = where[part]
    where[path[-1]] = value
    return content


@pytest.mark.parametrize("number", [float("inf"), float("-inf"), float("nan"), 10**400, True])
def test_a_number_that_is_none_is_refused_at_every_place(tmp_path, number):
    assert fp.load_problem(written(tmp_path, EVERY_NUMBER)).robot.joints == ("q1", "q2")
    places = numbers(tomllib.loads(EVERY_NUMBER))
    assert len(places) > 50
    for path in places:
        with pytest.raises(InputError) as caught:
            fp.load_problem(written(tmp_path, changed(path, number)))
        assert next(str(part) for part in reversed(path) if isinstance(part, str)) in str(caught.value)


def test_a_negative_margin_between_links_is_refused(tmp_path):
    """The certificate would refuse the plan of it."""
    with pytest.raises(InputError, match="negative"):
        fp.load_problem(written(tmp_path, changed(("self_clearance", 0, "margin"), -0.1)))


def test_a_key_given_twice_is_refused(tmp_path):
    with pytest.raises(InputError, match="is not TOML"):
        fp.load_problem(written(tmp_path, EVERY_NUMBER.replace("gravity = 9.81", "gravity = 9.81\ngravity = 1.62")))
