"""A limit and a kind of obstacle, added to a copy of the package as CONTRIBUTING says, work in every room."""

import os
import shutil
import subprocess
import sys

import pytest
from places import ROOT

MOST_FILES_OF_A_LIMIT, MOST_FILES_OF_AN_OBSTACLE = 6, 6


EFFORT = {
    "floatplan/tables.py": (
        ('Literal["velocity", "acceleration", "torque",', 'Literal["velocity", "acceleration", "torque", "effort",'),
        (
            '    LimitRow("orientation_rate"',
            '    LimitRow("effort", "efforts", "N m", "Efforts", "joints"),\n    LimitRow("orientation_rate"',
        ),
    ),
    "floatplan/problem/parts.py": (
        (
            "    acceleration: Annotated[",
            '    effort: Annotated[\n        Literal["none"] | JointValues,\n'
            '        Key("Largest torque with friction", "N m", "limit"),\n'
            '    ] = "none"\n    acceleration: Annotated[',
        ),
    ),
    "floatplan/motion/dynamics.py": (
        (
            "    def shaped(self",
            "    @property\n    def efforts(self) -> Array:\n"
            '        """Torques (..., n) with the friction of 1 N m s/rad, N m."""\n'
            "        return self.torques + self.velocities\n\n    def shaped(self",
        ),
    ),
    "floatplan/planning/constraints.py": (
        (
            '    "orientation_rate": MotionQuantity(',
            '    "efforts": MotionQuantity(\n'
            "        sums=lambda it: dict.fromkeys(('torques', 'velocities'), np.eye(len(it.problem.robot.joints))),\n"
            "    ),\n"
            '    "orientation_rate": MotionQuantity(',
        ),
    ),
    "floatplan/certificate/limits.py": (
        (
            '    "accelerations": lambda robot, joints:',
            '    "efforts": lambda robot, joints: generalized_torques(robot, joints) + joints.velocities,\n'
            '    "accelerations": lambda robot, joints:',
        ),
    ),
    "floatplan/plans/measures.py": (
        (
            "    position_low: float\n",
            "    effort_peak: float\n    effort_limit: float | None\n    effort_utilisation: float | None\n"
            "    effort_instant: float\n    position_low: float\n",
        ),
    ),
}

BEND = {
    "floatplan/problem/parts.py": (
        (
            "OBSTACLE_KINDS: dict[str, type[Obstacle]] =",
            '@dataclass(frozen=True, kw_only=True)\nclass Bend(Obstacle):\n    """A bar with a corner."""\n\n'
            '    kind: ClassVar[str] = "bend"\n    about: ClassVar[str] = "A bar with a corner"\n'
            '    start: Annotated[Pair, Key("One end", "m")]\n'
            '    corner: Annotated[Pair, Key("Where it bends", "m")]\n'
            '    end: Annotated[Pair, Key("The other end", "m")]\n'
            '    radius: Annotated[float, Key("Of the bar", "m")]\n\n'
            "    @classmethod\n    def example(cls, place: complex, size: float) -> Self:\n"
            "        x, y, arm = place.real, place.imag, 0.2 * size\n"
            "        return cls(start=(x - arm, y), corner=(x, y), end=(x, y + arm), radius=0.04 * size)\n\n"
            "    @property\n    def pieces(self) -> tuple[Obstacle, ...]:\n"
            "        ends = (self.start, self.corner), (self.corner, self.end)\n"
            "        shared = {'radius': self.radius, 'velocity': self.velocity}\n"
            "        return tuple(Bar(start=start, end=end, **shared) for start, end in ends)\n\n\n"
            "OBSTACLE_KINDS: dict[str, type[Obstacle]] =",
        ),
        ("(Circle, HalfPlane, Bar)}", "(Circle, HalfPlane, Bar, Bend)}"),
    ),
    "floatplan/plans/record.py": (
        (
            '    "capsule": {"start"',
            '    "bend": {"start": POINT, "corner": POINT, "end": POINT, "radius": non_negative},\n'
            '    "capsule": {"start"',
        ),
    ),
    "floatplan/__init__.pyi": (
        (
            "from floatplan.problem.parts import Circle",
            "from floatplan.problem.parts import Bend as Bend\nfrom floatplan.problem.parts import Circle",
        ),
    ),
    "docs/api/problems.md": ((".. autoclass:: Bar\n", ".. autoclass:: Bar\n.. autoclass:: Bend\n"),),
    "floatplan/certificate/planar/obstacles.py": (
        (
            "SEPARATIONS: dict[",
            "def _bend(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> PointSegments:\n"
            '    ends = {"end": obstacle["corner"]}, {"start": obstacle["corner"]}\n'
            "    return PointSegments.joined([_bar(surroundings, {**obstacle, **end}, velocity) for end in ends])\n\n\n"
            "SEPARATIONS: dict[",
        ),
        ('    "capsule": _bar,\n', '    "capsule": _bar,\n    "bend": _bend,\n'),
    ),
    "floatplan/view/report/assets/flight.js": (
        (
            "  capsule: (",
            "  bend: ({ start, corner, end, radius }) => [[start, corner, radius], [corner, end, radius]],\n"
            "  capsule: (",
        ),
    ),
}

