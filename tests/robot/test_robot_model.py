"""The planar model and the planar tree, against the free-flyer model of the URDF as it stands."""

from __future__ import annotations

import subprocess
import sys
from unittest.mock import patch

import numpy as np
import pinocchio as pin
import pytest
from robot_free_flyer import FreeFlyer, random_states, relative_error
from robot_samples import (
    CHAIN_NAMES,
    GYMNAST,
    URDF_FOLDER,
    RandomTree,
    flipped_axes,
    inertial,
    joint,
    mounted,
    other_plane,
    robot_text,
)
from straight_axes import axes_turned_in_file

import floatplan as fp
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.robot import Coupling, Robot
from floatplan.robot import robot as robot_module

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
    pytest.importorskip("mujoco")
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


def test_tree_has_the_robot_s_momentum(robot):
    """Sum of each body's own and of its centre's moment of momentum, from the tree's constants alone."""
    tree, data = robot.tree, robot.model.createData()
    for full, velocity, _ in random_states(robot, 10):
        positions = np.linalg.lstsq(robot.selection, full - robot.reference, rcond=None)[0]
        rates = np.linalg.lstsq(robot.selection, np.r_[np.zeros(3), velocity[3:]], rcond=None)[0]
        spins = velocity[2] + tree.turns @ rates
        rotations = tree.rotations(tree.absolute_angles(full[2], positions))
        weights = tree.point_weights(np.arange(len(tree.mass)), tree.center)
        places, speeds = rotations @ weights.T, (1j * tree.turn * spins * rotations) @ weights.T
        momentum = tree.inertia @ spins + tree.turn * tree.mass @ (places.conj() * speeds).imag
        expected = momentum_row(robot, data, full) @ np.r_[velocity[2], rates]
        assert momentum == pytest.approx(expected, rel=1e-11, abs=1e-12)


def test_absolute_angles_are_orientation_plus_joint_angles_on_the_path(tmp_path):
    bent = joint("k", "b", "c", "0 -1 0", kind="revolute")
    text = robot_text(joint("j", "a", "b"), bent, joint("l", "c", "d"), links="abcd")
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    robot = Robot.from_urdf(path, locked={"k": 0.3})
    angles = robot.tree.absolute_angles(np.array([0.5, 7.0]), np.array([[0.1, 0.2], [1.0, 2.0]]))
    assert angles == pytest.approx(np.array([[0.5, 0.6, 0.5], [7.0, 8.0, 9.7]]))
    assert robot.tree.names == ("a", "b", "d")


def test_links_that_do_not_move_against_each_other_are_one_body(tmp_path):
    robot = random_robot(tmp_path, 3, "xz")
    assert len(robot.tree.mass) == 1 + len(robot.joints)
    assert robot.mass == pytest.approx(pin.computeTotalMass(robot.model), rel=1e-14)
    assert set(robot.frames) >= {f"link{i}" for i in range(9)} | {f"joint{i}" for i in range(1, 9)}


def test_model_is_one_coordinate_per_joint_and_without_gravity(robot):
    model = robot.model
    assert model.nq == model.nv == model.njoints - 1 == len(robot.reference) == len(robot.selection)
    assert not model.gravity.vector.any()
    assert not robot.reference[:3].any()
    assert not robot.selection[:3].any()
    data = model.createData()
    pin.forwardKinematics(model, data, np.r_[2.0, 3.0, np.zeros(model.nv - 2)])
    moved = data.oMi[3].translation
    assert moved == pytest.approx(2.0 * robot.plane.horizontal + 3.0 * robot.plane.vertical)


def test_derivatives_of_momentum_and_torque_agree_with_differences(robot):
    """``JointModelComposite`` as the root fails here, though all its values are right."""
    model, data = robot.model, robot.model.createData()
    full, velocity, acceleration = next(random_states(robot, 1))
    by_position = pin.computeRNEADerivatives(model, data, full, velocity, acceleration)[0].copy()
    step = 1e-6
    for column in range(model.nv):
        shift = step * np.eye(model.nv)[column]
        ahead = pin.rnea(model, data, full + shift, velocity, acceleration).copy()
        behind = pin.rnea(model, data, full - shift, velocity, acceleration)
        assert by_position[:, column] == pytest.approx((ahead - behind) / (2 * step), abs=1e-6)


def test_frames_prefer_the_link_where_a_joint_has_its_name(tmp_path):
    text = robot_text(joint("c", "a", "b"), joint("k", "b", "c"), links="abc")
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    frame = Robot.from_urdf(path).frames["c"]
    assert (frame.body, frame.local) == (2, 0j)


def test_links_without_collision_are_segments_to_their_children():
    robot = Robot.from_urdf(URDF_FOLDER / "gymnast.urdf")
    shapes = [(shape.link, shape.body, shape.start, shape.end, shape.radius) for shape in robot.shapes]
    assert [shape[:2] for shape in shapes] == [("body0", 0), ("body1", 1), ("body2", 2)]
    assert [shape[2] for shape in shapes] == [0, 0, 0]
    assert [shape[3] for shape in shapes] == pytest.approx([0.4, 0.4, 0.3])
    assert [shape[4] for shape in shapes] == [0, 0, 0]


