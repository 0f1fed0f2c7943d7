"""Feet that roll: circles about their frames, on which a robot stands and from which it jumps."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from jumps import GO2, INSTALLED, go2_problem
from needed import skip_or_fail
from once import made_once

import floatplan as fp
from floatplan.errors import InputError
from floatplan.jumps.check import judged
from floatplan.jumps.contacts import GroundContact, contact_at, rolling
from floatplan.jumps.exact import OnePoint, StanceDynamics
from floatplan.jumps.jump import Jump, load_jump
from floatplan.jumps.model import PlanarModel
from floatplan.jumps.motion import Grid, Stance
from floatplan.jumps.phases import Phase
from floatplan.jumps.planner import jump
from floatplan.robot import Robot

if not INSTALLED:
    skip_or_fail("CasADi or example-robot-data is not installed")

ROLLING = fp.JumpRequest(feet="rolling")
RADIUS = 0.0227  # [m] of the Go2's feet, from their frames down to the ground
ANYMAL = "example-robot-data:anymal_b_simple_description/robots/anymal.urdf"
TALOS = "example-robot-data:talos_data/robots/talos_reduced.urdf"


def backflip() -> Jump:
    """The Go2's backflip on feet that roll."""
    found: Jump = made_once("rolling backflip", lambda: jump(go2_problem(), ROLLING, starts=1))
    return found


def go2_foot(frame: str = "RL_foot") -> tuple[Robot, GroundContact, np.ndarray]:
    robot = Robot.from_urdf(GO2, coupled="mirror", reference="standing")
    home = np.append(0.0, robot.resting)
    return robot, rolling(robot, contact_at(robot, frame, home)[0], home), home


def rocking(times: np.ndarray) -> tuple[np.ndarray, ...]:
    """Joints (4, N) of a Go2 that rocks on one pair of feet, with their derivatives."""
    sizes, rates = np.array([[0.3], [-0.5], [0.2], [0.4]]), np.array([[7.0], [9.0], [8.0], [6.0]])
    home = np.array([[0.7], [-1.4], [0.8], [-1.5]])
    return (
        home + sizes * np.sin(rates * times),
        sizes * rates * np.cos(rates * times),
        -sizes * rates**2 * np.sin(rates * times),
    )


def test_a_foot_that_rolls_does_not_slip_and_balances() -> None:
    """A Go2 rocks on its rear feet: by Pinocchio what is on the ground is at rest, and all forces act there."""
    robot, contact, _ = go2_foot()
    dynamics = StanceDynamics(PlanarModel(robot), Phase("takeoff", (contact,), 1.0, (1.0, 1.0), 1), np.zeros(5))
    times = np.linspace(0.0, 0.2, 41)
    point = OnePoint(dynamics, times)
    y, v, a = point.follow([np.stack(rocking(each)) for each in point.sampled], (0.1, 2.0))
    stance = Stance(robot, 9.81, (contact,), 0.3 + 0.1j, Grid(times, y, v, a, np.empty((0, len(times)))))
    state, model = stance.at(times), robot.model
    data = model.createData()
    assert np.ptp(y[0] + y[1:].T @ robot.tree.turns[contact.spots[0].body]) > 0.3
    for row, (q, rates, changes) in enumerate(zip(state.positions, state.velocities, state.accelerations, strict=True)):
        wrench = pin.rnea(model, data, q, rates, changes + 9.81 * np.eye(model.nv)[1])
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for name in ("RL_foot", "RR_foot"):
            center = data.oMf[model.getFrameId(name)].translation
            np.testing.assert_allclose(state.points[name][row], center - [0.0, 0.0, contact.radius], atol=1e-12)
            jacobian = pin.getFrameJacobian(model, data, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED)
            speed, turning = np.split(jacobian @ rates, 2)
            np.testing.assert_allclose(speed + np.cross(turning, [0.0, 0.0, -contact.radius]), 0.0, atol=1e-12)
            force = np.insert(state.forces[name][row], 1, 0.0)
            wrench -= jacobian.T @ np.concatenate((force, np.cross([0.0, 0.0, -contact.radius], force)))
        np.testing.assert_allclose(wrench[:3], 0.0, atol=1e-8)
        np.testing.assert_allclose(wrench, state.torques[row], atol=1e-8)
    heights = [state.points[name][:, 2] for name in state.points]
    np.testing.assert_allclose(heights, 0.1 - contact.radius, atol=1e-12)


