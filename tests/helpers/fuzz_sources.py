"""What the fuzzer's cases begin with: sound problems, robots and plans, of this project and of its gallery."""

import os
import re
from pathlib import Path

from places import ROOT

from floatplan.export.formats import FORMATS as KNOWN

PROBLEMS = (
    *("new_configuration", "obstacle", "moving_hoop", "torque_limited", "somersault_motors"),
    *("falling_cat", "handstand_ground"),
)
GALLERY = tuple(sorted(path.stem for path in (ROOT / "problems" / "gallery").glob("*.toml")))
FLYING = ("double_pendulum", "go2", "solo")  # robots of the gallery with plans and meshes, planned at once
FORMATS = tuple(KNOWN)
PREFIX = "example-robot-data:"


def problem_file(name: str) -> Path:
    """A problem of the project or of its gallery."""
    path = ROOT / "problems" / f"{name}.toml"
    return path if path.is_file() else path.parent / "gallery" / path.name


def robot_of(problem: str) -> str:
    """The robot that a problem file names: a file of ``urdf/``, or one of example-robot-data without the prefix."""
    text = problem_file(problem).read_text(encoding="utf-8")
    found = re.search(rf'urdf = "(?:\.\./urdf/|{PREFIX})([^"]+)"', text)
    assert found, f"{problem} names its robot"
    return found[1]


def _made() -> Path:
    folder = Path(os.environ.get("FLOATPLAN_FUZZ_PLANS") or ROOT / "build" / "fuzz")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def plan_of(problem: str) -> Path:
    """A plan file of a problem, made once."""
    import floatplan as fp

    path = _made() / f"{problem}.json"
    if not path.is_file():
        fp.plan(fp.load_problem(problem_file(problem)), prove=True).save(path)
    return path


def has_gallery() -> bool:
    """Whether the package of the gallery's robots is installed."""
    from floatplan.robot.urdf.tree import robots_folder

    return robots_folder() is not None


def prepare() -> None:
    """Make what cases begin with."""
    for problem in (*PROBLEMS, *(FLYING if has_gallery() else ())):
        plan_of(problem)
