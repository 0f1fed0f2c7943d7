from dataclasses import replace

import numpy as np
import pytest
from places import ROOT

import floatplan as fp
from floatplan.studio import edits


@pytest.fixture(scope="module")
def problem():
    return fp.load_problem(ROOT / "problems" / "obstacle.toml")


@pytest.mark.parametrize("key", ["velocity", "torque"])
def test_limits_by_hand_begin_with_what_the_motion_needs(problem, key):
    needed = {joint: 2.0 + index for index, joint in enumerate(problem.robot.motors)}
    changed = edits.limit(key, edits.BY_HAND, needed)(problem)
    assert edits.limit_choice(changed, key) == edits.BY_HAND
    for joint in problem.robot.joints:
        assert edits.limit_of(changed, key, joint) == pytest.approx(edits.AMPLE * needed[joint])
    back = edits.limit(key, "none", needed)(changed)
    assert edits.limit_choice(back, key) == "none"
    assert np.isinf(edits.limit_of(back, key, problem.robot.joints[0]))


def test_a_leader_s_limit_is_set_with_those_of_its_followers(tmp_path):
    from robot_samples import RandomTree

    tree = RandomTree(38, "y", joints=7)
    path = tmp_path / "random.urdf"
    path.write_text(tree.text)
    coupled = {"joint2": fp.Coupling("joint1", -0.7, 0.4)}
    robot = fp.Robot.from_urdf(path, plane="xz", locked=tree.locked, coupled=coupled)
    paths = edits.limit_paths(robot, "torque", "joint1")
    assert paths == ("limits.torque.joint1", "limits.torque.joint2")
    still = fp.Posture(0.0, robot.resting)
    problem = fp.Problem(robot, still, still, fp.Flight(1.0), limits=fp.Limits(torque=30.0))
    changed = edits.numbers(dict.fromkeys(paths, 12.5))(problem)
    limits = dict(zip(robot.motors, changed.motor_torque_limits.tolist(), strict=True))
    assert {name: limit for name, limit in limits.items() if limit != 30.0} == {"joint1": 12.5, "joint2": 12.5}


@pytest.mark.parametrize(
    "obstacle",
    [
        fp.Circle(center=(1.0, 2.0), radius=0.1, margin=0.02),
        fp.Bar(start=(0.0, 1.0), end=(1.0, 1.5), radius=0.1, velocity=(0.1, 0.0)),
        fp.HalfPlane(point=(0.0, -3.0), normal=(0.0, 1.0)),
    ],
)
def test_obstacles_are_added_moved_and_taken_away(problem, obstacle):
    far = edits.moved(obstacle, 50 + 60j)
    more = edits.with_obstacle(far)(problem)
    assert more.obstacles[-1] is far
    last = len(more.obstacles) - 1
    put = edits.put_obstacle(last, edits.moved(far, -1 + 2j))(more)
    places = [getattr(put.obstacles[-1], name) for name in obstacle.places()]
    first = [getattr(obstacle, name) for name in obstacle.places()]
    assert np.allclose(np.array(places) - np.array(first), [49.0, 62.0])
    assert replace(put.obstacles[-1], **dict(zip(obstacle.places(), first, strict=True))) == obstacle
    assert edits.put_obstacle(last)(put).obstacles == problem.obstacles