def test_momentum_about_a_contact_that_moves() -> None:
    """Its derivatives are those of its values along a motion that balances, of a foot that turns by 0.3 rad."""
    robot, contact, _ = go2_foot("FL_foot")
    model = PlanarModel(robot)
    dynamics = StanceDynamics(model, Phase("landing", (contact,), 1.0, (1.0, 1.0), 1), np.zeros(5))
    times = np.linspace(0.0, 0.2, 401)
    point = OnePoint(dynamics, times)
    path = point.follow([np.stack(rocking(each)) for each in point.sampled], (0.1, 2.0))
    found = model.function("about", model.momentum_about(contact.spots[0]))(*path)
    values, rates, changes = (np.asarray(each).ravel() for each in found)
    for low, high in ((values, rates), (rates, changes)):
        differences = (low[2:] - low[:-2]) / (times[2] - times[0])
        np.testing.assert_allclose(high[1:-1], differences, atol=3e-4 * np.abs(high).max())


@pytest.mark.parametrize(
    ("source", "choices", "stands", "reason"),
    [
        (ANYMAL, {"coupled": "mirror"}, ("LH_FOOT", 0.0), "no circle about it, by"),
        (TALOS, {"coupled": "mirror", "plane": "xz", "reference": "half_sitting"}, ("leg_left_6_link", 0.0), "a sole"),
        (Path("urdf/gymnast.urdf"), {}, ("foot", np.pi / 2), "a point"),
    ],
)
def test_what_is_not_round_does_not_roll(source: Any, choices: Any, stands: tuple[str, float], reason: str) -> None:
    robot, (frame, orientation) = Robot.from_urdf(source, **choices), stands
    home = np.append(orientation, robot.resting)
    with pytest.raises(InputError, match=reason) as caught:
        rolling(robot, contact_at(robot, frame, home)[0], home)
    assert "feet = " in str(caught.value)


def test_a_request_for_feet_that_are_not_round_names_its_key() -> None:
    robot = Robot.from_urdf(TALOS, coupled="mirror", plane="xz", reference="half_sitting")
    posture = fp.Posture(0.0, np.array(robot.resting))
    flight = fp.Flight(0.4, takeoff=fp.Takeoff("leg_left_6_link"))
    with pytest.raises(InputError, match=r"jump\.takeoff\.contacts.*cannot roll"):
        jump(fp.Problem(robot, posture, posture, flight, fp.Motion(objective="torque")), ROLLING)


def test_a_hop_on_one_round_foot(tmp_path: Path) -> None:
    """The high jumper, whose shank is its base and whose joints turn the other way, on a ball of 5 cm."""
    ball = '<link name="foot"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>'
    for name, old, new in (
        ("urdf/high_jumper.urdf", '<link name="foot"/>', ball),
        ("problems/jumps/high_jumper.toml", "[jump]", '[jump]\nfeet = "rolling"'),
    ):
        text = Path(name).read_text()
        assert text.count(old) == 1
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(text.replace(old, new))
    found = jump(tmp_path / "problems/jumps/high_jumper.toml", starts=1)
    assert found.ok
    assert max(found.check.figures["takeoff_seam"], found.check.figures["landing_seam"]) < 1e-6
    landing = found.phases[-1].begin
    times = np.array([[0.0, 0.8 * found.takeoff_time], [(landing + found.duration) / 2, found.duration]])
    points, q = found.contact_points(times)["foot"], found.q(times)
    model = pin.buildModelFromXML(found.problem.robot.xml, pin.JointModelFreeFlyer())
    data = model.createData()
    for row in np.ndindex(2, 2):
        pin.framesForwardKinematics(model, data, q[row])
        center = data.oMf[model.getFrameId("foot")].translation
        np.testing.assert_allclose(points[row], center - [0.0, 0.0, 0.05], atol=1e-9)
    assert np.isnan(found.contact_points(found.takeoff_time + 0.1)["foot"]).all()
    assert np.ptp(points[..., 0]) > 0.003


@pytest.mark.long
def test_a_backflip_on_feet_that_roll(tmp_path: Path) -> None:
    found = backflip()
    figures = found.check.figures
    assert found.ok
    assert max(figures["takeoff_seam"], figures["landing_seam"], figures["junction"]) < 1e-6
    assert (figures["drift"], figures["foot_speed"]) < (1e-6, 1e-4)
    assert found.flight is not None
    assert fp.certify(found.flight).proved
    again = load_jump(found.save(tmp_path / "jump.json"))
    assert again.check.figures == found.check.figures
    times = np.linspace(0.0, found.duration, 33)
    for name, places in found.contact_points(times).items():
        np.testing.assert_array_equal(again.contact_points(times)[name], places)


