"""Torques of joints that are held: those of Pinocchio's inverse dynamics; and jumps that keep within their efforts."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from jumps import backflip, go2_problem

import floatplan as fp
from floatplan.jumps.contacts import contact_at, rolling
from floatplan.jumps.locked_joints import LockedJoints
from floatplan.jumps.model import PlanarModel, casadi
from floatplan.jumps.motion import Stance
from floatplan.robot import Robot
from floatplan.robot.standing import Spot

ROBOTS = {
    "go2": ("go2_description/urdf/go2.urdf", "standing", ["RL_foot", "FL_foot"]),
    "rolling": ("go2_description/urdf/go2.urdf", "standing", ["RL_foot", "FL_foot"]),
    "talos": ("talos_data/robots/talos_reduced.urdf", "half_sitting", ["leg_left_6_link"]),
}


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("stands", [True, False])
def test_torques_are_those_of_pinocchio(name, stands):
    """With contact forces beyond the joints, by RNEA in the robot's own model."""
    source, reference, feet = ROBOTS[name]
    robot = Robot.from_urdf(f"example-robot-data:{source}", coupled="mirror", plane="xz", reference=reference)
    model, rng = PlanarModel(robot), np.random.default_rng(5)
    home = np.append(0.0, robot.resting)
    contacts = [each for foot in feet for each in contact_at(robot, foot, home)] if stands else []
    contacts = [rolling(robot, each, home) for each in contacts] if name == "rolling" else contacts
    held = LockedJoints(model)
    forces = casadi().SX.sym("forces", 2, len(contacts))
    pairs = [(forces[0, k], forces[1, k]) for k in range(len(contacts))]
    function = model.function("held", [held.shares(list(held.efforts), contacts, pairs)], forces)
    y, v, a = rng.normal(size=(3, 1 + len(robot.joints)))
    given = rng.normal(size=(2, len(contacts))) * 100
    found = np.asarray(function(y, v, a, given)).ravel() * list(held.efforts.values())

    full = np.stack([robot.selection @ each[1:] for each in (y, v, a)])
    full[0] += robot.reference
    full[:, 2] = y[0], v[0], a[0]
    anchor = contacts[0].spots[0] if contacts else None
    base = model.function("base", model.positions(model.weights([Spot(0, 0j)], anchor), 2))
    full[2, :2] = [float(part) for part in base(y, v, a)]
    full[2, 1] += 9.81 if contacts else 0.0
    torques = pin.rnea(robot.model, robot.model.createData(), *full)
    stance = Stance(robot, 9.81, tuple(contacts), 0j, None)
    for contact, force in zip(contacts, given.T, strict=True):
        for point in contact.names:
            torques -= force / len(contact.names) @ stance.touching(full[:1])[point][1][0]
    columns = [robot.model.joints[robot.model.getJointId(each)].idx_v for each in held.efforts]
    assert len(columns) >= 4
    assert np.abs(found - torques[columns]).max() < 1e-9


@pytest.mark.long
def test_a_jump_is_found_that_keeps_within_efforts():
    """The front hips take 12.8 N m in the usual one."""
    problem, known = go2_problem(), backflip()
    tree, weaker = problem.robot.joint_tree, ("FL_hip_joint", "FR_hip_joint")
    joints = tuple(replace(each, effort=10.5) if each.name in weaker else each for each in tree.joints)
    robot = replace(problem.robot, joint_tree=replace(tree, joints=joints))
    sides = ([replace(each, robot=robot) for each in side] for side in (known.before, known.after))
    problem = replace(problem, robot=robot)
    weak = replace(known, problem=problem, **{name: tuple(next(sides)) for name in ("before", "after")})
    assert weak.check.figures["held_torque"] > 1.1
    found = fp.jump(problem, starts=1)
    assert found.ok
    assert 0.8 < found.check.figures["held_torque"] <= 1.0
