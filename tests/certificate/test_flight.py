"""The proof's dynamics against Pinocchio, against the paper's corrected Appendix, and against 50-digit values."""

from pathlib import Path

import flint
import numpy as np
import pinocchio as pin
import proof_reference as reference
import pytest
from flint import arb, arb_series
from places import URDF
from proof_plans import draw_coefficients, make_plan
from proof_sharp import BITS, Sharp

from floatplan.certificate.cells import TimeCells
from floatplan.certificate.planar.flight import assemble, fly, joint_models
from floatplan.certificate.planar.inertia import cached_robot
from floatplan.robot.robot import Coupling, Robot


def proof_robot(record):
    file = Path(record.robot.urdf)
    return cached_robot(file.read_bytes(), file, record.robot)


def branched_urdf(rng, links, axis, tilt):
    """A random tree whose joints turn about plus or minus one axis; a fixed and a prismatic joint among them."""
    parts = ['<robot name="random">']
    for k in range(links):
        center = " ".join(map(str, rng.uniform(-0.3, 0.3, 3)))
        diagonal = rng.uniform(0.05, 0.1, 3)
        parts.append(
            f'<link name="l{k}"><inertial><origin xyz="{center}" rpy="{tilt * rng.uniform()} 0.2 {tilt}"/>'
            f'<mass value="{rng.uniform(0.5, 3)}"/><inertia ixx="{diagonal[0]}" iyy="{diagonal[1]}" '
            f'izz="{diagonal[2]}" ixy="0.01" ixz="-0.005" iyz="0.004"/></inertial></link>'
        )
    for k in range(1, links):
        kind = {2: "fixed", 4: "prismatic"}.get(k, "revolute")
        sign = rng.choice([-1, 1])
        place = " ".join(map(str, rng.uniform(-0.5, 0.5, 3)))
        turn = np.zeros(3)
        turn[axis] = rng.uniform(-1, 1)
        direction = np.zeros(3)
        direction[axis] = sign
        parts.append(
            f'<joint name="j{k}" type="{kind}"><parent link="l{rng.integers(0, k)}"/><child link="l{k}"/>'
            f'<origin xyz="{place}" rpy="{" ".join(map(str, turn))}"/><axis xyz="{" ".join(map(str, direction))}"/>'
            '<limit lower="-3" upper="3" effort="9" velocity="9"/></joint>'
        )
    return "\n".join([*parts, "</robot>"])


def sharp_joints(record, t):
    """Positions, velocities and accelerations (n,), rounded from 128 bits."""
    states = []
    with flint.ctx.workprec(128):
        for row, centre, amplitude in zip(record.coefficients, record.centre, record.amplitude, strict=True):
            local = flint.arb_poly(row.tolist())(flint.arb_poly([arb(t), arb(1)]))
            q = arb_series(local.coeffs(), 3).sin() * arb(float(amplitude)) + arb(float(centre))
            states.append([float(q[0]), float(q[1]), 2.0 * float(q[2])])
    return np.array(states).T


def pinocchio_flight(robot, record, t):
    """Joint torques, orientation rate and its derivative at an instant, by RNEA with a base wrench of zero."""
    model, data = robot.model, robot.model.createData()
    q, dq, ddq = sharp_joints(record, t)
    configuration = robot.reference + robot.selection @ q
    velocity, acceleration = robot.selection @ dq, robot.selection @ ddq
    normal = 3 + int(np.argmax(np.abs(robot.plane.normal)))
    rows = [int(np.argmax(robot.plane.horizontal)), int(np.argmax(robot.plane.vertical)), normal]
    momentum = pin.computeCentroidalMap(model, data, configuration)[rows]
    target = np.array([0.0, 0.0, robot.plane.normal[normal - 3] * record.angular_momentum])
    velocity[:3] = np.linalg.solve(momentum[:, :3], target - momentum @ velocity)
    wrench = pin.rnea(model, data, configuration, velocity, acceleration)[:3]
    mass = pin.crba(model, data, configuration)
    mass = np.triu(mass) + np.triu(mass, 1).T
    acceleration[:3] = -np.linalg.solve(mass[:3, :3], wrench)
    return robot.selection.T @ pin.rnea(model, data, configuration, velocity, acceleration), velocity[2]