def test_arrays_and_mappings_are_read_only(robot):
    tree = robot.tree
    arrays = [robot.reference, robot.selection, robot.position_limits, robot.velocity_limits, robot.torque_limits]
    arrays += [tree.parent, tree.anchor, tree.mass, tree.center, tree.inertia, tree.turns, tree.offsets]
    arrays += [robot.plane.normal, robot.plane.horizontal, robot.plane.vertical]
    assert not any(array.flags.writeable for array in arrays)
    for mapping in (robot.locked, robot.coupled, robot.frames):
        with pytest.raises(TypeError):
            mapping["j"] = 0.0


def test_file_is_recorded_as_read():
    path = URDF_FOLDER / "gymnast.urdf"
    robot = Robot.from_urdf(path)
    assert (robot.name, robot.path, robot.xml) == ("gymnast", path, path.read_text())
    assert len(robot.sha256) == 64
    assert Robot.from_urdf(str(path)).sha256 == robot.sha256
    assert repr(robot) == "Robot('gymnast', plane='xz', joints=['q1', 'q2'], mass=6.5 kg)"


def test_loading_builds_one_model_and_imports_no_geometry():
    with patch.object(robot_module.planar, "build_model", wraps=robot_module.planar.build_model) as build:
        Robot.from_urdf(URDF_FOLDER / "gymnast.urdf")
    assert build.call_count == 1
    code = (
        "import sys, floatplan.robot as room; room.Robot.from_urdf('urdf/gymnast.urdf');"
        "print([name for name in ('yourdfpy', 'trimesh', 'matplotlib', 'scipy') if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=URDF_FOLDER.parent, capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("[]\n", "")


def rotated_base(text):
    return mounted(text, '<origin xyz="0.3 0.1 -0.2" rpy="0 0.7 0"/>')


def split_link(text):
    """Body 1's mass as two fixed links, 1 kg and 1.5 kg, of the same centre and inertia together."""
    light, heavy = 0.2 + 0.09, 0.2 - 0.06
    inertia = 0.107 - 1.0 * 0.09**2 - 1.5 * 0.06**2
    halves = [
        f'<inertial><origin xyz="{place} 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="0.001" ixy="0" ixz="0" iyy="{inertia / 2}" iyz="0" izz="{inertia / 2}"/></inertial>'
        for place, mass in ((light, 1.0), (heavy, 1.5))
    ]
    begin = text.index("<inertial>", text.index('name="body1"'))
    end = text.index("</inertial>", begin) + len("</inertial>")
    seam = joint("seam", "body1", "half", kind="fixed").replace("0.3 0 0", "0 0 0")
    second = f'<link name="half">{halves[1]}</link>{seam}'
    return (text[:begin] + halves[0] + text[end:]).replace("</robot>", f"{second}</robot>")


@pytest.mark.parametrize("change", [other_plane, flipped_axes, rotated_base, split_link])
def test_the_same_robot_written_otherwise_moves_the_same(tmp_path, change):
    path = tmp_path / "robot.urdf"
    path.write_text(change(GYMNAST))
    plain, other = Robot.from_urdf(URDF_FOLDER / "gymnast.urdf"), Robot.from_urdf(path)
    assert other.joints == plain.joints
    assert other.tree.turns.tolist() == plain.tree.turns.tolist()
    assert other.tree.mass == pytest.approx(plain.tree.mass)
    assert other.tree.inertia == pytest.approx(plain.tree.inertia)
    assert abs(other.tree.center[1:]) == pytest.approx(abs(plain.tree.center[1:]))
    data, other_data = plain.model.createData(), other.model.createData()
    for full, velocity, acceleration in random_states(plain, 5):
        assert relative_error(momentum_row(other, other_data, full), momentum_row(plain, data, full)) < 1e-13
        state = full, velocity, acceleration
        assert relative_error(flight_torques(other, *state), flight_torques(plain, *state)) < 1e-12


def flight_torques(robot, full, velocity, acceleration):
    """Joint torques with the base acceleration that leaves no wrench on it; the base starts without linear velocity."""
    data = robot.model.createData()
    velocity = np.r_[0.0, 0.0, velocity[2:]]
    mass = np.triu(pin.crba(robot.model, data, full))
    mass += np.triu(mass, 1).T
    bias = pin.nonLinearEffects(robot.model, data, full, velocity)
    forces = mass[:, 3:] @ acceleration[3:] + bias
    base = np.linalg.solve(mass[:3, :3], -forces[:3])
    return forces[3:] + mass[3:, :3] @ base


class TestFreeFlyer:
    def test_is_the_model_that_pinocchio_makes_of_the_file(self, any_robot):
        model = any_robot.free_flyer()
        expected = pin.buildModelFromXML(any_robot.xml, pin.JointModelFreeFlyer())
        assert model == expected
        assert (any_robot.nq, any_robot.nv) == (expected.nq, expected.nv)

    def test_each_is_its_own(self, gymnast):
        model = gymnast.free_flyer()
        model.gravity.linear = np.array([0.0, 0.0, 1.0])
        assert gymnast.free_flyer().gravity.linear[2] == pytest.approx(-9.81)

    def test_root_joint_is_a_name_that_pinocchio_needs(self, tmp_path):
        text = (URDF_FOLDER / "gymnast.urdf").read_text()
        name = Robot.from_urdf(URDF_FOLDER / "gymnast.urdf").joints[0]
        (tmp_path / "named.urdf").write_text(text.replace(f'"{name}"', '"root_joint"'))
        with pytest.raises(fp.InputError, match="rename it"):
            Robot.from_urdf(tmp_path / "named.urdf").free_flyer()
