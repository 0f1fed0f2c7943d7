"""Real robots of example-robot-data: planned within their limits, proved, and flown in two engines."""

import re
import runpy
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from long_cases import cases
from places import ROOT
from proof_records import certify_record

import floatplan as fp
from floatplan.certificate.certificate import shapes_of
from floatplan.motion.planar.contact_rates import has_contact
from floatplan.robot.leak import MEANINGLESS, WORTH_A_WARNING
from floatplan.robot.urdf.tree import PREFIX

GALLERY = ROOT / "problems" / "gallery"
NAMES = sorted(path.stem for path in GALLERY.glob("*.toml"))
IN_MUJOCO = ("a1", "bolt", "go2", "human", "solo12", "talos")


@pytest.fixture
def plans(planned):
    return lambda name: planned(f"gallery/{name}")


@pytest.mark.parametrize("name", cases(NAMES, {"g1", "talos", "solo12", "human"}))
def test_plans_are_proved_and_hardly_leave_their_plane(plans, name):
    plan = plans(name)
    assert plan.certificate.proved
    assert plan.record.robot.urdf == plan.robot.source
    leak = plan.record.out_of_plane_leak
    assert leak < (MEANINGLESS if name in ("borinot", "double_pendulum") else WORTH_A_WARNING)


@pytest.mark.parametrize("name", cases(IN_MUJOCO, set(IN_MUJOCO) - {"bolt"}))
def test_mujoco_agrees_and_converges_with_fourth_order(plans, name):
    errors = []
    for step in (2e-3, 1e-3, 5e-4):
        flown = fp.replay(plans(name), engine="mujoco", step=step)
        errors.append(max(flown.orientation_error, *flown.position_error))
    assert errors[-1] < 1e-8
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.25)


def test_go2_turns_once_backwards_within_its_real_limits(plans):
    plan = plans("go2")
    assert plan.final_orientation == pytest.approx(-2.0 * np.pi, abs=1e-9)
    assert np.isfinite(plan.problem.torque_limits).all()
    assert np.isfinite(plan.problem.velocity_limits).all()
    assert len(plan.robot.coupled) == 4


def test_plans_are_proved_with_the_robot_s_capsules(plans):
    plan = plans("a1")
    shapes = shapes_of(plan.robot)
    assert certify_record(plan.record, shapes=shapes).verdict == "proved"
    bar = {**plan.record.problem["obstacles"][1], "center": [0.65, 0.5]}
    moved = replace(plan.record, problem={**plan.record.problem, "obstacles": [bar]})
    assert certify_record(moved, shapes=shapes).verdict == "refuted"


def test_a_leak_is_warned_of(floatplan):
    run = floatplan("plan", GALLERY / "borinot.toml", "--no-figures")
    assert run.code == 0, run
    assert "In space this motion leaves its plane: borinot__base_link lands 5.72 degrees" in " ".join(
        run.stdout.split()
    )
    assert "plane" not in floatplan("plan", GALLERY / "bolt.toml", "--no-figures").stdout


def test_what_the_leak_does_is_integrated_in_space(plans):
    assert np.linalg.norm(plans("go2").out_of_plane) == pytest.approx(0.026, abs=5e-4)
    assert np.linalg.norm(plans("bolt").out_of_plane) < 1e-4


def test_a_leak_that_makes_plans_meaningless_is_refused(floatplan):
    flight = ("--start", "0" + ",0.8,-1.6" * 4, "--goal", "0" + ",0.8,-1.5" * 4, "--duration", "0.5")
    run = floatplan("plan", PREFIX + "go2_description/urdf/go2.urdf", *flight)
    assert run.code == 2
    assert "meaningless" in run.stderr
    assert "couple FR_thigh_joint with FL_thigh_joint" in run.stderr
    assert not Path("runs").exists()


def test_the_script_makes_the_table(monkeypatch, capsys):
    script = ROOT / "scripts" / "gallery.py"
    monkeypatch.syspath_prepend(str(script.parent))
    monkeypatch.setattr(sys, "argv", [str(script), "flights", "double_pendulum", "--no-picture"])
    runpy.run_path(str(script), run_name="__main__")
    header, rule, row = capsys.readouterr().out.splitlines()
    assert header.startswith("| robot | joints planned | kg |")
    assert set(rule) <= set("|-: ")
    assert row.startswith("| double pendulum | 2 | 0.701 | 0.6 |")


