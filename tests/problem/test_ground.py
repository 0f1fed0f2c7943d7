"""The ground, asked for or measured, and what a plan does to the URDF's limits: warnings beside the verdict."""

import json
from dataclasses import replace

import numpy as np
import pytest
from long_cases import cases
from places import ROOT
from robot_samples import inertial, joint, robot_text
from true_heights import lowest_by_link

import floatplan as fp

KEYS = {"kind", "subject", "value", "limit", "unit", "instant", "message"}


@pytest.fixture(scope="module")
def handstand():
    """From the foot to the hand; all links above the ground."""
    return fp.load_problem(ROOT / "problems" / "handstand.toml")


@pytest.fixture(scope="module")
def backflip():
    """A Go2's, without obstacles and limits."""
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

    def test_without_gravity_there_is_no_ground(self, sinking):
        plan = fp.plan(replace(sinking, flight=replace(sinking.flight, gravity=0.0)))
        assert "ground" not in kinds(plan)

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

    def test_a_foot_that_moves_down_is_refused(self, gymnast):
        """A fall: it lands a metre below where it took off, sooner than gravity alone would take it there."""
        flight = fp.Flight(0.2, takeoff=fp.Takeoff("foot"), landing=fp.Landing("foot", -1.0))
        upright = fp.Posture(np.pi / 2, [0.0, 0.0])
        problem = fp.Problem(gymnast, upright, upright, flight, ground=True, limits=fp.Limits(position="full"))
        with pytest.raises(fp.InputError, match="moves down into the ground at takeoff"):
            fp.plan(problem)
        assert fp.plan(replace(problem, ground=False)).ok


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


class TestTrueShapes:
    """The line and what rests on it touch corners, rims and vertices, not the capsules around them."""

    @pytest.mark.parametrize("foot", cases(FEET, {"cylinder across", "box"}))
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
    @pytest.mark.parametrize("foot", cases(FEET, FEET.keys() - {"cylinder aslant", "mesh"}))
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
