"""What a jump does not do is refused by its key, and never answered with another jump."""

from dataclasses import replace

import numpy as np
import pytest
from jumps import go2_problem

import floatplan as fp


def flight(**changes):
    problem = go2_problem()
    return replace(problem, flight=replace(problem.flight, **changes))


def test_a_file_without_a_jump_is_refused_by_the_command(floatplan, root):
    done = floatplan("jump", root / "problems/somersault.toml")
    assert done.code == 2
    assert "somersault.toml: jump: no jump is asked for" in done.stderr
    assert not done.stdout


@pytest.mark.parametrize(
    ("problem", "said"),
    [
        (lambda: flight(landing=fp.Landing("FL_calf")), r"flight\.landing\.frame: 'FL_calf' is not among .*FL_foot"),
        (lambda: flight(landing=fp.Landing("RL_foot")), r"flight\.landing\.frame: 'RL_foot' is not among .*FL_foot"),
        (lambda: flight(landing=fp.Landing("FL_foot", height=0.4)), r"flight\.landing\.height: .*not 0\.4 m up"),
        (
            lambda: replace(go2_problem(), goal=fp.Posture(-0.4 * np.pi * 2, go2_problem().goal.positions)),
            r"goal\.orientation: a jump ends as level as it begins",
        ),
    ],
)
def test_what_a_jump_does_not_keep_is_refused(problem, said):
    with pytest.raises(fp.InputError, match=said) as caught:
        fp.jump(problem())
    assert caught.value.advice


def test_a_frame_of_the_takeoff_has_to_stand():
    """The feet that stand where none are named, and not the frame of the flight, would take off."""
    feet = [["RL_foot", "FL_foot"], ["RL_foot"]]
    request = fp.JumpRequest(takeoff=fp.JumpTakeoff(feet), landing=fp.JumpLanding(feet[::-1]))
    with pytest.raises(fp.InputError, match=r"flight\.takeoff\.frame: 'FL_calf' is not among .*RL_foot, RR_foot"):
        fp.jump(flight(takeoff=fp.Takeoff("FL_calf")), request)
