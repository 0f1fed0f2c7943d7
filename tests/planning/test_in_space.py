"""Plans of flights in space: twists, rolls within limits, an arm on a free base; their files, replays and refusals."""

import copy
import functools
import json
import math
import operator
import re
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT, SPACE
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.motion.spatial.rotations import logarithm
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.tables import ORIENTATION


@pytest.fixture(scope="module")
def half_twist(planned):
    return planned("space/diver_half_twist")


def test_half_a_twist_is_made_by_the_arms(half_twist):
    plan = half_twist
    assert plan.ok, plan.explanation
    assert plan.certificate.proved, plan.certificate.unproved
    assert plan.certificate.attitude_bound < 1e-9
    assert plan.out_of_plane is None
    angles = plan.whole.angles("yxz")
    assert angles[-1] == pytest.approx([2 * math.pi, 0, math.pi], abs=1e-8)
    assert plan.whole.missed < ORIENTATION
    assert np.abs(angles[:, 1]).max() < math.radians(70)
    assert 0.1 < plan.objective_value < 2
    ends, problem = plan.at([0.0, plan.duration]), plan.problem
    for index, end in enumerate((problem.initial, problem.final)):
        assert ends.positions[index] == pytest.approx(end.positions, abs=1e-9)
        assert ends.velocities[index] == pytest.approx(end.velocities, abs=1e-9)
        assert ends.accelerations[index] == pytest.approx(end.accelerations, abs=1e-9)
    momentum = plan.at(np.linspace(0, plan.duration, 23)).angular_momentum
    assert np.abs(momentum - plan.angular_momentum).max() < 1e-9


def test_its_file_is_read_back_bit_for_bit_and_changes_are_seen(half_twist, tmp_path):
    path = half_twist.save(tmp_path / "plan.json")
    content = json.loads(path.read_text())
    assert content["format"] == "floatplan.plan/2"
    assert content["robot"]["base"] == "free-flyer"
    assert content["orientation"]["goal"]["quaternion_xyzw"] == pytest.approx([0, 0, 1, 0], abs=1e-12)
    again = fp.load_plan(path)
    times = np.linspace(0, again.duration, 7)
    for name, values in vars(half_twist.at(times)).items():
        assert np.array_equal(values, getattr(again.at(times), name)), name
    assert again.problem.final.attitude == half_twist.problem.final.attitude
    for key, value, named in (
        ("format", "floatplan.plan/1", "angular_momentum"),
        ("angular_momentum", 1.0, "angular_momentum"),
        ("angular_momentum", [1.0, 2.0], "angular_momentum"),
        ("angular_momentum_bounds", [0.0, 1.0], "angular_momentum_bounds"),
        ("orientation", {"start": 0.0, "end": 1.0, "goal": 2.0}, "orientation"),
        ("orientation", {**content["orientation"], "start": {"quaternion_xyzw": [0, 0, 0, 0]}}, "must have length 1"),
        ("orientation", {**content["orientation"], "goal": {"quaternion_xyzw": [0, 0, 3, 4]}}, "must have length 1"),
        ("com", {**content["com"], "position0": [0.0, 0.0]}, "com"),
        ("robot", {**content["robot"], "base": "planar"}, "robot"),
    ):
        path.write_text(json.dumps({**content, key: value}))
        with pytest.raises(fp.InputError, match=named):
            fp.load_plan(path)


def test_it_lands_in_forward_dynamics_and_a_changed_one_does_not(half_twist, tmp_path):
    flown = fp.replay(half_twist)
    assert flown.landed
    assert flown.orientation_error < 1e-9
    assert flown.momentum_drift < 1e-9
    record = half_twist.record
    faster = replace(record, angular_momentum=1.001 * record.angular_momentum)
    with pytest.raises(fp.InputError, match=r"orientation\.end: is .* rad beside where the motion ends"):
        fp.replay(faster, half_twist.robot)


def _numbers(content, path=()):
    """Paths of one number under each key."""
    if isinstance(content, dict):
        for key, value in content.items():
            yield from _numbers(value, (*path, key))
    elif isinstance(content, list) and content:
        yield from _numbers(content[0], (*path, 0))
    elif type(content) in (int, float):
        yield path


