"""Plans whose files are read back: of coupled legs, and of a tree with joints of every kind."""

import jumps
import numpy as np
import pytest
from robot_samples import PAIR, RandomTree, inertial, robot_text

import floatplan as fp


@pytest.fixture(scope="session")
def flown():
    """The plan of a robot between postures drawn at random."""

    def flown(robot):
        start, goal = np.random.default_rng(0).uniform(-0.6, 0.6, (2, len(robot.joints)))
        flight = fp.Flight(0.8, angular_momentum="free", horizontal_velocity=0.4)
        plan = fp.plan(fp.Problem(robot, fp.Posture(0.2, start), fp.Posture(1.0, goal), flight))
        assert plan.ok, plan.explanation
        return plan

    return flown


@pytest.fixture(scope="session")
def coupled(flown, tmp_path_factory):
    """Two legs that move together, the right one with its own names: what a quadruped's are."""
    path = tmp_path_factory.mktemp("robot") / "pair.urdf"
    path.write_text(robot_text(f'<link name="body">{inertial(2.0, "0 0 0")}</link>', PAIR))
    return flown(fp.Robot.from_urdf(path, coupled={"right_hip": "left_hip", "right_knee": "left_knee"}))


@pytest.fixture(scope="session")
def tree(flown, tmp_path_factory):
    """Turned frames, fixed, sliding, continuous and off-plane joints between: a locked slide is there in metres.

    Its last joint follows the first one the other way round.
    """
    drawn = RandomTree(1260, "y", joints=7)
    path = tmp_path_factory.mktemp("robot") / "tree.urdf"
    path.write_text(drawn.text)
    first, *_, last = fp.Robot.from_urdf(path, plane="xz", locked=drawn.locked).joints
    coupled = {last: fp.Coupling(first, -0.7, 0.3)}
    return flown(fp.Robot.from_urdf(path, plane="xz", locked=drawn.locked, coupled=coupled))


@pytest.fixture(scope="module")
def jump():
    return jumps.backflip()
