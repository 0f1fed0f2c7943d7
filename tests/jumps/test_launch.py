"""Stances from rest to a takeoff: those of a jump are found again, and those that no robot can have are not."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_stances import Drawing, drawn_stance
from jumps import backflip, go2_problem

import floatplan as fp
from floatplan.jumps.check import limit_shares, sentences_on
from floatplan.jumps.launches.launch import launch
from floatplan.jumps.launches.result import largest_user
from floatplan.jumps.motion import JumpState
from floatplan.jumps.program import JumpProgram


@pytest.mark.long
def test_the_takeoff_of_a_jump_is_reached():
    """A stance is known, within 0.88 of the rates and 0.85 of the torques."""
    flight = backflip().flight
    assert flight is not None
    found = launch(flight, starts=1)
    assert found.ok
    assert found.ratio < 0.9
    assert found.sentences[0].startswith("Takeoff: reachable, with ")
    assert found.joint in found.sentences[0]
    assert found.sentences[-1].startswith("Friction 0.6, at rest with FL_thigh_joint 0.7")
    assert found.figures["residual"] < 1e-3


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "seed", "together"), [("Go2", 324, False), ("A1", 1460, True), ("A1", 7043, True), ("A1", 9478, True)]
)
def test_a_takeoff_that_is_known_to_be_within_reach_is_reached(name, seed, together):
    """A foot that dips as little as the check lets; forces that leave the cone only between nodes; far guesses."""
    drawn = drawn_stance(Drawing(name), np.random.default_rng(seed), together)
    found = launch(drawn.plan, drawn.request)
    assert found.ok
    assert found.ratio <= 1
    shares = {"torque", "torque_speed", "velocity"}
    assert max(found.figures[share] for share in shares) == found.ratio
    assert not sentences_on(drawn.request, {key: value for key, value in found.figures.items() if key not in shares})[0]


def test_a_takeoff_of_a_weak_robot_is_shown_to_be_impossible(monkeypatch):
    """The rates with which the foot is at rest are those of ``takeoff``: beyond the limits there is nothing to find."""
    monkeypatch.setattr(JumpProgram, "solve", lambda *_: pytest.fail("a search for what there is not"))
    problem = replace(go2_problem(), limits=fp.Limits(velocity=12.0), jump=None)
    plan = fp.plan(replace(problem, limits=fp.Limits()))
    found = launch(replace(plan, problem=problem))
    assert found.impossible
    assert found.ratio == pytest.approx(fp.takeoff(problem, plan.angular_momentum).ratio, rel=1e-9)
    words = f"with RL_foot at rest then, {found.joint}'s rate is at least {found.ratio:.2f} of its limit"
    assert found.sentences[0] == f"Takeoff: no stance reaches it: {words}, whatever came before."
    after = launch(replace(plan, problem=problem), end="landing")
    assert after.impossible
    assert after.sentences[0].endswith(", whatever comes after.")


def test_the_torque_of_a_leader_with_its_followers_is_named_by_the_joint():
    """It has a limit of its own, and its motors have none; limits of motors are named by the motor."""
    problem = go2_problem()
    robot = problem.robot
    joint = robot.joints[2]
    torques = np.zeros((3, robot.model.nv))
    torques[1] = robot.selection[:, 2]
    still = np.zeros_like(torques)
    state = JumpState(np.arange(3.0), still, still, still, {}, torques, {})
    generalised = float((torques @ robot.selection)[1, 2])
    bounds = np.full(len(robot.joints), 100.0)
    bounds[2] = generalised / 2
    by_joint = replace(problem, limits=fp.Limits(torque=bounds.tolist()))
    assert np.isinf(by_joint.motor_torque_limits).all()
    assert limit_shares(by_joint, state)["torque"].max() == pytest.approx(2.0)
    assert largest_user(by_joint, [state], "torque") == joint
    by_motor = replace(problem, limits=fp.Limits(torque=1.0))
    torques[1] = robot.transmission[:, 5]
    assert largest_user(by_motor, [state], "torque") == robot.motors[5]


def test_a_saved_plan_stands_where_its_robot_did_on_the_ground_of_its_jump(tmp_path):
    """The reference posture is in no URDF, and friction in no flight: the plan's file holds both."""
    problem = replace(go2_problem(), jump=fp.JumpRequest(friction=0.45))
    plan = fp.plan(problem)
    again = fp.load_plan(plan.save(tmp_path / "plan.json"))
    np.testing.assert_array_equal(again.robot.resting, problem.robot.resting)
    assert again.problem.jump == problem.jump
    flight = backflip().flight
    assert flight.problem.jump == backflip().request
    np.testing.assert_array_equal(flight.robot.resting, problem.robot.resting)