def test_numbers_of_a_file_that_are_not_its_motion_s_are_refused(half_twist, tmp_path):
    """All that can be computed again, but what is so wherever it is told; a limit counts where it is not kept."""
    path = half_twist.save(tmp_path / "plan.json")
    content, passed = json.loads(path.read_text()), set()
    for place in _numbers(
        {key: value for key, value in content.items() if key not in ("solver", "utilisation", "certificate")}
    ):
        changed = copy.deepcopy(content)
        *tables, last = place
        table = functools.reduce(operator.getitem, tables, changed)
        table[last] += 0.01 * max(1.0, abs(table[last]))
        path.write_text(json.dumps(changed))
        try:
            fp.load_plan(path)
        except fp.InputError:
            continue
        passed.add(".".join(map(str, place)))
    assert passed == {"problem.limits.position.0.0", "robot.resting.0"}
    turned = Rotation.from_quat(content["orientation"]["end"]["quaternion_xyzw"]) * Rotation.from_rotvec([0, 1e-4, 0])
    slower = {**content["problem"]["limits"], "velocity": (0.9 * half_twist.peaks.velocity).tolist()}
    for named, changed in (
        (
            "orientation.end",
            {"orientation": {**content["orientation"], "end": {"quaternion_xyzw": turned.as_quat().tolist()}}},
        ),
        ("ok: is true", {"problem": {**content["problem"], "limits": slower}}),
    ):
        path.write_text(json.dumps({**content, **changed}))
        with pytest.raises(fp.InputError, match=named):
            fp.load_plan(path)


def test_an_arm_turns_its_free_base_within_its_limits(request):
    plan = request.getfixturevalue("planned")("space/free_ur5")
    assert plan.ok, plan.explanation
    assert plan.angular_momentum == pytest.approx([0, 0, 0])
    assert (plan.peaks.velocity <= plan.problem.velocity_limits * (1 + 1e-9)).all()
    assert (plan.peaks.motor_torque <= plan.problem.motor_torque_limits * (1 + 1e-9)).all()
    turned = logarithm(plan.whole.attitudes(np.array([0.0, plan.duration])))
    assert np.linalg.norm(turned[1]) == pytest.approx(math.radians(60), abs=1e-4)


@pytest.mark.usefixtures("little_work")
def test_a_search_that_finds_nothing_says_so_and_ends():
    """Two joints about one axis cannot turn the base about another."""
    robot = fp.Robot.from_urdf(ROOT / "urdf" / "gymnast.urdf", base="free-flyer")
    level, aside = fp.Attitude(quaternion_xyzw=(0, 0, 0, 1)), fp.Attitude(quaternion_xyzw=(0.3, 0, 0, 1))
    problem = fp.Problem(robot, fp.Posture(level, 0.1), fp.Posture(aside, 0.1), fp.Flight(1.0, 0.0))
    found = planned(problem, SearchOptions())
    assert not found.plan.ok
    assert "misses the goal's orientation" in found.plan.explanation


@pytest.mark.usefixtures("little_work")
def test_a_motion_that_makes_other_turns_is_said_to():
    """Without momentum there is no somersault, and half a twist alone ends next to where it should."""
    problem = fp.load_problem(SPACE / "diver_half_twist.toml")
    found = planned(replace(problem, flight=replace(problem.flight, angular_momentum=0)), SearchOptions())
    assert not found.plan.ok
    assert "it makes other turns than are asked for" in found.plan.explanation


def somersaults(turns, **changes):
    """Ask the diver for more of them than fit a guess of the whole flight at once."""
    problem = fp.load_problem(SPACE / "diver_half_twist.toml")
    goal = fp.Attitude(angles=(2 * math.pi * turns, 0, math.pi * turns), axes="yxz")
    return replace(problem, goal=replace(problem.goal, orientation=goal), **changes)


def test_two_somersaults_are_closed_in_finer_cells_too():
    plan = fp.plan(somersaults(2))
    assert plan.ok, plan.explanation
    assert plan.solver["starts"] == 1
    assert plan.whole.angles("yxz")[-1] == pytest.approx([4 * math.pi, 0, 2 * math.pi], abs=1e-8)


@pytest.mark.parametrize("momentum", [(1e5, 0, 0), "suggested"])
def test_what_turns_too_fast_is_refused(momentum):
    problem = somersaults(150 if momentum == "suggested" else 1)
    with pytest.raises(fp.InputError, match=r"flight\.angular_momentum: turns the robot too fast"):
        fp.plan(replace(problem, flight=replace(problem.flight, angular_momentum=momentum)))


