"""What ``init`` asks of a second search where the links of the first flight overlap."""

from pathlib import Path

import numpy as np
import pytest

import floatplan as fp
from floatplan.initial.separation import MOST_PAIRS, STEP, open_range, separated
from floatplan.plans.overlaps import overlaps

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def problem():
    robot = fp.Robot.from_urdf(ROOT / "urdf" / "gymnast.urdf")
    ends = fp.Posture(0.0, [0.1, 0.2]), fp.Posture(0.4, [0.3, 0.1])
    return fp.Problem(robot, *ends, fp.Flight(1.0, gravity=0.0))


def through(*postures):
    """Positions that go through postures, evenly, in a second."""
    known = np.array(postures)
    times = np.linspace(0.0, 1.0, len(known))
    return lambda at: np.stack([np.interp(at, times, column) for column in known.T], axis=1)


@pytest.mark.parametrize("joint", [0, 1])
def test_the_range_ends_where_neighbours_meet(problem, joint):
    """To a degree; beyond it they overlap, on either side."""
    for end in open_range(problem, joint):
        assert abs(end) < np.pi - 3 * STEP
        for beyond, count in ((0.0, 0), (1.5 * STEP, 1)):
            posture = np.zeros(2)
            posture[joint] = end + np.sign(end) * beyond
            assert len(overlaps(problem.robot, through(np.zeros(2), posture), 1.0)) == count


def test_neighbours_have_ranges_and_others_a_distance(problem):
    folded = through([0.0, 0.0], [0.0, 3.1], [2.2, 2.2])
    assert {each.joint for each in overlaps(problem.robot, folded, 1.0)} == {None, "q2"}
    apart = separated(problem, folded, 1.0)
    assert apart is not None
    (pair,) = apart.self_clearances
    assert set(pair.links) == {"body0", "body2"}
    assert pair.margin == pytest.approx(2 * 0.055 * 0.4)
    assert np.abs(apart.position_limits).max() < np.pi - 3 * STEP
    assert separated(apart, through([0.0, 0.0], [0.3, 0.4]), 1.0) is None


def test_nothing_is_asked_of_a_motion_without_overlaps(problem):
    assert separated(problem, through([0.0, 0.0], [1.0, -1.0]), 1.0) is None
    assert MOST_PAIRS >= 1
