from __future__ import annotations

import gc
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, wraps
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import once
import pytest
from browser import Browser, started
from long_cases import cases
from once import made_once, same_robot
from places import ROOT
from robot_samples import CHAIN_NAMES, URDF_FOLDER, RandomTree
from threadpoolctl import threadpool_limits
from typer.main import get_command
from typer.testing import CliRunner

if TYPE_CHECKING:
    from floatplan import Plan, Robot
    from floatplan.robot.shapes.capsules import Outline

PATIENT = 60.0  # [s] of search: a slow machine is no reason to fail
LARGE = 2000  # bytes of a mesh, or of points of one
LITTLE = 20  # times less work than usual
UNASKED = (
    "floatplan.planning.search.ANNOUNCED_EVERY",
    "floatplan.planning.in_space.ANNOUNCED_EVERY",
    "floatplan.cli.progress.EVERY",
)
TREES = {  # plane, normal and seed of trees that stay well enough in their plane
    "tree xz": ("xz", "y", 20),
    "tree zy": ("zy", "x", 21),
    "tree xy": ("xy", "z", 22),
    "tree coupled": ("xz", "y", 38),
}

put_together = cache(get_command)  # what typer's runner does anew at each call


@dataclass(frozen=True)
class Run:
    """What one run of the command line left."""

    code: int
    stdout: str
    stderr: str


def pytest_collection() -> None:
    """Look for no garbage while modules are imported: there is none."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Hold BLAS to one thread where a test computes itself: beside other tests its threads wait for cores, spinning.

    Public calls do so by themselves; ``test_threads.py`` looks at that, in processes of its own. The modules and tests,
    which stay to the end, are not looked through for garbage time and again, and what comes after them seldom: with
    Python's own threshold of 700 that would be 6 % of all work.
    """
    threadpool_limits(limits=1, user_api="blas")
    gc.freeze()
    gc.set_threshold(20_000)
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Of all processes of the tests: where ``made_once`` puts what it made."""
    folder = tmp_path_factory.getbasetemp()
    once.folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


@pytest.fixture(scope="session", autouse=True)
def robots_once(shared_folder: None) -> Iterator[None]:
    """What a mesh file holds, the capsules around it, and what a list of robots says of one are found once.

    Tests read the same robots hundreds of times. Small meshes are made by tests, most of them spoiled. A robot of
    example-robot-data, whose files no test changes, is the same object for all tests of a process that choose alike.
    """
    from floatplan import Robot
    from floatplan.cli import robots
    from floatplan.robot.shapes import collisions, links, solid_capsules
    from floatplan.robot.urdf.tree import PREFIX, urdf_path

    read, fit, facts = collisions._corners_and_faces, links.fit, robots._facts
    fit_in_space = solid_capsules.fit

    def read_once(content: bytes, kind: str) -> Any:
        if len(content) < LARGE:
            return read(content, kind)
        return made_once(f"mesh {sha256(content).hexdigest()} {kind}", lambda: read(content, kind))

    def fit_once(outline: Outline) -> Any:
        if outline.points.nbytes < LARGE:
            return fit(outline)
        given = sha256(outline.points.tobytes() + outline.edges.tobytes() + str(outline.radius).encode())
        return made_once(f"capsules {given.hexdigest()}", lambda: fit(outline))

    def fit_in_space_once(points: Any, radius: float, splits: int = 2) -> Any:
        given = sha256(points.tobytes() + f"{points.shape} {radius} {splits}".encode())
        return made_once(f"solid capsules {given.hexdigest()}", lambda: fit_in_space(points, radius, splits))

    def facts_once(source: str) -> Any:
        if not source.startswith(PREFIX):
            return facts(source)
        return made_once(f"facts {sha256(source.encode()).hexdigest()}", lambda: facts(source))

    load = Robot.from_file

    @wraps(load)
    def load_once(source: Any, kind: Any = None, **choices: Any) -> Robot:
        if not isinstance(source, str) or not source.startswith(PREFIX):
            return load(source, kind, **choices)
        path = urdf_path(source, kind)  # in the folder that is set now
        return same_robot(load, path, source, kind, choices)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Robot, "from_file", load_once)
        patch.setattr(robots, "_facts", facts_once)
        patch.setattr(collisions, "_corners_and_faces", read_once)
        patch.setattr(links, "fit", fit_once)
        patch.setattr(solid_capsules, "fit", fit_in_space_once)
        yield


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture
def floatplan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Run]:
    """Run the command line in an empty working directory; any exception that it lets through fails the test.

    What it says of its progress after a while, on a slow machine alone, it says where a test asks for it, and what it
    compares a plan with is searched for as long as that takes.
    """
    from floatplan.cli.commands import app

    for seconds in UNASKED:
        monkeypatch.setattr(seconds, math.inf)
    monkeypatch.setattr("typer.testing._get_command", put_together)
    monkeypatch.setattr("floatplan.cli.commands.COMPARISON_BUDGET", PATIENT)
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)

    def run(*arguments: str | Path) -> Run:
        result = CliRunner().invoke(app, [str(argument) for argument in arguments], prog_name="floatplan")
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return Run(result.exit_code, result.stdout, result.stderr)

    return run


@pytest.fixture
def little_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches end after less work than usual: the same on every machine, unlike a budget of seconds."""
    from floatplan.planning import search

    monkeypatch.setattr(search, "DEFAULT_WORK", search.DEFAULT_WORK / LITTLE)


@pytest.fixture(scope="session")
def shared_browser() -> Iterator[Browser]:
    """The one browser of all tests of a process."""
    yield from started()


@pytest.fixture(scope="module")
def browser(shared_browser: Browser) -> Browser:
    """The browser as it was when it started."""
    shared_browser.reset()
    return shared_browser


@pytest.fixture(scope="session")
def gymnast() -> Robot:
    """Table I of the paper."""
    from floatplan import Robot

    return Robot.from_urdf(URDF_FOLDER / "gymnast.urdf")


@pytest.fixture(scope="session", params=cases([*CHAIN_NAMES, *TREES], {"acrobat", "high_jumper", "tree zy", "tree xy"}))
def any_robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Every chain of ``urdf/``, and random trees in several planes, one with a coupled joint."""
    from floatplan import Coupling, Robot

    if request.param in CHAIN_NAMES:
        return Robot.from_urdf(URDF_FOLDER / f"{request.param}.urdf")
    plane, normal, seed = TREES[request.param]
    tree = RandomTree(seed, normal, joints=7)
    path = tmp_path_factory.mktemp("robot") / "random.urdf"
    path.write_text(tree.text)
    coupled = {"joint2": Coupling("joint1", -0.7, 0.4)} if request.param == "tree coupled" else None
    return Robot.from_urdf(path, plane=plane, locked=tree.locked, coupled=coupled)


@pytest.fixture(scope="session")
def planned() -> Callable[[str], Plan]:
    """The plan of a problem file, by its path in ``problems/`` without the ending; made once in all processes.

    It is that of ``floatplan plan``: proved, by the usual work.
    """
    from floatplan import load_problem, plan

    def plan_of(name: str) -> Plan:
        return made_once(name, lambda: plan(load_problem(ROOT / "problems" / f"{name}.toml"), prove=True))

    return plan_of


@pytest.fixture(scope="session")
def handstand(planned: Callable[[str], Plan]) -> Plan:
    return planned("handstand")


@pytest.fixture(scope="session")
def somersault(planned: Callable[[str], Plan]) -> Plan:
    return planned("somersault")
