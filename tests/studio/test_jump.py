"""A jump in the studio: what is said of it, its phases, and the page around it."""

from dataclasses import replace

import numpy as np
import pytest
from jumps import backflip, go2_problem, planned_jump
from places import PROBLEMS

import floatplan as fp
from floatplan.studio import cards, edits
from floatplan.studio.curves import curves_card, phase_colours
from floatplan.studio.planning import packed, unpacked
from floatplan.studio.session import Session, View
from floatplan.studio.tasks import ShownPlan
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


@pytest.mark.long
def test_a_jump_is_planned_changed_and_saved(tmp_path):
    problem = fp.load_problem(PROBLEMS / "jumps" / "go2.toml")
    session, said = Session(problem), set[str]()
    session.listen(lambda: said.add(session.view.doing))
    try:
        assert session.wait(lambda view: view.result is not None, PATIENCE)
        assert session.view.verdict == "waiting"
        assert session.wait(lambda view: view.verdict == "proved", PATIENCE), session.view.fault
        answer = session.view.result
        expected = planned_jump("go2").flight
        assert np.array_equal(answer.plan.coefficients, expected.coefficients)
        ends = [phase.end for phase in answer.jump.phases]
        ends[1] -= 0.02
        assert session.edit(edits.phases(ends, 2))
        assert session.view.result is answer, "the last jump stays until there is another"
        assert session.wait(lambda view: view.verdict == "proved", PATIENCE), session.view
        assert said >= {"start 1 of 4", "from the jump at hand"}
        assert "start 2 of 4" not in said
        assert session.save("plan", str(tmp_path)).endswith("jump.json is saved.")
        saved = fp.load_jump(tmp_path / "jump.json")
        assert [phase.end for phase in saved.phases] == pytest.approx(ends, abs=1e-6)
    finally:
        session.close()
