"""Distances of links to one another, and how deep one is in an obstacle; when apart: ``tests/plans/test_plan.py``."""

import numpy as np
import pytest

import floatplan as fp
from floatplan.motion.planar.clearance import LinkShapes, Segments, obstacle_distances, pair_distances
from floatplan.robot import LinkCapsule


@pytest.fixture
def depth(gymnast):
    """Distance of a link of radius 0 from (-1, 0) to (1, 0) to a bar."""
    shapes, angles = LinkShapes(gymnast.tree, (LinkCapsule("link", 0, 0j, 2 + 0j, 0.0),)), np.zeros((1, 3))
    link = shapes.place(-1 - shapes.place(np.zeros(1, dtype=complex), angles).start[:, 0], angles)
    return lambda bar: float(obstacle_distances(link, bar, np.zeros(1))[0, 0])


def test_it_is_the_shortest_way_out_by_an_end(depth):
    assert depth(fp.Bar(start=(0.6, -0.5), end=(0.6, 0.8), radius=0.1)) == pytest.approx(-0.4 - 0.1)
    assert depth(fp.Bar(start=(0.1, -0.2), end=(0.1, 0.8), radius=0.1)) == pytest.approx(-0.2 - 0.1)


def test_it_falls_continuously_as_a_bar_is_taken_off(depth):
    places = np.linspace(0.6, 1.6, 201)
    values = [depth(fp.Bar(start=(x, -0.5), end=(x, 0.8), radius=0.1)) for x in places]
    assert np.diff(values) == pytest.approx(0.005, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_distance_of_a_pair_is_that_of_its_nearest_points(seed):
    """Of three capsules and two others half a metre away, every pair a row, less both radii."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-0.3, 0.3, (2, 4, 5)) + 1j * rng.uniform(-0.3, 0.3, (2, 4, 5))
    ends[..., 3:] += 0.9 + 0.4j
    radii = rng.uniform(0.01, 0.05, 5)
    both = Segments(*ends, radii)
    found = pair_distances(both.of(slice(3)), both.of(slice(3, None)))
    along = np.linspace(0, 1, 101)
    points = ends[0][..., None] + along * (ends[1] - ends[0])[..., None]
    nearest = np.abs(points[:, :3, None, :, None] - points[:, None, 3:, None, :]).min(axis=(3, 4)).reshape(4, 6)
    off = nearest - np.add.outer(radii[:3], radii[3:]).ravel() - found
    apart = found > 0
    assert apart.sum() > 12
    assert off[apart].min() > -1e-12
    assert off[apart].max() < 0.02
