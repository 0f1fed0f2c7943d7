"""What is asked of a first flight: it reaches the problem, or is refused by the option's name before any search."""

from dataclasses import replace

import pytest
from jumps import GO2, backflip

import floatplan as fp
from floatplan.errors import InputError
from floatplan.initial import flight
from floatplan.initial.flight import NoFlightError, first_flight, requested_flight
from floatplan.initial.options import InitOptions
from floatplan.initial.robots import chosen_robot
from floatplan.initial.text import problem_file_text
from floatplan.jumps.jump import Jump


@pytest.fixture(scope="module")
def go2():
    return chosen_robot(GO2)


REFUSED = {
    "no turn backwards": (InitOptions(turns=0, backwards=True), "backwards: no turn is neither"),
    "a takeoff from nowhere": (InitOptions(takeoff="nose"), "takeoff: the robot has no frame 'nose'"),
    "a landing nowhere": (InitOptions(landing="nose"), "landing: the robot has no frame 'nose'"),
    "two takeoffs": (
        InitOptions(takeoff="FL_foot", contacts=(("RL_foot", "FL_foot"), ("RL_foot",))),
        'takeoff: --contacts "RL_foot,FL_foot;RL_foot" has RL_foot next to the flight',
    ),
    "no time": (InitOptions(duration=0.0), "duration: 0.0 s is not positive"),
    "hardly any time": (InitOptions(duration=2e-3), "duration: it jumps .* give 0.016 to 1.6 s"),
    "too much time": (InitOptions(duration=30.0), "duration: it jumps .* m high in 30 s"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused_by_its_option(go2, name):
    asked, reason = REFUSED[name]
    with pytest.raises(InputError, match=f"^{reason}"):
        first_flight(go2, asked)


def test_what_was_asked_is_in_the_file(go2, monkeypatch, tmp_path):
    found = backflip()
    problem = found.problem
    assert problem.jump is not None
    asked = InitOptions(duration=found.flight.duration, backwards=True)
    held = replace(problem, flight=replace(problem.flight, duration=found.flight.duration))
    kept = Jump(held, replace(found.request, fixed=("duration",)), found.flight, found.before, found.after)
    monkeypatch.setattr(flight, "jump", lambda *_, **__: replace(kept, status="found"))
    path = tmp_path / "go2.toml"
    path.write_text(problem_file_text(go2, first_flight(go2, asked), path))
    again = fp.load_problem(path)
    assert again.jump.fixed == ("duration",)
    assert again.flight.duration == found.flight.duration
    assert again.jump.takeoff.contacts is not None


def test_where_none_is_found_what_stands_in_the_way_is_said(monkeypatch):
    """And nothing that was asked is dropped for it: without the duration it would be found, so it is."""
    tried = []

    def searched(problem, **options):
        if "near" not in options:  # not again, for links that overlap
            tried.append(problem)
        return Jump(problem, problem.jump, explanation="It is too long.") if problem.jump.fixed else backflip()

    monkeypatch.setattr(flight, "jump", searched)
    asked, words = InitOptions(backwards=True, duration=0.9), dict[str, str]()
    with pytest.raises(NoFlightError, match=r"with --backwards --duration 0\.9\..*too long.*Without --duration 0\.9 a"):
        requested_flight(GO2, asked, {}, words, 0, lambda _: None)
    assert [each.flight.duration == 0.9 for each in tried][:4] == [True, True, True, False]
