"""What a plan in a plane leaves out: roll and yaw at landing of a robot that is not its own mirror image."""

import math

import numpy as np
import pinocchio as pin
import pytest
from robot_samples import inertial
from scipy.integrate import solve_ivp

import floatplan as fp


def biped(path, right):
    """Two legs that swing together about y; the right one has a mass of its own, kg."""
    legs = "".join(
        f'<link name="{name}">{inertial(mass, "0.02 0 -0.2")}</link>'
        f'<joint name="hip_{name}" type="revolute"><parent link="trunk"/><child link="{name}"/>'
        f'<origin xyz="0 {side} 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="30"/></joint>'
        for name, side, mass in (("left", 0.15, 1.0), ("right", -0.15, right))
    )
    path.write_text(f'<robot name="biped"><link name="trunk">{inertial(2.0, "0 0 0.2")}</link>{legs}</robot>')
    return fp.Robot.from_urdf(path, plane="xz", coupled={"hip_right": "hip_left"})


def planned(path, right):
    robot = biped(path / f"biped_{right}.urdf", right)
    ends = fp.Posture(0.2, [0.3]), fp.Posture(0.2 + 2 * math.pi, [-0.6])
    plan = fp.plan(fp.Problem(robot, *ends, fp.Flight(duration=0.8, angular_momentum="free")))
    assert plan.ok
    return plan


def test_it_is_what_the_free_flyer_of_the_file_does(tmp_path):
    """The joints as planned on Pinocchio's own model, its base turned by the momentum, integrated by SciPy."""
    plan = planned(tmp_path, 1.2)
    model, plane = pin.buildModelFromUrdf(str(plan.robot.path), pin.JointModelFreeFlyer()), plan.robot.plane
    data, momentum = model.createData(), plan.angular_momentum * plane.normal

    def rate(time, quaternion):
        now = min(time, plan.duration)
        q, v = plan.q(now), plan.v(now)
        q[:7] = 0, 0, 0, *quaternion / np.linalg.norm(quaternion)
        turn = pin.Quaternion(q[3:7]).matrix()
        rows = pin.crba(model, data, q)[:6]
        rows[:, :6] = np.triu(rows[:, :6]) + np.triu(rows[:, :6], 1).T
        wanted = np.concatenate((np.zeros(3), turn.T @ momentum)) - rows[:, 6:] @ v[6:]
        omega = np.linalg.solve(rows[:, :6], wanted)[3:]
        return np.append(quaternion[3] * omega + np.cross(quaternion[:3], omega), -quaternion[:3] @ omega) / 2

    flown = solve_ivp(rate, (0, plan.duration), plan.q(0.0)[3:7], method="DOP853", rtol=1e-9, atol=1e-10).y[:, -1]
    flown = pin.Quaternion(flown / np.linalg.norm(flown)).matrix()
    missed = pin.log3(pin.Quaternion(plan.q(plan.duration)[3:7]).matrix().T @ flown)
    assert plan.out_of_plane == pytest.approx(
        [missed @ axis for axis in (plane.horizontal, plane.vertical, plane.normal)], abs=1e-7
    )
    assert np.linalg.norm(plan.out_of_plane) > math.radians(1)


def test_it_is_a_warning_with_its_figures_where_it_is_large_and_none_where_it_is_not(tmp_path):
    plan = planned(tmp_path, 1.2)
    (warning,) = (each for each in plan.warnings if each.kind == "leak")
    assert warning.value == pytest.approx(np.linalg.norm(plan.out_of_plane))
    assert warning.subject == "trunk"
    assert f"{math.degrees(plan.out_of_plane[0]):.2f}".rstrip("0") in warning.message
    assert "leak" in [each["kind"] for each in plan.record.warnings]
    for right, turned in ((1.0, 0.0), (1.0 + 1e-4, 1e-6)):
        even = planned(tmp_path, right)
        assert turned <= np.linalg.norm(even.out_of_plane) < 1e-3
        assert "leak" not in [each.kind for each in even.warnings]
