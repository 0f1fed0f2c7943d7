"""Each motor's own torque: where joints are coupled, a leader and its followers are limited and proved one by one."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from proof_records import finding
from robot_samples import PAIR, inertial, robot_text

import floatplan as fp
from floatplan.problem.file import problem_from_dict, problem_to_dict

COUPLED = {"right_hip": fp.Coupling("left_hip", -0.7, 0.1), "right_knee": "left_knee"}
LEGS = PAIR.replace("0.1 0.2 0", "0.1 0 0").replace("0.1 -0.2 0", "0.1 0 0")  # in one plane: they may move apart
MIMIC = '<mimic joint="left_knee" multiplier="1" offset="0"/>'


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    file = tmp_path_factory.mktemp("robot") / "pair.urdf"
    file.write_text(robot_text(f'<link name="body">{inertial(2.0, "0 0 0")}</link>', LEGS))
    return file


@pytest.fixture(scope="module")
def geared(tmp_path_factory):
    """The same legs, the right knee geared to the left one by the file."""
    text = robot_text(f'<link name="body">{inertial(2.0, "0 0 0")}</link>', LEGS)
    begin = text.index("<joint", text.index('name="right_knee"') - 10)
    end = text.index("</joint>", begin)
    file = tmp_path_factory.mktemp("robot") / "geared.urdf"
    file.write_text(text[:end] + MIMIC + text[end:])
    return fp.Robot.from_urdf(file, coupled={"right_hip": COUPLED["right_hip"]})


def flight(robot, **changes):
    start, goal = fp.Posture(0.2, 0.3), fp.Posture(1.0, [0.8, -0.5])
    return fp.Problem(robot, start, goal, fp.Flight(0.8, angular_momentum="free"), **changes)


@pytest.fixture(scope="module")
def robot(path):
    return fp.Robot.from_urdf(path, coupled=COUPLED)


@pytest.fixture(scope="module")
def free(robot):
    plan = fp.plan(flight(robot))
    assert plan.ok, plan.explanation
    return plan


class TestRobot:
    def test_motors_are_leaders_then_followers(self, robot):
        assert robot.motors == ("left_hip", "left_knee", "right_hip", "right_knee")
        assert robot.motor_ratios.tolist() == [[1, 0], [0, 1], [-0.7, 0], [0, 1]]
        assert (robot.transmission @ robot.motor_ratios == robot.selection).all()

    def test_gearing_is_the_files_however_it_is_asked_for(self, geared):
        again = fp.Robot.from_urdf(geared.path, joints=geared.joints, coupled=dict(geared.coupled))
        assert again.motors == geared.motors
        other = {**geared.coupled, "right_knee": fp.Coupling("left_knee", -1.0)}
        assert "right_knee" in fp.Robot.from_urdf(geared.path, joints=geared.joints, coupled=other).motors


class TestState:
    def test_own_torques_are_those_of_inverse_dynamics(self, free, robot):
        """RNEA on the file's own free-flying model, joint by joint."""
        times = np.linspace(0, free.duration, 7)
        model = pin.buildModelFromUrdf(str(robot.path), pin.JointModelFreeFlyer())
        model.gravity.linear = -free.ballistics.gravity * robot.plane.vertical
        data, state = model.createData(), free.at(times)
        rows = [model.joints[model.getJointId(name)].idx_v for name in robot.motors]
        wanted = [pin.rnea(model, data, free.q(t), free.v(t), free.a(t))[rows] for t in times]
        assert state.motor_torques == pytest.approx(np.array(wanted), abs=1e-10)
        assert state.torques == pytest.approx(state.motor_torques @ robot.motor_ratios, abs=1e-11)

    def test_a_follower_turns_as_fast_as_its_ratio_says_whichever_way(self, free):
        used = {use.joint: use for use in free.utilisation}
        assert used["right_hip"].velocity_peak == pytest.approx(0.7 * used["left_hip"].velocity_peak)
        assert used["right_knee"].velocity_peak == used["left_knee"].velocity_peak

    def test_of_a_geared_joint_the_leader_takes_the_sum(self, geared):
        plan = fp.plan(flight(geared))
        times = np.linspace(0, plan.duration, 7)
        motion, state = plan.full_motion(times), plan.at(times)
        own = dict(zip(motion.joints, motion.torques.T, strict=True))
        assert state.motor_torques[:, 1] == pytest.approx(own["left_knee"] + own["right_knee"], abs=1e-11)
        made = dict(zip(motion.joints, motion.motor_torques.T, strict=True))
        assert (made["right_knee"] == 0).all()
        assert made["left_knee"] == pytest.approx(state.motor_torques[:, 1], abs=1e-12)


