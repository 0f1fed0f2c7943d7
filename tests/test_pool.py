"""Processes of floatplan import what the main one does, whatever lies in the working directory, and end with it."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from multiprocessing import forkserver, reduction
from pathlib import Path
from typing import Any

import pytest
from long_cases import cases
from needed import skip_or_fail

from floatplan.pool import processes, same_modules

ROOT = Path(__file__).resolve().parents[1]
PATIENCE = 300.0  # [s] for what takes a few
PLANTED = ("numpy.py", "random.py", "socket.py", "floatplan/__init__.py", "floatplan/studies/__init__.py")
PROGRAM = "from floatplan.cli import main\nif __name__ == '__main__':\n    main()\n"
MANY = """
import sys
import floatplan as fp
if __name__ == "__main__":
    problem = fp.load_problem(sys.argv[1])
    plans = fp.plan_many([problem] * 9, jobs=2)
    assert plans.ok.all(), plans.messages
"""
STUDY = """
problem = "{}"
[vary]
"flight.duration" = {{ from = 0.9, to = 1.4, count = 200 }}
"""


@pytest.fixture(autouse=True)
def own_server(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A fork server of these tests' own, as it loads nothing, and is killed; other tests go on with theirs."""
    own: Any = forkserver.ForkServer()
    for name in ("ensure_running", "connect_to_new_process", "set_forkserver_preload"):
        monkeypatch.setattr(forkserver, name, getattr(own, name))
    yield
    own._stop()


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """A folder whose modules, where one is executed, leave their names in a file."""
    folder = tmp_path / "here"
    for name in PLANTED:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"open({str(tmp_path / 'executed')!r}, 'a').write({name!r} + ' ')\n")
    return folder


def run_there(here: Path, script: str, *arguments: str | Path) -> None:
    """Run a script of another folder, as an installed command is, and see that nothing planted was executed."""
    program = here.parent / "bin" / "floatplan"
    program.parent.mkdir()
    program.write_text(script)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    environment["PYTHONPATH"] = os.pathsep.join(place for place in sys.path if place)
    done = subprocess.run(
        [sys.executable, str(program), *map(str, arguments)],
        cwd=here,
        env=environment,
        check=False,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    executed = here.parent / "executed"
    assert not executed.exists(), executed.read_text()
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


@pytest.fixture
def study_file(tmp_path: Path) -> Path:
    path = tmp_path / "study.toml"
    path.write_text(STUDY.format(ROOT / "problems" / "somersault.toml"))
    return path


@pytest.mark.parametrize("engine", cases(["processes", "dask"], {"dask"}))
def test_a_study_executes_nothing_of_the_working_directory(here: Path, study_file: Path, engine: str) -> None:
    try:
        import distributed  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError:
        skip_or_fail("the extra study is not installed")
    run_there(here, PROGRAM, "study", study_file, "--jobs", "2", "--engine", engine)


def test_nor_does_a_search(here: Path) -> None:
    problem = ROOT / "problems" / "obstacle.toml"
    run_there(here, PROGRAM, "plan", problem, "--jobs", "2", "--starts", "4", "--no-figures")


def test_nor_do_many_searches(here: Path) -> None:
    run_there(here, MANY, ROOT / "problems" / "obstacle.toml")


def test_processes_of_a_study_that_cannot_begin_are_begun_once(tmp_path: Path, study_file: Path) -> None:
    """Each process reads a script anew, and this one would start further processes there."""
    script = tmp_path / "script.py"
    script.write_text(f"import floatplan as fp\nfp.study({str(study_file)!r}, folder='out', jobs=2)\n")
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(place for place in sys.path if place)},
        check=False,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 1
    assert "no process can be started" in done.stderr.splitlines()[-1]
    assert not list((tmp_path / "out").rglob("*.parquet"))


def test_the_environment_is_as_it_was() -> None:
    before = dict(os.environ)
    with processes(1, ()) as executor:
        assert executor.submit(os.getpid).result() != os.getpid()
    assert dict(os.environ) == before


def test_nor_do_threads_leave_something_there() -> None:
    """Who begins while another has changed it sees what that put there, and goes on when that is done."""
    before, (first, second) = dict(os.environ), (same_modules(), same_modules())
    for step in (first.__enter__, second.__enter__):
        step()
        assert os.environ["PYTHONSAFEPATH"] == "1"
    first.__exit__(None, None, None)
    assert os.environ["PYTHONSAFEPATH"] == "1"
    second.__exit__(None, None, None)
    assert dict(os.environ) == before


def large() -> bytes:
    return bytes(300_000_000)


def ended_amid_an_answer() -> bool:
    """Let a process go while it answers; whether it still did."""
    with processes(1, ()) as executor:
        asked: Future[bytes] = executor.submit(large)
        while not executor._result_queue._reader.poll() and not asked.done():  # type: ignore[attr-defined]
            time.sleep(0.001)
        return not asked.done()


def test_they_end_amid_an_answer() -> None:
    """Whoever waits for the rest of what a dead process was sending waits for ever."""
    assert any(ended_amid_an_answer() for _ in range(20))  # on a busy machine the answer may be there before the look


def server() -> int:
    """Process of the fork server, which starts all others; it imports nothing of the working directory."""
    with processes(1, ()) as executor:
        assert executor.submit(os.getenv, "PYTHONSAFEPATH").result() == "1"
        return executor.submit(os.getppid).result()


def once(monkeypatch: pytest.MonkeyPatch, module: Any, name: str, first: Callable[[], object]) -> None:
    """Do something before a function is called for the first time from here on."""
    real, left = getattr(module, name), [first]

    def called(*args: Any) -> Any:
        if left:
            left.pop()()
        return real(*args)

    monkeypatch.setattr(module, name, called)


def test_they_are_let_go_amid_a_start_and_the_next_ones_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fork server that is sent a pipe which is closed already ends, and with it the start of any other process."""
    before = server()
    pool = processes(1, ())
    executor = pool.__enter__()
    closing = threading.Thread(target=lambda: pool.__exit__(None, None, None))

    def let_go() -> None:
        closing.start()
        closing.join(0.3)

    once(monkeypatch, reduction, "sendfds", let_go)
    asked = executor.submit(os.getpid)
    closing.join()
    assert asked.done()
    assert server() == before
    with pytest.raises(RuntimeError):
        executor.submit(os.getpid)


@pytest.mark.parametrize(("module", "name"), [(socket, "socket"), (reduction, "sendfds"), (forkserver, "read_signed")])
def test_they_start_although_the_fork_server_ends(monkeypatch: pytest.MonkeyPatch, module: Any, name: str) -> None:
    """Found running, and killed before it is connected, before it is sent a process, or before it has started that."""
    before = server()

    def kill() -> None:
        os.kill(before, signal.SIGKILL)
        os.waitid(os.P_PID, before, os.WEXITED | os.WNOWAIT)

    os.kill(before, signal.SIGSTOP)
    once(monkeypatch, module, name, kill)
    assert server() != before
