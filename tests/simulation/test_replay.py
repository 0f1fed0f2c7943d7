"""Replay: forward dynamics lands where plans say, in two engines; what is wrong shows."""

import itertools
import json
import math
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from long_cases import cases
from long_chains import chain_problem
from robot_samples import PAIR, inertial, joint, robot_text

import floatplan as fp
from floatplan.plans.reading import load_record
from floatplan.simulation.replay import replays

PERTURBED = ("mass=2%", "inertia=2%", "h=1%,torque=1%,rise=5%")
EVERY_OTHER = {("handstand", "mass=2%"), ("handstand", PERTURBED[2]), *(("branched", one) for one in PERTURBED[1:])}
PROBLEMS = Path(__file__).parents[2] / "problems"
NAMES = sorted(path.stem for path in PROBLEMS.glob("*.toml"))
GALLERY = sorted(f"gallery/{path.stem}" for path in (PROBLEMS / "gallery").glob("*.toml"))
FLOWN = {
    "falling_cat",
    "handstand",
    "high_jump",
    "obstacle_hard",
    "somersault",
}  # every time


@pytest.mark.parametrize("name", cases([*NAMES, *GALLERY], {*NAMES, *GALLERY} - FLOWN))
def test_every_problem_lands_where_its_plan_says(planned, name):
    plan = planned(name)
    flown = fp.replay(plan)
    assert flown.landed
    assert flown.orientation_error < 1e-8
    assert max(flown.position_error) < 1e-8
    assert flown.com_error < 1e-9
    assert flown.momentum_drift < 1e-9
    assert max(flown.growth.orientation.max(), flown.growth.joints.max(), flown.growth.com.max()) < 1e-8


def test_sensitivity_is_the_derivative_of_the_orientation(handstand):
    record, step = handstand.record, 1e-5
    ends = []
    for sign in (-1.0, 1.0):
        momentum = record.angular_momentum + sign * step
        moved = replace(handstand, angular_momentum=momentum)
        ends.append(moved.final_orientation)
    expected = (ends[1] - ends[0]) / (2 * step)
    assert fp.replay(record).orientation_sensitivity == pytest.approx(expected, rel=1e-7)


def test_a_wrong_momentum_at_takeoff_turns_the_base_as_the_sensitivity_says(handstand):
    flown = fp.replay(handstand, perturb="h=0.1%", feedback=100.0)
    expected = 1e-3 * abs(handstand.angular_momentum) * flown.orientation_sensitivity
    assert flown.orientation_error == pytest.approx(expected, rel=0.05)
    assert flown.disturbed
    assert not flown.landed


def test_feedback_helps_against_wrong_masses_and_motors(handstand):
    open_loop = fp.replay(handstand, perturb="mass=2%,torque=2%")
    tracked = fp.replay(handstand, perturb="mass=2%,torque=2%", feedback=40.0)
    assert max(tracked.position_error) < 0.1 * max(open_loop.position_error)
    assert tracked.momentum_drift < 1e-9
    assert open_loop.growth.orientation[0] < open_loop.growth.orientation[-1]


def test_each_of_many_replays_has_the_next_seed(handstand):
    first, second = replays(handstand, 2, 3, math.inf, perturb="mass=2%")
    assert second.orientation_error == fp.replay(handstand, perturb="mass=2%", seed=4).orientation_error
    assert second.orientation_error != first.orientation_error


@pytest.mark.long
def test_a_chain_of_20_joints_lands_with_feedback_alone():
    plan = fp.plan(chain_problem(20))
    assert plan.ok, plan.explanation
    assert plan.final_orientation == pytest.approx(1.0, abs=1e-9)
    open_loop, tracked = fp.replay(plan), fp.replay(plan, feedback=30.0)
    assert open_loop.growth.joints[0] < 1e-6 < open_loop.growth.joints[-1]
    assert tracked.landed


@pytest.mark.parametrize(
    "tampered",
    [
        lambda r: replace(r, coefficients=r.coefficients * (1.0 + 1e-5 * (np.arange(r.coefficients.shape[1]) == 4))),
        lambda r: replace(r, angular_momentum=r.angular_momentum * (1.0 + 1e-4)),
        lambda r: replace(r, orientation={**r.orientation, "goal": r.orientation["goal"] + 1e-5}),
        lambda r: replace(r, problem={**r.problem, "flight": {**r.problem["flight"], "duration": r.duration - 1e-4}}),
    ],
)
def test_tampered_plans_do_not_land(handstand, tampered):
    assert not fp.replay(tampered(handstand.record), handstand.robot).landed


