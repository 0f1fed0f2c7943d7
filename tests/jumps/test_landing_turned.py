"""Landings that are not as planned: turned about their feet, or late; feet as round as their shapes; level ground."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from jumps import backflip, go2_problem
from long_cases import cases

import floatplan as fp
from floatplan.jumps.check import TOUCHDOWN
from floatplan.jumps.planner import _largest_share
from floatplan.jumps.setup import jump_setup


@cache
def touchdown_heights(error):
    """Least height over the ground of knees and trunk of a Go2's backflip that lands turned, by Pinocchio's frames."""
    found = backflip()
    model = pin.buildModelFromXML(found.problem.robot.xml, pin.JointModelFreeFlyer())
    data, landing = model.createData(), found.takeoff_time + found.flight.duration
    least = np.inf
    for time in landing + np.linspace(0.0, TOUCHDOWN, 60):
        q = found.q(time)
        for sign in (1.0, -1.0):
            turned = q.copy()
            rotation = pin.exp3(np.array([0.0, sign * error, 0.0]))
            turned[:3] = rotation @ q[:3]
            turned[3:7] = pin.Quaternion(rotation @ pin.Quaternion(q[6], *q[3:6]).matrix()).coeffs()
            pin.framesForwardKinematics(model, data, turned)
            height = {
                name: data.oMf[model.getFrameId(name)].translation[2]
                for name in ("FL_foot", "RL_foot", "FL_calf", "RL_calf", "base")
            }
            ground = min(height["FL_foot"], height["RL_foot"])
            least = min(least, *(height[name] - ground for name in ("FL_calf", "RL_calf", "base")))
    return float(least)


def test_it_lands_clear_of_the_ground_also_where_it_is_turned():
    found = backflip()
    assert found.ok
    assert found.request.pitch_error == pytest.approx(np.radians(4), abs=1e-3)
    assert found.check.figures["touchdown"] >= 0
    assert touchdown_heights(found.request.pitch_error) > 0.03


def test_a_landing_that_is_not_clear_where_it_is_turned_does_not_hold(tmp_path):
    """The same motion is asked to be clear where it is turned by so much that its trunk is in the ground."""
    content = json.loads(backflip().to_json())
    content["problem"]["jump"]["pitch_error"] = 0.5
    path = tmp_path / "jump.json"
    path.write_text(json.dumps(content))
    check = fp.load_jump(path).check
    assert not check.ok
    assert "where it lands turned by the pitch error" in check.sentences[0]
    del content["problem"]["jump"]["pitch_error"]  # as files were written before there was the key
    path.write_text(json.dumps(content))
    old = fp.load_jump(path)
    assert old.request.pitch_error == 0
    assert "touchdown" not in old.check.figures
    assert old.ok


@pytest.mark.parametrize(("feet", "radius"), [("auto", 0.0227), ("rolling", 0.0227), ("points", 0.0), ("point", 0.0)])
def test_feet_are_as_round_as_their_shapes_unless_points_are_asked_for(feet, radius):
    setup = jump_setup(go2_problem(), fp.JumpRequest(feet=feet))
    radii = [contact.radius for phase in setup.phases for contact in phase.contacts]
    assert radii == pytest.approx([radius] * 6, abs=1e-3)


@pytest.mark.parametrize("below", cases([0.0, 0.0013, 0.03], {0.0, 0.03}))
def test_a_half_plane_under_the_feet_is_their_ground(below):
    """A hop of the high jumper, whose foot's point is at the origin, over a half-plane with a margin."""
    root = Path(__file__).resolve().parents[2]
    problem = fp.load_problem(root / "problems/jumps/high_jumper.toml")
    floor = fp.HalfPlane(point=(0.0, -below), normal=(0.0, 1.0), margin=0.01)
    found = fp.jump(replace(problem, obstacles=(floor,)), starts=1, helps=False)
    assert found.ok
    assert "obstacles" not in found.check.figures


@pytest.mark.long
def test_the_least_largest_share_is_that_of_the_whole_jump():
    """Of a hop: the flight of least torque takes more of a limit than the whole of the jump of the least share."""
    root = Path(__file__).resolve().parents[2]
    problem = fp.load_problem(root / "problems/jumps/high_jumper.toml")
    assert problem.jump is not None
    shares = []
    for objective in ("torque", "limits"):
        found = fp.jump(problem, replace(problem.jump, objective=objective), starts=2)
        assert found.ok
        shares.append(_largest_share(found, found.check))
    assert shares[1] < 0.7 * shares[0]