COMMON = """
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock
import numpy as np
import floatplan as fp
from floatplan.problem.file import problem_schema
from floatplan.studies.schema import varied_number
from floatplan.studio import edits
from floatplan.studio.session import View
from floatplan.view.figures.figures import figures
from floatplan.view.report.report import report

assert Path(fp.__file__).parents[1] == Path.cwd()

def saved(problem):
    fp.save_problem(problem, "problem.toml")
    return fp.load_problem("problem.toml")

def verdicts(plan, kind):
    plan.save("plan.json")
    return {each.label: each.verdict for each in fp.certify("plan.json").findings if each.kind == kind}
"""

LIMIT_WORKS = """
from floatplan.certificate import limits as of_certificate
from floatplan.studio.panel import LimitsTab
from floatplan.plans.measures import limits_shown
from floatplan.tables import LIMIT_TABLE

problem = fp.load_problem(ROOT / "problems" / "somersault.toml")
free = fp.plan(problem)
most = float(0.8 * free.peaks.joints["effort"].max())
limited = saved(replace(problem, limits=replace(problem.limits, effort=most)))
assert limited.joint_limits["effort"].tolist() == [most] * len(problem.robot.joints)
plan = fp.plan(limited, prove=True)
assert plan.ok and plan.certificate.proved
assert plan.peaks.joints["effort"].max() <= most * (1 + 1e-9) < free.peaks.joints["effort"].max()
names = [f"effort {joint}" for joint in problem.robot.joints]
assert verdicts(plan, "effort") == dict.fromkeys(names, "proved")
content = json.loads(Path("plan.json").read_text())
content["problem"]["limits"]["effort"] = [0.5 * most] * len(names)
Path("tampered.json").write_text(json.dumps(content))
assert "refuted" in {each.verdict for each in fp.certify("tampered.json").findings if each.kind == "effort"}
assert "Efforts" in report(plan) and "efforts" in figures(plan)
assert LIMIT_TABLE["effort"] in limits_shown(plan.utilisation)
assert "effort" in problem_schema()["$defs"]["LimitsTable"]["properties"]
assert varied_number("limits.effort", False).unit == "N m"
by_hand = edits.limit("effort", edits.BY_HAND, dict.fromkeys(problem.robot.motors, 10.0))(problem)
assert edits.limit_of(by_hand, "effort", problem.robot.joints[0]) == edits.AMPLE * 10
inputs = MagicMock()
LimitsTab(MagicMock(), SimpleNamespace(view=View(problem)), inputs)
assert f"{problem.robot.joints[0]}, N m" in [call.args[0] for call in inputs.slider.call_args_list]
try:
    fp.Replanner(plan)
except fp.InputError as error:
    assert "corrections in flight do not know limits of efforts" in str(error)
else:
    raise AssertionError("a correction in flight does not know efforts")

cat = fp.load_problem(ROOT / "problems" / "space" / "cat.toml")
free = fp.plan(cat)
most = float(0.9 * free.peaks.joints["effort"].max())
plan = fp.plan(saved(replace(cat, limits=replace(cat.limits, effort=most))), prove=True)
assert plan.ok and plan.certificate.proved
assert plan.peaks.joints["effort"].max() <= most * (1 + 1e-9)
assert verdicts(plan, "effort") == {f"effort {joint}": "proved" for joint in cat.robot.joints}
content = json.loads(Path("plan.json").read_text())
content["problem"]["limits"]["effort"] = [0.5 * most] * len(cat.robot.joints)
Path("tampered.json").write_text(json.dumps(content))
assert fp.certify("tampered.json").verdict == "refuted"
efforts = of_certificate.JOINT_QUANTITIES.pop("efforts")  # nobody limits it here: it is not looked up
assert fp.certify(free).proved
of_certificate.JOINT_QUANTITIES["efforts"] = efforts
"""