CHAIN = robot_text(
    joint("one", "a", "b"),
    joint("two", "b", "c", "0 -1 0"),
    joint("roll", "a", "d", "1 0 0"),
    joint("side", "d", "e", "0 -1 0"),
    joint("slide", "c", "f", "0 0 1", kind="prismatic"),
    links="abcdef",
)
CHAIN = CHAIN.replace("</robot>", f'<link name="world">{inertial(0.2)}</link>{joint("tip", "f", "world")}</robot>')


@pytest.fixture(scope="module")
def branched(tmp_path_factory):
    path = tmp_path_factory.mktemp("branched") / "robot.urdf"
    path.write_text(CHAIN)
    coupled = {"side": fp.Coupling("two", -0.5, 0.2)}
    locked = {"roll": 0.0, "slide": 0.05, "tip": 0.4}
    robot = fp.Robot.from_urdf(path, plane="xz", joints=["one", "two"], coupled=coupled, locked=locked)
    problem = fp.Problem(
        robot,
        start=fp.Posture(0.3, [0.2, -0.4]),
        goal=fp.Posture(-0.7, [1.0, 0.8]),
        flight=fp.Flight(duration=0.7, takeoff=fp.Takeoff("a")),
        limits=fp.Limits(position="full"),
    )
    return fp.plan(problem)


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_coupled_joints_are_driven_and_locked_ones_are_rigid(branched, engine):
    assert branched.ok
    flown = fp.replay(branched, engine=engine)
    assert flown.orientation_error < 1e-8
    assert max(flown.position_error) < 1e-8


class TestInput:
    def test_without_mujoco_the_error_names_the_command(self, handstand, monkeypatch):
        monkeypatch.setitem(sys.modules, "mujoco", None)
        with pytest.raises(fp.InputError, match=r"pip install .*\[replay\]"):
            fp.replay(handstand, engine="mujoco")

    @pytest.mark.parametrize("case", cases(itertools.product(("handstand", "branched"), PERTURBED), EVERY_OTHER))
    def test_both_engines_fly_the_same_perturbed_robot(self, case, request):
        name, perturb = case
        plan = request.getfixturevalue(name)
        one, other = (
            fp.replay(plan, engine=engine, perturb=perturb, seed=3, step=1e-3) for engine in ("pinocchio", "mujoco")
        )
        assert one.orientation_error > 1e-4
        assert one.orientation_error == pytest.approx(other.orientation_error, rel=1e-5)
        np.testing.assert_allclose(one.position_error, other.position_error, rtol=1e-5)
        if name == "handstand":  # gains hold joints of the other
            assert other.spatial.orientation_error == pytest.approx(one.orientation_error, rel=1e-2)


class TestCommand:
    def test_lands(self, floatplan, handstand):
        plan = handstand.save("plan.json")
        run = floatplan("replay", plan, "--json")
        assert run.code == 0, run
        content = json.loads(run.stdout)
        keys = {"engine", "orientation_error", "position_error", "com_error", "momentum_drift"}
        assert keys | {"orientation_sensitivity", "seconds", "growth", "landed"} <= set(content)
        assert content["orientation_error"] < 1e-8
        assert len(content["position_error"]) == 2
        assert "landed" in floatplan("replay", plan).stdout

    def test_is_kept_when_asked_for(self, floatplan, handstand):
        plan = handstand.save("plan.json")
        assert floatplan("replay", plan, "--save").code == 0
        assert load_record(plan).replay["landed"] is True
        assert fp.load_plan(plan).record.replay["engine"] == "pinocchio"

    def test_missing_the_goal_is_a_failed_check(self, floatplan, handstand):
        record = replace(handstand.record, angular_momentum=handstand.angular_momentum + 0.01)
        run = floatplan("replay", record.save("plan.json"))
        assert run.code == 1
        assert "missed the goal" in run.stdout

    def test_bad_input(self, floatplan, handstand):
        plan = handstand.save("plan.json")
        for arguments in (("--engine", "bullet"), ("--perturb", "x=1"), ("--urdf", "nowhere.urdf")):
            run = floatplan("replay", plan, *arguments)
            assert run.code == 2, run
            assert "error" in run.stderr


@pytest.fixture(scope="module")
def sides(tmp_path_factory):
    """Plans of a body with a pair of limbs, by the mass of the right hip's link: 0.6 kg is symmetric."""

    @cache
    def planned(mass):
        path = tmp_path_factory.mktemp("sides") / "robot.urdf"
        text = robot_text(f'<link name="body">{inertial(2.0, "0 0 0")}</link>', PAIR)
        right = text.index("right_hip_link")
        path.write_text(text[:right] + text[right:].replace('mass value="0.6"', f'mass value="{mass}"', 1))
        coupled = {"right_hip": "left_hip", "right_knee": "left_knee"}
        robot = fp.Robot.from_urdf(path, coupled=coupled)
        flight = fp.Flight(0.5, angular_momentum="free")
        plan = fp.plan(fp.Problem(robot, fp.Posture(0.2, 0.3), fp.Posture(1.0, [0.8, -0.5]), flight))
        assert plan.ok
        return plan

    return planned


