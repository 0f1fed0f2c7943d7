"""A jump in the studio: what is said of it, its phases, and the page around it."""

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from jumps import backflip, go2_problem, plan_on_fewer_nodes, planned_jump, roll
from places import PROBLEMS
from studio_insides import logged_errors

import floatplan as fp
from floatplan.studio import cards, edits
from floatplan.studio.curves import curves_card, phase_colours
from floatplan.studio.page import Studio
from floatplan.studio.planning import Worker, packed, unpacked
from floatplan.studio.session import Session, View
from floatplan.studio.tasks import PlanTask, ShownPlan
from floatplan.view.charts import SampledPlan

PATIENCE = 600.0  # s for what takes ten, and lets others go first


@pytest.fixture(scope="module")
def shown():
    flight = backflip().flight
    assert flight is not None
    jump = backflip().with_certificate(fp.certify(flight))
    assert jump.flight is not None
    return ShownPlan.of(jump.flight, True, jump)


@pytest.fixture(scope="module")
def problem():
    return replace(go2_problem(), jump=fp.JumpRequest())


def test_a_jump_is_told_as_its_report_tells_it(shown, problem):
    """Whatever it went through on its way from the process that planned it."""
    robot = shown.plan.robot
    found = unpacked(packed(shown, robot), robot)
    view = View(problem, result=found)
    assert view.verdict == "proved"
    assert replace(view, result=replace(found, jump=None)).verdict == "waiting", "the flight alone is no answer"
    assert f"<b>{found.jump.verdict.capitalize()}</b>" in cards.status_card(view)
    assert found.motion.duration == found.jump.duration > found.plan.duration
    columns = SampledPlan.of(found.jump, np.linspace(0.0, found.jump.duration, 401)).columns
    for of_all, key in zip(found.shares, ("torque_use", "rate_use"), strict=True):
        most = max(np.abs(values).max() for name, values in columns.items() if name.startswith(key))
        assert of_all.limited
        assert of_all.peak == pytest.approx(most)
        assert f"{most:.0%} at most" in curves_card(found.motion, found.shares)
    assert found.largest_use == max(each.peak for each in found.shares)
    assert len(phase_colours(found.jump)) == len(found.jump.phases) == 5
    assert f"friction used</span>{found.jump.check.figures['friction']:.2f}" in cards.status_card(view)
    compared = cards.comparison_card(found, replace(found, jump=None))
    assert f"<td>duration<td>{found.plan.duration:.3g} s<td>{found.jump.duration:.3g} s" in compared
    assert "<td>- N m</tr>" in compared or "<td>-</tr>" in compared, "what is the flight's alone is not the jump's"


def test_phases_last_as_the_bar_has_them(shown, problem, tmp_path):
    ends = tuple(round(phase.end, 3) for phase in shown.jump.phases)
    kept = edits.phases(ends, 2)(problem)
    assert edits.phase_ends(kept) == pytest.approx(ends)
    assert kept.flight.duration == pytest.approx(ends[2] - ends[1])
    again = fp.load_problem(fp.save_problem(kept, tmp_path / "kept.toml"))
    assert edits.phase_ends(again) == pytest.approx(ends)
    assert edits.phases(ends, 2)(kept).jump == kept.jump
    free = edits.phases(None)(kept)
    assert edits.phase_ends(free) is None
    assert free.jump == problem.jump
    for wrong in ((*ends[:3], ends[2] - 0.1, ends[4]), (*ends[:4], float("nan"))):
        with pytest.raises(fp.InputError):
            edits.phases(wrong, 2)(problem)


@pytest.mark.parametrize("part", ["duration", "angular_momentum", "start", "goal"])
def test_a_part_of_the_flight_is_kept_as_it_was_found(shown, problem, tmp_path, part):
    kept = edits.keep(part, shown.plan)(problem)
    again = fp.load_problem(fp.save_problem(kept, tmp_path / "kept.toml"))
    for each in (kept, again):
        assert list(each.jump.fixed) == [part]
        if part in ("start", "goal"):
            state, found = edits.end_state(each, part), edits.end_state(shown.plan.problem, part)
            assert np.append(state.orientation, state.positions) == pytest.approx(
                np.append(found.orientation, found.positions)
            )
        else:
            assert getattr(each.flight, part) == pytest.approx(getattr(shown.plan, part))
    assert edits.keep(part, shown.plan)(kept).jump == kept.jump
    assert edits.keep(part, None)(kept).jump == problem.jump


@pytest.fixture(scope="module")
def shown_in_space():
    jump = roll().with_certificate(fp.certify(roll().flight))
    return ShownPlan.of(jump.flight, True, jump)


def test_a_jump_in_space_is_told_and_drawn(shown_in_space):
    robot = shown_in_space.plan.robot
    found = unpacked(packed(shown_in_space, robot), robot)
    view = View(roll().problem, result=found)
    assert view.verdict == "proved"
    card = cards.status_card(view)
    assert f"<b>{found.jump.verdict.capitalize()}</b>" in card
    momentum = np.linalg.norm(found.plan.angular_momentum)
    assert f"angular momentum</span>{momentum:.3g} kg" in card
    assert f"<td>angular momentum<td>{momentum:.3g} kg" in cards.comparison_card(found, found)
    assert found.largest_use == max(each.peak for each in found.shares)
    assert [len(colours) for colours in phase_colours(found.jump)] == [4, 2, 1, 2, 4]
    times = np.linspace(0.0, found.jump.duration, 361)
    state = found.jump.state(times)
    assert found.paths[0] == pytest.approx(state.com_position)
    assert found.poses.places[[0, -1], 1] == pytest.approx(state.base_position[[0, -1]])
    assert np.ptp(found.grid[..., 2]) == 0.0
    assert found.grid[0, 0, 2] == pytest.approx(found.jump.ground)


