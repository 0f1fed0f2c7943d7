"""The script that makes the environment looks for a compiler, or a package index that has one, before it installs."""

import os
import shutil
import subprocess
import sys

import pytest
from places import ROOT

NEEDED = ("scripts/environment", "pyproject.toml", "floatplan/kernel/build.py", "floatplan/kernel/kernel.h")
PYTHON = """#!/bin/sh
case "$*" in *install*) echo "$@" "elsewhere=${{FLOATPLAN_KERNEL_ELSEWHERE:-}}" >> installed; exit 0 ;; esac
exec {python} "$@"
"""


COMPILER = """#!/bin/sh
while [ $# -gt 1 ]; do
  if [ "$1" = -o ]; then echo "$@" > "$2"; fi
  shift
done
"""


def executable(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)


@pytest.fixture
def checkout(tmp_path):
    """What the script reads, an interpreter that writes down what it is to install, and a few commands."""
    for name in NEEDED:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    executable(tmp_path / ".venv" / "bin" / "python", PYTHON.format(python=sys.executable))
    for name in ("bash", "sh", "env", "dirname", "cat"):
        executable(tmp_path / "bin" / name, f'#!/bin/sh\nexec {shutil.which(name)} "$@"\n')
    return tmp_path


def made(checkout):
    kept = {name: value for name, value in os.environ.items() if name not in ("CXX", "CI")}
    environment = {**kept, "PATH": str(checkout / "bin"), "PIP_NO_INDEX": "1"}
    command = ["/bin/sh", "-c", "exec bash scripts/environment"]
    return subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True)


@pytest.mark.long
def test_without_compiler_and_index_it_says_so_and_installs_nothing(checkout):
    done = made(checkout)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "needs a C++ compiler" in line
    assert "install g++ or clang++" in line
    assert not (checkout / "installed").exists()


def test_where_compiling_fails_it_says_so_and_tries_again_next_time(checkout):
    """Then it installs, and compiles meanwhile."""
    executable(checkout / "bin" / "c++", '#!/bin/sh\n[ "$1" = --version ] || { echo "no memory" >&2; exit 1; }\n')
    done = made(checkout)
    assert done.returncode == 1
    assert "floatplan: c++ cannot compile the kernel:\nno memory" in done.stderr
    assert not (checkout / ".venv" / "installed-alone").exists()
    executable(checkout / "bin" / "c++", COMPILER)
    (checkout / "installed").unlink()
    assert made(checkout).returncode == 0
    (installed,) = (checkout / "installed").read_text().splitlines()
    assert "--editable" in installed
    assert installed.endswith("elsewhere=1")
    assert (checkout / "floatplan" / "kernel" / "_kernel.so").is_file()
    assert (checkout / ".venv" / "installed-alone").is_file()
