"""Landings that are not as planned: turned about their feet, or late; feet as round as their shapes; level ground."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from jumps import INSTALLED, backflip, go2_problem
from legged_samples import biped, fixed, link
from needed import skip_or_fail
from once import made_once

import floatplan as fp
from floatplan.initial.flight import jump_problem
from floatplan.initial.options import InitOptions
from floatplan.initial.robots import chosen_robot
from floatplan.jumps import planner
from floatplan.jumps.check import TOUCHDOWN, touchdown_height
from floatplan.jumps.contacts import is_ground
from floatplan.jumps.jump import Jump
from floatplan.jumps.planner import _largest_share, _merit
from floatplan.jumps.setup import jump_setup
from floatplan.robot import Robot
from floatplan.robot.standing import corners, undersides

if not INSTALLED:
    skip_or_fail("CasADi or example-robot-data is not installed")


@cache
def touchdown_heights(error: float) -> float:
    """Least height over the ground of knees and trunk of a Go2's backflip that lands turned, by Pinocchio's frames."""
    found = backflip()
    assert found.flight is not None
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


def test_it_lands_clear_of_the_ground_also_where_it_is_turned() -> None:
    found = backflip()
    assert found.ok
    assert found.request.pitch_error == pytest.approx(np.radians(4), abs=1e-3)
    assert found.check.figures["touchdown"] >= 0
    assert touchdown_heights(found.request.pitch_error) > 0.03


def test_a_landing_that_is_not_clear_where_it_is_turned_does_not_hold(tmp_path: Path) -> None:
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


def test_of_two_that_do_not_hold_the_one_that_lacks_room_where_it_lands_is_kept() -> None:
    """It is a jump for somebody who asks for a smaller pitch error. One that holds goes before it."""

    def asked(**of_request: Any) -> Jump:
        return replace(backflip(), request=replace(backflip().request, **of_request))

    turned, weak = asked(pitch_error=0.5), asked(pitch_error=0.5, margin={"torque": 0.1})
    nothing = Jump(backflip().problem, backflip().request)
    assert not turned.ok
    assert max(nothing, turned, weak, key=_merit) is turned
    assert max(backflip(), turned, key=_merit) is backflip()


def test_where_two_programs_have_no_flight_no_third_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = go2_problem(0)
    figures: list[Any] = []

    def tried(room: Any, request: Any, found: Any, finer: Any, complete: Any) -> Jump:
        for _ in range(2):
            answer, of_check = complete(None, None)
            figures.append(of_check)
        return answer

    monkeypatch.setattr(planner, "completed", lambda *_: Jump(problem, fp.JumpRequest()))
    monkeypatch.setattr(planner, "corrected", tried)
    setup = jump_setup(problem, fp.JumpRequest())
    planner._corrected(setup, (None, None), setup.program, 0, lambda _: None)  # type: ignore[arg-type]
    assert figures == [{}, None], "the second one ends it"


def test_lines_beside_a_foot_s_geometry_touch_nothing_where_it_lands_turned(tmp_path: Path) -> None:
    """An ankle without geometry, whose foot is fixed to it at an origin 6 mm below the sole."""
    text, more = biped(foot="sole", knee=(0.0, 2.4)).replace("0.03 0 -0.035", "0 0 0.021"), []
    for side in ("left", "right"):
        text = text.replace(f'<child link="{side}_foot"/>', f'<child link="{side}_ankle_link"/>')
        more += [
            link(f"{side}_ankle_link", 0.1),
            fixed(f"{side}_end", f"{side}_ankle_link", f"{side}_foot", "0.03 0 -0.05"),
        ]
    path = tmp_path / "robot.urdf"
    path.write_text(text.replace("</robot>", "".join(more) + "</robot>"))
    chosen = chosen_robot(path)
    found = fp.jump(jump_problem(chosen, 0, InitOptions()), starts=1, helps=False)
    assert found.ok, found.explanation
    y, ends = np.append(0.0, chosen.posture), corners(chosen.robot.link_hulls["left_ankle_link"])
    under = (
        undersides(chosen.robot, ends, y).min()
        - undersides(chosen.robot, corners(chosen.robot.link_hulls["left_foot"]), y).min()
    )
    assert under < -0.005
    assert touchdown_height(found, 0.05) > 0.01


def test_the_ground_s_force_grows_gently_after_touchdown() -> None:
    """Within 10 ms, by which feet land late, it stays below one and a half weights."""
    found = backflip()
    assert found.flight is not None
    landing = found.takeoff_time + found.flight.duration
    forces = found.forces(landing + np.array([0.005, 0.01, 0.03]))
    load = sum(force[:, 2] for force in forces.values()) / (found.problem.robot.mass * 9.81)
    assert load[0] < 0.8
    assert load[1] < 1.4
    assert load[2] > load[1]


@pytest.mark.parametrize(("feet", "radius"), [("auto", 0.0227), ("rolling", 0.0227), ("points", 0.0), ("point", 0.0)])
def test_feet_are_as_round_as_their_shapes_unless_points_are_asked_for(feet: Any, radius: float) -> None:
    setup = jump_setup(go2_problem(), fp.JumpRequest(feet=feet))
    radii = [contact.radius for phase in setup.phases for contact in phase.contacts]
    assert radii == pytest.approx([radius] * 6, abs=1e-3)


def test_soles_and_feet_that_are_no_circle_stand_on_points() -> None:
    robot = Robot.from_urdf(
        "example-robot-data:anymal_b_simple_description/robots/anymal.urdf", coupled="mirror", reference="standing"
    )
    standing = fp.Posture(0.0, np.array(robot.resting))
    flight = fp.Flight(0.2, angular_momentum="free", takeoff=fp.Takeoff("LH_FOOT"))
    problem = fp.Problem(robot, standing, standing, flight, jump=fp.JumpRequest())
    phases = jump_setup(problem, fp.JumpRequest()).phases
    assert {contact.radius for phase in phases for contact in phase.contacts} == {0.0}


def test_what_stood_on_circles_is_written(tmp_path: Path) -> None:
    """Feet that are left out are "auto"; what was taken is written of each contact."""
    found = backflip()
    content = json.loads(found.to_json())
    assert content["problem"]["jump"]["feet"] == "auto"
    assert all(contact["rolls"] for stance in content["stances"] for contact in stance["contacts"])
    again = fp.load_jump(found.save(tmp_path / "jump.json"))
    assert again.ok


@pytest.mark.parametrize(
    ("obstacle", "ground"),
    [
        (fp.HalfPlane(point=(3.0, -0.101)), True),
        (fp.HalfPlane(point=(0.0, -0.097), normal=(0.0, 5.0), margin=0.02), True),
        (fp.HalfPlane(point=(0.0, -7.0)), True),
        (fp.HalfPlane(point=(0.0, -0.05)), False),
        (fp.HalfPlane(point=(0.0, -0.2), normal=(0.1, 1.0)), False),
        (fp.HalfPlane(point=(0.0, -0.2), normal=(0.0, -1.0)), False),
        (fp.HalfPlane(point=(0.0, -0.2), velocity=(0.0, 0.1)), False),
        (fp.Circle(center=(0.0, -0.3), radius=0.1), False),
    ],
)
def test_which_obstacles_are_the_ground(obstacle: Any, ground: bool) -> None:
    assert is_ground(obstacle, -0.1) is ground


@pytest.mark.parametrize("below", [0.0, 0.0013, 0.03])
def test_a_half_plane_under_the_feet_is_their_ground(below: float) -> None:
    """A hop of the high jumper, whose foot's point is at the origin, over a half-plane with a margin."""
    root = Path(__file__).resolve().parents[2]
    problem = fp.load_problem(root / "problems/jumps/high_jumper.toml")
    floor = fp.HalfPlane(point=(0.0, -below), normal=(0.0, 1.0), margin=0.01)
    found = fp.jump(replace(problem, obstacles=(floor,)), starts=1, helps=False)
    assert found.ok
    assert "obstacles" not in found.check.figures


def test_the_least_largest_share_is_that_of_the_whole_jump() -> None:
    """Of a hop: the flight of least torque takes more of a limit than the whole of the jump of the least share."""
    root = Path(__file__).resolve().parents[2]
    problem = fp.load_problem(root / "problems/jumps/high_jumper.toml")
    assert problem.jump is not None
    shares = []
    for objective in ("torque", "limits"):
        found = fp.jump(problem, replace(problem.jump, objective=objective), starts=4)  # type: ignore[arg-type]
        assert found.ok
        shares.append(_largest_share(found, found.check))
    assert shares[1] < 0.7 * shares[0]


def test_a_takeoff_upside_down_is_reached() -> None:
    """Bolt turns by more than half of a turn before it takes off; it did not stand a whole turn further on."""
    root = Path(__file__).resolve().parents[2]
    found = made_once("bolt.toml", lambda: fp.jump(root / "problems/jumps/bolt.toml", starts=1))
    assert found.flight.problem.initial.orientation < -np.pi
    told: list[str] = []
    launch = fp.launch(found.flight, progress=told.append)
    assert launch.ok
    assert told[0] == "start 1 of 3"
