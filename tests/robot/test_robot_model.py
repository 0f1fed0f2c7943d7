"""The planar model and the planar tree, against the free-flyer model of the URDF as it stands."""

import numpy as np
import pinocchio as pin
import pytest
from robot_free_flyer import FreeFlyer, random_states, relative_error
from robot_samples import CHAIN_NAMES, URDF_FOLDER, RandomTree, inertial, joint, robot_text
from straight_axes import axes_turned_in_file

import floatplan as fp
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.robot import Coupling, Robot

NORMALS = {"xz": "y", "zx": "y", "yz": "x", "zy": "x", "xy": "z", "yx": "z"}


def random_robot(tmp_path, seed, plane=None, **options):
    tree = RandomTree(seed, NORMALS.get(plane, "y"), joints=8)
    path = tmp_path / "random.urdf"
    path.write_text(tree.text)
    return Robot.from_urdf(path, plane=plane, locked=tree.locked, **options)


@pytest.fixture(params=[*CHAIN_NAMES, *NORMALS, "coupled"])
def robot(request, tmp_path):
    if request.param in CHAIN_NAMES:
        return Robot.from_urdf(URDF_FOLDER / f"{request.param}.urdf")
    if request.param == "coupled":
        return random_robot(tmp_path, 12, "xz", coupled={"joint2": Coupling("joint1", -0.7, 0.4)})
    return random_robot(tmp_path, list(NORMALS).index(request.param), request.param)


def momentum_row(robot, data, full):
    row = robot.plane.normal @ pin.computeCentroidalMap(robot.model, data, full)[3:]
    return np.r_[row[2], row @ robot.selection]


def test_momentum_row_equals_the_free_flyer_s(robot):
    oracle, data = FreeFlyer(robot), robot.model.createData()
    for full, _, _ in random_states(robot, 20):
        assert relative_error(momentum_row(robot, data, full), oracle.momentum_row(full)) < 1e-12


def test_torques_equal_the_free_flyer_s(robot):
    oracle, data = FreeFlyer(robot), robot.model.createData()
    for full, velocity, acceleration in random_states(robot, 20):
        torques = robot.selection.T @ pin.rnea(robot.model, data, full, velocity, acceleration)
        assert relative_error(torques, oracle.torques(full, velocity, acceleration)) < 1e-12


@pytest.fixture
def tilted(tmp_path):
    """A robot with links off the plane beyond a tilted joint that is bent where the planned positions are zero."""
    joints = joint("one", "a", "b"), joint("two", "b", "c", "0.0009 1 0"), joint("three", "c", "d", "0 1 0.0005")
    sides = (
        f'<link name="c">{inertial(1.0, "0.1 0.1 0.05")}</link><link name="d">{inertial(1.0, "0.1 -0.1 0.1")}</link>'
    )
    path = tmp_path / "tilted.urdf"
    path.write_text(robot_text(*joints, sides, links="ab"))
    return Robot.from_urdf(path, plane="xz", coupled={"two": Coupling("one", -0.5, 1.2)})


def test_tilted_axes_are_turned_onto_the_normal(tilted):
    text, tilt = axes_turned_in_file(tilted)
    assert tilted.tilt == pytest.approx(tilt, rel=1e-9) == pytest.approx(0.0009, rel=1e-6)
    oracle, data, closed = FreeFlyer(tilted, text), tilted.model.createData(), Dynamics(tilted.tree)
    for full, velocity, acceleration in random_states(tilted, 10):
        positions = np.linalg.lstsq(tilted.selection, full - tilted.reference, rcond=None)[0]
        assert relative_error(momentum_row(tilted, data, full), oracle.momentum_row(full)) < 1e-12
        assert relative_error(closed.momentum_map(positions[None])[0], oracle.momentum_row(full)) < 1e-12
        torques = tilted.selection.T @ pin.rnea(tilted.model, data, full, velocity, acceleration)
        assert relative_error(torques, oracle.torques(full, velocity, acceleration)) < 1e-12
        frame = tilted.model.frames[tilted.model.getFrameId("d")]
        pin.framesForwardKinematics(tilted.model, data, full)
        turned = data.oMi[frame.parentJoint].rotation @ frame.placement.rotation
        assert abs(turned[1] - [0.0, 1.0, 0.0]).max() < 1e-15


def test_planner_certificate_and_engines_turn_tilted_axes_alike(tilted):
    problem = fp.Problem(
        tilted,
        start=fp.Posture(0.1, [0.2, 0.1]),
        goal=fp.Posture(0.6, [0.7, -0.4]),
        flight=fp.Flight(duration=0.7, takeoff=fp.Takeoff("a")),
    )
    plan = fp.plan(problem)
    assert plan.ok, plan.explanation
    assert fp.certify(plan).verdict == "proved"
    assert fp.replay(plan).landed
    assert fp.replay(plan, engine="mujoco").landed


def test_tree_puts_every_frame_where_forward_kinematics_does(robot):
    data = robot.model.createData()
    for full, _, _ in random_states(robot, 10):
        positions = np.linalg.lstsq(robot.selection, full - robot.reference, rcond=None)[0]
        pin.framesForwardKinematics(robot.model, data, full)
        com = pin.centerOfMass(robot.model, data, full)
        rotations = robot.tree.rotations(robot.tree.absolute_angles(full[2], positions))
        for name, frame in robot.frames.items():
            weights = robot.tree.point_weights(np.array([frame.body]), np.array([frame.local]))
            place = data.oMf[robot.model.getFrameId(name)].translation - com
            expected = complex(place @ robot.plane.horizontal, place @ robot.plane.vertical)
            assert abs((rotations @ weights.T)[0] - expected) < 1e-13


def test_frames_prefer_the_link_where_a_joint_has_its_name(tmp_path):
    text = robot_text(joint("c", "a", "b"), joint("k", "b", "c"), links="abc")
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    frame = Robot.from_urdf(path).frames["c"]
    assert (frame.body, frame.local) == (2, 0j)


def test_arrays_and_mappings_are_read_only(robot):
    tree = robot.tree
    arrays = [robot.reference, robot.selection, robot.position_limits, robot.velocity_limits, robot.torque_limits]
    arrays += [tree.parent, tree.anchor, tree.mass, tree.center, tree.inertia, tree.turns, tree.offsets]
    arrays += [robot.plane.normal, robot.plane.horizontal, robot.plane.vertical]
    assert not any(array.flags.writeable for array in arrays)
    for mapping in (robot.locked, robot.coupled, robot.frames):
        with pytest.raises(TypeError):
            mapping["j"] = 0.0


class TestFreeFlyer:
    def test_is_the_model_that_pinocchio_makes_of_the_file(self, any_robot):
        model = any_robot.free_flyer()
        expected = pin.buildModelFromXML(any_robot.xml, pin.JointModelFreeFlyer())
        assert model == expected
        assert (any_robot.nq, any_robot.nv) == (expected.nq, expected.nv)
