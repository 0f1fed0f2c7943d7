"""The ground, asked for or measured, and what a plan does to the URDF's limits: warnings beside the verdict."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from long_cases import cases
from robot_samples import inertial, joint, robot_text
from true_heights import lowest_by_link

import floatplan as fp
from floatplan.motion.planar.end_rates import motion_into_ground
from floatplan.robot.shapes.capsules import OUTSIDE, Outline, with_fewer_corners
from floatplan.robot.urdf.tree import robots_folder

ROOT = Path(__file__).resolve().parents[2]
KEYS = {"kind", "subject", "value", "limit", "unit", "instant", "message"}


@pytest.fixture(scope="module")
def handstand():
    """From the foot to the hand; all links above the ground."""
    return fp.load_problem(ROOT / "problems" / "handstand.toml")


@pytest.fixture(scope="module")
def backflip():
    """A Go2's, without obstacles and limits."""
    if robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    problem = fp.load_problem(ROOT / "problems" / "gallery" / "go2.toml")
    return replace(problem, obstacles=(), limits=fp.Limits())


@pytest.fixture(scope="module")
def sinking(backflip):
    """Too short a flight: its feet go down before they leave."""
    return replace(backflip, flight=replace(backflip.flight, duration=0.4))


@pytest.fixture(scope="module")
def sunk(sinking):
    return fp.plan(sinking, prove=True)


def kinds(plan):
    return [warning.kind for warning in plan.warnings]


class TestMeasured:
    def test_ground_is_measured_unasked(self, sunk):
        assert sunk.certificate.proved
        (warning,) = [warning for warning in sunk.warnings if warning.kind == "ground"]
        times = np.linspace(0, sunk.duration, 4001)
        lowest = sunk.clearances(times, [sunk.problem.ground_plane])
        assert warning.value == pytest.approx(lowest.min(), abs=1e-5)
        assert warning.value < -0.001
        assert times[np.argmin(lowest)] == pytest.approx(warning.instant, abs=1e-3)
        assert warning.subject in ("RL_foot", "RR_foot")
        assert "ground = true" in warning.message

    def test_a_plan_above_it_has_none(self, handstand):
        assert kinds(fp.plan(handstand)) == [
            "takeoff",
            "landing",
        ]  # fast, and on a stretched arm: no joint rates stop it

    def test_without_gravity_there_is_no_ground(self, sinking):
        plan = fp.plan(replace(sinking, flight=replace(sinking.flight, gravity=0.0)))
        assert "ground" not in kinds(plan)

    def test_a_frame_that_is_not_lowest_is_told_from_sinking(self, handstand):
        takeoff = fp.Takeoff("body1", (0.0, 1.0))
        plan = fp.plan(replace(handstand, flight=replace(handstand.flight, takeoff=takeoff, duration=0.9)))
        (message,) = [warning.message for warning in plan.warnings if warning.kind == "ground"]
        assert "flight.takeoff names" in message

    def test_limits_of_the_urdf(self, tmp_path):
        """Positions, rates, torques and a locked joint's holding torque, none of them asked for."""
        limits = '<limit lower="-1" upper="1" effort="0.5" velocity="2"/>'
        text = robot_text(
            joint("q1", "a", "b", kind="revolute").replace(
                '<limit lower="-1" upper="1" effort="5" velocity="7"/>', limits
            ),
            joint("q2", "b", "c", kind="revolute").replace('effort="5"', 'effort="0.01"'),
            links="abc",
        )
        path = tmp_path / "r.urdf"
        path.write_text(text)
        robot = fp.Robot.from_urdf(path, locked={"q2": 0.3})
        flight = fp.Flight(0.3)
        problem = fp.Problem(
            robot, fp.Posture(0.0, -1.1), fp.Posture(0.4, 1.1), flight, limits=fp.Limits(position={"q1": [-1.5, 1.5]})
        )
        plan = fp.plan(problem)
        assert plan.ok, plan.explanation
        found = {warning.kind: warning for warning in plan.warnings}
        assert {"position", "velocity", "torque", "holding_torque"} <= set(found)
        assert found["velocity"].value == pytest.approx(plan.peaks.velocity[0])
        assert found["velocity"].limit == 2.0
        assert found["torque"].value == pytest.approx(plan.peaks.motor_torque[0])
        assert found["position"].unit == "rad"
        times = np.linspace(0, plan.duration, 301)
        held = dict(zip(plan.full_motion(times).joints, plan.full_motion(times).torques.T, strict=True))["q2"]
        assert found["holding_torque"].value == pytest.approx(np.abs(held).max(), rel=1e-3)
        assert found["holding_torque"].subject == "q2"


