"""The examples run, each in a folder of its own, print what their texts promise, and are on the site as they are."""

import ast
import io
import json
import runpy
import shutil
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import example_pages
import pytest
from jumps import find_jumps_once
from long_cases import cases
from places import ROOT

EXAMPLES = ROOT / "examples"
PROMISED = {
    "first_flight": "for every instant of the flight: proved; warnings: none",
    "own_robot": "optimal",
    "obstacle": "m; proved",
    "weak_motors": "torques up to [1.85 1.01] N m, proved",
    "falling_cat": "the loop run backwards: 20.00 degrees; there and back: 0.00",
    "space_arm": "optimal, proved: the antenna ends at most",
    "sweep": "that plan is proved",
    "study": "resumed: 165 rows",
    "library": "100 flips asked for, 100 planned and proved",
    "certificate": "20.001000 mm: refuted at 0.7219 s",
    "mujoco_playback": "rad from the plan",
    "in_flight": "lands as planned",
    "jump": "flight proved; The stances hold at 2 kHz.",
    "fly_a_go2": "degrees off at touchdown, and stands",
    "pinocchio_interop": "nothing pushes the base",
    "ros_trajectory": "with accelerations too",
    "reference_motion": "89 frames, 50 a second",
    "repair_a_clip": "retime: physical, falls at 9.81 m/s^2",
    "from_mjcf": "optimal, proved",
    "bounds_by_hand": "middle -1.1778 kg m^2/s (10)",
    "the_method": "|b| = 25.0411",
}
LONG = {
    *("fly_a_go2", "from_mjcf", "jump", "library", "reference_motion", "repair_a_clip", "ros_trajectory", "study"),
    *("sweep", "pinocchio_interop", "obstacle", "space_arm", "mujoco_playback", "in_flight", "falling_cat"),
    "bounds_by_hand",
}


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """The examples with all that they may read: nothing else is beside them."""
    folder = tmp_path_factory.mktemp("copied")
    for name in ("examples", "problems", "urdf"):
        shutil.copytree(ROOT / name, folder / name)
    return folder / "examples"


def test_none_is_left_out():
    shown = [name for names in example_pages.SHOWN.values() for name in names]
    assert sorted(shown) == sorted(path.stem for path in EXAMPLES.iterdir() if path.suffix in (".py", ".ipynb"))
    assert set(shown) == {*PROMISED, "first_flip", "handstand"}
    assert len(shown) > 15


def test_pages_are_as_the_scripts_say():
    pages = example_pages.pages()
    assert {path.name for path in example_pages.PAGES.glob("*.md")} == set(pages)
    for name, content in pages.items():
        assert (example_pages.PAGES / name).read_text(encoding="utf-8") == content, "run scripts/example_pages.py"


def test_each_has_what_it_draws_and_prints():
    pages = example_pages.pages()
    for picture in example_pages.PICTURES.iterdir():
        assert (
            sum(f"/examples/{picture.name}\n" in content for name, content in pages.items() if name != "index.md") == 1
        )
    for name, promise in PROMISED.items():
        said = (example_pages.PAGES / f"{name}.txt").read_text(encoding="utf-8")
        assert promise in said, f"run scripts/example_pages.py run {name}"


@pytest.fixture
def commands_here(floatplan, monkeypatch):
    """Commands that a script starts are run in this process, where jumps that other tests had are not searched for."""

    def run(words, check):
        assert words[:3] == [sys.executable, "-m", "floatplan"]
        assert check
        assert floatplan(*words[3:]).code == 0

    monkeypatch.setattr(subprocess, "run", run)
    find_jumps_once(monkeypatch)


@pytest.mark.usefixtures("commands_here")
@pytest.mark.parametrize("name", cases(list(PROMISED), LONG))
def test_script_runs(name, copied, monkeypatch, capsys):
    given = [] if name == "first_flight" else ["given"]
    promised = PROMISED[name]
    if name == "library":  # as many flips as it takes to say the same of each
        given.append("20")
        promised = promised.replace("100", "20")
    monkeypatch.setattr(sys, "argv", [f"{name}.py", *given])
    runpy.run_path(str(copied / f"{name}.py"), run_name="__main__")
    assert promised in capsys.readouterr().out
    out = Path("runs", name) if name == "first_flight" else Path("given")
    assert name == "the_method" or (out / f"{name}.png").stat().st_size > 5000
    assert [path.name for path in Path().iterdir()] == [out.parts[0]] * (name != "the_method")
    assert not open_files(Path.cwd())  # Python would complain of them in whichever test comes next


def open_files(folder):
    """The files below a folder that this process has open; none where the system does not tell (macOS)."""
    targets = [Path(descriptor).resolve() for descriptor in Path("/proc/self/fd").glob("*")]
    return [target for target in targets if target.is_relative_to(folder.resolve())]


def outputs(cell):
    """What a cell of the notebook printed and returned when it was written."""
    texts = [output.get("text") or output["data"]["text/plain"] for output in cell["outputs"]]
    return "".join(line for text in texts for line in text)


def run(source, namespace):
    """Execute a cell: what it prints, and what its last line returns unless that is None."""
    tree = ast.parse(source)
    returned = ast.Expression(tree.body.pop().value) if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), namespace)
        value = eval(compile(returned, "cell", "eval"), namespace) if returned else None
    return printed.getvalue() + ("" if value is None else repr(value))


@pytest.mark.parametrize(("name", "count"), [("first_flip", 3), pytest.param("handstand", 6, marks=pytest.mark.long)])
def test_notebook_gives_the_outputs_that_it_shows(name, count, monkeypatch):
    monkeypatch.chdir(EXAMPLES)
    cells = json.loads((EXAMPLES / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) == count
    namespace = {}
    for cell in code:
        assert run("".join(cell["source"]), namespace) == outputs(cell)