@pytest.mark.long
def test_the_page_has_the_table_of_these_plans(monkeypatch, plans):
    """Joints, mass and duration as the script prints them; what depends on the plan found within its limits."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    script = runpy.run_path(str(ROOT / "scripts" / "gallery.py"))
    page = re.sub(r"</?a.*?>", "", (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8"))
    written = {line.split(" | ")[0]: line.strip("| ").split(" | ") for line in page.splitlines()}
    assert sorted(script["TITLES"]) == NAMES
    for name, title in script["TITLES"].items():
        cells = written[f"| {title}"]
        row = script["Entry"](name, plans(name), 0.0).row()
        assert cells[:4] == row[:4]
        if "no limit" in (cells[4], row[4]):
            assert cells[4] == row[4]
        else:
            assert float(cells[4]) <= 1.0
            assert float(row[4]) <= 1.0
        for cell, end in ((5, "takeoff"), (6, "landing")):
            assert (cells[cell] == "flies") == (row[cell] == "flies") == (not has_contact(plans(name).problem, end))
            assert (cells[cell] == "no limit") == (row[cell] == "no limit")
        assert float(cells[8]) == pytest.approx(float(row[8]), rel=0.05, abs=1e-3)
        stands = has_contact(plans(name).problem, "takeoff")
        assert (cells[7] == "flies") == (not stands)
        first = (GALLERY / f"{name}.toml").read_text().splitlines()[0]
        assert ("without a stance" in first) == cells[7].startswith(("flies", "not found", "does not stand")), first


def test_the_page_has_the_table_of_flights_in_space(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    script = runpy.run_path(str(ROOT / "scripts" / "gallery.py"))
    page = re.sub(r"</?a.*?>", "", (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8"))
    assert sorted(script["SPACE_TITLES"]) == sorted(path.stem for path in (ROOT / "problems" / "space").glob("*.toml"))
    assert f"| {' | '.join(script['SPACE_COLUMNS'])} |" in page
    for title in script["SPACE_TITLES"].values():
        assert f"| {title} | " in page
    (barrel,) = (line for line in page.splitlines() if line.startswith("| Go2, barrel roll"))
    row = script["planned"](ROOT / "problems" / "space" / "go2_barrel_roll.toml").row_in_space()
    assert barrel.strip("| ").split(" | ")[:4] == row[:4]
    assert float(row[7]) < 1e-10
    assert float(row[8]) < 1e-9


def test_the_page_begins_with_jumps_that_are_there(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    script = runpy.run_path(str(ROOT / "scripts" / "gallery.py"))
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    header = f"| {' | '.join(script['JUMP_COLUMNS'])} |"
    assert page.index(header) < page.index(f"| {' | '.join(script['COLUMNS'])} |")
    rows = page[page.index(header) :].split("\n\n")[0].splitlines()[2:]
    titles = {script["title_of"](path.stem): path for path in (ROOT / "problems" / "jumps").glob("*.toml")}
    assert len(rows) == len(titles)
    for row in rows:
        cells = row.strip("| ").split(" | ")
        problem = fp.load_problem(titles[cells[0].partition(",")[0]])
        assert float(cells[4]) <= problem.jump.margin["torque"]
        if np.isfinite(problem.velocity_limits).any():
            assert float(cells[5]) <= problem.jump.margin["velocity"]
        else:
            assert cells[5] == "no limit"
        assert float(cells[6]) <= problem.jump.friction
        assert cells[7:9] == ["proved", "checked"]


def test_problems_are_written_with_the_robot_s_address(tmp_path, plans):
    problem = plans("solo12").problem
    again = fp.load_problem(fp.save_problem(problem, tmp_path / "problem.toml"))
    assert again.robot.source == problem.robot.source
    assert dict(again.robot.coupled) == dict(problem.robot.coupled)
    assert dict(again.robot.locked) == dict(problem.robot.locked)
