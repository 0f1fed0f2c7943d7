"""Processes of floatplan import what the main one does, whatever lies in the working directory, and end with it."""

import os
import subprocess
import sys
from multiprocessing import forkserver

import pytest
from long_cases import cases
from places import ROOT

from floatplan.pool import fork_server

PATIENCE = 300.0  # [s] for what takes a few
PLANTED = ("numpy.py", "random.py", "socket.py", "floatplan/__init__.py", "floatplan/studies/__init__.py")
PROGRAM = "from floatplan.cli import main\nif __name__ == '__main__':\n    main()\n"
STUDY = """
problem = "{}"
[vary]
"flight.duration" = {{ from = 0.9, to = 1.4, count = 200 }}
"""


@pytest.fixture(autouse=True)
def own_server(monkeypatch):
    """A fork server of these tests' own, as it loads nothing, and is killed; other tests go on with theirs."""
    own = forkserver.ForkServer()
    for name in ("ensure_running", "connect_to_new_process", "set_forkserver_preload"):
        monkeypatch.setattr(forkserver, name, getattr(own, name))
    monkeypatch.setattr(fork_server, "_server", None)
    yield own
    own._stop()


@pytest.fixture
def here(tmp_path):
    """A folder whose modules, where one is executed, leave their names in a file."""
    folder = tmp_path / "here"
    for name in PLANTED:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"open({str(tmp_path / 'executed')!r}, 'a').write({name!r} + ' ')\n")
    return folder


def run_there(here, script, *arguments):
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
def study_file(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY.format(ROOT / "problems" / "somersault.toml"))
    return path


@pytest.mark.parametrize("engine", cases(["processes", "dask"], {"dask"}))
def test_a_study_executes_nothing_of_the_working_directory(here, study_file, engine):
    run_there(here, PROGRAM, "study", study_file, "--jobs", "2", "--engine", engine)


@pytest.mark.long
def test_processes_of_a_study_that_cannot_begin_are_begun_once(tmp_path, study_file):
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


def test_whoever_forgets_them_ends_all_the_same(tmp_path):
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