class TestLimits:
    def test_a_number_is_for_each_motor(self, robot):
        problem = flight(robot, limits=fp.Limits(torque=2.0, velocity=3.0))
        assert problem.motor_torque_limits.tolist() == [2.0] * 4
        assert problem.torque_limits == pytest.approx([3.4, 4.0])
        assert problem.velocity_limits.tolist() == [3.0, 3.0]

    def test_a_faster_follower_slows_its_leader(self, path):
        robot = fp.Robot.from_urdf(
            path, coupled={"right_hip": fp.Coupling("left_hip", -2.0), "right_knee": "left_knee"}
        )
        assert flight(robot, limits=fp.Limits(velocity=3.0)).velocity_limits.tolist() == [1.5, 3.0]
        assert flight(robot, limits=fp.Limits(velocity=[3.0, 3.0])).velocity_limits.tolist() == [3.0, 3.0]

    def test_a_mapping_names_motors_and_leaders_speak_for_followers(self, robot):
        limits = fp.Limits(torque={"left_hip": 2.0, "right_knee": 1.0}, motor={"left_knee": fp.Motor(5.0, 0.2)})
        problem = flight(robot, limits=limits)
        assert problem.motor_torque_limits.tolist() == [2.0, np.inf, 2.0, 1.0]
        assert problem.motor_stall.tolist() == [np.inf, 5.0, np.inf, 5.0]
        assert problem.torque_limits.tolist() == [pytest.approx(3.4), np.inf]

    def test_a_sequence_is_about_generalised_torques(self, robot):
        problem = flight(robot, limits=fp.Limits(torque=[2.0, 1.0]))
        assert problem.torque_limits.tolist() == [2.0, 1.0]
        assert not np.isfinite(problem.motor_torque_limits).any()

    def test_the_files_efforts(self, robot):
        problem = flight(robot, limits=fp.Limits(torque="urdf"))
        assert (problem.motor_torque_limits == robot.motor_torque_limits).all()

    @pytest.mark.parametrize(
        "limits",
        [
            fp.Limits(torque=2.0),
            fp.Limits(torque={"left_hip": 2.0, "right_knee": 1.0}, motor={"right_hip": fp.Motor(5.0, 0.2)}),
            fp.Limits(torque=[2.0, 1.0]),
            fp.Limits(torque=[np.inf, 1.0]),
            fp.Limits(torque="urdf", velocity=2.0),
        ],
    )
    def test_files_hold_them(self, robot, limits, tmp_path):
        problem = flight(robot, limits=limits)
        fp.save_problem(problem, tmp_path / "p.toml")
        for again in (fp.load_problem(tmp_path / "p.toml"), problem_from_dict(problem_to_dict(problem), robot)):
            for name in ("torque_limits", "motor_torque_limits", "motor_stall", "motor_slope", "velocity_limits"):
                assert (getattr(again, name) == getattr(problem, name)).all(), name


class TestPlans:
    @pytest.mark.parametrize("by", ["torque", "motor"])
    def test_a_follower_keeps_its_limit(self, free, robot, by):
        """The follower alone is limited, to 90 % of what it takes without."""
        own = dict(zip(robot.motors, free.peaks.motor_torque.tolist(), strict=True))
        most = 0.9 * own["right_hip"]
        limits = fp.Limits(torque={"right_hip": most})
        if by == "motor":
            limits = fp.Limits(motor={"right_hip": fp.Motor(most, 0.01)})
        plan = fp.plan(flight(robot, limits=limits), prove=True)
        assert plan.certificate.proved, plan.explanation
        assert plan.peaks.motor_torque[2] <= most * (1 + 1e-9)
        certificate = fp.certify(replace(plan, problem=flight(robot, limits=limits)))
        assert finding(certificate, f"{by} right_hip").verdict == "proved"

    def test_generalised_torques_keep_theirs(self, free, robot):
        most = 0.9 * free.peaks.torque
        plan = fp.plan(flight(robot, limits=fp.Limits(torque=most)), prove=True)
        assert plan.certificate.proved, plan.explanation
        assert (plan.peaks.torque <= most * (1 + 1e-9)).all()
        labels = {item.label for item in plan.certificate.findings}
        assert {"generalized_torque left_hip", "generalized_torque left_knee"} <= labels

    def test_a_follower_beyond_its_effort_is_refuted(self, free, robot):
        """The motion made without limits, said to keep the follower's."""
        own = float(free.peaks.motor_torque[2])
        for torque, verdict in ((own * (1 + 1e-6), "proved"), (own * (1 - 1e-6), "refuted")):
            claimed = replace(free, problem=flight(robot, limits=fp.Limits(torque={"right_hip": torque})))
            assert fp.certify(claimed).verdict == verdict

    def test_a_robot_with_gears_is_proved(self, geared, tmp_path):
        plan = fp.plan(flight(geared, limits=fp.Limits(torque="urdf")), prove=True)
        assert plan.certificate.proved
        again = fp.load_plan(plan.save(tmp_path / "plan.json"))
        assert again.robot.motors == geared.motors
        assert (again.problem.motor_torque_limits == plan.problem.motor_torque_limits).all()
        assert fp.certify(tmp_path / "plan.json").proved


@pytest.mark.usefixtures("little_work")
def test_case_of_a_weak_follower(tmp_path):
    """Leader of 50 N m, follower of 1 N m that carries the weight: what it takes is said, not hidden in the sum."""
    from robot_samples import WEAK_FOLLOWER

    (tmp_path / "r.urdf").write_text(WEAK_FOLLOWER)
    robot = fp.Robot.from_urdf(tmp_path / "r.urdf", joints=["a"], coupled={"b": "a"})
    problem = fp.Problem(robot, fp.Posture(0.0, -1.0), fp.Posture(2.0, 1.0), fp.Flight(0.5))
    limited = fp.plan(replace(problem, limits=fp.Limits(torque="urdf")), prove=True)
    assert not limited.ok
    assert "torque of b" in limited.explanation
    unlimited = fp.plan(problem, prove=True)
    assert unlimited.certificate.proved
    (warning,) = [warning for warning in unlimited.warnings if warning.kind == "torque"]
    assert (warning.subject, warning.limit, warning.unit) == ("b", 1.0, "N m")
    assert warning.value == pytest.approx(unlimited.peaks.motor_torque[1])
