"""The kernel's program of flights in space: derivatives, values against Pinocchio, minima, and lifted motions."""

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from kernel_program import KernelProgram
from long_cases import cases
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan import tables
from floatplan.motion.sine_polynomial import WrittenMotion, basis
from floatplan.motion.spatial.attitude import LEVELS, cells
from floatplan.motion.spatial.clearance import pair_distances_in_space
from floatplan.motion.spatial.flight import spatial_flight
from floatplan.planning.kernel_input.rows import DistanceRows
from floatplan.planning.lifting import LiftedFlight
from floatplan.planning.search import Search

LEVEL = 2  # of grids
EXTRA = (0.0, 0.123, 0.5, 0.77, 1.0)
OBJECTIVES = ("coefficients", "torque", "acceleration")
LIMITS = {"torque": 40.0, "velocity": 9.0, "acceleration": 200.0, "orientation_rate": 12.0}
TIGHT = {"torque": 8.0, "velocity": 1.5, "acceleration": 20.0, "orientation_rate": 1.0}
MOMENTA = {"given": (3.0, 25.0, -5.0), "free": "free", "none": 0.0}


def diver(root, momentum="free", objective="coefficients", limits=LIMITS, degree=7, **of_robot):
    """Ask for one somersault and a half with half a twist, of a robot with what all features need."""
    robot = fp.Robot.from_urdf(root / "urdf" / "diver.urdf", base="free-flyer", armature=0.02, **of_robot)
    n, rng = len(robot.joints), np.random.default_rng(3)
    low, high = robot.position_limits.T
    ends = low + (high - low) * rng.uniform(0.3, 0.7, (2, n))
    start = fp.Posture(fp.Attitude(angles=(0, 0, 0), axes="yxz"), ends[0], *(rng.normal(size=(2, n)) * [[0.3], [2.0]]))
    goal = fp.Posture(fp.Attitude(angles=(3 * math.pi, 0, math.pi), axes="yxz"), ends[1])
    motion = fp.Motion(degree=degree, objective=objective)
    motors = {"left_flexion": fp.Motor(stall=300.0, slope=8.0)} if limits else {}
    return fp.Problem(robot, start, goal, fp.Flight(1.3, momentum), motion, fp.Limits(**limits, motor=motors))


def program_and_point(problem, seed, size=0.2):
    program = KernelProgram(problem, LEVEL, EXTRA)
    variables = program.of
    return program, variables.nominal_motion + size * np.random.default_rng(seed).normal(size=variables.size)


def test_every_limit_and_objective_of_the_tables_is_among_them():
    assert set(LIMITS) == set(tables.LIMIT_TABLE)
    assert set(OBJECTIVES) == set(tables.OBJECTIVES)


@pytest.mark.parametrize("momentum", MOMENTA)
@pytest.mark.parametrize("objective", OBJECTIVES)
def test_derivatives_are_those_of_differences(root, momentum, objective):
    """Of fourth order, of the attitude at landing, all limits at all instants, and the objective, by each variable."""
    coupled = {"right_abduction": "left_abduction"}
    problem = diver(root, MOMENTA[momentum], objective, coupled=coupled)
    program, x = program_and_point(problem, 1)
    assert program.of.momentum.axes.shape[1] == 3 * (momentum == "free")

    def value(at):
        it = program.whole(at)
        return np.concatenate((it["values"][known], it["equality"], [it["objective"]]))

    here, step = program.whole(x), 2e-4
    known = np.isfinite(here["values"])
    assert known.any(axis=1).all()
    computed = np.concatenate((here["slopes"][known], here["row"], here["gradient"][None]))
    for column in np.linalg.inv(program.of.metric).T:
        ahead, behind, far_ahead, far_behind = (value(x + share * step * column) for share in (1, -1, 2, -2))
        expected = (8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * step)
        assert np.abs(computed @ column - expected).max() < 1e-6 * (1 + np.abs(expected).max())
    eigenvalues = np.linalg.eigvalsh(here["hessian"])
    assert eigenvalues.min() > 1e-7 * eigenvalues.max()