OBSTACLE_WORKS = """
from floatplan.inflight.prediction import DISTANCE_AIM
from kernel_program import KernelProgram
from sampled_flight import nodes_of, trajectory, values_of
from floatplan.planning.kernel_input.rows import DistanceRows, PlanarRows
from floatplan.motion.planar.flight import planar_flight
from floatplan.planning.search import Search
from floatplan.problem.parts import OBSTACLE_KINDS
from floatplan.studio.panel import ObstaclesTab, obstacle_dials
from floatplan.view.scene.scene import obstacle_slab

problem = fp.load_problem(ROOT / "problems" / "obstacle.toml")
x, y = problem.obstacles[0].center
bend = fp.Bend(start=(x - 0.3, y + 0.1), corner=(x, y), end=(x - 0.1, y + 0.4), radius=0.25, margin=0.02)
asked = saved(replace(problem, obstacles=(bend,)))
assert asked.obstacles == (bend,)
times = np.linspace(0, problem.flight.duration, 200)
free = fp.plan(replace(problem, obstacles=()))
assert free.clearances(times, [bend]).min() < 0
assert np.array_equal(free.clearances(times, [bend]), free.clearances(times, bend.pieces))

compiled = PlanarRows(asked.robot.tree, [DistanceRows(bend, 0.0, 1.0)], flight=planar_flight(asked))
assert compiled.rows == 2 * len(problem.robot.shapes)
plan = fp.plan(asked, prove=True)
assert plan.ok and plan.certificate.proved
assert plan.clearances(times).min() >= 0.02 - 1e-8

ready = Search(asked)
start = ready.nominal_start
nodes = nodes_of(4, start.variables.polynomials.form)
of_kernel = KernelProgram(asked, 4).whole(start.x)["values"]
(block,) = ready.spec.constraints
by_numpy = values_of(block, trajectory(ready.spec.flight, start.variables, nodes, start.x)).T
assert np.allclose(of_kernel, by_numpy, rtol=1e-10, atol=1e-10) and np.abs(of_kernel).max() > 0

assert verdicts(plan, "obstacle") == {"obstacles[0] bend": "proved"}
for shift in np.linspace(-0.5, 0.5, 5):
    elsewhere = edits.moved(bend, 1j * shift)
    content = json.loads(Path("plan.json").read_text())
    content["problem"]["obstacles"][0] |= {name: list(getattr(elsewhere, name)) for name in elsewhere.places()}
    Path("tampered.json").write_text(json.dumps(content))
    found = [each.verdict for each in fp.certify("tampered.json").findings if each.kind == "obstacle"]
    finely = plan.clearances(np.linspace(0, plan.duration, 4000), [elsewhere]).min()
    if abs(finely - 0.02) > 1e-4:
        assert found == ["proved" if finely > 0.02 else "refuted"], (shift, finely, found)

replanner = fp.Replanner(plan)
assert [rows.block.between for rows in replanner.views.rows if rows.aim == DISTANCE_AIM] == [bend]
flown = fp.closed_loop(plan, perturb=fp.Perturbation(h=0.1), flights=1, budget=None)
assert flown.uncorrected.clearance.min() < 0.9 * bend.margin < flown.corrected.clearance.min()

slab, *slabs = (obstacle_slab(plan, each, 0j, 1 + 1j) for each in (bend, *bend.pieces))
assert np.array_equal(slab[0], np.concatenate([corners for corners, _ in slabs]))
assert "bend" in report(plan) and figures(plan)
assert "BendTable" in problem_schema()["$defs"]
assert varied_number("obstacles.0.corner.1", False).unit == "m"

assert [label for label, *_ in obstacle_dials(0, bend)] == [
    "start →, m", "start ↑, m", "corner →, m", "corner ↑, m", "end →, m", "end ↑, m", "radius, m", "margin, m"
]
gui = MagicMock()
ObstaclesTab(gui, MagicMock(), MagicMock(), MagicMock(), MagicMock(), (1 + 1j, 2.0))
assert [call.args[0] for call in gui.add_button.call_args_list] == [f"Add a {kind}" for kind in OBSTACLE_KINDS]
assert "bend" in OBSTACLE_KINDS and OBSTACLE_KINDS["bend"].example(1 + 1j, 2.0).thickness == 0.16
"""


def add(edits, folder):
    """Edit the package and its reference in a folder."""
    for name, changes in edits.items():
        text = (folder / name).read_text(encoding="utf-8")
        for before, after in changes:
            assert text.count(before) == 1, f"{name} does not hold {before!r} once"
            text = text.replace(before, after)
        (folder / name).unlink()
        (folder / name).write_text(text, encoding="utf-8")


@pytest.mark.long
def test_additions_work_in_every_room(tmp_path):
    """Both in one copy, and one process."""
    assert len(EFFORT) <= MOST_FILES_OF_A_LIMIT
    assert len(BEND) <= MOST_FILES_OF_AN_OBSTACLE
    shutil.copytree(ROOT / "floatplan", tmp_path / "floatplan")
    shutil.copytree(ROOT / "docs" / "api", tmp_path / "docs" / "api")
    for edits in (EFFORT, BEND):
        add(edits, tmp_path)
    program = tmp_path / "works.py"
    text = f"ROOT = __import__('pathlib').Path({str(ROOT)!r})\n{COMMON}{LIMIT_WORKS}{OBSTACLE_WORKS}"
    program.write_text(text, encoding="utf-8")
    path = os.pathsep.join(map(str, (tmp_path, ROOT / "benchmarks")))
    environment = {**os.environ, "PYTHONPATH": path}
    run = subprocess.run([sys.executable, program], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr  # its last lines name the place that is left
