"""``floatplan jump`` of a jump in space that cannot be: one line each, with the element and what would do; code 2."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

GOAL = 'angles = [360, 0, 0], axes = "xyz"'
ALL = '"FL_foot", "FR_foot", "RL_foot", "RR_foot"'
THREE = '"FL_foot", "FR_foot", "RL_foot"'


def contacts(side: str, *phases: str) -> tuple[str, str]:
    """An edit that names the feet of a side's phases, of text at the end of the file."""
    groups = ", ".join(f"[{phase}]" for phase in phases)
    return "[limits]", f"[jump.{side}]\ncontacts = [{groups}]\n[limits]"


def goal(text: str) -> tuple[str, str]:
    return GOAL, text


WRONG = {
    "a foot is left behind before takeoff": (
        contacts("takeoff", THREE),
        "jump.takeoff.contacts: 'RR_foot' is on the ground too; name all feet in the outer phase, or bend that leg",
    ),
    "a foot is left behind after landing": (
        contacts("landing", THREE),
        "jump.landing.contacts: 'RR_foot' is on the ground too; name all feet in the outer phase, or bend that leg",
    ),
    "a foot joins before takeoff": (
        contacts("takeoff", THREE, ALL),
        "jump.takeoff.contacts: 'RR_foot' would come to the ground before takeoff; name it in the first phase too",
    ),
    "a foot stands alone": (
        contacts("takeoff", ALL, '"FL_foot"'),
        "jump.takeoff.contacts: 'FL_foot' would stand on its own; name two feet at least in each phase",
    ),
    "a leg stands on two frames": (
        contacts("takeoff", f'{ALL}, "FL_calf"'),
        "jump.takeoff.contacts: 'FL_calf' stands twice: on the same leg as 'FL_foot'; name one foot of each leg",
    ),
    "a foot and its joint": (
        contacts("takeoff", f'{ALL}, "FL_foot_joint"'),
        "jump.takeoff.contacts: 'FL_foot_joint' stands twice: on the same leg as 'FL_foot'; name one foot of each leg",
    ),
    "a foot twice in the second phase": (
        contacts("takeoff", ALL, '"FL_foot", "FL_foot"'),
        "jump.takeoff.contacts[1]: 'FL_foot' stands twice; name each foot once",
    ),
    "a goal that is not level": (
        goal('angles = [180, 0, 0], axes = "xyz"'),
        "goal.orientation: a jump ends as level as it begins: it would be tilted by 180 degrees; ask for angles that"
        " leave it level, or plan the flight alone with floatplan plan",
    ),
    "a goal of many turns": (
        goal('angles = [7200, 0, 0], axes = "xyz"'),
        "goal.orientation: the base would turn by 7200 degrees, no jump turns by more than 1080; ask for"
        " fewer turns, or plan the flight alone with floatplan plan",
    ),
    "a goal whose way is left open": (
        goal("quaternion_xyzw = [1, 0, 0, 0]"),
        "goal.orientation: is half a turn from the start, and which way round is left open; give it as angles about"
        " axes, with the turns that are meant",
    ),
    "a flip whose middle angle turns": (
        goal('angles = [0, 360, 0], axes = "xyz"'),
        "goal.orientation: its second angle about 'xyz' is 360 degrees; it must be within -70 to 70: rotate about other"
        " axes, the largest rotation's first, or give the goal as a quaternion",
    ),
    "a middle angle just beyond": (
        goal('angles = [360, 76, 0], axes = "xyz"'),
        "goal.orientation: its second angle about 'xyz' is 76 degrees; it must be within -70 to 70",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_it_is_refused_with_what_would_do(floatplan: Callable[..., Any], root: Path, tmp_path: Path, name: str) -> None:
    (before, after), message = WRONG[name]
    text = (root / "problems" / "jumps" / "space" / "go2_roll.toml").read_text()
    assert before in text
    path = tmp_path / "wrong.toml"
    path.write_text(text.replace(before, after))
    run = floatplan("jump", path)
    assert run.code == 2, run.stdout
    lines = run.stderr.splitlines()
    assert len(lines) == 1, run.stderr
    assert lines[0].startswith("error: ")
    assert "wrong.toml" in lines[0]
    assert message in lines[0]
