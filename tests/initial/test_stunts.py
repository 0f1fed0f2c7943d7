"""``floatplan init --stunt``: a problem file of a jump in space, which is that of problems/jumps/space."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jumps import GO2
from long_cases import cases

import floatplan as fp
from floatplan.errors import InputError
from floatplan.initial.stunts import STUNTS, stunt_file_text
from floatplan.initial.text import rotors_comment
from floatplan.jumps.spatial.setup import spatial_setup

A1 = "example-robot-data:a1_description/urdf/a1.urdf"
Command = Callable[..., Any]


WRITTEN = [
    (GO2, "roll", "go2_roll"),
    (A1, "side", "a1_side"),
    (GO2, "half-twist", "go2_half_flip_half_twist"),
    (A1, "turn", "a1_quarter_turn"),
    (A1, "half-turn", "a1_half_turn"),
    (GO2, "diagonal", "go2_diagonal"),
]


@pytest.mark.parametrize("written_as", cases(WRITTEN, WRITTEN[2:]), ids=lambda case: case[-1])
def test_the_file_is_that_of_the_example(root: Path, tmp_path: Path, written_as: tuple[str, str, str]) -> None:
    """The same goal, contacts and limits; the posture to within some degrees, the displacement to a tenth."""
    source, stunt, file = written_as
    path = tmp_path / "jump.toml"
    path.write_text(stunt_file_text(source, stunt, {}, path))
    written = fp.load_problem(path)
    example = fp.load_problem(root / "problems" / "jumps" / "space" / f"{file}.toml")
    assert written.jump is not None
    assert example.jump is not None
    assert written.goal.orientation.axes == example.goal.orientation.axes
    assert written.goal.orientation.angles == pytest.approx(example.goal.orientation.angles)
    np.testing.assert_allclose(written.start.positions, example.start.positions, atol=np.deg2rad(5))
    np.testing.assert_array_equal(written.motor_torque_limits, example.motor_torque_limits)
    assert written.jump.margin == example.jump.margin
    assert written.jump.friction == example.jump.friction
    assert written.flight.duration == example.flight.duration
    wanted = example.jump.landing.displacement
    assert written.jump.landing.displacement == (None if wanted is None else pytest.approx(wanted, rel=0.1))
    setups = [spatial_setup(problem, problem.jump) for problem in (written, example)]
    assert [phase.frames for phase in setups[0].phases] == [phase.frames for phase in setups[1].phases]


@pytest.mark.long
def test_soles_are_named_by_their_frames(tmp_path: Path) -> None:
    """A humanoid's roll: off its right sole, onto its left one."""
    source = "example-robot-data:g1_description/urdf/g1_29dof_rev_1_0.urdf"
    text = stunt_file_text(source, "roll", {}, tmp_path / "jump.toml")
    comment = " ".join(line.removeprefix("#").strip() for line in text.splitlines() if line.startswith("#"))
    left, right = "left_ankle_roll_link", "right_ankle_roll_link"
    assert f"here first {left} and {right}, then {right}, then none, then {left}, then {left} and {right}." in comment


@pytest.mark.parametrize(
    ("stunt", "leaves", "lands"),
    [
        ("backflip", {"RL_foot", "RR_foot"}, {"FL_foot", "FR_foot"}),
        ("roll-left", {"FL_foot", "RL_foot"}, {"FR_foot", "RR_foot"}),
    ],
)
def test_it_leaves_from_the_feet_over_which_it_turns(
    tmp_path: Path, stunt: str, leaves: set[str], lands: set[str]
) -> None:
    path = tmp_path / "jump.toml"
    path.write_text(stunt_file_text(GO2, stunt, {}, path))
    problem = fp.load_problem(path)
    assert problem.jump is not None
    phases = spatial_setup(problem, problem.jump).phases
    assert set(phases[1].frames) == leaves
    assert set(phases[3].frames) == lands


def test_every_other_stunt_is_written(tmp_path: Path) -> None:
    written = {"roll", "side", "backflip", "roll-left"}  # which those above read too
    for name in STUNTS.keys() - written:
        path = tmp_path / f"{name}.toml"
        path.write_text(stunt_file_text(A1, name, {}, path))
        assert fp.load_problem(path).jump is not None


def test_where_no_rotors_are_known_it_says_how_to_state_them(root: Path, tmp_path: Path) -> None:
    """The line that it writes becomes the key when its sentence is a number; with rotors there is none."""
    path = tmp_path / "jump.toml"
    text = stunt_file_text(GO2, "side", {}, path)
    comment = next(line for line in text.splitlines() if line.startswith("# armature: "))
    path.write_text(text.replace(comment, "armature = 0.002  # kg m^2"))
    with_rotors = fp.load_problem(path).robot
    assert set(with_rotors.armature.values()) == {0.002}
    talos = fp.load_problem(root / "problems" / "jumps" / "space" / "talos_side.toml").robot
    assert rotors_comment(with_rotors) == rotors_comment(talos) == []


def test_the_command(floatplan: Command) -> None:
    run = floatplan("init", GO2, "--stunt", "roll", "-o", "roll.toml")
    assert run.code == 0, run
    assert "next: floatplan jump roll.toml" in run.stderr
    assert Path("roll.toml").read_text().startswith("# go2_description stands, rolls once about its long axis")
    assert floatplan("init", GO2, "--stunt", "roll", "-o", "roll.toml").code == 2  # it is there
    for options, words in (
        (("--stunt", "cartwheel"), "there is no stunt 'cartwheel'"),
        (("--stunt", "roll", "--turns", "2"), "--turns: says what jumps in a plane do"),
        (("--stunt", "roll", "--coupled", "mirror"), "--coupled: is for jumps in a plane"),
    ):
        run = floatplan("init", GO2, *options, "-o", "other.toml")
        assert run.code == 2
        assert words in run.stderr
        assert not Path("other.toml").exists()


def test_robots_without_such_feet_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no foot was recognised"):
        stunt_file_text("example-robot-data:ur_description/urdf/ur5_robot.urdf", "roll", {}, tmp_path / "jump.toml")