def assert_agrees(robot, record, instants):
    for t in instants:
        cells = TimeCells.between(np.array([t]), np.array([t + 1e-7]))
        joints = joint_models(proof_robot(record), record, cells)
        torques, rate = pinocchio_flight(robot, record, t)
        start = joints.motor_torques.at_end(-1.0)
        scale = max(1.0, np.abs(torques).max())
        ratios = robot.motor_ratios
        off = np.abs(start.mid[0] @ ratios - torques)
        assert (off <= 1e-12 * scale + start.rad[0] @ np.abs(ratios)).all()
        assert start.rad.max() <= 1e-9 * scale
        assert joints.rate.at_end(-1.0).mid[0, 0] == pytest.approx(rate, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", ["gymnast", "acrobat", "high_jumper", "chain10"])
def test_torques_and_rate_agree_with_pinocchio(name):
    robot = Robot.from_urdf(URDF / f"{name}.urdf")
    rng = np.random.default_rng(3)
    record = make_plan(robot, draw_coefficients(rng, len(robot.joints), 0.9, 0.3), duration=0.9)
    assert_agrees(robot, record, np.linspace(0.0, 0.85, 6))


@pytest.mark.parametrize("seed", range(6))
def test_random_trees_agree_with_pinocchio(seed, tmp_path):
    """Either side of the plane, joint axes of both signs, rotated inertias, a fixed, a locked and a coupled joint."""
    rng = np.random.default_rng(seed)
    path = tmp_path / "tree.urdf"
    axis = seed % 3
    path.write_text(branched_urdf(rng, 7, axis, tilt=0.4))
    coupled = {"j5": Coupling("j1", -0.7, 0.3)} if seed % 2 else {}
    locked = {"j4": 0.2} | ({"j3": -0.5} if seed > 2 else {})
    plane = ["zy", "xz", "yx"][axis] if seed < 3 else None
    robot = Robot.from_urdf(path, plane=plane, coupled=coupled, locked=locked)
    record = make_plan(robot, draw_coefficients(rng, len(robot.joints), 1.0, 0.3), duration=1.0)
    assert_agrees(robot, record, [0.0, 0.3, 0.8])


def test_appendix_constants():
    """C_ij of the gymnast: the corrected d_1 to d_7 of (A.5)."""
    robot = Robot.from_urdf(URDF / "gymnast.urdf")
    planar = proof_robot(make_plan(robot, np.zeros((2, 8)) + 0.1))
    d = appendix()
    wanted = [[d[1], d[2], d[3]], [d[2], d[4], d[6]], [d[3], d[6], d[7]]]
    assert np.abs(planar.inertia.re.mid - np.array([[float(x) for x in row] for row in wanted])).max() < 1e-16
    assert np.abs(planar.inertia.im.mid).max() < 1e-16


def appendix():
    """d_1 ... d_7 of (A.5) with the slips corrected, in Arb, from the doubles of Table I."""
    m0, m1, m2 = arb(3.0), arb(2.5), arb(1.0)
    l1, l2, r0, r1 = arb(0.2), arb(0.15), arb(0.2), arb(0.4) - arb(0.2)
    i0, i1, i2, m = arb(0.16), arb(0.107), arb(0.053), m0 + m1 + m2
    r0 = arb(0.4) - r0
    return {
        1: i0 + m0 * (m1 + m2) * r0 * r0 / m,
        2: m0 * r0 * ((m1 + m2) * l1 + m2 * r1) / m,
        3: m0 * r0 * m2 * l2 / m,
        4: i1 + (m0 * m1 * l1 * l1 + m1 * m2 * r1 * r1 + m0 * m2 * (l1 + r1) * (l1 + r1)) / m,
        6: m2 * l2 * (m0 * (l1 + r1) + m1 * r1) / m,
        7: i2 + m2 * (m0 + m1) * l2 * l2 / m,
    }


def test_models_contain_values_of_fifty_digits():
    """theta' and torques at instants, and theta(T), by code of their own."""
    robot = Robot.from_urdf(URDF / "gymnast.urdf")
    record = make_plan(robot, draw_coefficients(np.random.default_rng(8), 2, 1.1, 0.15), frames=("foot", "hand"))
    flight = fly(proof_robot(record), record, [], 4096)
    sharp = Sharp(robot, record)
    with flint.ctx.workprec(BITS):
        for cell in range(0, len(flight.cells), 5):
            for u in (-1.0, 0.25, 1.0):
                first, last = arb(float(flight.cells.low[cell])), arb(float(flight.cells.high[cell]))
                t = (first + last) / 2 + (last - first) / 2 * arb(u)
                truths = [(flight.joints.rate, 0, sharp.rate(t))]
                truths += [(flight.joints.motor_torques, k, torque) for k, torque in enumerate(sharp.torques(t))]
                for model, item, truth in truths:
                    value = flint.arb_poly([float(x) for x in model.c[:, cell, item]])(arb(u))
                    assert abs(value - truth) <= arb(float(model.e[cell, item]))
        last = flight.orientation.at_end(1.0)
        off = sharp.orientation(record.duration) - arb(float(last.mid[-1, 0]))
        assert abs(off) <= arb(float(last.rad[-1, 0]))
        assert last.rad[-1, 0] < 1e-10


@pytest.mark.parametrize("seed", range(6))
def test_wide_enclosures_contain_the_motion(seed):
    """Cells far too coarse, so that cutting off dominates the radii: they must hold, and be of use."""
    rng = np.random.default_rng(seed)
    robot = Robot.from_urdf(URDF / f"{('gymnast', 'acrobat', 'high_jumper')[seed % 3]}.urdf")
    coefficients = draw_coefficients(rng, len(robot.joints), 1.1, 0.1)
    record = make_plan(robot, coefficients, instants=1001)
    ends = np.linspace(0.0, 1.1, 9 + 2 * seed)
    cells = TimeCells.between(ends[:-1], ends[1:])
    with np.errstate(all="ignore"):
        flight = assemble(record, cells, joint_models(proof_robot(record), record, cells))
    u = np.linspace(-1.0, 1.0, 41)
    times = 0.5 * (cells.low + cells.high) + 0.5 * (cells.high - cells.low) * u[:, None]
    instants = np.unique(np.concatenate([[0.0], times.ravel()]))
    dense = reference.evaluate(robot, record, instants)
    place = np.searchsorted(instants, times)
    pairs = [
        (flight.joints.rate, dense.rate[:, None]),
        (flight.joints.motor_torques, dense.torques),
        (flight.joints.velocities, dense.velocities),
        (flight.orientation, dense.orientation[:, None]),
    ]
    widest = 0.0
    for model, truth in pairs:
        off = np.abs(np.tensordot(u[:, None] ** np.arange(model.order), model.c, axes=1) - truth[place]).max(axis=0)
        noise = 1e-9 * (1.0 + np.abs(truth).max())
        assert not (off > model.e + noise).any()
        wide = np.isfinite(model.e) & (model.e > 10.0 * noise)
        widest = max(widest, (off[wide] / model.e[wide]).max(initial=0.0))
    assert widest > 1e-6
