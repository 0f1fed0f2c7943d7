"""One record of the keys of problem files: checks, tables, options and plan files follow it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import pytest

import floatplan as fp
from floatplan.cli.common import OPTIONS
from floatplan.keys import ANGLE, Key, Keyed, Reader, read_tables
from floatplan.plans.record import SHARED, problem_table
from floatplan.problem import parts
from floatplan.problem.file import TABLES


@dataclass(frozen=True, kw_only=True)
class Wing(Keyed):
    """A part that no problem has."""

    span: Annotated[float, Key("From tip to tip", "m", "radius")]
    sweep: Annotated[float | Literal["none"], Key("Backwards", ANGLE, "orientation")] = "none"
    tip: Annotated[parts.Takeoff | None, Key("What is at its end")] = None


def test_a_field_with_its_key_is_checked():
    with pytest.raises(fp.InputError, match=r"span: -1\.0 m is negative"):
        Wing(span=-1.0)
    with pytest.raises(fp.InputError, match="sweep: must be a number or 'none', not 'much'"):
        Wing(span=1.0, sweep="much")
    with pytest.raises(fp.InputError, match="tip: 3 is not a Takeoff"):
        Wing(span=1.0, tip=3)


def test_a_field_with_its_key_is_read_from_a_file():
    content = {"span": 2, "sweep": 90.0, "tip": {"frame": "foot", "position": [1.0, 2.0]}}
    wing = Reader(degrees=True).part(Wing, content)
    assert wing.faults() == []
    assert wing == Wing(span=2.0, sweep=math.pi / 2, tip=parts.Takeoff("foot", (1.0, 2.0)))
    for damage, reason in (
        ({"span": "x"}, "span: 'x' is not a number"),
        ({"spam": 1.0}, "spam: unknown key; did you mean 'span'"),
        ({"sweep": []}, r"sweep: must be a number or 'none', not \[\]"),
        ({"tip": {}}, "tip.frame: is missing"),
    ):
        with pytest.raises(fp.InputError, match=reason):
            read_tables(Wing, {**content, **damage})


def test_options_stand_for_keys():
    for option in OPTIONS.values():
        place, _, name = (key := option.key).rpartition(".")
        assert key in TABLES if not place else name in TABLES[place][0].keys


def test_plan_files_hold_the_keys_of_problem_files():
    """They are written a second time there: what proves a plan does not know what asked for it."""
    tables = problem_table(("q1",), ("q1",)).keys
    assert {"velocities_asked", "accelerations_asked"} == tables["start"].optional.keys()
    for name, part in (("start", fp.Posture), ("goal", fp.Posture), ("flight", fp.Flight), ("motion", fp.Motion)):
        optional = tables[name].optional.keys() - {"velocities_asked", "accelerations_asked"}
        assert tables[name].keys.keys() | optional == part.keys.keys()
    for name, part in (("takeoff", fp.Takeoff), ("landing", fp.Landing)):
        assert tables["flight"].keys[name].keys.keys() == part.keys.keys()
    limits = tables["limits"]
    assert {*limits.keys, *limits.optional} == {*fp.Limits.keys, "motor_torque"}
    assert limits.optional["motor"].optional["q1"].keys.keys() == fp.Motor.keys.keys()
    assert SHARED.keys() == parts.Obstacle.keys.keys()
