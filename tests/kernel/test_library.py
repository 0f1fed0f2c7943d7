"""The compiled kernel as a library: sets of instructions, building it, an installation without it."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from elsewhere import told
from places import ROOT
from plain_problems import plain_problems

import floatplan as fp
from floatplan.kernel import build
from floatplan.motion.exact_polynomials import powers_of_seconds
from floatplan.planning.batch import follow_unconstrained
from floatplan.planning.kernel_input.numbers import Numbers


def followed(problem):
    return follow_unconstrained(problem, Numbers.of_problems([problem]), 1, 0)


def test_all_sets_of_instructions_agree(kernel, monkeypatch):
    if kernel.instructions == 0:
        pytest.skip("this processor has one set")
    problems = plain_problems(64)[::2]
    widest = list(map(fp.plan_many, [[problem] for problem in problems]))
    for narrower in range(kernel.instructions):
        monkeypatch.setattr(kernel, "instructions", narrower)
        found = list(map(fp.plan_many, [[problem] for problem in problems]))
        assert np.mean([one.status[0] == other.status[0] for one, other in zip(widest, found, strict=True)]) > 0.95
        solved = [pair for pair in zip(widest, found, strict=True) if all(each.ok[0] for each in pair)]
        assert np.mean([abs(one.objective[0] / other.objective[0] - 1) < 1e-9 for one, other in solved]) > 0.95


@pytest.mark.parametrize("degree", [6, 10, 15])
def test_coefficients_are_rounded_as_exact_arithmetic_does(kernel, degree):
    """Sums of two doubles against whole numbers of 2^-256."""
    problem = plain_problems(24)[17]
    problem = fp.Problem(problem.robot, problem.start, problem.goal, problem.flight, fp.Motion(degree=degree))
    batch = followed(problem)
    assert batch.branch[0].tolist() == [0] * len(problem.degrees)
    x = batch.x[0].tolist()
    free = degree - 5
    for joint, b in enumerate(batch.coefficients[0]):
        own = range(joint * free, (joint + 1) * free)
        z = []
        for r in own:  # as the kernel sums
            beyond = 0.0
            for c in own:
                beyond += float(batch.motions.scaling[0, r, c]) * x[c]
            z.append(float(batch.motions.offset[0, r]) + beyond)
        combination = [*batch.motions.boundary[0, joint].tolist(), *z]
        assert powers_of_seconds(combination, problem.flight.duration) == b.tolist()


@pytest.fixture
def checkout(tmp_path):
    """The package alone, without a library."""
    shutil.copytree(ROOT / "floatplan", tmp_path / "floatplan", ignore=shutil.ignore_patterns("*.so"))
    for name in ("hatch_build.py", "pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path / name)
    for name in ("urdf", "problems", "motions"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def built(folder, **environment):
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel"]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, env={**os.environ, **environment})


@pytest.mark.parametrize(
    ("compiler", "message"),
    [
        ("no-such-compiler", "CXX names no C++ compiler: there is no command no-such-compiler"),
        pytest.param("false", "false cannot", marks=pytest.mark.long),
    ],
)
def test_an_installation_that_cannot_compile_fails_and_says_so(checkout, compiler, message):
    done = built(checkout, CXX=compiler)
    assert done.returncode == 1
    assert f"floatplan cannot be installed: {message}" in done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert not list(checkout.glob("dist/*"))


@pytest.mark.long
def test_an_editable_installation_leaves_the_kernel_to_who_compiles_it_elsewhere(checkout):
    """A wheel has it in any case."""
    code = (
        "from hatch_build import CustomBuildHook\n"
        "CustomBuildHook('.', {}, None, None, 'dist', 'wheel').initialize('editable', {})"
    )
    elsewhere = {"CXX": "false", "FLOATPLAN_KERNEL_ELSEWHERE": "1"}
    assert told(code, checkout, **elsewhere) == ""
    assert not (checkout / "floatplan" / "kernel" / build.LIBRARY).exists()
    with pytest.raises(subprocess.CalledProcessError):
        told(code, checkout, CXX="false")
    assert built(checkout, **elsewhere).returncode == 1


def asked_for(folder, path):
    """What an installation asks for before it builds a wheel."""
    code = "from hatchling.build import *; print(*get_requires_for_build_wheel(), *get_requires_for_build_editable())"
    return told(code, folder, PATH=path, CXX="").split()


def test_a_compiler_from_a_wheel_is_asked_for_only_where_there_is_none(checkout):
    (checkout / "empty").mkdir()
    assert "ziglang" in asked_for(checkout, str(checkout / "empty"))
    shim = checkout / "empty" / "c++"
    shim.write_text("#!/bin/sh\nexit 1\n")  # as macOS has one without its developer tools
    shim.chmod(0o755)
    assert "ziglang" in asked_for(checkout, str(checkout / "empty"))
    shim.write_text("#!/bin/sh\nexit 0\n")
    assert "ziglang" not in asked_for(checkout, str(checkout / "empty"))


def test_that_compiler_is_used_where_there_is_no_other(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setattr(build, "WHEEL", "no_such_wheel")
    with pytest.raises(build.CompilerError, match="there is no C\\+\\+ compiler: install one"):
        build.command()
    monkeypatch.setattr(build, "WHEEL", "json")  # any module
    assert build.command()[:4] == [sys.executable, "-m", "json", "c++"]


@pytest.mark.parametrize(
    ("content", "reason"),
    [(None, "not compiled"), pytest.param(b"\0" * 100, "cannot be loaded", marks=pytest.mark.long)],
)
def test_an_installation_that_is_not_complete_says_so(checkout, content, reason):
    library_file = checkout / "floatplan" / "kernel" / build.LIBRARY
    if content:
        library_file.write_bytes(content)
    code = "from floatplan.kernel.library import kernel; kernel()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=checkout)
    assert done.returncode == 1
    assert f"InstallationError: the kernel cannot be used: {reason}" in done.stderr
    assert "install floatplan again" in done.stderr.splitlines()[-1]
