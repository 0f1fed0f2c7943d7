"""Obstacles of flights in space, links that keep apart, and the ground: kept, seen by others, or refused."""

from dataclasses import replace

import coal
import numpy as np
import pytest
from obstructed_in_space import least_seen, obstructed, obstructed_problem
from places import SPACE
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.motion.spatial.clearance import SpatialSegments, pair_distances_in_space
from floatplan.plans.record import check_requested
from floatplan.robot.shapes.solid_capsules import solid_capsules
from floatplan.robot.shapes.solids import LinkSolid

AT_EDGE = 1e-7  # [m] that a clearance may be below its margin between instants
DENSE = 2001


@pytest.fixture(scope="module")
def diver():
    return fp.load_problem(SPACE / "diver_half_twist.toml")


@pytest.fixture(scope="module")
def past_a_bar(planned):
    return planned("space/diver_past_a_bar")


class TestDistances:
    """NumPy's distances against Coal's, of capsules that are apart; deep inside, a box is left by its nearest face."""

    @pytest.mark.parametrize("kind", ["sphere", "capsule", "half-space", "capsules"])
    @pytest.mark.parametrize("seed", range(30))
    def test_of_capsules(self, kind, seed):
        rng = np.random.default_rng(seed)
        start, end, *others = rng.normal(size=(4, 3))
        if seed % 5 == 0:
            end = start + 2 * (others[1] - others[0])  # parallel
        own, turned = _as_coal(start, end, 0.1)
        segments = SpatialSegments(start[None, None], end[None, None], np.array([0.1]))
        if kind == "sphere":
            found = segments.distances(fp.Sphere(center=tuple(others[0]), radius=0.2), np.zeros(1))
            other = coal.Sphere(0.2), coal.Transform3s(np.eye(3), others[0])
        elif kind == "half-space":
            found = segments.distances(fp.HalfSpace(point=tuple(others[0]), normal=tuple(others[1])), np.zeros(1))
            normal = others[1] / np.linalg.norm(others[1])
            other = coal.Halfspace(normal, 0.0), coal.Transform3s(np.eye(3), others[0])
        else:
            other = _as_coal(*others, 0.2)
            if kind == "capsule":
                bar = fp.Capsule(start=tuple(others[0]), end=tuple(others[1]), radius=0.2)
                found = segments.distances(bar, np.zeros(1))
            else:
                ends = (each[None, None] for each in others)
                found = pair_distances_in_space(segments, SpatialSegments(*ends, np.array([0.2])))
        expected = coal.distance(own, turned, *other, coal.DistanceRequest(), coal.DistanceResult())
        if expected > 0:
            assert found.min() == pytest.approx(expected, abs=1e-6)
        else:
            assert found.min() < 1e-6

    @pytest.mark.parametrize("seed", range(30))
    def test_of_a_box_is_no_more_than_the_true_one(self, seed):
        rng = np.random.default_rng(seed)
        start, end, middle = rng.normal(size=(3, 3))
        size = rng.uniform(0.1, 1.0, 3)
        segments = SpatialSegments(start[None, None], end[None, None], np.array([0.1]))
        found = segments.distances(fp.Box(center=tuple(middle), size=tuple(size)), np.zeros(1)).item()
        box = coal.Box(*size), coal.Transform3s(np.eye(3), middle)
        expected = coal.distance(*_as_coal(start, end, 0.1), *box, coal.DistanceRequest(), coal.DistanceResult())
        assert found <= expected + 1e-6
        ends = (middle + np.array([along, 0.0, 2.0 + along])[None, None] for along in (0.0, 1.0))
        facing = SpatialSegments(*ends, np.array([0.1]))
        straight = facing.distances(fp.Box(center=tuple(middle), size=tuple(size)), np.zeros(1)).item()
        assert straight == pytest.approx(2.0 - size[2] / 2 - 0.1, abs=1e-12)


def _as_coal(start, end, radius):
    along = end - start
    turned = Rotation.align_vectors([along], [[0, 0, 1]])[0].as_matrix()
    return coal.Capsule(radius, float(np.linalg.norm(along))), coal.Transform3s(turned, (start + end) / 2)


class TestShapes:
    """Capsules hold the solids that they are around, and are those of balls and bars themselves."""

    @pytest.mark.parametrize("seed", range(20))
    def test_hold_the_solid(self, seed):
        rng = np.random.default_rng(seed)
        points = rng.normal(size=(int(rng.integers(1, 30)), 3)) * rng.uniform(0.05, 1.0, 3)
        turned = Rotation.random(random_state=seed).as_matrix()
        lengths = (np.zeros(3), np.full(3, 0.1), np.array([0.2, 0.2, 0.0]), np.array([0.3, 0.2, 0.1]))[seed % 4]
        solid = LinkSolid("link", 1, points, turned * lengths)
        capsules = solid_capsules((solid,))
        weights = rng.dirichlet(np.full(len(points), 0.3), 500)
        inside = rng.normal(size=(500, 3))
        inside /= np.linalg.norm(inside, axis=1, keepdims=True)
        sampled = weights @ points + inside @ solid.axes.T
        depth = np.max([capsule.depth(sampled) for capsule in capsules], axis=0)
        assert depth.min() > -1e-9