@pytest.mark.long
def test_forces_act_where_the_circles_touch() -> None:
    """In the file's own model, of a jump that rolls by some centimetres before and after a whole turn."""
    found = backflip()
    model = pin.buildModelFromXML(found.problem.robot.xml, pin.JointModelFreeFlyer())
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    data, weight = model.createData(), found.problem.robot.mass * 9.81
    times = np.linspace(0.0, found.duration, 60)
    points, forces = found.contact_points(times), found.forces(times)
    for row, t in enumerate(times):
        q, v, a, tau = found.q(t), found.v(t), found.a(t), found.tau(t)
        wrench = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        standing = next(phase.contacts for phase in found.phases if t <= phase.end)
        for name, places in points.items():
            assert np.isfinite(places[row]).all() == (name in standing)
            if name not in standing:
                assert (forces[name][row] == 0).all()
                continue
            arm = places[row] - data.oMf[model.getFrameId(name)].translation
            np.testing.assert_allclose(arm, [0.0, 0.0, -RADIUS], atol=5e-5)
            jacobian = pin.getFrameJacobian(model, data, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED)
            speed, turning = np.split(jacobian @ v, 2)
            assert np.abs(speed + np.cross(turning, arm)).max() < 1e-4
            wrench -= jacobian.T @ np.concatenate((forces[name][row], np.cross(arm, forces[name][row])))
        assert np.abs(wrench[6:] - tau[6:]).max() < 1e-6 * weight
        assert np.abs(wrench[[0, 2, 4]]).max() < 1e-5 * weight
    rolled = [np.ptp(places[np.isfinite(places[:, 0]), 0]) for places in points.values()]
    assert min(rolled) > 0.005


def flat(content: dict[str, Any]) -> None:
    """Feet that turn about their frames, said to roll on as far."""
    for stance in content["stances"]:
        for each in stance["contacts"]:
            each["rolls"] = False
    content["problem"]["jump"]["feet"] = "point"


def other_radius(content: dict[str, Any]) -> None:
    for stance in content["stances"]:
        for each in stance["contacts"]:
            each["depth"] += 2e-3
        stance["place"][1] += 2e-3


def slid(content: dict[str, Any]) -> None:
    """The front feet land, and slide by rolling a little too far: their knees are bent."""
    stance = content["stances"][2]
    values, share = np.array(stance["y"]), np.linspace(0.0, 1.0, len(stance["times"]))
    values[2] += 0.02 * np.sin(np.pi * share) ** 2
    stance["y"] = values.tolist()


@pytest.mark.long
@pytest.mark.parametrize(
    ("spoil", "shown"),
    [
        (flat, "takeoff_seam"),
        (other_radius, "takeoff_seam"),
        (slid, "derivative"),
        (lambda content: content["problem"]["jump"].update(feet="point"), "do not fit problem.jump.feet"),
        (lambda content: content["stances"][1]["contacts"][0].update(rolls=False), "do not fit problem.jump.feet"),
    ],
)
def test_a_spoiled_file_is_refused(spoil: Any, shown: str, tmp_path: Path) -> None:
    path = backflip().save(tmp_path / "jump.json")
    content = json.loads(path.read_text())
    spoil(content)
    path.write_text(json.dumps(content))
    try:
        again = load_jump(path)
    except InputError as error:
        assert shown in str(error)  # noqa: PT017
        return
    assert not again.ok
    assert judged(again.request, {shown: again.check.figures[shown]})[0]


@pytest.mark.long
def test_circles_that_the_feet_are_not() -> None:
    """A file that is right but for the shape of its feet: the check looks at their outlines."""
    found = backflip()
    stances = [
        replace(
            stance,
            contacts=tuple(
                replace(each, spots=tuple(spot._replace(radius=0.03) for spot in each.spots), depth=0.03)
                for each in stance.contacts
            ),
            anchor_position=stance.anchor_position + 0.0073j,
        )
        for stance in found.stances
    ]
    check = replace(found, before=tuple(stances[:2]), after=tuple(stances[2:])).check
    assert judged(found.request, {"circle": check.figures["circle"]})[0]
    assert not check.ok