def test_a_goal_in_space_is_changed_by_its_angles_and_place(shown_in_space, tmp_path):
    problem = roll().problem
    assert edits.number_at(problem, "goal.orientation.angles.0") == pytest.approx(2 * np.pi)
    assert np.isnan(edits.number_at(problem, "jump.landing.displacement.1"))
    kept = edits.displaced(shown_in_space.jump)(problem)
    com = shown_in_space.jump.state([0.0, shown_in_space.jump.duration]).com_position
    assert kept.jump.landing.displacement == pytest.approx((com[1] - com[0])[:2], abs=1e-3)
    turned = edits.numbers({"goal.orientation.angles.2": 0.1, "jump.landing.displacement.1": -0.3})(kept)
    again = fp.load_problem(fp.save_problem(turned, tmp_path / "turned.toml"))
    for each in (turned, again):
        assert edits.number_at(each, "goal.orientation.angles.2") == pytest.approx(0.1)
        assert edits.number_at(each, "jump.landing.displacement.1") == pytest.approx(-0.3)
    assert edits.displaced(None)(kept).jump == problem.jump


def test_a_jump_at_hand_of_other_phases_is_left_aside(monkeypatch):
    asked = []

    def refuses_near(problem, progress, near=None):
        asked.append(near)
        if near is not None:
            raise fp.InputError("is a jump of other phases", element="near")
        raise fp.InputError("is wrong", element="goal")

    monkeypatch.setattr(fp, "jump", refuses_near)
    with pytest.raises(fp.InputError, match="is wrong"):
        PlanTask(roll().problem, near=roll()).run()
    assert asked == [roll(), None]


def test_a_flight_in_space_alone_is_refused():
    with pytest.raises(fp.InputError, match="for whole jumps, not yet for single flights"):
        Studio(replace(roll().problem, jump=None))


class WorkerHere(Worker):
    """Does in this process what it would in another one: that of the jump in a plane, below, is one."""

    def ask(self, task, say=str):
        result = unpacked(packed(task, self._robot), self._robot).run(say)
        return unpacked(packed(result, self._robot), self._robot)


@pytest.mark.long
def test_a_jump_in_space_is_planned_changed_and_saved(tmp_path, monkeypatch):
    """By its page, which has no ghosts to drag, and inputs of a jump in space alone."""
    find = fp.jump
    monkeypatch.setattr(fp, "jump", lambda *given, **options: find(*given, **options) if "near" in options else roll())
    monkeypatch.setattr("floatplan.studio.planning.Worker", WorkerHere)
    plan_on_fewer_nodes(monkeypatch, share=0.45)
    with logged_errors() as errors, closing(Studio(roll().problem, folder=str(tmp_path), port=0)) as studio:
        session = studio.session
        said = set[str]()
        session.listen(lambda: said.add(session.view.doing))
        assert session.wait(lambda view: view.verdict == "proved", PATIENCE), session.view.fault
        assert studio.painter.wait(PATIENCE)
        assert not studio.stage.ghosts
        assert {"goal.orientation.angles.0", "jump.landing.displacement.0", "jump.friction"} <= set(
            studio.panel.inputs.sliders
        )
        assert session.edit(edits.numbers({"goal.orientation.angles.2": np.radians(2), "jump.friction": 0.55}))
        assert session.wait(lambda view: view.is_current and view.verdict == "proved", PATIENCE), session.view
        assert "from the jump at hand" in said
        assert session.save("plan", str(tmp_path)).endswith("jump.json is saved.")
        saved = fp.load_jump(tmp_path / "jump.json")
        assert saved.ok
        assert saved.request.friction == 0.55
        assert saved.problem.goal.orientation.angles[2] == pytest.approx(np.radians(2))
        assert session.save("report", str(tmp_path)).endswith("report.html is saved.")
    assert errors == []


@pytest.mark.long
def test_a_jump_is_planned_changed_and_saved(tmp_path):
    """In a process of its own; of a chain, whose jump takes less time than that of legs in pairs."""
    problem = fp.load_problem(PROBLEMS / "jumps" / "high_jumper.toml")
    session, said = Session(problem), set[str]()
    session.listen(lambda: said.add(session.view.doing))
    try:
        assert session.wait(lambda view: view.result is not None, PATIENCE)
        assert session.view.verdict == "waiting"
        assert session.wait(lambda view: view.verdict == "proved", PATIENCE), session.view.fault
        answer = session.view.result
        expected = planned_jump("high_jumper").flight
        assert np.array_equal(answer.plan.coefficients, expected.coefficients)
        ends = [phase.end for phase in answer.jump.phases]
        ends[0] -= 0.02
        assert session.edit(edits.phases(ends, 1))
        assert session.view.result is answer, "the last jump stays until there is another"
        assert session.wait(lambda view: view.verdict == "proved", PATIENCE), session.view
        assert said >= {"start 1 of 4", "from the jump at hand"}
        assert "start 2 of 4" not in said
        assert session.save("plan", str(tmp_path)).endswith("jump.json is saved.")
        saved = fp.load_jump(tmp_path / "jump.json")
        assert [phase.end for phase in saved.phases] == pytest.approx(ends, abs=1e-6)
    finally:
        session.close()
