from __future__ import annotations

from floatplan.studio.session import MOST, ONE_GESTURE, History


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_what_is_undone_can_be_done_again_until_something_else_is() -> None:
    history = History("a")
    assert not history.go(-1)
    assert not history.go(1)
    history.change("b")
    history.change("c")
    history.go(-1)
    assert history.present == "b"
    history.go(1)
    assert history.present == "c"
    history.go(-1)
    history.change("d")
    assert history.present == "d"
    assert not history.go(1)
    assert history.present == "d"
    for _ in range(5):
        history.go(-1)
    assert history.present == "a"


def test_a_drag_is_undone_as_a_whole() -> None:
    clock = Clock()
    history = History(0, clock)
    for value in range(1, 50):
        clock.now += 0.5 * ONE_GESTURE
        history.change(value, "goal")
    history.go(-1)
    assert history.present == 0
    history.go(1)
    assert history.present == 49


def test_another_gesture_or_a_pause_begins_anew() -> None:
    clock = Clock()
    history = History(0, clock)
    history.change(1, "goal")
    history.change(2, "start")
    clock.now += 2 * ONE_GESTURE
    history.change(3, "start")
    history.change(4)
    history.change(5)
    for value in (4, 3, 2, 1, 0):
        history.go(-1)
        assert history.present == value


def test_a_gesture_goes_on_no_longer_after_it_was_undone() -> None:
    history = History(0, Clock())
    history.change(1, "goal")
    history.go(-1)
    history.go(1)
    history.change(2, "goal")
    history.go(-1)
    assert history.present == 1


def test_it_is_bounded() -> None:
    history = History(0)
    for value in range(1, 3 * MOST):
        history.change(value)
    steps = 0
    while history.go(-1):
        steps += 1
    assert steps == MOST - 1
    assert history.present == 2 * MOST