@pytest.mark.parametrize("momentum", [0, "free"])
def test_what_ends_as_it_begins_may_stay_as_it_is(momentum):
    problem = fp.load_problem(SPACE / "free_ur5.toml")
    flight = replace(problem.flight, angular_momentum=momentum)
    plan = fp.plan(replace(problem, goal=problem.start, flight=flight))
    assert plan.ok, plan.explanation
    assert plan.objective_value == pytest.approx(0, abs=1e-9)


def test_where_the_given_momentum_leads_to_no_plan_another_is_named_that_does():
    problem = fp.load_problem(SPACE / "go2_barrel_roll.toml")
    still = replace(problem.flight, angular_momentum=0.0)
    asked = replace(problem, motion=fp.Motion(degree=5), flight=still, limits=fp.Limits())
    plan = fp.plan(asked)
    assert not plan.ok
    (named,) = re.findall(r"With flight.angular_momentum = \[(.*)\] kg m\^2/s a plan was found", plan.explanation)
    h = tuple(map(float, named.split(",")))
    assert fp.plan(replace(asked, motion=fp.Motion(), flight=replace(still, angular_momentum=h))).ok


@pytest.mark.parametrize("momentum", ["free", "suggested"])
def test_what_never_leaves_a_plane_is_planned_within_limits_too(momentum):
    """Two of the three turns at landing nothing changes: they are no equalities."""
    robot = fp.Robot.from_urdf(ROOT / "urdf" / "gymnast.urdf", base="free-flyer")
    start, goal = (fp.Attitude(angles=(angle, 0, 0), axes="yxz") for angle in (0.0, 2 * math.pi))
    ends = fp.Posture(start, 0.1), fp.Posture(goal, [0.4, -0.3])
    problem = fp.Problem(robot, *ends, fp.Flight(1.0, momentum), fp.Motion(degree=9), fp.Limits(velocity=4.0))
    wide, plan = fp.plan(replace(problem, limits=fp.Limits())), fp.plan(problem)
    assert wide.ok
    assert plan.ok, plan.explanation
    tight = replace(problem, limits=fp.Limits(velocity=(0.95 * wide.peaks.velocity).tolist()))
    within = fp.plan(tight)
    assert within.ok, within.explanation
    assert (within.peaks.velocity <= tight.velocity_limits * (1 + 1e-9)).all()
    assert within.objective_value >= wide.objective_value * (1 - 1e-9)


def test_ctrl_c_ends_a_search_with_the_nearest_motion(monkeypatch):
    from floatplan.planning import in_space

    follow, followed = in_space.SpatialSearch._follow_lifted, []

    def interrupted(search, start, *bounds):
        followed.append(start)
        if len(followed) > 1:
            raise KeyboardInterrupt
        return follow(search, start, *bounds)

    monkeypatch.setattr(in_space.SpatialSearch, "_follow_lifted", interrupted)
    robot = fp.Robot.from_urdf(ROOT / "urdf" / "gymnast.urdf", base="free-flyer")
    level, aside = fp.Attitude(quaternion_xyzw=(0, 0, 0, 1)), fp.Attitude(quaternion_xyzw=(0.3, 0, 0, 1))
    plan = fp.plan(fp.Problem(robot, fp.Posture(level, 0.1), fp.Posture(aside, 0.1), fp.Flight(1.0, 0.0)))
    assert plan.status == "interrupted"
    assert "was interrupted" in plan.explanation


def test_a_file_whose_motion_is_too_wild_is_told_in_one_line(half_twist, tmp_path, floatplan):
    path = half_twist.save(tmp_path / "plan.json")
    path.write_text(json.dumps({**json.loads(path.read_text()), "angular_momentum": [1e13, 0.0, 0.0]}))
    with pytest.raises(fp.FloatplanError, match="the motion is too wild to be integrated"):
        fp.load_plan(path).at(0.1)
    for command in ("export", "replay"):
        run = floatplan(command, path, *(["-f", "csv", "-o", tmp_path / "out.csv"] if command == "export" else []))
        assert run.code == 1
        assert "too wild" in run.stderr
        assert len(run.stderr.splitlines()) == 1
    assert not (tmp_path / "out.csv").exists()