OBSTACLES = (
    fp.Sphere(center=(0.5, 0.2, 2.0), radius=0.2, margin=0.02, velocity=(0.1, -0.3, 0.2)),
    fp.Capsule(start=(1.0, 0.0, 1.0), end=(1.0, 0.5, 2.5), radius=0.1, window=(0.2, 0.9)),
    fp.HalfSpace(point=(0.0, 0.0, -0.5), normal=(0.1, 0.2, 1.0)),
    fp.Box(center=(-0.8, 0.4, 1.5), size=(0.3, 0.5, 0.7), velocity=(0.2, 0.0, 0.0)),
)
PAIRS = (fp.SelfClearance(("left_arm", "legs"), 0.01), fp.SelfClearance(("left_arm", "right_arm")))


@pytest.mark.parametrize("instructions", cases(["widest", 0, 1], {0, 1}))
@pytest.mark.parametrize("momentum", MOMENTA)
@pytest.mark.parametrize("others", [True, False])
def test_derivatives_of_distances_are_those_of_differences(root, kernel, momentum, others, instructions, monkeypatch):
    """To obstacles that move, between links, and over the ground, by each variable; a nearest place may jump at one."""
    if instructions != "widest":
        if instructions >= kernel.instructions:
            pytest.skip("these are the widest that the processor has, or wider ones")
        monkeypatch.setattr(kernel, "instructions", instructions)
    coupled = {"right_abduction": "left_abduction"}
    limits = LIMITS if others else {}
    problem = replace(
        diver(root, MOMENTA[momentum], limits=limits, coupled=coupled),
        obstacles=OBSTACLES,
        self_clearances=PAIRS,
        ground=True,
    )
    program, x = program_and_point(problem, 1)
    here, step = program.whole(x), 2e-5
    known = np.isfinite(here["values"])
    count = sum(len(block.labels) for block in Search(problem).spec.constraints if isinstance(block.rows, DistanceRows))
    known[count:] = False
    assert known[:count].any(axis=1).all()
    jumped = 0
    for column in np.linalg.inv(program.of.metric).T:
        ahead, behind, far_ahead, far_behind = (
            program.whole(x + share * step * column)["values"][known] for share in (1, -1, 2, -2)
        )
        expected = (8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * step)
        off = np.abs(here["slopes"][known] @ column - expected)
        jumped += int((off > 1e-5 * (1 + np.abs(expected).max())).sum())
    assert jumped <= len(program.of.metric) * 3


def test_distances_are_those_of_numpy(root):
    """Of the whole motion's capsules, at the nodes, and the heights of its solids over the ground."""
    problem = replace(diver(root, limits={}), obstacles=OBSTACLES, self_clearances=PAIRS, ground=True)
    program, x = program_and_point(problem, 2)
    values = program.whole(x)["values"]
    s = np.concatenate((cells(*LEVELS[LEVEL]).s, EXTRA))
    variables, flight = program.of, spatial_flight(problem)
    h, z = variables.angular_momentum(x), variables.free_coefficients(x)
    motions = variables.motion_class(h)
    b, low, high = motions.powers_of_seconds(z), motions.centre, motions.amplitude
    written = WrittenMotion.from_powers(low, high, b, problem.flight.duration)
    motion = flight.whole_motion(written, h, flight.ballistics)
    times = s * problem.flight.duration
    segments = motion.segments(times)
    expected = [(segments.distances(each, times) - each.margin) / 0.1 for each in problem.obstacles]
    expected.append(motion.heights(times)[0] / 0.1)
    for pair in PAIRS:
        ends = (
            segments.of(np.array([i for i, link in enumerate(flight.links) if link == name])) for name in pair.links
        )
        expected.append((pair_distances_in_space(*ends) - pair.margin) / 0.1)
    rows = np.concatenate(expected, axis=1).T
    applies = np.isfinite(values)
    assert applies.mean() > 0.8
    back_off = values[applies] - rows[applies]
    assert np.abs(back_off).max() < 1e-7


