"""A foot may leave the ground from its toe, its tip or its round bottom, and not from its frame: the verdict knows."""

import numpy as np
import pytest
from robot_samples import inertial

import floatplan as fp
from floatplan.motion.planar.contact import lowest_points

SOLE = '<box size="0.24 0.1 0.03"/>'
BALL = '<sphere radius="0.04"/>'


def leg(folder, shape, center="0.03 0 -0.05"):
    """A trunk on a leg of two links and a foot, whose frame is its ankle, above its shape."""
    limits = '<limit lower="-2.4" upper="2.4" effort="100" velocity="{}"/>'
    links = {"trunk": (14.0, "0 0 0.2"), "thigh": (1.8, "0 0 -0.12"), "shank": (1.2, "0 0 -0.1"), "foot": (0.5, center)}
    text = ""
    for name, (mass, place) in links.items():
        geometry = f'<collision><origin xyz="{center}"/><geometry>{shape}</geometry></collision>'
        text += f'<link name="{name}">{inertial(mass, place)}{geometry if name == "foot" else ""}</link>'
    for name, parent, child, height, rate in (
        ("hip", "trunk", "thigh", 0.0, 11.0),
        ("knee", "thigh", "shank", -0.27, 11.0),
        ("ankle", "shank", "foot", -0.24, 16.0),
    ):
        ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 {height}"/><axis xyz="0 1 0"/>'
        text += f'<joint name="{name}" type="revolute">{ends}{limits.format(rate)}</joint>'
    path = folder / "leg.urdf"
    path.write_text(f'<robot name="leg">{text}</robot>')
    return fp.Robot.from_urdf(path)


def hop(robot, jump):
    """A flight that begins with the heel off the ground, and ends so."""
    posture = fp.Posture(0.0, {"hip": -0.4, "knee": 0.5, "ankle": 0.35})
    flight = fp.Flight(duration=0.25, angular_momentum=0.3, takeoff=fp.Takeoff("foot"), landing=fp.Landing("foot"))
    return fp.Problem(robot, posture, posture, flight, jump=jump)


@pytest.mark.parametrize("end", ["takeoff", "landing"])
def test_of_a_jump_the_point_that_rests_is_one_on_the_ground(end, tmp_path):
    robot = leg(tmp_path, SOLE)
    verdict = {"takeoff": fp.takeoff, "landing": fp.landing}[end]
    of_frame, of_jump = (verdict(hop(robot, jump)) for jump in (None, fp.JumpRequest()))
    assert of_frame.point == robot.frames["foot"]
    assert of_jump.point.local != robot.frames["foot"].local
    assert of_jump.ratio is not None
    assert of_jump.ratio < of_frame.ratio, "it is the best of them"
    assert of_jump.speed(of_jump.orientation_rate, of_jump.rates) < 1e-9
    assert of_frame.speed(of_jump.orientation_rate, of_jump.rates) > 0.01, "the ankle moves then"


def test_the_point_of_a_sole_is_its_toe_and_that_of_a_ball_its_bottom(tmp_path):
    toe = fp.takeoff(hop(leg(tmp_path, SOLE), fp.JumpRequest())).point
    assert abs(toe.local.imag) == pytest.approx(0.065)  # half of its thickness below its middle
    assert abs(toe.local.real) == pytest.approx(0.15)  # half of its length before it
    robot = leg(tmp_path, BALL, center="0 0 0")
    problem = hop(robot, fp.JumpRequest())
    bottom, *same = lowest_points(problem, "takeoff")
    assert all(each.local == bottom.local for each in same)
    angle = robot.tree.absolute_angles(np.array(0.0), problem.initial.positions)[bottom.body]
    assert bottom.local * robot.tree.rotations(angle) == pytest.approx(-0.04j, abs=1e-12)