class TestWritten:
    def test_into_the_file_and_back(self, sunk, tmp_path):
        path = sunk.save(tmp_path / "plan.json")
        content = json.loads(path.read_text())
        assert [warning["kind"] for warning in content["warnings"]] == kinds(sunk)
        assert all(set(warning) == KEYS for warning in content["warnings"])
        assert kinds(fp.load_plan(path)) == kinds(sunk)

    def test_none_is_an_empty_list(self, tmp_path):
        problem = fp.load_problem(ROOT / "problems" / "falling_cat_apart.toml")
        afloat = replace(problem, flight=replace(problem.flight, gravity=0.0))
        path = fp.plan(afloat).save(tmp_path / "plan.json")
        assert json.loads(path.read_text())["warnings"] == []

    def test_in_json_summary_and_report(self, sunk, floatplan, tmp_path):
        fp.save_problem(sunk.problem, tmp_path / "sinking.toml")
        run = floatplan("plan", tmp_path / "sinking.toml", "--json", "--report", "-o", tmp_path / "out")
        assert run.code == 0
        content = json.loads(run.stdout)
        assert [warning["kind"] for warning in content["warnings"]] == kinds(sunk)
        assert {row["joint"] for row in content["utilisation"]} == set(sunk.robot.motors)
        assert "with warnings" in run.stderr
        assert "below the ground" in " ".join(run.stderr.split())
        page = (tmp_path / "out" / "report.html").read_text()
        assert "proved, with warnings" in page
        certified = floatplan("certify", tmp_path / "out" / "plan.json")
        assert certified.code == 0

    @pytest.mark.usefixtures("little_work")
    def test_utilisation_is_worst_first(self, sunk):
        rows = sunk.utilisation
        assert [row.worst for row in rows] == sorted((row.worst for row in rows), reverse=True)
        assert rows[0].joint == "RL_calf_joint"
        assert rows[0].velocity_utilisation == pytest.approx(rows[0].velocity_peak / 15.7)
        assert rows[0].instant == rows[0].velocity_instant
        limits = fp.Limits(torque={"FL_thigh_joint": 2.0, "FR_thigh_joint": 5.0})
        weak = fp.plan(replace(sunk.problem, limits=limits))
        use = {row.joint: row for row in weak.utilisation}
        assert (use["FL_thigh_joint"].torque_limit, use["FR_thigh_joint"].torque_limit) == (2.0, 5.0)


