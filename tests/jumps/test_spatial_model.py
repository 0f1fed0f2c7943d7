"""The model of jumps in space: against Pinocchio; and pieces of a program against finite differences."""

import ctypes
import os
from pathlib import Path

import numpy as np
import pytest

import floatplan as fp
from floatplan.jumps.model import casadi
from floatplan.jumps.reading import read_spatial_stance
from floatplan.jumps.spatial.coordinates import Mechanics, angles_of, rotation_with_rates
from floatplan.jumps.spatial.jump import contact_table
from floatplan.jumps.spatial.model import BASE, SpatialModel
from floatplan.jumps.spatial.pendulum import Line, Pendulum, pushed_from
from floatplan.jumps.spatial.pieces import Assembly, Expression, Piece
from floatplan.jumps.spatial.stance import shared_forces
from floatplan.jumps.spatial.standing import feet_at
from floatplan.problem.attitude import Attitude

FEET = ("FL_foot", "RR_foot")


@pytest.fixture(scope="module")
def go2():
    return fp.Robot.from_urdf(
        "example-robot-data:go2_description/urdf/go2.urdf", base="free-flyer", reference="standing", armature=0.01
    )


@pytest.fixture(scope="module")
def mechanics(go2):
    level = Attitude(angles=(0.0, 0.0, 0.0), axes="xyz")
    feet = [feet_at(go2, frame, level, go2.resting, "contacts")[0] for frame in FEET]
    return Mechanics(go2, "yxz", 9.81, feet)


def sampled_motion(robot, count=4):
    """Base, angles whose middle one is small, and joints, with derivatives (3, 6+n, count)."""
    rng = np.random.default_rng(0)
    motion = rng.uniform(-1.0, 1.0, (3, BASE + len(robot.joints), count)) * [[[1.0]], [[5.0]], [[50.0]]]
    motion[0, 3] *= 3.0
    return motion


def test_torques_and_balance_are_pinocchios(go2, mechanics):
    model = SpatialModel(go2, "yxz", 9.81)
    ca = casadi()
    symbols = {frame: ca.SX.sym(frame, 3) for frame in FEET}
    feet = ca.vertcat(*(order for frame in FEET for order in model.foot(frame)[1]))
    function = ca.Function(
        "model", [model.y, model.v, model.a, *symbols.values()], [model.torques(symbols), model.balance(symbols), feet]
    )
    motion = sampled_motion(go2)
    centres, _ = mechanics.centre(motion)
    wrenches = mechanics.wrench(motion)
    rotations = rotation_with_rates("yxz", motion[:, 3:BASE])[0]
    places = mechanics.feet(motion, FEET)
    _, jacobians = mechanics.places_and_jacobians(mechanics.coordinates(motion)[0], FEET, of_slip=False)
    forces = np.random.default_rng(1).uniform(-100.0, 100.0, (2, 3))
    for index in range(motion.shape[2]):
        of_centre = motion[:, :, index].copy()
        of_centre[:, :3] = centres[:, :, index]
        torques, balance, positions = (np.array(part) for part in function(*of_centre, *forces))
        carried = np.einsum("fin,fi->n", jacobians[index], forces)
        expected = wrenches[index, BASE:] - carried
        assert np.abs(torques.ravel() - expected).max() < 1e-12 * max(1.0, np.abs(expected).max())
        force = rotations[index] @ wrenches[index, :3]
        arm = motion[0, :3, index] - centres[0, :, index]
        moment = rotations[index] @ wrenches[index, 3:BASE] + np.cross(arm, force)
        arms = places[0, index] - centres[0, :, index]
        left = np.concatenate((force - forces.sum(axis=0), moment - np.cross(arms, forces).sum(axis=0)))
        assert np.abs(balance.ravel() - left).max() < 1e-12 * np.abs(left).max()
        scale = np.abs(places[:, index]).max(axis=(1, 2))
        off = np.abs(positions.reshape(2, 3, 3).transpose(1, 0, 2) - places[:, index]).max(axis=(1, 2))
        assert (off < 1e-13 * scale).all()


