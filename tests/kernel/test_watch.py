"""Rows that the kernel watches, their derivatives and their minima: those of the general path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from general_path import take_general_path

import floatplan as fp
from floatplan.kernel import layout
from floatplan.planning.attempt import Attempts
from floatplan.planning.transcription.constraints import Limit
from floatplan.planning.transcription.exchange import local_minima
from floatplan.planning.transcription.program import FlightProgram, objective, watching

PROBLEMS = ("obstacle", "moving_hoop", "somersault_motors", "torque_limited", "falling_cat_apart", "handstand_ground")
LEVEL = 4  # of grids
EXTRA = np.array([0.0, 0.123, 0.5, 0.77, 1.0])
EVERYTHING = fp.Limits(torque=30.0, velocity=20.0, acceleration=300.0, orientation_rate=9.0)
AROUND = (
    fp.Circle(center=(0.3, 1.2), radius=0.2, margin=0.02, velocity=(0.4, -0.2)),
    fp.HalfPlane(point=(0.0, -0.3), normal=(0.1, 1.0), margin=0.01),
    fp.Bar(start=(0.2, 0.5), end=(0.4, 1.4), radius=0.03, velocity=(0.1, 0.3), window=(0.2, 0.8)),
)


@pytest.fixture
def kernel():
    return layout.kernel()


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


def program_and_point(problem, seed):
    ready = Attempts(problem, 0)
    variables = ready.plain_start.variables
    x = ready.plain_start.x + 0.3 * np.random.default_rng(seed).normal(size=variables.size)
    nodes = ready.model.nodes(LEVEL, variables.polynomials.form)
    sampling = watching(nodes, ready.constraints, EXTRA)
    aim = objective(problem, ready.model, variables, nodes)
    return ready, FlightProgram(ready.model, variables, sampling, aim, ready.constraints), x


def close(actual, expected):
    assert actual.shape == expected.shape
    assert np.abs(actual - expected).max(initial=0) <= 1e-11 * (1 + np.abs(expected).max(initial=0))


@pytest.mark.parametrize("instructions", range(3))
@pytest.mark.parametrize("aim", ["coefficients", "torque", "acceleration"])
def test_rows_and_derivatives_are_those_of_the_constraints(kernel, problem, aim, instructions, monkeypatch):
    if instructions > kernel.instructions:
        pytest.skip("the processor has no such instructions")
    problem = replace(problem, motion=replace(problem.motion, objective=aim))
    _, program, x = program_and_point(problem, 0)
    monkeypatch.setattr(kernel, "instructions", instructions)
    here = program.evaluate(x)
    derivatives = here.gradient, here.equality_jacobian, here.inequality_jacobian
    take_general_path(monkeypatch)
    _, without, x = program_and_point(problem, 0)
    there = without.evaluate(x)
    close(here.inequality, there.inequality)
    close(here.equality, there.equality)
    assert here.objective == pytest.approx(there.objective, rel=1e-12)
    for one, other in zip(
        derivatives, (there.gradient, there.equality_jacobian, there.inequality_jacobian), strict=True
    ):
        close(one, other)
    assert np.abs(there.inequality_jacobian).max() > 0


@pytest.mark.parametrize("aim", ["coefficients", "torque"])
def test_rows_that_the_kernel_does_not_know_stand_beside_its_own(problem, aim, monkeypatch):
    problem = replace(problem, motion=replace(problem.motion, objective=aim))
    _, program, x = program_and_point(problem, 1)
    here = program.evaluate(x)
    derivatives = here.gradient, here.equality_jacobian, here.inequality_jacobian
    hidden, compiled = {"motor_torques", "orientation_rate"}, Limit.compiled
    monkeypatch.setattr(Limit, "compiled", lambda self: None if self.weights.keys() & hidden else compiled(self))
    _, beside, _ = program_and_point(problem, 1)
    there = beside.evaluate(x)
    limits = [block for block in beside.constraints if isinstance(block, Limit)]
    assert [block for block, _ in beside._others] == [block for block in limits if block.weights.keys() & hidden]
    close(here.inequality, there.inequality)
    for one, other in zip(
        derivatives, (there.gradient, there.equality_jacobian, there.inequality_jacobian), strict=True
    ):
        close(one, other)


@pytest.mark.parametrize("instructions", range(3))
@pytest.mark.parametrize("seed", range(3))
def test_minima_between_the_nodes_are_those_of_finer_and_finer_looks(kernel, problem, seed, instructions, monkeypatch):
    """Of a start that may do no work: what the kernel says of it, and what the general path finds."""
    if instructions > kernel.instructions:
        pytest.skip("the processor has no such instructions")
    monkeypatch.setattr(kernel, "instructions", instructions)
    ready, _, x = program_and_point(problem, seed)
    variables = ready.plain_start.variables
    ended = ready._compiled.follow(variables, x, at_once=True, most_work=-1.0)
    here = ended.worst
    take_general_path(monkeypatch)
    model = Attempts(problem, 0).model
    there = local_minima(model, variables, ready.constraints, ended.level, ended.x)
    order, other = (np.lexsort((each.s, each.row, each.block)) for each in (here, there))
    assert here.block[order].tolist() == there.block[other].tolist()
    assert here.row[order].tolist() == there.row[other].tolist()
    assert np.abs(here.s[order] - there.s[other]).max(initial=0) < 1e-4  # a flat minimum is anywhere
    through_the_middle = there.value[other] < -1  # of a disc: there a distance falls and rises as a V
    off = here.value[order] - there.value[other]
    assert (off <= np.where(through_the_middle, 1e-4, 1e-9)).all()
