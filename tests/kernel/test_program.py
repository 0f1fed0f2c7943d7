"""The kernel's program: its rows, objectives and derivatives, its elastic steps, and minima of rows between instants.

Derivatives are held to those of a reference in NumPy, and in ``tests/planning/test_constraints.py`` to differences.
"""

from dataclasses import replace

import numpy as np
import pytest
from general_flight import general_flight
from kernel_program import KernelProgram
from long_cases import cases
from looked_minima import local_minima
from reduced_program import objective
from sampled_flight import jacobian_of, nodes_of, sample_also, trajectory, values_of

import floatplan as fp
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.planning.constraints import applies
from floatplan.planning.kernel_problem import KernelProblem
from floatplan.planning.spec import FlightSpec, nominal_start
from floatplan.planning.variables import Start

PROBLEMS = ("obstacle", "moving_hoop", "somersault_motors", "torque_limited", "falling_cat_apart", "handstand_ground")
LEVEL = 4  # of grids
EXTRA = (0.0, 0.123, 0.5, 0.77, 1.0)
EVERYTHING = fp.Limits(torque=30.0, velocity=20.0, acceleration=300.0, orientation_rate=9.0)
AROUND = (
    fp.Circle(center=(0.3, 1.2), radius=0.2, margin=0.02, velocity=(0.4, -0.2)),
    fp.HalfPlane(point=(0.0, -0.3), normal=(0.1, 1.0), margin=0.01),
    fp.Bar(start=(0.2, 0.5), end=(0.4, 1.4), radius=0.03, velocity=(0.1, 0.3), window=(0.2, 0.8)),
)


@pytest.fixture(params=[*PROBLEMS, "everything", "free", "following"])
def problem(request, root):
    if request.param in PROBLEMS:
        return fp.load_problem(root / "problems" / f"{request.param}.toml")
    plain = fp.load_problem(root / "problems" / "handstand.toml")
    if request.param == "everything":
        return replace(plain, limits=EVERYTHING, obstacles=AROUND)
    free = replace(plain, limits=EVERYTHING, obstacles=AROUND, flight=replace(plain.flight, angular_momentum="free"))
    if request.param == "free":
        return free
    start = replace(free.start, velocities="takeoff", accelerations="free")
    return replace(free, start=start)


AIMS = ("coefficients", "torque", "acceleration")


def program_and_point(problem, seed, size=0.3):
    program = KernelProgram(problem, LEVEL, EXTRA, back_off=EXCHANGE.back_off)
    start = nominal_start(FlightSpec(problem), problem.degrees)
    return program, start.x + size * np.random.default_rng(seed).normal(size=start.variables.size)


def close(actual, expected):
    assert actual.shape == expected.shape
    assert np.abs(actual - expected).max(initial=0) <= 1e-11 * (1 + np.abs(expected).max(initial=0))


@pytest.mark.parametrize("instructions", cases(["widest", 0, 1], {1}))
@pytest.mark.parametrize("aim", AIMS)
def test_values_and_derivatives_are_those_in_numpy(kernel, problem, aim, instructions, monkeypatch):
    problem = replace(problem, motion=replace(problem.motion, objective=aim))
    program, x = program_and_point(problem, 0)
    if instructions != "widest":
        if instructions >= kernel.instructions:
            pytest.skip("these are the widest that the processor has, or wider ones")
        monkeypatch.setattr(kernel, "instructions", instructions)
    here, kept = program.whole(x), FlightSpec(problem)
    flight, variables = general_flight(problem), program.of
    nodes = nodes_of(LEVEL, variables.polynomials.form)
    motion = trajectory(flight, variables, sample_also(nodes, np.array(EXTRA)), x)
    values = np.concatenate([values_of(block, motion) for block in kept.constraints], axis=1).T - EXCHANGE.back_off
    known = np.isfinite(here["values"])
    when = np.array([applies(block, motion.sampling.grid.s) for block in kept.constraints for _ in block.labels])
    assert (known <= when).all()
    assert (known == when)[:, motion.sampling.grid.s % 1 > 0].all()
    close(here["values"][known], values[known])
    close(here["equality"][0], motion.residual[0])
    if variables.following:
        return
    goal = objective(problem, flight, variables, nodes_of(EXCHANGE.constrained_level, variables.polynomials.form))
    assert here["objective"] == pytest.approx(goal.value(motion, x), rel=1e-12)
    slopes = np.concatenate([jacobian_of(block, motion) for block in kept.constraints], axis=1).swapaxes(0, 1)
    assert np.abs(slopes).max() > 0
    close(here["slopes"][known], slopes[known])
    close(here["row"][0], motion.residual_jacobian[0])
    close(here["gradient"], goal.gradient(motion, x))
    close(here["hessian"], goal.hessian(motion))


@pytest.mark.parametrize("penalty", [1.0, 1e3, 1e6])
def test_elastic_steps_are_the_least_of_their_program(problem, penalty):
    """Of a convex function, quadratic piece by piece: where its gradient vanishes."""
    kinks = 0
    for seed in range(6):
        program, x = program_and_point(problem, seed, 1.0)
        it = program.whole(x, penalty)
        known, step = np.isfinite(it["values"]), it["step"]
        rows, values = it["slopes"][known], it["values"][known]
        left = values + rows @ step
        kinks += ((left < 0) != (values < 0)).sum()
        pulls = penalty * np.append(np.minimum(left, 0), it["equality"][0] + it["row"][0] @ step)
        normals = np.vstack((rows, it["row"]))
        unbalanced = it["gradient"] + it["hessian"] @ step + normals.T @ pulls
        size = 1 + (np.abs(normals.T) @ np.abs(pulls)).max()
        # Times the last change, which may be larger.
        regular = EXCHANGE.regularisation * penalty * (1 + np.linalg.norm(step))
        assert np.abs(unbalanced).max() < 1e-6 * size + 10 * regular
    assert kinks


@pytest.mark.parametrize("seed", range(3))
def test_minima_between_the_nodes_are_those_of_finer_and_finer_looks(problem, seed):
    """Of a start that may do no work: what the kernel says of it, and what looks in NumPy find."""
    _, x = program_and_point(problem, seed)
    kept = FlightSpec(problem)
    variables = nominal_start(kept, problem.degrees).variables
    started = KernelProblem.of(kept, Start(variables, x, at_once=True))
    started.follow(range(1), np.inf, 0, expired=True)
    ended = started.result(kept)
    here = ended.worst
    flight = general_flight(problem)
    there = local_minima(flight, variables, kept.constraints, ended.level, ended.x)
    order, other = (np.lexsort((each.s, each.row, each.block)) for each in (here, there))
    assert here.block[order].tolist() == there.block[other].tolist()
    assert here.row[order].tolist() == there.row[other].tolist()
    assert np.abs(here.s[order] - there.s[other]).max(initial=0) < 1e-4  # a flat minimum is anywhere
    through_the_middle = there.value[other] < -1  # of a disc: there a distance falls and rises as a V
    off = here.value[order] - there.value[other]
    assert (off <= np.where(through_the_middle, 1e-4, 1e-9)).all()