def test_angles_are_the_inverse_of_rotations(go2):
    motion = sampled_motion(go2, 20)
    angles = motion[:, 3:BASE]
    off = angles[0] + np.random.default_rng(2).uniform(-0.1, 0.1, angles[0].shape)
    assert np.abs(angles_of("yxz", *rotation_with_rates("yxz", angles), off) - angles).max() < 1e-10


def test_a_robot_on_two_feet_turns_so_that_no_moment_is_left(go2, mechanics):
    motion = sampled_motion(go2, 3)
    places = mechanics.feet(motion[:, :, :1], FEET)
    line = Line.through(dict(zip(FEET, places[0, 0], strict=True)))
    pendulum = Pendulum(mechanics, line, motion)
    state = np.array([0.3, -1.2])
    for index in range(3):
        angle = np.array([*state, pendulum.acceleration(index, *state)])[:, None]
        rotated = line.rotated_robot("yxz", motion[:, :, [index]], angle)
        wrench = mechanics.base_wrench(rotated)[0]
        arm = rotated[0, :3, 0] - line.point
        moment = wrench[3:] + np.cross(arm, wrench[:3])
        assert abs(moment @ line.direction) < 1e-10 * np.abs(moment).max()


BENT = np.array([-0.5, 0.0, 0.0, 1.0, -0.5, 0.0])  # a G1's left leg, rad


@pytest.fixture(scope="module")
def g1():
    joints = [
        f"left_{name}_joint" for name in ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
    ]
    urdf = "example-robot-data:g1_description/urdf/g1_29dof_rev_1_0.urdf"
    return fp.Robot.from_urdf(urdf, base="free-flyer", joints=joints)


@pytest.fixture(scope="module")
def feet(g1):
    level = Attitude(angles=(0.0, 0.0, 0.0), axes="zyx")
    return feet_at(g1, "left_ankle_roll_link", level, BENT, "contacts")


def test_files_hold_points_of_soles(g1, feet):
    arrays = {name: np.zeros((BASE + 6, 2)).tolist() for name in ("y", "v", "a")}
    content = {"axes": "zyx", "friction": 0.6, "times": [0.0, 1.0], "shares": np.zeros((9, 2)).tolist(), **arrays}
    content["contacts"] = [contact_table(foot) for foot in feet]
    assert read_spatial_stance(content, g1, 9.81, "stances[0]").contacts == feet
    del content["contacts"][1]["point"]
    with pytest.raises(fp.InputError, match="by suffix and point, or by neither"):
        read_spatial_stance(content, g1, 9.81, "stances[0]")


def test_a_sole_stands_on_three_points(g1, feet):
    """Heel and toes on the ground; where the base moves, the leg brings all three back to where they were."""
    assert [foot.suffix for foot in feet] == [".heel", ".left_toe", ".right_toe"]
    mechanics = Mechanics(g1, "zyx", 9.81, feet)
    motion = np.zeros((3, BASE + 6, 1))
    motion[0, BASE:, 0] = BENT
    names = [foot.name for foot in feet]
    places = mechanics.feet(motion, names)[0, 0]
    assert np.ptp(places[:, 2]) < 1e-12
    assert np.allclose(places[1] - places[2], [0.0, 0.06, 0.0], atol=1e-9)  # the width of its toes
    moved = motion.copy()
    moved[0, :BASE, 0] = [0.01, 0.02, -0.02, 0.1, 0.05, -0.05]
    moved[1:, :BASE, 0] = [[0.1, -0.2, 0.3, 1.0, -1.0, 0.5], [1.0, 2.0, -3.0, 4.0, 5.0, -6.0]]
    closed = mechanics.feet(mechanics.close(moved, dict(zip(names, places, strict=True))), names)[:, 0]
    assert np.abs(closed[0] - places).max() < 1e-11
    assert np.abs(closed[1:]).max() < 1e-8


