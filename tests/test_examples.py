"""The examples run, each in a folder of its own, and print what their texts promise."""

from __future__ import annotations

import ast
import io
import json
import runpy
from contextlib import redirect_stdout
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from long_cases import cases
from needed import skip_or_fail

from floatplan.robot.urdf.tree import robots_folder

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
PROMISED = {
    "first_flight": "for every instant of the flight: proved",
    "own_robot": "optimal",
    "obstacle": "m; proved",
    "sweep": "least torque",
    "mujoco_playback": "rad from the plan",
    "pinocchio_interop": "nothing pushes the base",
    "in_flight": "lands as planned",
    "the_method": "|b| = 25.0411",
    "fly_a_go2": "degrees off at touchdown, and stands",
}
EXTRAS = {"mujoco_playback": ("mujoco",), "fly_a_go2": ("mujoco", "casadi")}
LONG = {"fly_a_go2"}


def test_none_is_left_out() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(PROMISED)


@pytest.mark.parametrize("name", cases(list(PROMISED), LONG))
def test_script_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in EXTRAS.get(name, ()):
        if find_spec(module) is None:
            skip_or_fail(f"{module} is not installed")
    if name == "fly_a_go2" and robots_folder() is None:
        skip_or_fail("example-robot-data is not installed")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    assert PROMISED[name] in capsys.readouterr().out


def outputs(cell: dict[str, Any]) -> str:
    """What a cell of the notebook printed and returned when it was written."""
    texts = [output.get("text") or output["data"]["text/plain"] for output in cell["outputs"]]
    return "".join(line for text in texts for line in text)


def run(source: str, namespace: dict[str, Any]) -> str:
    """Execute a cell: what it prints, and what its last line returns unless that is None."""
    tree = ast.parse(source)
    returned = ast.Expression(tree.body.pop().value) if isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), namespace)
        value = eval(compile(returned, "cell", "eval"), namespace) if returned else None
    return printed.getvalue() + ("" if value is None else repr(value))


def test_notebook_gives_the_outputs_that_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(EXAMPLES)
    cells = json.loads((EXAMPLES / "handstand.ipynb").read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) > 5
    namespace: dict[str, Any] = {}
    for cell in code:
        assert run("".join(cell["source"]), namespace) == outputs(cell)