class TestAsked:
    def test_the_line_goes_through_the_lowest_point_of_what_takes_off(self, tmp_path):
        ball = '<collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.05"/></geometry></collision>'
        links = f'<link name="a">{inertial()}</link><link name="b">{inertial()}{ball}</link>'
        path = tmp_path / "r.urdf"
        path.write_text(robot_text(links, joint("q", "a", "b", kind="revolute")))
        robot = fp.Robot.from_urdf(path, plane="xz")
        flight = fp.Flight(0.5, takeoff=fp.Takeoff("b", (0.0, 0.3)))
        hanging = -robot.plane.turn * np.pi / 2
        for orientation, low in ((0.0, 0.05), (hanging, 0.25), (-hanging, -0.15)):
            start = fp.Posture(orientation, 0.0)
            problem = fp.Problem(robot, start, start, flight)
            assert problem.ground_plane.point[1] == pytest.approx(0.3 - low, abs=1e-9)

    def test_a_landing_without_height_rests_on_it(self, handstand):
        flight = replace(handstand.flight, landing=fp.Landing("hand"))
        asked = replace(handstand, ground=True, flight=flight)
        assert asked.landing_height == pytest.approx(0.0, abs=1e-12)
        tilted = replace(asked, goal=fp.Posture(-np.pi / 2, [0.0, 0.4]))
        assert tilted.landing_height == pytest.approx(0.0, abs=1e-12)  # the hand's link hangs down to its tip
        plain = replace(asked, ground=False)
        assert plain.landing_height == 0.0

    def test_it_is_kept_and_proved(self, backflip):
        resting = replace(backflip.flight, landing=fp.Landing("RL_foot"))
        plan = fp.plan(replace(backflip, ground=True, flight=resting), prove=True)
        assert plan.certificate.proved, plan.explanation
        assert "ground" in {finding.label for finding in plan.certificate.findings}
        assert "ground" not in kinds(plan)

    @pytest.mark.usefixtures("little_work")
    def test_a_free_momentum_that_takes_the_foot_down_is_told(self, sinking):
        plan = fp.plan(replace(sinking, ground=True))
        assert not plan.ok
        assert "moves down into the ground at takeoff" in plan.explanation

    def test_a_plan_below_it_is_refuted(self, sunk, tmp_path):
        content = sunk.record.to_dict()
        content["problem"]["ground"] = True
        path = tmp_path / "plan.json"
        path.write_text(json.dumps(content))
        certificate = fp.certify(path)
        assert certificate.verdict == "refuted"
        (finding,) = [finding for finding in certificate.findings if finding.label == "ground"]
        (warning,) = [warning for warning in sunk.warnings if warning.kind == "ground"]
        assert finding.bound == pytest.approx(warning.value, abs=1e-5)

    def test_problem_files_hold_it(self, handstand, tmp_path):
        fp.save_problem(replace(handstand, ground=True), tmp_path / "p.toml")
        assert "ground = true" in (tmp_path / "p.toml").read_text()
        assert fp.load_problem(tmp_path / "p.toml").ground

    def test_a_foot_that_moves_down_is_refused(self, gymnast):
        """A fall: it lands a metre below where it took off, sooner than gravity alone would take it there."""
        flight = fp.Flight(0.2, takeoff=fp.Takeoff("foot"), landing=fp.Landing("foot", -1.0))
        upright = fp.Posture(np.pi / 2, [0.0, 0.0])
        problem = fp.Problem(gymnast, upright, upright, flight, ground=True, limits=fp.Limits(position="full"))
        with pytest.raises(fp.InputError, match="moves down into the ground at takeoff"):
            fp.plan(problem)
        assert fp.plan(replace(problem, ground=False)).ok

    @pytest.mark.parametrize(("digits", "refused"), [(6, False), (3, True)])
    def test_a_foot_at_rest_but_for_the_digits_of_a_file_is_not_refused(self, root, digits, refused):
        """Rates with six digits are off by what takes a foot less than the clearances' tolerance into the ground."""
        problem = fp.load_problem(root / "problems" / "backflip.toml")
        settled = fp.plan(problem).problem
        ends = [settled.initial, settled.final]
        off = 2.0 * 10.0 ** -(digits - 1)  # rad/s, about half of the last digit of 20 rad/s: towards the ground
        signs = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
        refusals = []
        for sign in signs:
            start, goal = (
                fp.Posture(end.orientation, end.positions, end.velocities + off * np.array(sign)) for end in ends
            )
            try:
                plan = fp.plan(replace(problem, start=start, goal=goal), prove=True)
            except fp.InputError as error:
                refusals.append(str(error))
                continue
            assert plan.certificate.proved
        assert bool(refusals) is refused
        assert all("the ground at" in refusal for refusal in refusals)

    def test_a_foot_that_rises_is_not(self, handstand):
        assert motion_into_ground(replace(handstand, ground=True), np.array([-1.17])) == []


FEET = {
    "box": ('<box size="0.3048 0.3048 0.3048"/>', "0 0.2 0"),
    "cylinder": ('<cylinder radius="0.08" length="0.2"/>', "0 0 0"),
    "cylinder across": ('<cylinder radius="0.08" length="0.3"/>', "1.5707963267948966 0 0"),
    "cylinder aslant": ('<cylinder radius="0.03" length="0.2"/>', "0.7 0.4 0"),
    "sphere": ('<sphere radius="0.06"/>', "0 0 0"),
    "mesh": ('<mesh filename="foot.stl"/>', "0 0.3 0"),
}
ROUNDED = {"cylinder aslant": 2e-4}  # [m] by which a rim seen aslant is taken outside; all others are exact