@pytest.mark.parametrize("fixed_end", [0, -1])
def test_on_a_sole_the_base_moves_as_forces_push_it(g1, feet, fixed_end):
    """The motion takes these forces and no others, its sole stands, and a finer grid gives the same motion."""
    mechanics = Mechanics(g1, "zyx", 9.81, feet)
    names = [foot.name for foot in feet]
    weight = 9.81 * g1.mass
    ends = np.array(
        [[[0.1, 0.0, 0.5], [-0.1, 0.1, 0.4], [0.0, -0.1, 0.3]], [[0.0, 0.1, 0.2], [0.1, 0.0, 0.3], [0.1, 0.1, 0.4]]]
    )

    def pushed(count):
        times = np.linspace(0.0, 0.03, count)
        motion = np.zeros((3, BASE + 6, count))
        motion[0, BASE:] = BENT[:, None]
        places = dict(zip(names, mechanics.feet(motion, names)[0, 0], strict=True))
        planned_forces = weight * np.array(
            [np.interp(times, times[[0, -1]], of_ends) for of_ends in ends.reshape(2, -1).T]
        )
        return pushed_from(mechanics, times, motion, planned_forces, places, fixed_end), planned_forces, places

    motion, planned_forces, places = pushed(3)
    positions = mechanics.feet(motion, names)
    assert np.abs(positions[0] - np.array(list(places.values()))).max() < 1e-11
    forces = planned_forces.T.reshape(3, 3, 3)
    arms = np.array(list(places.values())) - motion[0, :3].T[:, None]
    borne = np.hstack((forces.sum(axis=1), np.cross(arms, forces).sum(axis=1)))
    assert np.abs(mechanics.base_wrench(motion) - borne).max() < 1e-9 * weight
    assert np.abs(motion[:2, :BASE, fixed_end]).max() == 0.0
    free_end = -1 - fixed_end
    fine, _, _ = pushed(5)
    assert np.abs(motion[0, :BASE, free_end]).max() > 1e-3
    assert np.abs(fine[:2, :, free_end] - motion[:2, :, free_end]).max() < 1e-4 * np.abs(motion[1, :, free_end]).max()


def test_forces_make_the_wrench_inside_the_cones():
    arms = np.array([[[0.2, 0.15, -0.3], [0.2, -0.15, -0.3], [-0.2, 0.15, -0.3], [-0.2, -0.15, -0.3]]])
    planned_forces = np.zeros((1, 4, 3))
    planned_forces[0, :, 2] = [60.0, 30.0, 20.0, 40.0]
    wrench = np.array([[60.0, -20.0, 150.0, 3.0, -18.0, 1.0]])
    forces = shared_forces(wrench, arms, planned_forces, 150.0, 0.6)
    made = np.concatenate((forces.sum(axis=1), np.cross(arms, forces).sum(axis=1)), axis=1)
    assert np.abs(made - wrench).max() < 1e-9 * 150.0
    assert (np.linalg.norm(forces[0, :, :2], axis=1) <= 0.6 * forces[0, :, 2] + 1e-6).all()
    unlimited = shared_forces(wrench, arms, planned_forces, 150.0, 100.0)
    assert np.abs(unlimited.sum(axis=1) - wrench[:, :3]).max() < 1e-9


