import json
import math

import numpy as np
import pytest
from places import ROOT

import floatplan as fp
from floatplan.problem.file import problem_from_dict, problem_to_dict

PROBLEMS = sorted((ROOT / "problems").glob("*.toml"))
GYMNAST = ROOT / "urdf" / "gymnast.urdf"

SOUND = f"""
angles = "deg"
[robot]
urdf = "{GYMNAST}"
[start]
orientation = 72
positions = {{ q1 = 18, q2 = -45 }}
[goal]
orientation = -90
positions = {{ q1 = 0, q2 = 0 }}
[flight]
duration = 1.4
takeoff = {{ frame = "foot" }}
[limits]
position = "full"
"""

EVERYTHING = (
    (ROOT / "tests" / "problem" / "cases" / "everything.toml").read_text().replace("../../../urdf", f"{ROOT / 'urdf'}")
)


def written(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.fixture
def everything(tmp_path):
    return fp.load_problem(written(tmp_path / "everything.toml", EVERYTHING))


class TestWhatIsRead:
    def test_angles_become_radians_in_joint_order(self, everything):
        assert everything.robot.joints == ("q2", "q1")
        assert everything.initial.orientation == math.pi / 2
        assert everything.final.orientation == pytest.approx(2.5 * math.pi, rel=1e-15)
        np.testing.assert_allclose(everything.initial.positions, [math.pi / 6, -math.pi / 3], rtol=1e-15)
        np.testing.assert_allclose(everything.final.positions, [0, math.pi / 4], rtol=1e-15)
        np.testing.assert_allclose(everything.initial.velocities, [math.pi / 10] * 2, rtol=1e-15)
        np.testing.assert_allclose(everything.initial.accelerations, [0, math.pi / 5], rtol=1e-15)
        np.testing.assert_allclose(everything.velocity_limits, [4 * math.pi] * 2, rtol=1e-15)
        np.testing.assert_allclose(everything.joint_limits["acceleration"], [20 * math.pi, math.inf], rtol=1e-15)
        assert everything.limits.orientation_rate == pytest.approx(5 * math.pi, rel=1e-15)

    def test_limits(self, everything):
        np.testing.assert_allclose(
            everything.position_limits, [[-math.pi, math.pi], [-math.pi / 2, math.pi / 2]], rtol=1e-15
        )
        np.testing.assert_array_equal(everything.torque_limits, [12, math.inf])
        np.testing.assert_array_equal(everything.motor_stall, [math.inf, 8, 8])
        np.testing.assert_array_equal(everything.motor_slope, [0, 0.4, 0.4])

    def test_what_is_no_angle_stays_as_it_is(self, everything):
        assert everything.flight == fp.Flight(
            duration=1.25,
            angular_momentum="free",
            takeoff=fp.Takeoff("foot", (0.25, 0.5)),
            landing=fp.Landing("hand", -0.125),
            horizontal_velocity=-2.0,
            gravity=1.62,
        )
        assert everything.obstacles == (
            fp.Circle(center=(1.5, 3.0), radius=0.2, margin=0.02, velocity=(0.5, 0.0), window=(0.1, 0.9)),
            fp.HalfPlane(),
            fp.Bar(start=(0.0, 0.0), end=(1.0, 1.0), radius=0.0),
        )
        assert everything.self_clearances == (fp.SelfClearance(("body0", "body2"), 0.01),)
        assert everything.degrees == (8, 9)
        assert everything.name == "everything"

    def test_what_is_left_out_has_its_default(self, tmp_path):
        problem = fp.load_problem(written(tmp_path / "short.toml", SOUND))
        assert problem.name == "short"
        assert problem.flight.angular_momentum == "midpoint"
        assert problem.landing == fp.Landing("foot", 0.0)
        assert problem.degrees == (7, 7)
        assert not problem.initial.velocities.any()
        assert np.isinf(problem.torque_limits).all()

    def test_locked_and_coupled_joints_are_in_the_unit_of_the_file(self, tmp_path):
        choice = 'joints = ["q1"]\ncoupled = { q2 = { leader = "q1", ratio = -1, offset = 90 } }\n'
        text = SOUND.replace("[start]", choice + "[start]").replace(", q2 = -45", "").replace(", q2 = 0", "")
        coupled = fp.load_problem(written(tmp_path / "c.toml", text)).robot
        assert coupled.joints == ("q1",)
        assert coupled.coupled["q2"] == fp.Coupling("q1", -1.0, math.pi / 2)
        text = SOUND.replace("[start]", "locked = { q2 = 45 }\n[start]").replace(", q2 = -45", "")
        assert fp.load_problem(written(tmp_path / "l.toml", text.replace(", q2 = 0", ""))).robot.locked == {
            "q2": math.pi / 4
        }


@pytest.mark.parametrize("path", PROBLEMS, ids=lambda path: path.stem)
class TestRoundTripsOfTheProblems:
    def test_plain_data(self, path):
        problem = fp.load_problem(path)
        content = json.loads(json.dumps(problem_to_dict(problem), allow_nan=False))
        assert problem_to_dict(problem_from_dict(content, problem.robot)) == content

    def test_toml(self, path, tmp_path):
        problem = fp.load_problem(path)
        again = fp.load_problem(fp.save_problem(problem, tmp_path / "folder" / "again.toml"))
        assert problem_to_dict(again) == problem_to_dict(problem)
        assert again.robot.sha256 == problem.robot.sha256


class TestRoundTripsOfEveryKey:
    def test_plain_data(self, everything):
        content = problem_to_dict(everything)
        again = problem_from_dict(json.loads(json.dumps(content, allow_nan=False)), everything.robot)
        for name in ("position_limits", "velocity_limits", "torque_limits", "motor_stall", "motor_slope"):
            np.testing.assert_array_equal(getattr(again, name), getattr(everything, name))
        assert again.obstacles == everything.obstacles
        assert again.self_clearances == everything.self_clearances
        assert again.flight == everything.flight
        assert problem_to_dict(again) == content

    def test_toml(self, everything, tmp_path):
        again = fp.load_problem(fp.save_problem(everything, tmp_path / "again.toml"))
        assert problem_to_dict(again) == problem_to_dict(everything)

    def test_toml_with_choices_of_the_robot(self, tmp_path):
        robot = fp.Robot.from_urdf(GYMNAST, joints=["q1"], coupled={"q2": fp.Coupling("q1", 0.5, 0.1)})
        problem = fp.Problem(robot, fp.Posture(0, 0.2), fp.Posture(1, 0.4), fp.Flight(1.0))
        again = fp.load_problem(fp.save_problem(problem, tmp_path / "again.toml"))
        assert again.robot.joints == robot.joints
        assert dict(again.robot.coupled) == dict(robot.coupled)
        assert problem_to_dict(again) == problem_to_dict(problem)


WRONG = {
    "unknown key": (SOUND.replace("duration = 1.4", "duratoin = 1.4\nduration = 1.4"), "flight.duratoin", "'duration'"),
    "unknown kind of obstacle": (SOUND + '[[obstacles]]\nkind = "cube"\n', "obstacles[0]", "half-plane"),
    "missing joint": (SOUND.replace("q1 = 18, ", ""), "start.positions", "no value for joint 'q1'"),
    "unknown joint": (SOUND.replace("q1 = 0", "q1 = 0, q7 = 0"), "goal.positions", "'q7' is not a planned joint"),
    "wrong count": (SOUND.replace("{ q1 = 18, q2 = -45 }", "[1, 2, 3]"), "start.positions", "3 values for 2 joints"),
    "unknown frame": (SOUND.replace('"foot"', '"toe"'), "flight.takeoff.frame", "no frame 'toe'"),
    "start outside": (SOUND.replace('"full"', "{ q1 = [-10, 10] }"), "start.positions.q1", "outside the joint's range"),
    "moving on the edge": (
        SOUND.replace('"full"', "{ q1 = [-10, 18] }").replace("[goal]", "velocities = { q1 = 1 }\n[goal]"),
        "start.velocities.q1",
        "on the edge",
    ),
    "accelerating out of the edge": (
        SOUND.replace('"full"', "{ q1 = [18, 30] }")
        .replace("q1 = 0,", "q1 = 20,")
        .replace("[goal]", "accelerations = { q1 = -1 }\n[goal]"),
        "start.accelerations.q1",
        "points out of it",
    ),
    "low degree": (SOUND + "[motion]\ndegree = 4\n", "motion.degree", "4 is outside 5 to 15"),
    "unknown objective": (SOUND + '[motion]\nobjective = "beauty"\n', "motion.objective", "'torque'"),
    "reversed range": (SOUND.replace('"full"', "{ q1 = [90, -90] }"), "limits.position.q1", "is not below high"),
    "reversed window": (
        SOUND + '[[obstacles]]\nkind = "half-plane"\nwindow = [1, 0.5]\n',
        "obstacles[0].window",
        "before it begins",
    ),
    "unknown link": (SOUND + '[[self_clearance]]\nlinks = ["body0", "tail"]\n', "self_clearance[0].links", "'tail'"),
    "no TOML": (SOUND + "\n[goal\n", "", "is not TOML"),
    "twice the same key": (SOUND.replace("duration", "duration = 1\nduration"), "", "line"),
    "binary": (bytes(range(256)), "", "not a text file"),
    "empty": ("", "robot", "is missing"),
    "nested too deeply": ("a = " + "[" * 5000, "", "nested too deeply"),
}


@pytest.mark.parametrize(("text", "element", "reason"), WRONG.values(), ids=WRONG.keys())
class TestWrongFiles:
    def test_one_clear_error(self, text, element, reason, tmp_path):
        path = written(tmp_path / "wrong.toml", text)
        with pytest.raises(fp.InputError) as caught:
            fp.load_problem(path)
        lines = str(caught.value).splitlines()
        assert any(line.startswith(f"{path}: {element}") and reason in line for line in lines), lines


@pytest.mark.parametrize(
    ("changes", "more", "named"),
    [
        (
            {"1.4": '"x"', "q1 = 18": "q1 = nan", "-90": "true"},
            "[modes]\n",
            {"start.positions.q1", "goal.orientation", "flight.duration", "modes"},
        ),
        (
            {"1.4": "-1", '"foot"': '"toe"', "q1 = 0": "q9 = 0"},
            "torque = -1\n",
            {"goal.positions", "flight.takeoff.frame", "flight.duration", "limits.torque"},
        ),
    ],
)
def test_every_error_is_reported_with_its_place(changes, more, named, tmp_path):
    """Of kind, or of meaning."""
    text = SOUND
    for old, new in changes.items():
        text = text.replace(old, new)
    with pytest.raises(fp.InputError) as caught:
        fp.load_problem(written(tmp_path / "wrong.toml", text + more))
    assert {line.split(": ")[1] for line in str(caught.value).splitlines()} == named
