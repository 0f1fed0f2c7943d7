"""A Go2's backflip from end to end: found, proved in flight, checked in stance, the same after saving."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin
import pytest
from jumps import INSTALLED, backflip, go2_problem
from needed import skip_or_fail
from once import made_once

import floatplan as fp
from floatplan.errors import InputError
from floatplan.jumps.jump import Jump, load_jump
from floatplan.jumps.motion import Grid
from floatplan.jumps.planner import MARGINS, guess_near, jump
from floatplan.jumps.setup import jump_setup

if not INSTALLED:
    skip_or_fail("CasADi or example-robot-data is not installed")


def tampered(found: Jump, index: int, **changes: np.ndarray) -> Jump:
    stances = list(found.stances)
    stances[index] = replace(stances[index], grid=replace(stances[index].grid, **changes))
    split = len(found.before)
    return replace(found, before=tuple(stances[:split]), after=tuple(stances[split:]))


def test_it_is_found_and_checked() -> None:
    found = backflip()
    assert found.ok
    assert [phase.kind for phase in found.phases] == ["stance", "stance", "flight", "stance", "stance"]
    assert set(found.phases[1].contacts) == {"RL_foot", "RR_foot"}
    figures = found.check.figures
    assert figures["residual"] < 1e-3
    assert figures["drift"] < 1e-6
    assert max(figures["takeoff_seam"], figures["landing_seam"]) < 1e-6
    assert figures["torque"] <= 0.85
    changes = np.array([phase.end for phase in found.phases[:-1]])
    torques = found.tau(changes[:, None] + [-0.002, 0.002])[..., 6:]
    motors = np.abs(np.diff(torques, axis=1)).max(axis=(0, 1))
    limits = dict(zip(found.problem.robot.motors, found.problem.motor_torque_limits, strict=True))
    joints = [*found.problem.robot.model.names][4:]
    shares = [motors[joints.index(name)] / limit for name, limit in limits.items()]
    assert figures["torque_step"] == pytest.approx(max(shares), rel=1e-6)
    assert "within 4 ms" in " ".join(found.check.sentences)


def test_the_flight_is_proved() -> None:
    assert backflip().flight is not None
    assert fp.certify(backflip().flight).proved


def test_it_stands_at_both_ends() -> None:
    found = backflip()
    ends = found.at([0.0, found.duration])
    assert np.abs(ends.velocities).max() < 1e-9
    assert np.abs(ends.accelerations).max() < 1e-6
    np.testing.assert_allclose(ends.positions[:, 2], [0.0, -2 * np.pi], atol=1e-9)


@pytest.mark.parametrize("feet", ["points", "auto"])
def test_pinocchio_s_free_flyer_of_the_file_balances(feet: Literal["points", "auto"]) -> None:
    """In the file's own model, with gravity and six coordinates of the base: nothing of floatplan is in it.

    Forces act at the frames of feet that are points, and below those of feet that roll, by their radius.
    """
    points = fp.JumpRequest(feet="points")
    found = backflip() if feet == "auto" else made_once("points", lambda: jump(go2_problem(), points, starts=1))
    model = pin.buildModelFromXML(found.problem.robot.xml, pin.JointModelFreeFlyer())
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    data, weight = model.createData(), found.problem.robot.mass * 9.81
    stances = (*found.before, *found.after)
    radius = {name: each.radius for stance in stances for each in stance.contacts for name in each.names}
    assert {value > 0 for value in radius.values()} == {feet == "auto"}
    for t in np.linspace(0.0, found.duration, 41):
        q, v, a, tau = found.q(t), found.v(t), found.a(t), found.tau(t)
        wrench = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for name, force in found.forces(t).items():
            jacobian = pin.getFrameJacobian(model, data, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED)
            moment = np.cross([0.0, 0.0, -radius[name]], force)
            wrench = wrench - jacobian.T @ np.concatenate((force, moment))
        assert np.abs(wrench[6:] - tau[6:]).max() < 1e-6 * weight
        assert np.abs(wrench[[0, 2, 4]]).max() < 1e-3 * weight


def test_it_is_the_same_after_saving(tmp_path: Path) -> None:
    found = backflip()
    again = load_jump(found.save(tmp_path / "jump.json"))
    times = np.linspace(0.0, found.duration, 17)
    np.testing.assert_array_equal(again.q(times), found.q(times))
    np.testing.assert_array_equal(again.tau(times), found.tau(times))
    assert again.request == found.request
    assert again.check.figures == found.check.figures


@pytest.mark.parametrize("key", ["stances", "problem", "flight"])
def test_a_damaged_file_is_refused(tmp_path: Path, key: str) -> None:
    path = backflip().save(tmp_path / "jump.json")
    content = json.loads(path.read_text())
    content[key] = [{"side": "takeoff"}]
    path.write_text(json.dumps(content))
    with pytest.raises(InputError):
        load_jump(path)


@pytest.mark.parametrize(
    ("change", "figure"),
    [
        (lambda grid: {"y": grid.y + 1e-3 * np.eye(5)[:, [2]] * (grid.times > grid.times[8])}, "derivative"),
        (lambda grid: {"times": grid.times[0] + 0.9 * (grid.times - grid.times[0])}, "derivative"),
        (lambda grid: {"a": 1.3 * grid.a}, "derivative"),
    ],
)
def test_the_check_sees_what_was_tampered_with(change, figure: str) -> None:
    found = backflip()
    check = tampered(found, 1, **change(found.stances[1].grid)).check
    assert not check.ok
    assert check.figures[figure] > 10 * found.check.figures[figure]


def test_the_check_sees_forces_out_of_balance() -> None:
    """The anchor alone cannot hold a robot that stands still, leaning."""
    found = backflip()
    grid = found.stances[1].grid
    still = Grid(grid.times, np.repeat(grid.y[:, :1], len(grid.times), axis=1), 0 * grid.y, 0 * grid.y, grid.ratios)
    check = tampered(found, 1, **{name: getattr(still, name) for name in ("y", "v", "a")}).check
    assert check.figures["residual"] > 0.01
    assert not check.ok


def test_without_gravity_nothing_stands() -> None:
    problem = go2_problem()
    with pytest.raises(InputError, match="gravity"):
        jump(replace(problem, flight=replace(problem.flight, gravity=0.0)))


@pytest.mark.long
def test_feet_stay_above_the_ground_where_capsules_around_them_begin_below_it(root: Path) -> None:
    """A sole's are 10 mm thicker than it, while the legs that swing back may only just clear the ground."""
    found = jump(root / "problems" / "jumps" / "talos_hop.toml", starts=1)
    assert found.ok
    assert found.flight is not None
    assert fp.certify(found.flight).proved
    assert found.check.figures["feet"] > -1e-3
    below, ground = found.flight.problem.obstacles
    assert ground.point[1] - below.point[1] > 0.01
    assert (below.window, ground.window[0] > 0, ground.window[1] < found.flight.duration) == (None, True, True)


