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
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import forkserver, reduction
from pathlib import Path
from typing import Any

import pytest
from long_cases import cases
from needed import skip_or_fail

from floatplan.pool import fork_server, processes, same_modules

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
def own_server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A fork server of these tests' own, as it loads nothing, and is killed; other tests go on with theirs."""
    own: Any = forkserver.ForkServer()
    for name in ("ensure_running", "connect_to_new_process", "set_forkserver_preload"):
        monkeypatch.setattr(forkserver, name, getattr(own, name))
    monkeypatch.setattr(fork_server, "_server", None)
    yield own
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
    run_there(here, PROGRAM, "plan", problem, "--starts", "4", "--no-figures")


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


def amid_an_answer(executor: Any) -> Future[bytes]:
    """Ask for something large; return when its process has begun to answer."""
    assert executor.submit(os.getpid).result()
    asked: Future[bytes] = executor.submit(large)
    while not executor._workers[0].pipe.poll() and not asked.done():
        time.sleep(0.001)
    return asked


def let_go_amid_an_answer() -> bool:
    """Let a process go while it answers; whether it still did."""
    with processes(1, ()) as executor:
        asked = amid_an_answer(executor)
        return not asked.done()


def killed_amid_an_answer() -> bool:
    """Let the system kill one of two processes while it answers; whether it still did."""
    with processes(2, ()) as executor:
        process = executor.submit(os.getpid).result()
        asked = amid_an_answer(executor)
        os.kill(process, signal.SIGKILL)
        if isinstance(asked.exception(), BrokenProcessPool):
            with pytest.raises(BrokenProcessPool, match="ended unexpectedly"):
                executor.submit(os.getpid)
            return True
        return False


@pytest.mark.parametrize("ended", [let_go_amid_an_answer, killed_amid_an_answer])
def test_they_end_amid_an_answer(ended: Callable[[], bool]) -> None:
    """Whoever waits for the rest of what a dead process was sending waits for ever."""
    assert any(ended() for _ in range(20))  # on a busy machine the answer may be there before the look


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


def test_they_start_at_once_although_the_fork_server_refuses(own_server: Any) -> None:
    """As one does that ends: its socket is closed, and it is gone seconds later. Nobody waits for that."""
    before = server()
    place = Path(own_server._forkserver_address)
    place.unlink()
    with socket.socket(socket.AF_UNIX) as deaf:
        deaf.bind(str(place))  # and listens to nobody
        assert server() != before
    with pytest.raises(ProcessLookupError):
        os.kill(before, 0)


def test_a_fork_server_that_nobody_knows_is_waited_for(own_server: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of which no process has said that it is its parent; another process is never killed in its place."""
    assert server()
    monkeypatch.setattr(fork_server, "_server", None)
    monkeypatch.setattr(fork_server, "PATIENCE", 0.1)
    place = Path(own_server._forkserver_address)
    place.unlink()
    with socket.socket(socket.AF_UNIX) as deaf, processes(1, ()) as executor:
        deaf.bind(str(place))
        with pytest.raises(ConnectionRefusedError):
            executor.submit(os.getpid)
        monkeypatch.setattr(fork_server, "_server", os.getppid())  # no child of this process
        with pytest.raises(ConnectionRefusedError):
            executor.submit(os.getpid)
    os.kill(os.getppid(), 0)


class OddError(Exception):
    """What cannot be read where it comes from another process."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(first + second)


def failing(kind: str) -> Any:
    if kind == "ends":
        sys.exit(3)
    if kind == "odd":
        raise OddError("a", "b")
    if kind == "result":
        return lambda: None
    raise ValueError(f"no such kind: {kind}")


@pytest.mark.parametrize(
    ("kind", "error", "words"),
    [
        ("x", ValueError, "no such kind: x"),
        ("ends", SystemExit, "3"),
        ("odd", RuntimeError, "OddError: ab"),
        ("result", Exception, "lambda"),
    ],
)
def test_errors_of_tasks_are_raised_here_and_say_where_they_were(
    kind: str, error: type[BaseException], words: str
) -> None:
    with processes(1, ()) as executor:
        raised = executor.submit(failing, kind).exception()
        assert isinstance(raised, error)
        assert words in str(raised)
        assert kind == "odd" or "Traceback" in "".join(raised.__notes__)
        unsendable = executor.submit(lambda: None).exception()
        assert "lambda" in str(unsendable)
        assert executor.submit(int, "3").result() == 3, "it goes on"


def test_as_many_work_at_a_time_as_were_asked_for_and_cancelled_ones_do_not() -> None:
    with processes(2, ()) as executor:
        tasks = [executor.submit(time.sleep, 0.01) for _ in range(20)]
        asleep = [executor.submit(time.sleep, 600) for _ in range(2)]
        waiting = executor.submit(os.getpid)
        assert [each.result() for each in tasks] == [None] * 20
        assert waiting.cancel()
        assert len(executor.process_ids) == 2  # type: ignore[attr-defined]
    assert waiting.cancelled()
    assert all(isinstance(each.exception(), BrokenProcessPool) for each in asleep)


def test_whoever_forgets_them_ends_all_the_same(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import os, time\nfrom floatplan.pool import processes\n"
        "if __name__ == '__main__':\n"
        "    pool = processes(2, ())\n    executor = pool.__enter__()\n"
        "    executor.submit(os.getpid).result()\n    executor.submit(time.sleep, 600)\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(place for place in sys.path if place)}
    done = subprocess.run(
        [sys.executable, str(script)], env=environment, check=False, capture_output=True, text=True, timeout=PATIENCE
    )
    assert (done.returncode, done.stderr) == (0, "")