class TestPlans:
    """What is asked holds between the instants of the search, as others see it."""

    def test_past_a_bar(self, past_a_bar, planned):
        problem, duration = past_a_bar.problem, past_a_bar.duration
        assert past_a_bar.status == "optimal"
        times = np.linspace(0, duration, DENSE)
        for obstacle in problem.obstacles:
            assert past_a_bar.clearances(times, [obstacle]).min() > obstacle.margin - AT_EDGE
        assert past_a_bar.peaks.clearance == pytest.approx(past_a_bar.clearances(times).min(), abs=1e-5)
        assert least_seen(past_a_bar, DENSE) > 0
        unobstructed = planned("space/diver_half_twist")
        assert unobstructed.clearances(times, problem.obstacles[:1]).min() < 0
        assert np.isinf(past_a_bar.clearances(np.array([1.0]), problem.obstacles[1:])).all()  # it is gone

    def test_past_a_bar_is_proved(self, past_a_bar):
        assert fp.certify(past_a_bar).proved

    @pytest.mark.long
    def test_links_keep_apart(self, planned):
        plan = planned("space/go2_half_twist_clear")
        assert plan.ok
        assert least_seen(plan, DENSE) > 0
        assert not [warning for warning in plan.warnings if warning.kind == "overlap"]

    def test_links_of_which_nothing_is_asked_are_warned_of_where_they_overlap(self, planned):
        overlaps = [w for w in planned("space/go2_half_twist").warnings if w.kind == "overlap"]
        assert {warning.subject for warning in overlaps} == {"FR_calf RR_calf", "FL_calf RL_calf"}
        assert all("[[self_clearance]] keeps them apart" in warning.message for warning in overlaps)

    @pytest.mark.long
    def test_drawn_problems_are_solved_and_clear(self):
        problems = list(obstructed(4))
        plans = [fp.plan(problem) for problem in problems]
        assert sum(plan.ok for plan in plans) >= 3
        assert min(least_seen(plan, 2000) for plan in plans if plan.ok) > 0

    def test_two_dips_between_two_instants_of_a_look_are_both_clear(self):
        """A UR5's forearm comes near the ball twice within 0.17 s of a flight of 20 s."""
        plan = fp.plan(obstructed_problem(39))
        assert plan.ok
        near = plan.clearances(np.linspace(13.5, 14.0, DENSE)) - plan.problem.obstacles[0].margin
        assert ((near[1:-1] < near[:-2]) & (near[1:-1] < near[2:])).sum() >= 2
        assert near.min() > 0

    def test_an_obstacle_on_the_start_is_said_to_be_impossible(self, diver):
        on_the_feet = fp.Sphere(center=(0.0, 0.0, 0.0), radius=0.1)
        plan = fp.plan(replace(diver, obstacles=(on_the_feet,)))
        assert not plan.ok
        assert "At takeoff the start itself is impossible: clearance of legs to obstacle 0 (sphere)" in plan.explanation

    def test_they_are_kept_by_files(self, past_a_bar, tmp_path):
        path = past_a_bar.save(tmp_path / "plan.json")
        again = fp.load_plan(path)
        assert again.problem.obstacles == past_a_bar.problem.obstacles
        assert again.record.clearance_min == past_a_bar.record.clearance_min
        check_requested(again.record)
        file = fp.save_problem(past_a_bar.problem, tmp_path / "problem.toml")
        assert fp.load_problem(file).obstacles == past_a_bar.problem.obstacles


class TestGround:
    """Where it is, what keeps above it, and what cannot leave it."""

    def test_links_stay_above_it(self):
        plan = fp.plan(replace(fp.load_problem(SPACE / "go2_half_twist.toml"), ground=True))
        assert plan.ok
        heights, links = plan.whole.heights(np.linspace(0, plan.duration, 1001))
        assert heights.min() > -AT_EDGE
        assert "RL_foot" in links
        assert plan.whole.heights(np.zeros(1))[0].min() == pytest.approx(0, abs=1e-9)
        assert plan.whole.heights(np.array([plan.duration]))[0].min() == pytest.approx(0, abs=1e-9)

    def test_the_landing_link_rests_on_it_where_no_height_is_given(self, diver):
        problem = replace(diver, ground=True, flight=replace(diver.flight, landing=fp.Landing("legs")))
        turned = replace(problem, goal=replace(problem.goal, orientation=fp.Attitude(angles=(0.4, 0, 0), axes="yxz")))
        plan = fp.plan(replace(turned, flight=replace(turned.flight, angular_momentum=(0, 0.5, 0))))
        height = plan.whole.heights(np.array([plan.duration]))[0].min()
        assert height == pytest.approx(0, abs=1e-9)
        assert turned.landing_height != problem.landing_height

    def test_what_moves_down_at_takeoff_is_refused(self, diver):
        spinning = replace(diver.flight, angular_momentum=(0.0, 0.0, 0.0), gravity=9.81, duration=0.05)
        sinking = replace(diver, ground=True, flight=spinning, start=replace(diver.start, velocities=0.0))
        down = replace(sinking, flight=replace(spinning, landing=fp.Landing("feet", -0.5)))
        with pytest.raises(fp.InputError, match="moves down into the ground at takeoff, at"):
            fp.plan(down)


def test_links_that_are_lines_need_a_margin(root):
    robot = fp.Robot.from_urdf(root / "urdf" / "acrobat.urdf", base="free-flyer")
    links = sorted({capsule.link for capsule in robot.solid_capsules})
    level = fp.Attitude(quaternion_xyzw=(0, 0, 0, 1))
    posture = fp.Posture(level, robot.position_limits.mean(axis=1).clip(-1, 1))
    problem = fp.Problem(robot, posture, posture, fp.Flight(1.0, 0.0))
    with pytest.raises(fp.InputError, match="are lines, which never touch in space; give a margin"):
        replace(problem, self_clearances=(fp.SelfClearance((links[0], links[-1])),))
    replace(problem, self_clearances=(fp.SelfClearance((links[0], links[-1]), margin=0.01),))