class TestInSpace:
    """MuJoCo with a free joint and every joint of the URDF: what the plane leaves out shows, and nothing else."""

    @pytest.fixture(autouse=True)
    def nothing_is_left_behind(self, tmp_path, monkeypatch):
        """MuJoCo writes its warnings to a file in the working directory."""
        monkeypatch.chdir(tmp_path)
        yield
        assert not (tmp_path / "MUJOCO_LOG.TXT").exists()

    def test_a_symmetric_robot_neither_rolls_nor_yaws(self, sides):
        landing = fp.replay(sides(0.6), engine="mujoco").spatial
        assert max(abs(landing.roll), abs(landing.yaw)) < 1e-10
        assert max(landing.orientation_error, *landing.position_error, landing.com_error) < 1e-8
        assert set(landing.held) == {"left_hip", "left_knee", "right_hip", "right_knee"}

    def test_one_heavier_on_a_side_does_by_its_leak(self, sides):
        """Twice the difference, twice the roll and yaw; on the other side, the other way."""
        turns = []
        for mass in (0.6006, 0.5988):
            landing = fp.replay(sides(mass), engine="mujoco", step=2e-3).spatial
            turns.append(np.array([landing.roll, landing.yaw]))
        assert np.abs(turns[0]).max() > 1e-5
        assert turns[1] == pytest.approx(-2 * turns[0], rel=0.02)

    def test_it_is_pinocchio_s_free_flyer(self, sides):
        """The same torques and gains on Pinocchio's model of the file, integrated by SciPy."""
        from scipy.integrate import solve_ivp
        from scipy.interpolate import BarycentricInterpolator

        plan = sides(0.65)
        landing = fp.replay(plan, engine="mujoco", feedback=30.0, step=1e-3).spatial
        model = pin.buildModelFromUrdf(str(plan.robot.path), pin.JointModelFreeFlyer())
        model.gravity.linear = -9.81 * plan.robot.plane.vertical
        data, start = model.createData(), plan.q(0.0)
        inverse = np.linalg.inv(crba(model, start))[6:, 6:]
        inertia = 1.0 / np.diagonal(inverse)

        knots = plan.duration * (1 - np.cos(np.pi * np.arange(81) / 80)) / 2
        planned = [quantity(knots) for quantity in (plan.q, plan.v, plan.tau)]
        of_plan = BarycentricInterpolator(knots, np.concatenate(planned, axis=1))  # asked for thousands of instants

        def rate(time, state):
            q, v = pin.integrate(model, start, state[: model.nv]), state[model.nv :]
            wanted_q, wanted_v, tau = np.split(of_plan(min(time, plan.duration)), (model.nq, model.nq + model.nv))
            tau[6:] += inertia * (30.0**2 * (wanted_q[7:] - q[7:]) + 60.0 * (wanted_v[6:] - v[6:]))
            exp = pin.dIntegrate(model, start, state[: model.nv], pin.ARG1)
            return np.concatenate((np.linalg.solve(exp, v), pin.aba(model, data, q, v, tau)))

        began = np.concatenate((np.zeros(model.nv), plan.v(0.0)))
        ended = solve_ivp(rate, (0, plan.duration), began, method="DOP853", rtol=1e-8, atol=1e-9).y[:, -1]
        landed = pin.integrate(model, start, ended[: model.nv])
        wanted = pin.Quaternion(plan.q(plan.duration)[3:7]).matrix()
        turn = pin.log3(pin.Quaternion(landed[3:7]).matrix() @ wanted.T)
        plane = plan.robot.plane
        assert landing.roll == pytest.approx(turn @ plane.horizontal, abs=1e-7)
        assert landing.yaw == pytest.approx(turn @ plane.vertical, abs=1e-7)
        assert landing.orientation_error == pytest.approx(abs(turn @ plane.normal), abs=1e-7)
        assert abs(landing.yaw) > 1e-3
        assert landing.com_error < 1e-9

    def test_the_command_tells(self, floatplan, sides):
        plan = sides(0.65).save("plan.json")
        content = json.loads(floatplan("replay", plan, "--engine", "mujoco", "--json").stdout)
        assert {"roll", "yaw", "orientation_error", "position_error", "held"} <= set(content["spatial"])
        assert "roll " in floatplan("replay", plan, "--engine", "mujoco", "--step", "5e-3").stdout
        assert json.loads(floatplan("replay", plan, "--json").stdout)["spatial"] is None


def crba(model, q):
    matrix = pin.crba(model, model.createData(), q)
    return np.triu(matrix) + np.triu(matrix, 1).T