@pytest.mark.long
def test_what_cannot_be_is_not_found_and_says_why() -> None:
    """With a tenth of its torque the robot does not even lift itself."""
    problem = go2_problem()
    weak = replace(problem, limits=fp.Limits(velocity="urdf", torque=2.0))
    found = jump(weak, starts=1)
    assert (found.ok, found.status) == (False, "not_found")
    assert "In the way: torque of" in found.explanation


def test_a_jump_at_hand_is_a_guess_that_nearly_holds() -> None:
    """Of programs with its phases, which last as long as they may there; of another it is none."""
    found = backflip()
    lasted = [phase.end - phase.begin for phase in found.phases]
    asked = fp.JumpRequest(takeoff=fp.JumpTakeoff(durations=[[0.9 * lasts] * 2 for lasts in lasted[:2]]))
    for request, off in ((fp.JumpRequest(), 0.5), (asked, 1.0)):
        program = jump_setup(found.problem, request).program(MARGINS)
        guess = guess_near(program, found)
        assert guess is not None
        lasts = np.array([0.9, 0.9, 1.0, 1.0, 1.0] if request is asked else [1.0] * 5) * lasted
        assert program.motion(guess)[-1].ravel() == pytest.approx(lasts)
        _, evaluate, rows, _ = program.compiled
        low, high = np.concatenate(rows.low), np.concatenate(rows.high)
        plain, near = (
            np.maximum(np.maximum(low - values, values - high), 0).max()
            for values in (np.asarray(evaluate(each)).ravel() for each in (program.guess(), guess))
        )
        assert near < off < plain
    other = fp.JumpRequest(landing=fp.JumpLanding([["FL_foot", "RL_foot"]]))
    assert guess_near(jump_setup(found.problem, other).program(MARGINS), found) is None
    assert guess_near(program, Jump(found.problem, found.request)) is None
    with pytest.raises(InputError, match="near"):
        jump(found.problem, near=found.flight)  # type: ignore[arg-type]


@pytest.mark.long
def test_from_a_jump_at_hand_another_is_found_that_holds_as_well() -> None:
    """Whatever changed, without a start; and where none is, the same is said as without."""
    found, said = backflip(), list[str]()
    lasted = [phase.end - phase.begin for phase in found.phases]
    durations = [[lasted[0] + 0.004] * 2, [lasted[1] - 0.004] * 2]
    for request in (
        fp.JumpRequest(takeoff=fp.JumpTakeoff(durations=durations)),
        fp.JumpRequest(friction=found.request.friction + 0.1, margin={"torque": 0.82}),
        fp.JumpRequest(objective="limits"),
    ):
        again = jump(found.problem, request, near=found, progress=said.append)
        assert again.ok
        assert again.check.ok
    programs = {words for words in said if words.startswith("program ")}
    assert "program 1 of 3 at most: flight, stances, check" in programs
    assert set(said) - programs == {"from the jump at hand"}
    icy = jump(found.problem, fp.JumpRequest(friction=0.12), starts=1, helps=False, near=found)
    assert icy.explanation == "No jump was found in 1 start."


@pytest.mark.long
def test_the_largest_share_of_the_limits_is_less_where_that_is_asked() -> None:
    """Than where squared torques are least; and what is said of it is what the check measured."""
    problem = go2_problem()
    spared = jump(problem, fp.JumpRequest(objective="limits"), starts=2)
    assert spared.ok
    shares = [max(each.check.figures[name] for name in ("torque", "velocity")) for each in (spared, backflip())]
    assert shares[0] < shares[1] - 0.05
    figures, margin = spared.check.figures, spared.request.margin
    share = max(figures[name] / margin.get(name, 1.0) for name in ("torque", "velocity", "held_torque"))
    told = re.search(r"Of what the margins leave the jump takes (\d+)%", spared.explanation)
    assert told is not None
    assert int(told[1]) / 100 >= share - 0.005, "it is the share of the whole jump, of which stances are a part"


@pytest.mark.long
def test_limits_of_generalised_torques_are_held() -> None:
    """Given as a list they are of the planned joints, left and right together."""
    limits = [30.0, 70.0, 30.0, 70.0]
    found = jump(replace(go2_problem(), limits=fp.Limits(velocity="urdf", torque=limits)), starts=1)
    assert found.ok
    state = found.at(np.linspace(0.0, found.duration, 2001))
    shares = np.abs(state.torques @ found.problem.robot.selection).max(axis=0) / limits
    assert 0.7 < shares.max() <= 0.85
