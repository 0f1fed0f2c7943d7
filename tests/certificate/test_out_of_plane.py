"""How far a plan in a plane leaves it: what is proved of it contains what DOP853 finds by Pinocchio's free flyer."""

import json
import math
from dataclasses import replace

import flint
import numpy as np
import pinocchio as pin
import pytest
from long_cases import cases
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from space_reference import joints_at

import floatplan as fp
from floatplan.certificate.spatial.out_of_plane import _upper
from floatplan.errors import InputError
from floatplan.robot.urdf.tree import urdf_path

INTEGRATED = 1e-11  # [rad] that DOP853 is off by
SHARP = 1e-8  # [rad] that a bound may be above it
SAMPLED = 1e-3  # [-] by which the largest tilt may be above that at the instants looked at
NAMES = ("flight", "landing", "attitude")


def bounds(certificate):
    found = {each.label: each for each in certificate.findings if each.kind == "out_of_plane"}
    assert list(found) == [f"out_of_plane.{name}" for name in NAMES]
    return list(found.values())


def in_space(plan, count=2001):
    """Attitudes (count, 3, 3) of the file's model on a free base, with the joints and h as planned."""
    record = plan.record
    robot = record.robot
    model = pin.buildModelFromUrdf(str(urdf_path(robot.file)), pin.JointModelFreeFlyer())
    data = model.createData()
    of_joints = []
    for name in model.names[2:]:
        coupling = robot.coupled.get(name, {"leader": name})
        if name in robot.locked:
            of_joints.append((model.joints[model.getJointId(name)], None, 0.0, robot.locked[name]))
        else:
            leader = robot.joints.index(coupling["leader"])
            ratio, offset = coupling.get("ratio", 1.0), coupling.get("offset", 0.0)
            of_joints.append((model.joints[model.getJointId(name)], leader, ratio, offset))
    normal = np.array(plan.robot.plane.normal)
    momentum = record.angular_momentum * normal

    def slope(time, quaternion):
        positions, velocities, _ = (values[0] for values in joints_at(record, [time]))
        q, v = pin.neutral(model), np.zeros(model.nv)
        for joint, leader, ratio, offset in of_joints:
            angle = offset if leader is None else ratio * positions[leader] + offset
            q[joint.idx_q : joint.idx_q + joint.nq] = angle if joint.nq == 1 else (math.cos(angle), math.sin(angle))
            v[joint.idx_v] = 0.0 if leader is None else ratio * velocities[leader]
        rows = pin.computeCentroidalMap(model, data, q)[3:]
        seen = Rotation.from_quat(quaternion).inv().apply(momentum)
        omega = np.linalg.solve(rows[:, 3:6], seen - rows[:, 6:] @ v[6:])
        return np.append(quaternion[3] * omega + np.cross(quaternion[:3], omega), -quaternion[:3] @ omega) / 2

    start = Rotation.from_rotvec(record.orientation["start"] * normal).as_quat()
    times = np.linspace(0.0, record.duration, count)
    found = solve_ivp(slope, (0.0, record.duration), start, "DOP853", t_eval=times, rtol=1e-13, atol=1e-14)
    return Rotation.from_quat(found.y.T)


@pytest.mark.parametrize("name", cases(["go2", "g1", "bolt"], {"go2", "g1"}))
def test_what_dop853_finds_is_within_the_bounds(planned, name):
    plan = planned(f"gallery/{name}")
    attitudes = in_space(plan)
    normal = np.array(plan.robot.plane.normal)
    tilts = np.arcsin(np.linalg.norm(np.cross(attitudes.apply(normal), normal), axis=1))
    planned = Rotation.from_rotvec(plan.final_orientation * normal)
    off = (planned.inv() * attitudes[-1]).magnitude()
    certificate = fp.certify(plan, out_of_plane=True)
    flight, landing, attitude = bounds(certificate)
    assert tilts.max() - INTEGRATED <= flight.bound <= tilts.max() * (1 + SAMPLED) + SHARP
    assert tilts[-1] - INTEGRATED <= landing.bound <= tilts[-1] + SHARP
    assert off - INTEGRATED <= attitude.bound <= off + SHARP
    assert off == pytest.approx(np.linalg.norm(plan.out_of_plane), rel=1e-3)
    assert {each.verdict for each in (flight, landing, attitude)} == {"proved"}
    assert landing.instant == attitude.instant == plan.duration
    assert 0.0 <= flight.instant <= plan.duration


def test_it_decides_nothing_and_is_left_out_where_nobody_asks(planned):
    plan = planned(
        "gallery/double_pendulum"
    )  # of flat links: they tumble, and tilt by more than a quarter turn on their way
    usual, asked = fp.certify(plan), fp.certify(plan, out_of_plane=True)
    assert [each.label for each in asked.findings[3:]] == [each.label for each in usual.findings]
    flight, landing, _ = bounds(asked)
    assert (flight.verdict, flight.bound) == ("undecided", math.inf)
    assert landing.verdict == "proved"
    assert landing.bound > math.pi / 2
    assert usual.proved
    assert asked.proved
    again = fp.Certificate.from_dict(json.loads(json.dumps(asked.to_dict())))
    assert [each.kind for each in again.findings[:3]] == ["out_of_plane"] * 3


def test_a_bound_has_what_the_attitude_may_be_off_by():
    assert _upper(flint.arb(0.5), 1e-3) >= 0.501
    assert _upper(flint.arb(0.5), math.inf) == math.inf


def test_a_robot_that_is_its_own_mirror_image_stays(planned):
    plan = planned("somersault")
    assert max(each.bound for each in bounds(fp.certify(plan, out_of_plane=True))) < 1e-8


def test_it_follows_the_record(planned):
    """Another momentum, or another direction of it, has another bound; one that is too coarse proves nothing."""
    record = planned("gallery/go2").record
    whole = [each.bound for each in bounds(fp.certify(record, out_of_plane=True))]
    turned = replace(record, angular_momentum=-record.angular_momentum)
    other = [each.bound for each in bounds(fp.certify(turned, out_of_plane=True))]
    assert min(abs(a - b) for a, b in zip(whole, other, strict=True)) > 1e-4
    wild = replace(record, coefficients=record.coefficients * 1e3)
    found = fp.certify(wild, out_of_plane=True, budget=30)
    assert found.verdict != "proved"
    assert {(each.verdict, each.bound) for each in bounds(found)} == {("undecided", math.inf)}


def test_a_flight_in_space_is_in_no_plane(planned):
    plan = planned("space/cat")
    with pytest.raises(InputError, match="out_of_plane: is of plans in a plane, and this flight is in space"):
        fp.certify(plan, out_of_plane=True)
    with pytest.raises(InputError, match="out_of_plane"):
        fp.certify(plan, out_of_plane="yes")


def test_the_command_says_it(planned, floatplan, tmp_path):
    path = planned("gallery/go2").save(tmp_path / "plan.json")
    run = floatplan("certify", path, "--out-of-plane", "--json", "--save")
    assert run.code == 0
    first = json.loads(run.stdout)["findings"][0]
    assert (first["label"], first["verdict"]) == ("out_of_plane.flight", "proved")
    assert first["bound"] == pytest.approx(0.0259, abs=1e-4)
    assert fp.load_plan(path).record.certificate["findings"][0] == first
    assert "out_of_plane.landing" in floatplan("certify", path, "--out-of-plane").stdout