def test_light_feet_do_not_keep_forces_from_making_the_wrench():
    """Near the cones' edges, with one foot that bears next to nothing and is held to its planned force."""
    rng = np.random.default_rng(0)
    weight = 150.0
    for _ in range(50):
        arms = np.array([[0.2, 0.1, -0.3], [0.2, -0.1, -0.3], [-0.2, 0.1, -0.3], [-0.2, -0.1, -0.3]])
        exact = 30.0 * rng.normal(size=(4, 3))
        exact[:, 2] = np.abs(exact[:, 2]) + 0.01
        exact[rng.integers(4)] *= 10 ** rng.uniform(-6, -1)
        horizontal = np.linalg.norm(exact[:, :2], axis=1)
        exact[:, :2] *= np.minimum(1.0, 0.55 * exact[:, 2] / horizontal)[:, None]
        wrench = np.concatenate((exact.sum(axis=0), np.cross(arms, exact).sum(axis=0)))
        planned_forces = exact + 3.0 * rng.normal(size=(4, 3)) * (exact[:, 2:] > 1.0)
        forces = shared_forces(wrench[None], arms[None], planned_forces[None], weight, 0.6)[0]
        made = np.concatenate((forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)))
        assert np.abs(made - wrench).max() < 1e-8 * weight
        assert (np.linalg.norm(forces[:, :2], axis=1) <= 0.6 * forces[:, 2] + 1e-9 * weight).all()


def test_derivatives_of_pieces_are_those_of_differences():
    """Two kinds of pieces that share variables: Jacobian, gradient and Hessian of the whole program."""
    ca = casadi()
    w = ca.SX.sym("w", 3)
    p = ca.SX.sym("p")
    rows = ca.vertcat(w[0] * w[1] * p, ca.sin(w[2]) * w[0])
    of_nodes = Expression(w, p, rows, w[0] ** 2 * w[1] + p * w[2])
    nodes = Piece(of_nodes, np.array([[0, 3], [1, 4], [2, 2]]), np.array([[2.0, 3.0]]),
                  np.zeros((2, 2)), np.ones((2, 2)), ("a", "b"))  # fmt: skip
    pairs = ca.SX.sym("pairs", 2)
    of_pairs = Expression(pairs, ca.SX.sym("q", 0), pairs[0] * pairs[1] ** 2, ca.SX(0))
    between = Piece(of_pairs, np.array([[1], [4]]),
                    np.zeros((0, 1)), np.zeros((1, 1)), np.zeros((1, 1)), ("c",))  # fmt: skip
    assembly = Assembly([nodes, between], np.array([1.0, 2.0, 3.0, 4.0, 5.0]))
    assert assembly.labels == ["a", "b", "a", "b", "c"]
    rng = np.random.default_rng(0)
    x = rng.uniform(0.5, 1.5, 5)
    parameters = np.append(rng.uniform(0.5, 1.5, 5), 0.7)
    multipliers = rng.uniform(-1.0, 1.0, 5)

    def lagrangian(point):
        cost, _ = assembly.functions["grad_f"](point, parameters)
        return 1.3 * float(cost) + multipliers @ np.array(assembly.evaluate(point, parameters)).ravel()

    def gradient(point):
        _, of_cost = assembly.functions["grad_f"](point, parameters)
        _, jacobian = assembly.functions["jac_g"](point, parameters)
        return 1.3 * np.array(of_cost).ravel() + multipliers @ np.array(jacobian)

    step = 1e-6 * np.eye(5)
    differences = [(lagrangian(x + one) - lagrangian(x - one)) / 2e-6 for one in step]
    assert np.abs(gradient(x) - differences).max() < 1e-8
    hessian = np.array(assembly.functions["hess_lag"](x, parameters, 1.3, multipliers))
    second = np.array([(gradient(x + one) - gradient(x - one)) / 2e-6 for one in step])
    assert np.abs(hessian - np.triu(second)).max() < 1e-8


def test_the_solver_s_blas_has_one_thread():
    """With more, jumps in processes, which have one, were others than here."""
    before = dict(os.environ)
    casadi()
    assert dict(os.environ) == before
    maps = Path("/proc/self/maps")
    lines = maps.read_text().splitlines() if maps.exists() else []
    loaded = {line.split()[-1] for line in lines if "libcasadi-tp-openblas" in line}
    if not loaded:
        pytest.skip("this CasADi has no such library")
    assert [ctypes.CDLL(path).openblas_get_num_threads() for path in loaded] == [1]
