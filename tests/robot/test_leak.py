"""The out-of-plane leak: none where the robot is its own mirror image, large where legs swing apart."""

import numpy as np
import pytest
from robot_samples import CHAIN_NAMES, URDF_FOLDER, inertial

import floatplan as fp
from floatplan.errors import InputError
from floatplan.robot import Robot
from floatplan.robot.leak import out_of_plane_leak


def leak_of(monkeypatch, robot, postures):
    monkeypatch.setattr("floatplan.robot.leak.POSTURES", postures)
    return out_of_plane_leak.__wrapped__(robot)


@pytest.mark.parametrize("name", CHAIN_NAMES)
def test_chains_in_one_plane_do_not_leak(name):
    assert out_of_plane_leak(Robot.from_urdf(URDF_FOLDER / f"{name}.urdf")) < 1e-14


def leg(name, side):
    return (
        f'<link name="{name}">{inertial(1.0, "0.02 0 -0.2")}</link>'
        f'<joint name="hip_{name}" type="continuous"><parent link="trunk"/><child link="{name}"/>'
        f'<origin xyz="0 {side} 0"/><axis xyz="0 1 0"/></joint>'
    )


@pytest.fixture
def biped(tmp_path):
    path = tmp_path / "biped.urdf"
    trunk = f'<link name="trunk">{inertial(2.0, "0 0 0.2")}</link>'
    path.write_text(f'<robot name="biped">{trunk}{leg("left", 0.15)}{leg("right", -0.15)}</robot>')
    return path


def test_legs_apart_leak_and_coupled_legs_do_not(biped):
    assert out_of_plane_leak(Robot.from_urdf(biped)) > 0.3
    assert out_of_plane_leak(Robot.from_urdf(biped, coupled={"hip_right": "hip_left"})) < 1e-14


def test_no_problem_can_be_posed_for_legs_apart(biped):
    def problem(robot):
        still = fp.Posture(orientation=0.0, positions=[0.0] * len(robot.joints))
        return fp.Problem(robot, still, still, fp.Flight(duration=1.0, angular_momentum=0.0))

    advice = "a motion planned in the plane is meaningless; couple .* with .*"
    with pytest.raises(InputError, match=advice) as refused:
        problem(Robot.from_urdf(biped))
    assert refused.value.element == "robot"
    assert problem(Robot.from_urdf(biped, coupled={"hip_right": "hip_left"})).robot.joints == ("hip_left",)


def test_leak_of_one_leg_is_its_closed_form(biped, monkeypatch):
    """A leg of mass m at the side, swung about y: momentum about x and z is that of its centre, seen from the CM."""
    robot = Robot.from_urdf(biped, joints=["hip_left"])
    mass, total, side, reach = 1.0, 4.0, 0.15, np.hypot(0.02, 0.2)
    others = np.array([mass * 0.02, -mass * side, 2.0 * 0.2 - mass * 0.2]) / (total - mass)  # CM of the rest
    leaks = []
    for angle in np.linspace(-np.pi, np.pi, 400):
        turn = np.arctan2(0.2, 0.02) + angle
        foot = np.array([reach * np.cos(turn), side, -reach * np.sin(turn)])
        speed = np.array([foot[2], 0.0, -foot[0]])
        momentum = mass * (total - mass) / total * np.cross(foot - others, speed)
        leaks.append((np.hypot(momentum[0], momentum[2]), abs(momentum[1] + 0.01)))
    out_of_plane, in_plane = np.sqrt(np.mean(np.square(leaks), axis=0))
    assert leak_of(monkeypatch, robot, 400) == pytest.approx(out_of_plane / in_plane, rel=0.02)
