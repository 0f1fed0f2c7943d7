"""What stances are made of: contacts found by shape, standing postures, and quintics between them."""

import re

import numpy as np
from jumps import GO2

from floatplan.jumps.contacts import contact_at
from floatplan.jumps.phases import not_static, standing_posture, static_beyond_ranges
from floatplan.robot import Robot
from floatplan.robot.standing import positions_from_com

TALOS = "example-robot-data:talos_data/robots/talos_reduced.urdf"


def level(robot):
    """The reference posture, its base level."""
    return np.append(0.0, robot.resting)


def test_a_humanoid_stands_on_heel_and_toe():
    robot = Robot.from_urdf(TALOS, coupled="mirror", plane="xz", reference="half_sitting")
    toe, heel = contact_at(robot, "leg_left_6_link", level(robot))
    assert (toe.suffix, heel.suffix, toe.vertical, heel.vertical) == (".toe", ".heel", False, True)
    places = positions_from_com(robot, [toe.spots[0], heel.spots[0]], level(robot))
    assert 0.15 < places[0].real - places[1].real < 0.3
    assert abs(places[0].imag - toe.depth - places[1].imag + heel.depth) < 1e-9


def test_where_nothing_stands_there_is_no_posture_and_a_reason():
    robot = Robot.from_urdf(GO2, coupled="mirror", reference="standing")
    contacts = [contact_at(robot, frame, level(robot))[0] for frame in ("RL_foot", "FL_foot")]
    narrow = np.array([[0.0, 0.0], [0.0, 0.1], [-1.0, -0.9], [1.5, 1.6], [-1.0, -0.9]])
    assert standing_posture(robot, contacts, level(robot), narrow) is None
    assert re.search("mm apart in height, '[RF]L_foot' is the highest", not_static(robot, contacts, narrow[:, 0]))
    beyond = static_beyond_ranges(robot, contacts, level(robot), narrow)
    assert beyond.startswith("static would be FL_thigh_joint at ")
    assert "where 0 to 0.1 rad are left of its range" in beyond
