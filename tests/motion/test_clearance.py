"""Distances between capsules and obstacles, against the nearest of very many points."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import floatplan as fp
from floatplan.motion.planar.clearance import LinkShapes, obstacle_distances, pair_distances
from floatplan.problem.parts import Obstacle
from floatplan.robot import LinkCapsule

TIMES = np.array([0.0, 0.3, 1.1, 2.0])
AWAY = 0.5 + 0.2j  # m
ALONG = np.linspace(0, 1, 2001)
SPACING = 0.5 / 2000 * 3  # m: neighbouring points of a link are no further apart

OBSTACLES = {
    "circle": fp.Circle(center=(0.8, 0.4), radius=0.15, margin=0.3),
    "moving circle": fp.Circle(center=(0.8, 0.4), radius=0.15, velocity=(-0.3, 0.5)),
    "half-plane": fp.HalfPlane(point=(0.1, -0.9), normal=(0.3, 2.0)),
    "moving half-plane": fp.HalfPlane(point=(0.1, -0.9), normal=(0.3, 2.0), velocity=(0.2, -0.7)),
    "capsule": fp.Bar(start=(0.7, -0.3), end=(0.9, 0.9), radius=0.05),
    "moving capsule": fp.Bar(start=(0.7, -0.3), end=(0.9, 0.9), radius=0.05, velocity=(0.4, 0.1)),
    "capsule of no length": fp.Bar(start=(0.7, -0.3), end=(0.7, -0.3), radius=0.05),
}


def shapes_of(robot, radius=0.04):
    """The links' capsules, made thick, ready to be placed."""
    capsules = [LinkCapsule(shape.link, shape.body, shape.start, shape.end, radius) for shape in robot.shapes]
    return LinkShapes(robot.tree, tuple(capsules))


def placed(robot, seed, **options):
    rng = np.random.default_rng(seed)
    com = rng.uniform(-0.5, 0.5, len(TIMES)) + 1j * rng.uniform(-0.5, 0.5, len(TIMES))
    angles = rng.uniform(-7, 7, (len(TIMES), len(robot.tree.mass)))
    return SimpleNamespace(shapes=shapes_of(robot, **options), com=com, angles=angles)


def points_on(segments):
    """Points (K, S, 2001) along the segments."""
    return segments.start[..., None] + ALONG * (segments.end - segments.start)[..., None]


def depth(obstacle: Obstacle, points, times):
    """Distance of points (K, ...) from the obstacle's surface, from first principles."""
    shift = (complex(*obstacle.velocity) * times).reshape(-1, *[1] * (points.ndim - 1))
    points = points - shift
    if isinstance(obstacle, fp.Circle):
        return np.abs(points - complex(*obstacle.center)) - obstacle.radius
    if isinstance(obstacle, fp.HalfPlane):
        normal = np.array(obstacle.normal) / np.hypot(*obstacle.normal)
        offset = points - complex(*obstacle.point)
        return normal[0] * offset.real + normal[1] * offset.imag
    start, end = complex(*obstacle.start), complex(*obstacle.end)
    on_bar = start + np.linspace(0, 1, 401) * (end - start)
    return np.abs(points[..., None] - on_bar).min(axis=-1) - obstacle.radius


@pytest.mark.parametrize("name", OBSTACLES)
def test_distance_is_that_of_the_nearest_point(gymnast, name):
    obstacle = OBSTACLES[name]
    for seed in range(3):
        case = placed(gymnast, seed)
        segments = case.shapes.place(case.com, case.angles)
        found = obstacle_distances(segments, obstacle, TIMES)
        if isinstance(obstacle, fp.HalfPlane):  # a row per end
            found = np.minimum(found[:, :3], found[:, 3:])
        nearest = depth(obstacle, points_on(segments)[:, :, :: 1 if "capsule" not in name else 10], TIMES).min(axis=-1)
        spacing = SPACING if "capsule" not in name else 20 * SPACING
        apart = found > 0.05 if isinstance(obstacle, fp.Bar) else np.ones_like(found, dtype=bool)
        assert apart.any()
        difference = (nearest - 0.04 - found)[apart]
        assert difference.min() > -1e-12
        assert difference.max() < spacing


def pair_of(case, angles):
    """Segments of the robot, and of one that moves as it does half a metre away: neighbours do not always touch."""
    return case.shapes.place(case.com, angles), case.shapes.place(case.com + AWAY, angles)


def test_distance_of_a_pair_is_that_of_the_nearest_points(any_robot):
    case = placed(any_robot, 5)
    first, second = pair_of(case, case.angles)
    found = pair_distances(first, second)
    count = len(case.shapes.links)
    assert found.shape == (4, count**2)
    a, b = (points_on(segments)[:, :, ::40] for segments in (first, second))
    nearest = np.abs(a[:, :, None, :, None] - b[:, None, :, None, :]).min(axis=(3, 4)).reshape(4, -1)
    apart = found > -0.08 + 1e-9  # links that cross: TestOverlap
    assert apart.sum() > 2
    difference = (nearest - 0.08 - found)[apart]
    assert difference.min() > -1e-12
    assert difference.max() < np.abs(first.end - first.start).max() / 50


class TestOverlap:
    """A link of radius 0 from (-1, 0) to (1, 0)."""

    @pytest.fixture
    def link(self, gymnast):
        shapes = LinkShapes(gymnast.tree, (LinkCapsule("link", 0, 0j, 2 + 0j, 0.0),))
        angles = np.zeros((1, 3))
        return shapes.place(-1 - shapes.place(np.zeros(1, dtype=complex), angles).start[:, 0], angles)

    def distance(self, link, obstacle):
        return float(obstacle_distances(link, obstacle, np.zeros(1))[0, 0])

    def test_is_the_shortest_way_out_by_an_end(self, link):
        assert self.distance(link, fp.Bar(start=(0.6, -0.5), end=(0.6, 0.8), radius=0.1)) == pytest.approx(-0.4 - 0.1)
        assert self.distance(link, fp.Bar(start=(0.1, -0.2), end=(0.1, 0.8), radius=0.1)) == pytest.approx(-0.2 - 0.1)

    def test_distance_grows_continuously_as_a_bar_is_drawn_off(self, link):
        places = np.linspace(0.6, 1.6, 201)
        values = [self.distance(link, fp.Bar(start=(x, -0.5), end=(x, 0.8), radius=0.1)) for x in places]
        assert np.diff(values) == pytest.approx(0.005, abs=1e-12)
