"""Replay of whole jumps in MuJoCo with contact: how they land, what is perturbed, what is refused."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from jumps import backflip, planned_jump, try_few_gains

import floatplan as fp
from floatplan.errors import InputError
from floatplan.simulation.contact.model import ContactRobot
from floatplan.simulation.contact.tracked_motion import control_times
from floatplan.simulation.jump_replay import middle_of_the_widest
from floatplan.simulation.jump_run import JumpControl, _JumpGuide
from floatplan.view.figures import animation
from floatplan.view.report.flights import write_jump_pages

LATE = "noise=0.1deg,delay=4ms"
SOFT = 40.0, 1.0  # [N m/rad, N m s/rad] as others control a Go2


@pytest.fixture(scope="module")
def flown() -> fp.JumpReplay:
    return fp.replay_jump(backflip(), gains=(57.0, 0.98))


def test_it_lands_on_its_feet(flown: fp.JumpReplay) -> None:
    """Turned a little too far, since torques are held and feet roll that the plan takes for points."""
    ends = flown.landings
    assert flown.landed
    assert ends.clean.all()
    assert -0.12 < ends.pitch[0] < 0.02
    assert 0.5 < ends.torque[0] < 1
    assert 0 < ends.slid[0] < 0.1


def test_a_flight_that_lasts_longer_gets_no_torques_of_the_stance() -> None:
    control = JumpControl(backflip(), np.ones((2, 12)), 250.0)
    [(begin, end)] = control.flights
    late = SimpleNamespace(begin=begin, landing=end + 0.05, replanner=control.replanners[0], correct=lambda *_: None)
    of_stance = control.times >= end
    control.torques[of_stance] = np.nan
    control.motor_torques = np.where(of_stance[:, None], np.nan, control.motor_torques)
    tick = int(np.flatnonzero(of_stance)[10])
    on_ground = SimpleNamespace(presses=lambda: True)
    guide = _JumpGuide(control, True, on_ground, corrections=[late])
    target, torques = guide.target(tick, control.times[tick], SimpleNamespace(delay=0))
    assert np.isfinite(target).all()
    assert np.isfinite(torques).all()


def test_it_begins_with_velocities_that_it_is_given() -> None:
    """In a plane too, of base and joints."""
    control = JumpControl(backflip(), np.ones((2, 12)), None)
    sample = control.sampled(fp.Perturbation(), 0, 0)
    robot = ContactRobot(control.tracked, 0.6, sample)
    velocities = np.linspace(-1.0, 1.0, len(control.tracked.velocities[0]))
    robot.begin(control.tracked.base_ends[0], control.tracked.positions[0], velocities)
    np.testing.assert_allclose(robot.state()[1], velocities, atol=1e-12)


def test_a_motion_that_lasts_too_long_is_refused() -> None:
    with pytest.raises(InputError, match=r"lasts 199.5 s, more than the 199 s that are simulated"):
        control_times(199.5)


def test_soft_joints_do_not_turn_it_short_of_its_landing() -> None:
    """A Go2 that lands 5 degrees short falls over its front feet."""
    ends = fp.replay_jump(backflip(), gains=SOFT, perturb="delay=4ms", friction=0.85).landings
    assert ends.clean.all()
    assert -0.1 < ends.pitch[0] < 0.02


@pytest.mark.parametrize(
    "changed",
    [
        {"friction": 0.1},
        pytest.param({"gains": (0, 0), "perturb": "mass=20%"}, marks=pytest.mark.long),
        pytest.param({"perturb": "torque=60%"}, marks=pytest.mark.long),
        pytest.param({"gains": (1e6, 1e6)}, marks=pytest.mark.long),
    ],
)
def test_without_grip_strength_or_feedback_it_does_not_land(
    changed: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On ice it ends upright, though without a turn: that is no landing. MuJoCo, which warns, leaves no log."""
    monkeypatch.chdir(tmp_path)
    flown = fp.replay_jump(backflip(), **{"gains": (57.0, 0.98), **changed})
    assert not flown.landed
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_seeds_and_corrections(floatplan: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gains that are searched twice are the same too: for flights as planned, by the command, and for others."""
    try_few_gains(monkeypatch)
    jump = backflip()
    perturb = f"mass=5%,armature=0.004,{LATE}"
    run = floatplan("replay", jump.save(tmp_path / "jump.json"), "--json")
    facts = json.loads(run.stdout)
    assert (run.code, facts["landed"]) == (0, True)
    assert facts["control"]["tried"] == 2
    first = fp.replay_jump(jump, perturb=perturb, friction=0.8, seed=3)
    assert (facts["control"]["kp"], facts["control"]["kd"]) == (first.kp.tolist(), first.kd.tolist())
    gains = [dict(zip(first.joints, values.tolist(), strict=True)) for values in (first.kp, first.kd)]
    other = fp.replay_jump(jump, perturb=perturb, friction=0.8, seed=4, gains=tuple(gains))
    both = fp.replay_jump(jump, 250.0, perturb=perturb, friction=0.8, seed=3, gains=tuple(gains))
    assert both.uncorrected.pitch.tolist() == first.landings.pitch.tolist() != other.landings.pitch.tolist()
    assert both.corrected is not None
    assert abs(both.corrected.pitch[0]) < np.deg2rad(2)
    assert both.statuses["applied"] > 20


@pytest.mark.long
@pytest.mark.parametrize(("name", "gains"), [("a1", (48.0, 0.816)), ("go1", (56.1, 0.9537))])
def test_other_quadrupeds_land_straight(name: str, gains: tuple[float, float]) -> None:
    """Also where rotors that the plan does not know make them land early."""
    found = planned_jump(name)
    perturb = f"mass=5%,friction=17.647%,armature=0.01,{LATE}"
    both = fp.replay_jump(found, 250.0, perturb=perturb, friction=0.85, flights=4, gains=gains, budget=None)
    assert both.corrected is not None
    assert both.uncorrected.clean.all()
    assert both.corrected.clean.all()
    assert both.corrected.pitch_rms < np.deg2rad(1)
    assert both.corrected.torque.max() < 1
    assert np.median(both.corrected.slid) < 1.2 * np.median(both.uncorrected.slid)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"perturb": "h=3%"}, "perturb: h"),
        ({"perturb": "rise=3%"}, "perturb: rise"),
        ({"perturb": "friction=200%"}, "friction"),
        ({"gains": (-1.0, 1.0)}, "kp"),
        ({"gains": (1.0, {"nose": 1.0})}, "nose"),
        ({"friction": -1.0}, "friction"),
        ({"replan": 1e4}, "replan"),
        ({"flights": 0}, "flights"),
    ],
)
def test_refused(given: dict[str, Any], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        fp.replay_jump(backflip(), **given)


@pytest.mark.long
def test_pages_and_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of flights that land, and of one that falls with joints beyond their ranges."""
    monkeypatch.setattr(animation, "FILM", replace(animation.FILM, rate=5.0))
    good, bad = {"flights": 2, "gains": (57.0, 0.98)}, {"perturb": "noise=1rad", "gains": (1e3, 1e3)}
    for name, options, files in (("good", good, 3), ("bad", bad, 2)):
        flown = fp.replay_jump(backflip(), **options)
        found = write_jump_pages(flown, tmp_path / name)
        assert [path.stat().st_size > 20_000 for path in found] == [True] * files
        page = found[0].read_text()
        assert f"{'stands' if name == 'good' else 'falls'} in MuJoCo with contact" in page
        assert "on its feet alone" in page


@pytest.mark.parametrize(
    ("landed", "tilts", "middle"),
    [
        ([4, 8, 8, 8, 5, 8, 8], [1, 1, 1, 1, 1, 0, 0], 0.9),  # the most multiples
        ([8, 8, 4, 4, 8, 8, 4], [2, 2, 9, 9, 1, 1, 9], 0.65),  # of as many those that tilt least
        ([0, 0, 0, 0, 0, 3, 0], [8, 8, 8, 8, 8, 5, 8], 0.6),
    ],
)
def test_gains_are_in_the_middle_of_those_with_which_most_robots_land(
    landed: list[int], tilts: list[int], middle: float
) -> None:
    assert middle_of_the_widest(np.array([landed, np.negative(tilts)]).T) == pytest.approx(middle)


def test_a_file_that_contradicts_itself_is_not_flown(
    floatplan: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor handed on to a robot: replay and export say why."""
    path = backflip().save(tmp_path / "jump.json")
    content = json.loads(path.read_text())
    stance = content["stances"][1]
    stance["a"] = (1.3 * np.array(stance["a"])).tolist()
    path.write_text(json.dumps(content))
    spoiled = fp.load_jump(path)
    monkeypatch.setattr(fp, "load_jump", lambda *_: spoiled)  # it is read, and checked, once
    for words, action in ((("replay",), "fly"), (("export", "-f", "csv"), "export")):
        run = floatplan(words[0], path, *words[1:])
        assert (run.code, run.stdout, len(run.stderr.splitlines())) == (2, "", 1)
        assert f"jump.json: stances: a jump that does not hold is none to {action}: forces are out" in run.stderr


def test_command(
    flown: fp.JumpReplay, floatplan: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The flight itself is flown from the command line by ``test_seeds_and_corrections``, and by pages of docs/."""
    path = backflip().save(tmp_path / "jump.json")
    asked: list[dict[str, Any]] = []
    with monkeypatch.context() as patched:
        patched.setattr(fp, "replay_jump", lambda _, **options: asked.append(options) or flown)
        run = floatplan("replay", path, "--json", "--kp", "57", "--kd", "0.98")
    facts = json.loads(run.stdout)
    assert (run.code, facts["landed"], facts["control"]["rate"]) == (0, True, 500.0)
    assert [each["gains"] for each in asked] == [(57.0, 0.98)]
    with monkeypatch.context() as patched:
        patched.setattr("floatplan.cli.common.read_motion", lambda *_: backflip())  # as it was read above
        for words, reason in (
            (["--engine", "pinocchio"], "--engine: knows no ground"),
            (["--authority"], "--authority: is for plans"),
            (["--step", "0.001"], "--step: is for plans"),
            (["--save"], "--save: is for plans"),
            (["--feedback", "80", "--kp", "40"], "feedback: gives the gains of all joints"),
            (["--feedback", "0"], "feedback: 0.0 rad/s is not positive"),
            (["--perturb", "wind=3"], "cannot perturb 'wind'"),
            (["--kp", "x=3"], "--kp"),
        ):
            run = floatplan("replay", path, *words)
            assert (run.code, len(run.stderr.splitlines())) == (2, 1)
            assert reason in run.stderr
    content = json.loads(path.read_text())
    content["stances"][0]["y"][0][3] = None
    path.write_text(json.dumps(content))
    run = floatplan("replay", path)
    assert run.code == 2
    assert "stances[0].y: must be a number or an array of numbers" in run.stderr
    plan = backflip().flight
    assert plan is not None
    run = floatplan("replay", plan.save(tmp_path / "plan.json"), "--friction", "1")
    assert run.code == 2
    assert "--friction: is for jumps" in run.stderr
