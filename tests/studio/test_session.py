"""A session without a page: changes, answers, refusals, the map, and files."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studio_insides import process_ids

import floatplan as fp
from floatplan.studio import cards
from floatplan.studio.planning import LAST, Actions, Planning, StoppedError, Worker, _prepare, packed, unpacked
from floatplan.studio.session import FILE_NAMES, Document, Session, View
from floatplan.studio.tasks import COLUMNS, ROWS, Failure, Map, MapTask, PlanTask, ShownPlan
from floatplan.view.outlines import body_poses

ROOT = Path(__file__).parents[2]
PATIENCE = 600.0  # s for what takes a fraction of one, and lets others go first
BEYOND = 1e6  # rad, outside what a problem may ask


@pytest.fixture(scope="module")
def problem() -> fp.Problem:
    return fp.load_problem(ROOT / "problems" / "new_configuration.toml")


@pytest.fixture
def session(problem: fp.Problem) -> Iterator[Session]:
    made = Session(problem, with_map=False)
    yield made
    made.close()


def settled(view: View) -> bool:
    return view.fault != "" or (view.is_current and view.result is not None and view.result.settled)


def test_each_change_is_planned_and_then_proved_as_the_planner_would(session: Session) -> None:
    assert session.wait(settled, PATIENCE)
    first = session.view
    assert first.verdict == "proved"
    assert session.set("goal.orientation", 0.5)
    assert session.wait(lambda view: settled(view) and view.number == 2, PATIENCE)
    view = session.view
    assert view.verdict == "proved"
    expected = fp.plan(view.problem, prove=True)
    assert view.result is not None
    assert np.array_equal(view.result.plan.coefficients, expected.coefficients)
    plan = view.result.plan
    assert plan.certificate is not None
    assert plan.certificate.proved
    assert first.result is not None
    assert not np.array_equal(plan.coefficients, first.result.plan.coefficients)


def test_what_cannot_be_is_said_and_nothing_changes(session: Session) -> None:
    before = session.view.problem
    for path, value in (("flight.duration", -1.0), ("goal.orientation", BEYOND), ("no.such.path", 1.0)):
        assert not session.set(path, value)
        assert session.view.refusal
        assert session.view.problem is before
    assert not session.edit(lambda _: 1 / 0)  # type: ignore[arg-type, return-value]
    assert "ZeroDivisionError" in session.view.refusal
    assert session.set("flight.duration", 1.2)
    assert session.view.refusal == ""


def test_what_is_impossible_is_explained_and_the_nearest_motion_is_shown(session: Session) -> None:
    session.edit(lambda problem: replace(problem, limits=replace(problem.limits, velocity=0.1)))
    assert session.wait(settled, PATIENCE)
    view = session.view
    assert view.verdict == "not found"
    assert view.result is not None
    assert "velocity limit" in view.result.plan.explanation
    assert len(view.result.poses.places) > 2
    card = cards.status_card(view)
    assert 'data-verdict="not found"' in card
    assert "velocity limit" in card
    session.undo()
    assert session.wait(lambda view: settled(view) and view.verdict == "proved", PATIENCE)


def test_a_drag_ends_at_its_newest_point_and_is_undone_as_one(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("floatplan.studio.session.ONE_GESTURE", PATIENCE)  # also on a slow machine
    session.wait(settled, PATIENCE)
    start = session.view.problem.goal.orientation
    seen: list[int] = []
    session.listen(lambda: seen.append(session.view.result_number))
    for step in range(1, 40):
        session.set("goal.orientation", start + 0.01 * step)
    assert session.wait(settled, PATIENCE)
    view = session.view
    assert view.result is not None
    assert view.number == 40
    assert view.result.plan.problem.goal.orientation == start + 0.39
    assert seen == sorted(seen)
    session.undo()
    assert session.view.problem.goal.orientation == start
    assert not session.undo()
    session.redo()
    assert session.view.problem.goal.orientation == start + 0.39


def test_a_process_that_is_lost_is_told_and_begun_anew(session: Session) -> None:
    assert session.wait(settled, PATIENCE)
    for number in process_ids(session):
        os.kill(number, signal.SIGKILL)
    for change in range(3):
        session.set("goal.orientation", 0.4 + 0.1 * change)
        session.wait(settled, PATIENCE)
    assert session.view.verdict == "proved"


def test_a_process_that_cannot_be_started_is_told(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    assert session.wait(settled, PATIENCE)

    def refused(_: Worker) -> None:
        raise OSError(12, "Cannot allocate memory")

    with monkeypatch.context() as patched:
        patched.setattr(Worker, "_started", refused)
        os.kill(process_ids(session)[0], signal.SIGKILL)
        for change in range(3):
            session.set("goal.orientation", 0.4 + 0.1 * change)
            session.wait(settled, PATIENCE)
        assert session.view.verdict == "failed"
        assert "cannot be started: OSError: [Errno 12] Cannot allocate memory" in session.view.fault
    session.set("goal.orientation", 0.8)
    assert session.wait(settled, PATIENCE)
    assert session.view.verdict == "proved"


def test_threads_may_all_change_it(session: Session) -> None:
    def drag(path: str) -> None:
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
    assert session.view.result is not None
    assert session.view.result.plan.problem.goal.orientation == session.view.problem.goal.orientation


def test_the_map_is_around_the_plan_and_leads_there(problem: fp.Problem) -> None:
    session = Session(problem)
    try:
        assert session.wait(lambda view: view.map is not None and len(view.map.points) == ROWS * COLUMNS, PATIENCE)
        chart = session.view.map
        assert chart is not None
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


def test_the_map_of_a_problem_with_limits_is_searched_point_by_point(problem: fp.Problem) -> None:
    limited = replace(problem, limits=replace(problem.limits, torque=1e3))
    chart = Map.centred_at(ShownPlan.of(fp.plan(limited), settled=True))
    assert chart.relative
    asked = list(chart.tasks(limited))
    points = [point for some, _ in asked for point in some]
    assert sorted(points) == sorted(np.ndindex(ROWS, COLUMNS))
    assert points[0] == (ROWS // 2, COLUMNS // 2)
    few = MapTask(limited, {"flight.duration": np.array([1.1, -1.0])}, PATIENCE).run()
    assert [cell.status for cell in few] == ["optimal", "error"]
    assert few[0].use is not None
    assert 0 < few[0].use < 1


def test_saved_files_are_the_session_s(session: Session, tmp_path: Path, floatplan: Callable[..., Any]) -> None:
    folder = str(tmp_path / "new" / "folder")
    session.set("goal.orientation", 0.7)
    assert session.wait(settled, PATIENCE)
    for part in ("problem", "plan", "report"):
        assert session.save(part, folder).endswith("is saved.")  # type: ignore[arg-type]
    assert floatplan("plan", f"{folder}/problem.toml", "-o", "again", "--no-figures", "--quiet").code == 0
    mine = json.loads(Path(folder, "plan.json").read_text())
    again = json.loads(Path("again", "plan.json").read_text())
    for key in ("coefficients", "angular_momentum", "centre", "amplitude", "orientation", "status", "torque_peak"):
        assert mine[key] == again[key], key
    assert mine["certificate"]["verdict"] == again["certificate"]["verdict"] == "proved"
    assert "<html" in Path(folder, "report.html").read_text()[:200]


@pytest.mark.parametrize("part", FILE_NAMES)
def test_what_the_session_has_not_written_is_not_overwritten(session: Session, tmp_path: Path, part: Document) -> None:
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


@pytest.mark.parametrize("folder", ["/proc/nowhere", "\0", "a" * 5000])
def test_what_cannot_be_saved_is_said(session: Session, folder: str) -> None:
    assert session.save("problem", folder).startswith("Not saved: ")


def test_a_worker_answers_says_and_stops(problem: fp.Problem) -> None:
    worker = Worker(problem.robot)
    try:
        answer = worker.ask(PlanTask(problem, PATIENCE))
        assert not isinstance(answer, Failure), answer.words
        assert answer.plan.ok
        assert answer.plan.robot is problem.robot
        failed = worker.ask(PlanTask(problem, -1.0))
        assert isinstance(failed, Failure)
        assert "not positive" in failed.words
        with stopped_again_and_again(worker), pytest.raises(StoppedError):
            ask_on(worker, problem)
        assert worker.ask(PlanTask(problem, PATIENCE)).plan.ok
    finally:
        worker.close()
    with pytest.raises(StoppedError):
        worker.ask(PlanTask(problem, PATIENCE))


def test_a_worker_says_what_it_does(problem: fp.Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """To whoever asks, in its order, and nothing of it to the next."""

    def run(task: PlanTask, say: Callable[[str], None]) -> float | None:
        say(f"asked for {task.budget}")
        return task.budget

    monkeypatch.setattr(PlanTask, "run", run)
    worker, words = Worker(problem.robot), list[str]()
    with ThreadPoolExecutor(1) as here:
        monkeypatch.setattr(worker, "_started", lambda: here)
        _prepare(problem.robot, 0, worker._progress_end)
        assert [worker.ask(PlanTask(problem, budget), words.append) for budget in (1.0, 2.0)] == [1.0, 2.0]
    assert words == ["asked for 1.0", "asked for 2.0"]


def test_a_search_is_stopped_and_all_is_as_it_was(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    assert session.wait(settled, PATIENCE)
    before = session.view
    session.stop()
    assert session.view is before, "nothing was sought"
    with monkeypatch.context() as unanswered:
        unanswered.setattr(Planning, "_plan", lambda *_: None)
        assert session.set("flight.duration", 1.2)
        asked = session.view
        session._take_words(asked.number, "start 2 of 4")
        assert session.view.doing == "start 2 of 4"
        assert "Start 2 of 4" in cards.status_card(session.view)
        session.stop()
    assert vars(session.view) == vars(before)
    assert before.result is not None
    session._take_plan(asked.number, before.result)
    session._take_words(asked.number, "too late")
    assert vars(session.view) == vars(before)
    assert session.undo()
    assert session.view.problem.flight.duration == 1.2
    assert session.wait(lambda view: settled(view) and view.is_current and view.number > asked.number, PATIENCE)


def test_the_first_search_is_stopped(problem: fp.Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as unanswered:
        unanswered.setattr(Planning, "_plan", lambda *_: None)
        session = Session(problem, with_map=False)
        session.stop()
    try:
        assert session.view.verdict == "stopped"
        assert "<b>Stopped</b>" in cards.status_card(session.view)
        assert session.set("flight.duration", 1.2)
        assert session.wait(settled, PATIENCE)
        assert session.view.verdict == "proved"
    finally:
        session.close()


def test_proofs_and_maps_let_the_page_go_first(session: Session) -> None:
    assert session.wait(lambda view: view.result is not None and view.result.settled, PATIENCE)
    quick, thorough = (os.getpriority(os.PRIO_PROCESS, number) for number in process_ids(session))
    assert quick == os.getpriority(os.PRIO_PROCESS, 0)
    assert thorough == min(quick + LAST, 19)


SCRIPT = """
import floatplan as fp
from floatplan.studio.tasks import PlanTask
from floatplan.studio.planning import Worker

