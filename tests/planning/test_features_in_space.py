"""What flights in a plane know goes together in space: couplings, locks, motors, files, threads; or is refused."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import SPACE, URDF
from robot_samples import inertial

import floatplan as fp

LEVEL = fp.Attitude(angles=(0, 0, 0), axes="xyz")
TILTED = fp.Attitude(angles=(0.1, -0.1, 0.05), axes="xyz")
FINE = np.linspace(0, 1, 41)


def body(name, parent, kind, axis, place, extra=""):
    return (
        f'<link name="{name}">{inertial(1.2, "0 0 -0.2")}</link><joint name="to_{name}" type="{kind}">'
        f'<parent link="{parent}"/><child link="{name}"/><origin xyz="{place}"/><axis xyz="{axis}"/>{extra}'
        f'<limit lower="-1.5" upper="1.5" effort="200" velocity="60"/></joint>'
    )


def written(path, *bodies):
    trunk = f'<link name="trunk">{inertial(5.0, "0 0 0")}</link>'
    path.write_text(f'<robot name="drawn">{trunk}{"".join(bodies)}</robot>')
    return path


@pytest.fixture
def four(tmp_path):
    """A left and a right limb, a wheel, and one about an axis that is askew."""
    return written(
        tmp_path / "four.urdf",
        body("left", "trunk", "revolute", "1 0 0", "0 0.2 0"),
        body("right", "trunk", "revolute", "1 0 0", "0 -0.2 0"),
        body("neck", "trunk", "continuous", "0 1 0", "0 0 0.2"),
        body("head", "neck", "revolute", "0.6 0 0.8", "0.1 0 0"),
        body("tail", "trunk", "revolute", "0 0 1", "-0.2 0 0"),
    )


def asked(robot, momentum=0, goal=TILTED, **more):
    posture = np.clip(0.2, *robot.position_limits.T)
    takes_off = fp.Takeoff(robot.joint_tree.root, (0.1, 0.2, 0.3))
    flight = fp.Flight(0.9, momentum, takes_off, fp.Landing("head" if "head" in robot.frame_names else "trunk"))
    speed = replace(flight, horizontal_velocity=(0.4, -0.3))
    return fp.Problem(robot, fp.Posture(LEVEL, posture), fp.Posture(goal, posture), speed, **more)


def flies(plan, tmp_path):
    """Hold a plan to what every plan promises: its goal, its momentum, its file, and where its torques take it."""
    assert plan.ok, plan.explanation
    problem, times = plan.problem, FINE * plan.duration
    state = plan.at(times)
    assert plan.whole.missed < 1e-8
    assert np.abs(state.angular_momentum - plan.angular_momentum).max() < 1e-9
    assert state.base_position[0] == pytest.approx(problem.takeoff.position, abs=1e-12)
    assert np.diff(state.com_position[[0, -1], :2], axis=0)[0] == pytest.approx(
        plan.duration * np.array(problem.flight.horizontal_velocity)
    )
    for values, limits in (
        (state.velocities, problem.velocity_limits),
        (state.accelerations, problem.joint_limits["acceleration"]),
        (state.motor_torques, problem.motor_torque_limits),
    ):
        assert (np.abs(values) <= limits * (1 + 1e-9)).all()
    whole = plan.full_motion(times)
    for name, coupling in problem.robot.coupled.items():
        leader, follower = (whole.positions[:, whole.joints.index(each)] for each in (coupling.leader, name))
        assert follower == pytest.approx(coupling.ratio * leader + coupling.offset, abs=1e-12)
    for name, place in problem.robot.locked.items():
        assert whole.positions[:, whole.joints.index(name)] == pytest.approx(place, abs=1e-12)
    flown = fp.replay(plan)
    assert flown.landed
    assert flown.orientation_error < 1e-8
    again = fp.load_plan(plan.save(tmp_path / "plan.json"))
    for name, values in vars(state).items():
        assert np.array_equal(values, getattr(again.at(times), name)), name


def test_mirror_images_locks_rotors_and_motors_go_together(four, tmp_path):
    coupled = {"to_right": fp.Coupling("to_left", -1.0, 0.1)}
    robot = fp.Robot.from_urdf(four, base="free-flyer", coupled=coupled, locked={"to_head": 0.3}, armature=0.01)
    assert robot.joints == ("to_left", "to_neck", "to_tail")
    limits = fp.Limits(
        torque=150.0,
        velocity={"to_left": 40.0},
        motor={"to_tail": fp.Motor(stall=150.0, slope=0.5)},
        acceleration=4000.0,
        orientation_rate=12.0,
    )
    plan = fp.plan(asked(robot, limits=limits))
    flies(plan, tmp_path)
    state = plan.at(FINE * plan.duration)
    tail = robot.motors.index("to_tail")
    used = np.abs(state.motor_torques[:, tail]) + 0.5 * np.abs(state.velocities[:, robot.joints.index("to_tail")])
    assert used.max() <= 150.0 * (1 + 1e-9)
    assert np.linalg.norm(state.orientation_rate, axis=1).max() <= 12.0 * (1 + 1e-9)
    assert plan.holding_torques["to_head"][0] > 0
    bare = fp.Robot.from_urdf(four, base="free-flyer", coupled=coupled, locked={"to_head": 0.3})
    assert asked(bare).robot.armature != robot.armature


def test_what_slides_is_locked_in_metres_whatever_the_unit_of_angles(tmp_path, floatplan):
    path = written(
        tmp_path / "slide.urdf",
        body("left", "trunk", "revolute", "0 1 0", "0 0.2 0"),
        body("boom", "trunk", "prismatic", "0 0 1", "0 0 0.2"),
        body("neck", "boom", "revolute", "0 1 0", "0 0 0.2"),
    )
    wanted = pytest.approx({"to_boom": 0.3, "to_neck": math.radians(20)})
    for base in ("planar", "free-flyer"):
        locked = {"to_boom": 0.3, "to_neck": 20}
        assert dict(fp.Robot.from_urdf(path, base=base, locked=locked, angles="deg").locked) == wanted
        file = tmp_path / f"{base}.toml"
        held = "locked = { to_boom = 0.3, to_neck = 20 }"
        file.write_text(f'angles = "deg"\n[robot]\nurdf = "slide.urdf"\nbase = "{base}"\n{held}\n')
        run = floatplan("info", file, "--json")
        assert json.loads(run.stdout)["locked"] == wanted
    run = floatplan("info", path, "--locked", "to_boom=0.3,to_neck=20", "--degrees", "--json")
    assert json.loads(run.stdout)["locked"] == wanted
    with pytest.raises(fp.InputError, match="angles: must be 'rad' or 'deg', not 'turns'"):
        fp.Robot.from_urdf(path, angles="turns")


def test_robots_from_mjcf_fly_in_space_too(tmp_path):
    robot = fp.Robot.from_mjcf(URDF / "kangaroo.xml", base="free-flyer", locked={"tail": 0.3})
    plan = fp.plan(asked(robot, momentum="free", goal=fp.Attitude(angles=(0.1, 0.3, 0), axes="xyz")))
    flies(plan, tmp_path)
    assert plan.record.robot.mjcf


def test_a_family_varies_angles_durations_and_momenta():
    diver, arm = (fp.load_problem(SPACE / f"{name}.toml") for name in ("diver_half_twist", "free_ur5"))
    twists = fp.Family(diver, {"goal.orientation.angles.2": [math.pi, 2 * math.pi], "flight.duration": [1.4, 1.5]})
    assert twists[1].final.attitude.angles == pytest.approx((2 * math.pi, 0, 2 * math.pi))
    assert twists[1].flight.duration == 1.5
    given = replace(arm, flight=replace(arm.flight, angular_momentum=(0.0, 0.0, 0.0)))
    assert fp.Family(given, {"flight.angular_momentum.2": [0.0, 0.5]})[1].flight.angular_momentum == (0, 0, 0.5)
    with pytest.raises(fp.InputError, match=r"goal\.orientation\.angles\.0: is no number"):
        fp.Family(arm, {"goal.orientation.angles.0": [0.0, 1.0]})
    with pytest.raises(fp.InputError, match=r"goal\.orientation: must be an Attitude"):
        fp.Family(arm, {"goal.orientation": [0.0, 1.0]})[1]


def test_what_is_not_yet_in_space_says_so(tmp_path, floatplan, planned):
    arm = fp.load_problem(SPACE / "free_ur5.toml")
    with pytest.raises(fp.InputError, match=r"robot\.base: the robot flies in space"):
        fp.plan_many(fp.Family(arm, {"flight.duration": [18.0, 20.0]}))
    study = tmp_path / "study.toml"
    study.write_text(
        f'problem = "{SPACE / "free_ur5.toml"}"\n[vary]\n"flight.duration" = {{ from = 15, to = 25, count = 3 }}\n'
    )
    plan = planned("space/free_ur5").save(tmp_path / "plan.json")
    for command in (
        ("study", study),
        ("bounds", SPACE / "free_ur5.toml"),
        ("takeoff", SPACE / "free_ur5.toml"),
        ("launch", plan),
    ):
        run = floatplan(*command)
        assert (run.code, run.stdout) == (2, ""), command
        assert "space" in run.stderr or "gravity" in run.stderr
    assert not Path("runs").exists()