def gymnast_with_foot(root, folder, foot):
    """A gymnast whose foot has a shape, and whose hand is a small cube."""
    import trimesh

    folder.mkdir(exist_ok=True)
    trimesh.creation.icosphere(subdivisions=2, radius=0.09).apply_scale([1.5, 1.0, 0.6]).export(folder / "foot.stl")
    geometry, turned = FEET[foot]
    text = (root / "urdf" / "gymnast.urdf").read_text()
    for link, shape, rpy in (("foot", geometry, turned), ("hand", '<box size="0.04 0.04 0.04"/>', "0 0 0")):
        collision = f'<collision><origin xyz="0.01 0 0.02" rpy="{rpy}"/><geometry>{shape}</geometry></collision>'
        text = text.replace(f'<link name="{link}"/>', f'<link name="{link}">{collision}</link>')
    path = folder / "robot.urdf"
    path.write_text(text)
    return fp.Robot.from_urdf(path)


def handstand_of(robot, handstand, **changes):
    flight = replace(handstand.flight, landing=fp.Landing("hand", changes.pop("height", None)))
    return replace(handstand, robot=robot, flight=flight, limits=fp.Limits(position="full"), **changes)


@pytest.mark.parametrize("foot", FEET)
class TestTrueShapes:
    """The line and what rests on it touch corners, rims and vertices, not the capsules around them."""

    def test_the_line_and_the_landing(self, root, tmp_path, handstand, foot):
        problem = handstand_of(gymnast_with_foot(root, tmp_path, foot), handstand, ground=True)
        plan = fp.plan(problem, prove=True)
        assert plan.certificate is not None, plan.explanation
        assert plan.certificate.proved, plan.certificate
        line, off = problem.ground_plane.point[1], ROUNDED.get(foot, 0.0)
        heights = lowest_by_link(plan, np.linspace(0.0, plan.duration, 2001))
        assert -1e-7 <= heights["foot"][0] - line <= off + 1e-7
        assert heights["hand"][-1] == pytest.approx(line, abs=1e-6)
        assert min(each.min() for each in heights.values()) >= line - 1e-6

    @pytest.mark.usefixtures("little_work")
    def test_a_depth_is_told_in_full(self, root, tmp_path, handstand, foot):
        """A hand that lands below the sole, as deep as the warning says, is refuted where the ground is asked for."""
        robot = gymnast_with_foot(root, tmp_path, foot)
        resting = handstand_of(robot, handstand, ground=True).landing_height
        plan = fp.plan(handstand_of(robot, handstand, height=resting - 0.0078))
        (warning,) = [each for each in plan.warnings if each.kind == "ground"]
        heights = lowest_by_link(plan, np.linspace(0.0, plan.duration, 2001))
        deepest = min(heights, key=lambda link: heights[link].min())
        true = heights[deepest].min() - heights["foot"][0]
        assert true < -0.0077
        assert -1.1e-3 <= warning.value - true <= ROUNDED.get(foot, 0.0) + 1e-6
        asked = replace(plan.problem, ground=True)
        assert not fp.plan(asked).ok


@pytest.mark.parametrize("name", cases(["go2", "g1", "talos"], {"g1", "talos"}))
def test_real_robots_warn_of_true_depths(root, name):
    if robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    problem = fp.load_problem(root / "problems" / "gallery" / f"{name}.toml")
    plan = fp.plan(replace(problem, obstacles=(), limits=fp.Limits()))
    heights = lowest_by_link(plan, np.linspace(0.0, plan.duration, 2001), robots_folder().parent.parent)
    standing = plan.robot.contact_link(plan.problem.takeoff_frame.link)
    line = heights[standing][0]
    assert problem.ground_plane.point[1] == pytest.approx(line, abs=1e-6)
    true = min(each.min() for each in heights.values()) - line
    told = min((each.value for each in plan.warnings if each.kind == "ground"), default=0.0)
    assert true - 1.1e-3 <= told <= min(true, 0.0) + 1e-6


@pytest.mark.parametrize("seed", cases(range(6), range(2, 6)))
def test_fewer_corners_hold_the_hull(seed):
    rng = np.random.default_rng(seed)
    hull = Outline.convex(0.2 * (rng.normal(size=400) + 1j * rng.normal(size=400)))
    outer = with_fewer_corners(hull)
    assert len(outer.points) <= len(hull.points)
    directions = np.exp(2j * np.pi * np.arange(3600) / 3600)
    reach = [(directions.conj()[:, None] * each.points).real.max(axis=1) for each in (hull, outer)]
    assert (reach[1] - reach[0]).min() > -1e-12
    assert (reach[1] - reach[0]).max() <= OUTSIDE
    disc = with_fewer_corners(Outline.convex(0.1 * np.exp(2j * np.pi * np.arange(720) / 720)))
    assert len(disc.points) < 40
