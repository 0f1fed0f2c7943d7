"""A session without a page: changes, answers, refusals, the map, and files."""

import json
import os
import signal
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import ROOT
from studio_insides import process_ids

import floatplan as fp
from floatplan.studio import cards
from floatplan.studio.session import FILE_NAMES, Session
from floatplan.studio.tasks import COLUMNS, ROWS

PATIENCE = 600.0  # s for what takes a fraction of one, and lets others go first
BEYOND = 1e6  # rad, outside what a problem may ask


@pytest.fixture(scope="module")
def problem():
    return fp.load_problem(ROOT / "problems" / "new_configuration.toml")


@pytest.fixture(scope="module")
def shared(problem):
    made = Session(problem, with_map=False)
    yield made
    made.close()


@pytest.fixture
def session(shared):
    """The session with its first problem, all of whose changes are taken back."""
    while shared.undo():
        pass
    shared.refuse("")
    return shared


def settled(view):
    return view.fault != "" or (view.is_current and view.result is not None and view.result.settled)


def test_each_change_is_planned_and_then_proved_as_the_planner_would(session):
    assert session.wait(settled, PATIENCE)
    first = session.view
    assert first.verdict == "proved"
    assert session.set("goal.orientation", 0.5)
    assert session.wait(lambda view: settled(view) and view.number == first.number + 1, PATIENCE)
    view = session.view
    assert view.verdict == "proved"
    expected = fp.plan(view.problem, prove=True)
    assert np.array_equal(view.result.plan.coefficients, expected.coefficients)
    plan = view.result.plan
    assert plan.certificate.proved
    assert not np.array_equal(plan.coefficients, first.result.plan.coefficients)


def test_what_cannot_be_is_said_and_nothing_changes(session):
    before = session.view.problem
    for path, value in (("flight.duration", -1.0), ("goal.orientation", BEYOND), ("no.such.path", 1.0)):
        assert not session.set(path, value)
        assert session.view.refusal
        assert session.view.problem is before
    assert not session.edit(lambda _: 1 / 0)
    assert "ZeroDivisionError" in session.view.refusal
    assert session.set("flight.duration", 1.2)
    assert session.view.refusal == ""


def test_what_is_impossible_is_explained_and_the_nearest_motion_is_shown(session):
    session.edit(lambda problem: replace(problem, limits=replace(problem.limits, velocity=0.1)))
    assert session.wait(settled, PATIENCE)
    view = session.view
    assert view.verdict == "not found"
    assert "velocity limit" in view.result.plan.explanation
    assert len(view.result.poses.places) > 2
    card = cards.status_card(view)
    assert 'data-verdict="not found"' in card
    assert "velocity limit" in card
    session.undo()
    assert session.wait(lambda view: settled(view) and view.verdict == "proved", PATIENCE)


@pytest.mark.long
def test_a_drag_ends_at_its_newest_point_and_is_undone_as_one(session, monkeypatch):
    monkeypatch.setattr("floatplan.studio.session.ONE_GESTURE", PATIENCE)  # also on a slow machine
    session.wait(settled, PATIENCE)
    start = session.view.problem.goal.orientation
    first, seen = session.view.number, list[int]()
    session.listen(lambda: seen.append(session.view.result_number))
    for step in range(1, 40):
        session.set("goal.orientation", start + 0.01 * step)
    assert session.wait(settled, PATIENCE)
    view = session.view
    assert view.number == first + 39
    assert view.result.plan.problem.goal.orientation == start + 0.39
    assert seen == sorted(seen)
    session.undo()
    assert session.view.problem.goal.orientation == start
    assert not session.undo()
    session.redo()
    assert session.view.problem.goal.orientation == start + 0.39


@pytest.mark.long
def test_a_process_that_is_lost_is_told_and_begun_anew(session):
    assert session.wait(settled, PATIENCE)
    for number in process_ids(session):
        os.kill(number, signal.SIGKILL)
    for change in range(3):
        session.set("goal.orientation", 0.4 + 0.1 * change)
        session.wait(settled, PATIENCE)
    assert session.view.verdict == "proved"


@pytest.mark.long
def test_threads_may_all_change_it(session):
    def drag(path):
        for step in range(30):
            session.set(path, 0.3 + 0.001 * step)
            if step % 10 == 9:
                session.undo()

    paths = ("goal.orientation", "goal.positions.q1", "start.positions.q2")
    threads = [threading.Thread(target=drag, args=(path,)) for path in paths]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert session.wait(settled, PATIENCE)
    assert session.view.result.plan.problem.goal.orientation == session.view.problem.goal.orientation


@pytest.mark.long
def test_the_map_is_around_the_plan_and_leads_there(problem):
    session = Session(problem)
    try:
        assert session.wait(lambda view: view.map is not None and len(view.map.points) == ROWS * COLUMNS, PATIENCE)
        chart = session.view.map
        assert chart.points[ROWS // 2, COLUMNS // 2].status == "optimal"
        assert chart.durations[ROWS // 2] == problem.flight.duration
        assert chart.momenta[COLUMNS // 2] == problem.flight.angular_momentum
        card = cards.map_card(chart, True)
        assert card.count("data-point=") == ROWS * COLUMNS
        session.jump(0, 1)
        assert session.view.problem.flight.duration == chart.durations[0]
        assert session.view.problem.flight.angular_momentum == chart.momenta[1]
        assert session.view.map is None
        assert session.wait(settled, PATIENCE)
        found = session.view.result is not None and session.view.result.plan.ok
        assert found == (chart.points[0, 1].use is not None)
    finally:
        session.close()


def test_saved_files_are_the_session_s(session, tmp_path, floatplan):
    folder = str(tmp_path / "new" / "folder")
    session.set("goal.orientation", 0.7)
    assert session.wait(settled, PATIENCE)
    for part in ("problem", "plan", "report"):
        assert session.save(part, folder).endswith("is saved.")
    assert floatplan("plan", f"{folder}/problem.toml", "-o", "again", "--no-figures", "--quiet").code == 0
    mine = json.loads(Path(folder, "plan.json").read_text())
    again = json.loads(Path("again", "plan.json").read_text())
    for key in ("coefficients", "angular_momentum", "centre", "amplitude", "orientation", "status", "torque_peak"):
        assert mine[key] == again[key], key
    assert mine["certificate"]["verdict"] == again["certificate"]["verdict"] == "proved"
    assert "<html" in Path(folder, "report.html").read_text()[:200]


@pytest.mark.parametrize("part", FILE_NAMES)
def test_what_the_session_has_not_written_is_not_overwritten(session, tmp_path, part):
    assert session.wait(settled, PATIENCE)
    mine = tmp_path / FILE_NAMES[part]
    mine.write_text("mine")
    own = mine.with_stem(f"{mine.stem}-2")
    for _ in range(2):
        told = session.save(part, str(tmp_path))
        assert told == f"{own} is saved: there is another {mine.name} already."
        assert mine.read_text() == "mine"
    assert sorted(tmp_path.iterdir()) == sorted((mine, own))
    own.write_text("changed by another")
    assert f"{mine.stem}-3" in session.save(part, str(tmp_path))
    assert own.read_text() == "changed by another"
    mine.unlink()
    mine.symlink_to(tmp_path / "nowhere")
    assert session.save(part, str(tmp_path)).startswith(str(tmp_path / f"{mine.stem}-3"))
    assert mine.is_symlink()
