"""Extremes of D over the joint ranges, and the interval (9) of the angular momentum."""

import numpy as np
import pytest
from generated_problems import random_chain
from scipy.optimize import minimize

import floatplan as fp
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.robot.planar.inertia import inertia_extremes


def random_ranges(rng, n, widest=3.0):
    centre, half = rng.uniform(-2, 2, n), rng.uniform(0.1, widest, n)
    return np.stack((centre - half, centre + half), axis=1)


def true_minimum(function, ranges, points):
    """Least value over a box: the best of a grid, each of its lowest points followed downhill."""
    axes = [np.linspace(*limits, points) for limits in ranges]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, len(ranges))
    values = function(grid)
    lowest = grid[np.argsort(values)[:5]]
    tight = {"ftol": 1e-15, "gtol": 1e-12}
    found = [minimize(lambda q: function(q[None])[0], q, bounds=ranges, options=tight).fun for q in lowest]
    return min(values.min(), *found)


class TestExtremes:
    @pytest.mark.parametrize("seed", range(4))
    @pytest.mark.parametrize(("joints", "widest"), [(1, 3.0), (2, 3.0), (3, 1.0)])
    def test_are_exact_for_a_few_joints(self, joints, widest, seed):
        """Three joints with wider ranges exhaust ``MOST_WORK`` first."""
        rng = np.random.default_rng([seed, joints])
        robot = random_chain(rng, joints)
        ranges = random_ranges(rng, joints, widest)
        low, high = inertia_extremes(robot.tree, ranges)
        momentum_map = Dynamics(robot.tree).momentum_map
        for i in range(joints + 1):
            least = true_minimum(lambda q, i=i: momentum_map(q)[:, i], ranges, 21)
            largest = -true_minimum(lambda q, i=i: -momentum_map(q)[:, i], ranges, 21)
            assert least - 1e-6 < low[i] <= least + 1e-12
            assert largest - 1e-12 <= high[i] < largest + 1e-6


class TestInterval:
    """Of examples A and B: test_errata.py."""

    def test_is_7_8_9(self, gymnast):
        ranges = [[-1.0, 2.0], [-2.0, 1.0]]
        start, goal = fp.Posture(0.4, [1.5, -1.0]), fp.Posture(-2.0, [-0.5, 0.8])
        limits = fp.Limits(position=ranges)
        problem = fp.Problem(gymnast, start, goal, fp.Flight(duration=1.3), limits=limits)
        low, high = inertia_extremes(gymnast.tree, np.array(ranges))
        least = (-2.4 * high[0] - 2.0 * high[1] + 1.8 * low[2]) / 1.3
        largest = (-2.4 * low[0] - 2.0 * low[1] + 1.8 * high[2]) / 1.3
        assert problem.momentum_interval == pytest.approx((least, largest), rel=1e-14)
