"""The compiled kernel as a library: sets of instructions, building it, doing without."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from elsewhere import told
from needed import skip_or_fail
from plain_problems import plain_problems

import floatplan as fp
from floatplan.kernel import build, library
from floatplan.kernel.batch import Search
from floatplan.kernel.bodies import merged_bodies
from floatplan.kernel.rows import Numbers, solver
from floatplan.motion.exact_polynomials import powers_of_seconds
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.sine_polynomial import Form, SinePolynomials, basis

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def kernel():
    found = library.kernel()
    if found is None:
        skip_or_fail("the kernel is not compiled: python -m floatplan.kernel.build")
    return found


def planned_by(problem, **search):
    return solver(problem, problem.degrees).plan(Numbers.of_problems([problem]).rows(), Search(**search))


def test_all_sets_of_instructions_agree(kernel, monkeypatch):
    if kernel.instructions == 0:
        pytest.skip("this processor has one set")
    problems = plain_problems(64)[::2]
    widest = [planned_by(problem) for problem in problems]
    for narrower in range(kernel.instructions):
        monkeypatch.setattr(kernel, "instructions", narrower)
        found = [planned_by(problem) for problem in problems]
        assert np.mean([one.status[0] == other.status[0] for one, other in zip(widest, found, strict=True)]) > 0.95
        solved = [pair for pair in zip(widest, found, strict=True) if all(each.status[0] for each in pair)]
        assert np.mean([abs(one.objective[0] / other.objective[0] - 1) < 1e-9 for one, other in solved]) > 0.95


@pytest.mark.parametrize("degree", [6, 10, 15])
def test_coefficients_are_rounded_as_exact_arithmetic_does(kernel, degree):
    """Sums of two doubles against whole numbers of 2^-256."""
    problem = plain_problems(24)[17]
    problem = fp.Problem(problem.robot, problem.start, problem.goal, problem.flight, fp.Motion(degree=degree))
    numbers = Numbers.of_problems([problem]).rows()
    found = planned_by(problem, most_starts=3)
    assert found.branch[0].tolist() == [0] * len(problem.degrees)
    for joint, b in enumerate(found.coefficients[0]):
        combination = [*numbers.boundary[0, joint], *found.z[0, joint]]
        assert powers_of_seconds(combination, problem.flight.duration) == b.tolist()


def test_the_orientation_is_that_of_the_closed_form(kernel):
    """Whatever the tree, with coupled joints and mirrored planes: what is left of (14), with many more nodes."""
    for problem in plain_problems(160)[::8]:
        found = planned_by(problem)
        if not found.status[0]:
            continue
        low, high = problem.position_limits.T
        rows = Numbers.of_problems([problem]).rows()
        free = tuple(degree - 5 for degree in problem.degrees)
        motion = SinePolynomials((low + high) / 2, (high - low) / 2, rows.duration[0], rows.boundary[0], free)
        quadrature = gauss_legendre(200)
        joints = motion.motion(found.z[0], basis(Form(max(free))).values(quadrature.nodes))
        rate = Dynamics(problem.robot.tree).base_rate(joints.positions, joints.velocities, rows.momentum[0])
        assert abs(rows.duration[0] * quadrature.weights @ rate - rows.change[0]) < 1e-9


def test_bodies_that_turn_alike_are_one(any_robot):
    """Mirrored legs of a quadruped count once, and all of the momentum is kept: D_0 at the middle of the ranges."""
    limits = np.where(np.isfinite(any_robot.position_limits), any_robot.position_limits, [-3.0, 3.0])
    centre, amplitude = limits.mean(axis=1), np.ptp(limits, axis=1) / 2
    bodies = merged_bodies(any_robot.tree, centre, amplitude)
    assert len(bodies.real) == len(np.unique(any_robot.tree.turns, axis=0))
    assert bodies.real.sum() == pytest.approx(Dynamics(any_robot.tree).momentum_map(centre[None])[0, 0], rel=1e-12)
    np.testing.assert_allclose(bodies.real, bodies.real.T, atol=1e-12)
    np.testing.assert_allclose(bodies.imaginary, -bodies.imaginary.T, atol=1e-12)


def describe(folder: Path, **environment: str) -> str:
    code = "import floatplan as fp, floatplan.kernel.library as kernel; print(kernel.description())"
    return told(code, folder, **environment)


@pytest.fixture
def checkout(tmp_path):
    """The package alone, without a library."""
    shutil.copytree(ROOT / "floatplan", tmp_path / "floatplan", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    for name in ("hatch_build.py", "pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path / name)
    for name in ("urdf", "problems"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def wheel_of(folder: Path, **environment: str) -> str:
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel"]
    subprocess.run(command, check=True, capture_output=True, cwd=folder, env={**os.environ, **environment})
    (path,) = (folder / "dist").iterdir()
    return path.name


def test_without_a_compiler_the_wheel_is_pure(checkout):
    assert wheel_of(checkout, CXX="no-such-compiler").endswith("-py3-none-any.whl")
    assert "not compiled" in describe(checkout)


def test_a_compiler_that_fails_is_as_good_as_none(checkout):
    broken = checkout / "broken"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(broken.stat().st_mode | stat.S_IXUSR)
    assert wheel_of(checkout, CXX=str(broken)).endswith("-py3-none-any.whl")


def test_a_library_that_is_none_is_not_used(checkout):
    (checkout / "floatplan" / "kernel" / build.LIBRARY).write_bytes(b"\0" * 100)
    assert "cannot be loaded" in describe(checkout)


def test_a_single_plan_is_the_kernel_s(kernel, root, monkeypatch):
    """And the same as the Python solver's."""
    problem = fp.load_problem(root / "problems" / "new_configuration.toml")
    compiled = fp.plan(problem)
    monkeypatch.setenv(library.SWITCH, "off")
    python = fp.plan(problem)
    assert (compiled.status, python.status) == ("optimal", "optimal")
    assert compiled.objective_value == pytest.approx(python.objective_value, rel=1e-9)
    assert compiled.solver["evaluations"] != python.solver["evaluations"]  # nodes are raised by other steps
    np.testing.assert_allclose(compiled.coefficients, python.coefficients, rtol=1e-4, atol=1e-4)


def test_further_starts_are_the_same_without_the_kernel(kernel, root, monkeypatch):
    """The plain motion of this one leads to ten times the objective of a start on another branch."""
    problem = fp.load_problem(root / "problems" / "falling_cat.toml")
    compiled = fp.plan(problem)
    monkeypatch.setenv(library.SWITCH, "off")
    python = fp.plan(problem)
    assert compiled.solver["starts"] > 1
    assert python.solver["starts"] > 1
    assert compiled.objective_value == pytest.approx(python.objective_value, rel=1e-9)
    np.testing.assert_allclose(compiled.coefficients, python.coefficients, rtol=1e-4, atol=1e-4)
