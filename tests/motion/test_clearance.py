"""How deep a link is in an obstacle; distances of links that are apart: ``tests/plans/test_plan.py``."""

from __future__ import annotations

import numpy as np
import pytest

import floatplan as fp
from floatplan.motion.planar.clearance import LinkShapes, obstacle_distances
from floatplan.robot import LinkCapsule


@pytest.fixture
def depth(gymnast: fp.Robot):
    """Distance of a link of radius 0 from (-1, 0) to (1, 0) to a bar."""
    shapes, angles = LinkShapes(gymnast.tree, (LinkCapsule("link", 0, 0j, 2 + 0j, 0.0),)), np.zeros((1, 3))
    link = shapes.place(-1 - shapes.place(np.zeros(1, dtype=complex), angles).start[:, 0], angles)
    return lambda bar: float(obstacle_distances(link, bar, np.zeros(1))[0, 0])


def test_it_is_the_shortest_way_out_by_an_end(depth) -> None:
    assert depth(fp.Bar(start=(0.6, -0.5), end=(0.6, 0.8), radius=0.1)) == pytest.approx(-0.4 - 0.1)
    assert depth(fp.Bar(start=(0.1, -0.2), end=(0.1, 0.8), radius=0.1)) == pytest.approx(-0.2 - 0.1)


def test_it_falls_continuously_as_a_bar_is_taken_off(depth) -> None:
    places = np.linspace(0.6, 1.6, 201)
    values = [depth(fp.Bar(start=(x, -0.5), end=(x, 0.8), radius=0.1)) for x in places]
    assert np.diff(values) == pytest.approx(0.005, abs=1e-12)
