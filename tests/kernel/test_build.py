"""How the kernel is compiled: side by side, once for all who need it at the same time, and whole or not at all."""

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from elsewhere import hear_ctrl_c

from floatplan.kernel import build, library

CURRENT = Path(build.__file__).parent
PATIENCE = 60  # [s] until what never happens counts as that
# A shell starts in a twentieth of the time that Python takes, and here one starts for each unit of each library. What
# it writes holds its arguments, and of a library what its objects hold.
COMPILER = """#!/bin/sh
log='{log}'
unit=link
output=
objects=
previous=
for argument in "$@"; do
    [ "$argument" = --version ] && exit
    case $previous in
    -c) unit=${{argument##*/}} unit=${{unit%.*}} ;;
    -o) output=$argument ;;
    esac
    case $argument in
    *.o) [ "$previous" = -o ] || objects="$objects $argument" ;;
    esac
    previous=$argument
done
echo "$unit" >>"$log"
{step}
printf '%s\\n' "$*" >"$output"
[ -z "$objects" ] || cat $objects >>"$output"
"""


class Checkout:
    """A folder with the kernel's sources, and a compiler that writes down what it is to compile, and its arguments."""

    def __init__(self, folder):
        self.kernel = folder / "kernel"
        self.log = folder / "compiled"
        self.compiler = folder / "compiler"
        shutil.copytree(CURRENT, self.kernel, ignore=shutil.ignore_patterns("*.so", "__pycache__", "tmp*"))
        self.files = self.listed()
        self.compile_by()

    def compile_by(self, step=""):
        """Let the compiler take a further step before it writes."""
        self.log.write_text("")
        self.compiler.write_text(COMPILER.format(log=self.log, step=step))
        self.compiler.chmod(0o755)

    @property
    def compiled(self):
        return sorted(self.log.read_text().split())

    def listed(self):
        return sorted(path.name for path in self.kernel.iterdir() if path.name != "__pycache__")

    def module(self):
        """The module that compiles, as it is imported anew with the sources as they are."""
        spec = importlib.util.spec_from_file_location("kernel_build", self.kernel / "build.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    def start(self, *arguments):
        """Compile in a process of its own."""
        command = [sys.executable, str(self.kernel / "build.py"), *arguments]
        environment = {**os.environ, "CXX": str(self.compiler)}
        return subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL, text=True, preexec_fn=hear_ctrl_c)


ONCE = sorted([*(Path(unit).stem for unit in build.UNITS), "link"])


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    made = Checkout(tmp_path)
    monkeypatch.setenv("CXX", str(made.compiler))
    monkeypatch.delenv("ARCHFLAGS", raising=False)
    return made


def wait_until(happened):
    deadline = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_library_is_taken_while_nothing_that_makes_it_has_changed(checkout, monkeypatch):
    def compiled_anew():
        checkout.log.write_text("")
        checkout.module().build_if_needed()
        return checkout.compiled == ONCE

    assert compiled_anew()
    assert not compiled_anew()
    with (checkout.kernel / "rows.hpp").open("a") as source:
        source.write("// changed\n")
    assert compiled_anew()
    monkeypatch.setenv("ARCHFLAGS", "-arch arm64")
    assert compiled_anew()
    monkeypatch.setenv("CXX", f"{checkout.compiler} -flag")
    assert compiled_anew()
    assert not compiled_anew()
    checkout.module().build()  # what is asked for by hand is done
    assert checkout.compiled == ONCE


def test_of_two_that_need_it_one_compiles(checkout):
    """The first goes on once the second is there."""
    both = checkout.kernel.parent / "both"
    checkout.compile_by(f"while [ ! -e '{both}' ]; do sleep 0.02; done")
    first = checkout.start("--if-needed")
    wait_until(lambda: bool(checkout.compiled))
    second = checkout.start("--if-needed")
    both.touch()
    assert [process.wait(timeout=PATIENCE) for process in (first, second)] == [0, 0]
    assert checkout.compiled == ONCE


def ended(processes):
    for process in processes:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            continue
        stat = Path(f"/proc/{process}/stat")
        if (
            not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] != "Z"
        ):  # nobody may have asked for it yet
            return False
    return True


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_an_interrupted_build_leaves_neither_files_nor_compilers(checkout, number):
    processes = checkout.kernel.parent / "processes"
    processes.mkdir()
    checkout.compile_by(f"touch '{processes}'/$$\nexec sleep {10 * PATIENCE}")
    process = checkout.start()
    wait_until(lambda: len(list(processes.iterdir())) == len(build.UNITS))
    process.send_signal(number)
    assert process.wait(timeout=PATIENCE) != 0
    assert checkout.listed() == checkout.files
    wait_until(lambda: ended([int(path.name) for path in processes.iterdir()]))


def test_only_what_is_of_a_set_of_instructions_uses_it():
    """What the sets share, and what chooses among them, runs on every processor: no instruction of AVX is in it."""
    if library.kernel().instructions == 0 or sys.platform != "linux":
        pytest.skip("there is one set")
    if not shutil.which("objdump"):
        pytest.skip("there is no disassembler")
    command = ["objdump", "-d", "--no-show-raw-insn", str(CURRENT / build.LIBRARY)]
    function, wide, narrow = "", 0, []
    for line in subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines():
        if line.endswith(">:"):
            function = line.split("<")[1][:-2]
        instruction = line.split("\t")[1].split()[0] if line.count("\t") == 1 and line.split("\t")[1] else ""
        if not instruction.startswith(("v", "kmov")) or instruction.startswith("ver"):
            continue
        if "avx2" in function or "avx512" in function:
            wide += 1
        else:
            narrow.append(f"{function}: {instruction}")
    assert wide > 1000
    assert not narrow
