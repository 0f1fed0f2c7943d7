"""The wheel of a clean checkout, built once: what it holds, and that its kernel works where it is unpacked."""

import json
import os
import shlex
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from elsewhere import told
from places import ROOT

import floatplan
from floatplan.kernel.build import command, header_digest

pytestmark = pytest.mark.long
SOURCES = ("hatch_build.py", "pyproject.toml", "README.md", "LICENSE")
QUICK_COMPILER = """#!/bin/sh
exec {} "$@" -O0
"""  # what is compiled is looked at, not how fast it plans: optimising takes most of a minute


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("checkout")
    shutil.copytree(ROOT / "floatplan", folder / "floatplan", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    for name in SOURCES:
        shutil.copy(ROOT / name, folder / name)
    for name in ("urdf", "problems", "motions", "tests", "scripts"):
        (folder / name).symlink_to(ROOT / name)
    compiler = folder / "quick-compiler"
    compiler.write_text(QUICK_COMPILER.format(shlex.join(command())))
    compiler.chmod(0o755)
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel"]
    environment = {**os.environ, "CXX": str(compiler)}
    subprocess.run(build, check=True, capture_output=True, cwd=folder, env=environment)
    (path,) = (folder / "dist").iterdir()
    return path


@pytest.fixture
def unpacked(wheel, tmp_path):
    zipfile.ZipFile(wheel).extractall(tmp_path)
    return tmp_path


def test_holds_robots_and_problems(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    for kind, ending in (("urdf", "urdf"), ("problems", "toml"), ("motions", "npz"), ("motions", "csv")):
        files = {path.name for path in (ROOT / kind).glob(f"*.{ending}")}
        assert files
        assert {f"floatplan/data/{kind}/{name}" for name in files} <= names


def test_holds_no_tests_and_no_scripts(wheel):
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert tops == {"floatplan", f"floatplan-{floatplan.__version__}.dist-info"}


def test_its_problems_find_its_robots(unpacked):
    code = (
        "import floatplan as fp, pathlib; folder = pathlib.Path(fp.__file__).parent\n"
        "for path in sorted(folder.glob('data/problems/*.toml')):\n"
        "    robot = fp.load_problem(path).robot\n"
        "    assert robot.path.resolve().is_relative_to(folder), robot.path\n"
        "    print(path.stem)"
    )
    assert told(code, unpacked).split() == sorted(path.stem for path in (ROOT / "problems").glob("*.toml"))


def test_it_plans_the_paper_s_example_without_a_compiler(unpacked):
    (unpacked / "empty").mkdir()
    code = (
        "import shutil, sys\n"
        "assert not any(map(shutil.which, ('c++', 'g++', 'clang++', 'cc')))\n"
        "from floatplan.cli import main\n"
        "sys.argv[1:] = ['plan', 'problems/new_configuration.toml', '--json', '--quiet']\n"
        "main()"
    )
    facts = json.loads(told(code, unpacked, PATH=str(unpacked / "empty"), CXX="no-compiler"))
    assert facts["objective"]["value"] == pytest.approx(25.0411, abs=1e-4)
    assert (unpacked / "runs" / "new_configuration" / "plan.json").is_file()


def test_its_kernel_knows_no_folder_of_the_machine(wheel):
    kernel = zipfile.ZipFile(wheel).read("floatplan/kernel/_kernel.so")
    for folder in (ROOT, Path.home(), wheel.parents[2]):
        assert str(folder).encode() not in kernel


def test_it_has_the_kernel_s_header_as_cffi_has_read_it(wheel):
    kept = zipfile.ZipFile(wheel).read("floatplan/kernel/_declarations.py").decode()
    assert f'HEADER = "{header_digest()}"' in kept


def test_it_is_for_this_platform(wheel, unpacked):
    assert "-py3-none-" in wheel.name
    assert "any" not in wheel.name
    describe = "import floatplan as fp, floatplan.kernel.library as kernel; print(fp.__file__, kernel.description())"
    assert str(unpacked) in told(describe, unpacked)
    assert "compiled kernel (" in told(describe, unpacked)
    with (unpacked / "floatplan" / "kernel" / "starts.hpp").open("a") as source:
        source.write("// changed\n")
    with pytest.raises(subprocess.CalledProcessError) as failed:
        told(describe, unpacked)
    assert "compiled from other sources" in failed.value.stderr