def test_torques_and_rates_are_pinocchio_s(root):
    """RNEA of the free flyer whose base moves so that no force acts on it, at the attitude that the kernel says."""
    problem = diver(root, limits=LIMITS)
    program, x = program_and_point(problem, 2)
    values, ready = program.whole(x)["values"], Search(problem)
    lifted = LiftedFlight(ready.spec, program.of)
    turning = lifted.turning(cells(16, 8), x)
    variables, model = program.of, problem.robot.model
    data = model.createData()
    form, h = variables.polynomials.form, variables.angular_momentum(x)
    s = np.concatenate((cells(*LEVELS[LEVEL]).s, EXTRA))
    motion = variables.motion_class(h).motion(variables.free_coefficients(x), basis(form).values(s))
    attitudes, selection = turning.at(s), problem.robot.selection
    rows = np.cumsum([0, *(len(block.labels) for block in ready.spec.constraints)])
    alone = {number: block for number, block in enumerate(ready.spec.constraints) if len(block.rows.weights) == 1}
    of = {next(iter(block.rows.weights)): number for number, block in alone.items()}
    assert set(of) == {"motor_torques", "velocities", "accelerations", "orientation_rate"}
    checked = 0
    for k in range(0, len(s), 7):
        q = np.zeros(model.nq)
        q[3:7] = Rotation.from_matrix(attitudes[k]).as_quat()
        q[7:] = problem.robot.reference[7:] + selection[6:] @ motion.positions[k]
        v, a = selection @ motion.velocities[k], selection @ motion.accelerations[k]
        pin.computeCentroidalMap(model, data, q)
        inertia, momentum = data.Ag[:, :6].copy(), data.Ag @ v
        v[:6] = np.linalg.solve(inertia, np.concatenate((np.zeros(3), h)) - momentum)
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        gravity = model.gravity.linear.copy()
        model.gravity.linear[:] = 0
        a[:6] = np.linalg.solve(mass[:6, :6], -pin.rnea(model, data, q, v, a)[:6])
        torques = problem.robot.transmission.T @ pin.rnea(model, data, q, v, a)
        model.gravity.linear[:] = gravity
        expected = {"motor_torques": torques, "orientation_rate": [np.linalg.norm(v[3:6])]}
        for name, own in expected.items():
            number = of[name]
            weights = ready.spec.constraints[number].rows.weights[name]
            here = values[rows[number] : rows[number + 1], k]
            if np.isfinite(here).all():
                assert here == pytest.approx(1 + weights @ own, abs=1e-8 * (1 + np.abs(weights @ own).max()))
                checked += 1
    assert checked > 20


@pytest.mark.parametrize("momentum", MOMENTA)
def test_minima_between_the_stages_are_those_of_a_fine_look(root, momentum):
    problem = diver(root, MOMENTA[momentum], limits=TIGHT)
    _, x = program_and_point(problem, 4)
    ready = Search(problem)
    variables = ready.nominal_start.variables
    ended = ready.judge(replace(ready.nominal_start, x=x), "infeasible")
    worst = ended.worst
    assert worst.least < 0
    fine = np.linspace(0.002, 0.998, 180)
    look = KernelProgram(problem, ended.level, tuple(fine), variables).whole(x)["values"][:, -len(fine) :]
    rows = np.cumsum([0, *(len(block.labels) for block in ready.spec.constraints)])
    row = rows[worst.block] + worst.row
    for number in np.flatnonzero(look.min(axis=1) < 0):
        found = worst.value[row == number]
        assert found.size
        assert found.min() < look[number].min() + 1e-9
        assert found.min() > look[number].min() - 0.1 * (1 + np.abs(look[number]).max())