if __name__ == "__main__":
    problem = fp.load_problem({path!r})
    worker = Worker(problem.robot)
    print(worker.ask(PlanTask(problem, 60.0)).plan.ok)
    worker.close()
"""


def test_processes_import_what_the_page_does_wherever_it_is_started(tmp_path: Path) -> None:
    """Another floatplan lies in the working directory."""
    for module in ("floatplan/__init__.py", "floatplan/studio/__init__.py"):
        (tmp_path / "here" / module).parent.mkdir(parents=True)
        (tmp_path / "here" / module).write_text("")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(path=str(ROOT / "problems" / "new_configuration.toml")))
    places = os.pathsep.join(place for place in sys.path if place)
    environment = {**os.environ, "PYTHONPATH": places}
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=tmp_path / "here",
        env=environment,
        check=False,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert (done.stdout, done.stderr) == ("True\n", "")


def ask_on(worker: Worker, problem: fp.Problem) -> None:
    begun = time.monotonic()
    while time.monotonic() - begun < PATIENCE:
        worker.ask(PlanTask(problem, PATIENCE))


@contextlib.contextmanager
def stopped_again_and_again(worker: Worker) -> Iterator[None]:
    """As a stop between two questions is no error to the next one."""
    enough = threading.Event()

    def stop() -> None:
        while not enough.wait(0.1):
            worker.stop()

    stopper = threading.Thread(target=stop)
    stopper.start()
    try:
        yield
    finally:
        enough.set()
        stopper.join()


def test_the_robot_stays_where_it_is(problem: fp.Problem) -> None:
    content = packed(PlanTask(problem, 1.0), problem.robot)
    assert len(content) < 10_000
    assert unpacked(content, problem.robot).problem.robot is problem.robot


def test_words_of_any_error_are_on_one_short_line() -> None:
    assert Failure.of(fp.InputError("is wrong", element="here")).words == "here: is wrong"
    told = Failure.of(RuntimeError("a\nb" + "c" * 5000)).words
    assert "\n" not in told
    assert len(told) < 500


def test_bodies_are_where_the_plan_has_them(problem: fp.Problem) -> None:
    plan = fp.plan(problem)
    times = np.array([0.0, 0.4, 1.1])
    state = plan.at(times)
    com = state.com_position @ np.array([1, 1j])
    poses = body_poses(plan.robot, state.orientation, state.positions, com)
    tree = plan.robot.tree
    base = state.base_position @ np.array([1, 1j])
    assert np.allclose(poses.places[:, 0], base, atol=1e-12)
    centers = poses.places + tree.rotations(poses.angles) * tree.center
    assert np.allclose(centers @ tree.mass / tree.mass.sum(), com, atol=1e-12)


def test_of_many_moves_the_newest_is_made_and_errors_end_nothing(caplog: pytest.LogCaptureFixture) -> None:
    actions, seen = Actions("test"), []
    try:
        gate = [True]
        actions.do("first", lambda: [None for _ in iter(lambda: gate[0], False)])
        for step in range(100):
            actions.do("drag", lambda step=step: seen.append(step))  # type: ignore[misc]
        actions.do("wrong", lambda: 1 / 0)
        actions.do("after", lambda: seen.append(-1))
        gate[0] = False
        assert actions.wait(PATIENCE)
    finally:
        actions.close()
    assert seen == [99, -1]
    (record,) = caplog.records
    assert record.getMessage() == "test: wrong"
    assert record.exc_info is not None
    assert record.exc_info[0] is ZeroDivisionError
