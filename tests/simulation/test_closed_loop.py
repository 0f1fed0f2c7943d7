"""Perturbed robots in forward dynamics, with corrections and without; the commands; how much can be corrected."""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flown_plans import Drifting

import floatplan as fp
from floatplan.inflight import authority as authority_module
from floatplan.simulation import closed_loop

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
PERTURBED = "h=10%,inertia=5%,noise=0.11deg,rate_noise=1.15deg/s,delay=5ms"


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    """Controllers at 500 Hz: what they do between is half of the work, and changes little."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(closed_loop, "PERIOD", 2e-3)
        yield


@pytest.fixture(scope="module")
def plan() -> fp.Plan:
    return fp.plan(fp.load_problem(PROBLEMS / "somersault.toml"))


@pytest.fixture(scope="module")
def flown(plan: fp.Plan) -> fp.ClosedLoop:
    return fp.closed_loop(plan, perturb=PERTURBED, flights=2, seed=5)


def test_corrected_flights_land(flown: fp.ClosedLoop) -> None:
    assert np.abs(flown.corrected.orientation).max() < math.radians(0.5)
    assert np.abs(flown.uncorrected.orientation).min() > math.radians(5)
    assert flown.corrected.joints.max() < math.radians(0.5)
    assert (flown.corrected.torque_peak.max(axis=1) < 3 * flown.plan_torque_peak.max()).all()
    assert set(flown.statuses) == {"applied"}
    for path in flown.paths:
        assert np.abs(np.diff(path.orientation)).max() < 0.2


def test_the_same_seed_the_same_flights(plan: fp.Plan, flown: fp.ClosedLoop) -> None:
    again = fp.closed_loop(plan, perturb=PERTURBED, flights=1, seed=5)
    assert again.corrected.orientation[0] == flown.corrected.orientation[0]
    assert again.uncorrected.orientation[0] == flown.uncorrected.orientation[0]
    np.testing.assert_array_equal(again.corrected.torque_peak[0], flown.corrected.torque_peak[0])
    assert flown.corrected.orientation[1] != flown.corrected.orientation[0]


def test_a_higher_jump_lands_later(plan: fp.Plan) -> None:
    result = fp.closed_loop(plan, perturb="h=5%,rise=4%", flights=1, seed=1)
    assert result.paths[0].times[-1] != pytest.approx(plan.duration, abs=0.01)
    assert np.abs(result.corrected.orientation).max() < math.radians(0.3)


def test_between_whole_periods_corrections_are_as_many_as_replanners_make(plan: fp.Plan) -> None:
    """At 500 Hz every third period of 200 Hz; after every second one a replanner only learns."""
    result = fp.closed_loop(plan, 200.0, perturb="h=5%", flights=1, seed=1)
    times = result.paths[0].corrections[:, 0]
    np.testing.assert_allclose(np.diff(times), 6e-3)
    assert len(times) == sum(result.statuses.values()) == len(result.update_seconds)


def test_mujoco_lands_too(plan: fp.Plan) -> None:
    result = fp.closed_loop(plan, perturb=PERTURBED, flights=1, seed=5, engine="mujoco")
    assert np.abs(result.corrected.orientation).max() < math.radians(0.5)


def test_commands(
    plan: fp.Plan, flown: fp.ClosedLoop, floatplan: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(authority_module, "LARGEST", 0.01)
    monkeypatch.setattr(authority_module, "SHARES", (0.0,))
    hostile = replace(plan, problem=replace(plan.problem, name="<script>alert(1)</script>"))
    path = hostile.save("plan.json")
    options = ("--flights", 1, "--seed", 3, "--perturb", PERTURBED)
    run = floatplan("replay", path.absolute(), "--replan", 100, *options, "--authority", "--json", "-o", "out")
    assert run.code == 0
    facts = json.loads(run.stdout)
    assert {"replan", "flights", "seed", "corrected", "uncorrected", "statuses", "authority"} <= set(facts)
    assert facts["corrected"]["orientation_error_worst"] < facts["uncorrected"]["orientation_error_worst"]
    page = Path("out/flights.html").read_text(encoding="utf-8")
    assert page.count("data:image/png") == 1
    assert "<script" not in page
    with monkeypatch.context() as patch:
        patch.setattr(fp, "closed_loop", lambda *_, **__: flown)
        run = floatplan("replay", path.absolute(), "--replan", 100, *options)
    assert run.code == 0
    assert "with corrections" in run.stdout
    for wrong in (
        ("--replan", 0),
        ("--output", "out"),
        ("--authority", "--output", "out"),
        ("--replan", 100, "--save"),
        ("--replan", 100, "--budget", 0),
        ("--replan", 100, "--perturb", "x"),
    ):
        assert floatplan("replay", path.absolute(), *wrong, "--flights", 1).code == 2


@pytest.fixture(scope="module")
def found(plan: fp.Plan) -> fp.Authority:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(authority_module, "LARGEST", 0.1)
        patch.setattr(authority_module, "SHARES", (0.6,))
        return fp.authority(plan)


@pytest.mark.parametrize(("factor", "reached"), [(0.9, True), (1.5, False)])
def test_authority_says_what_flies(plan: fp.Plan, found: fp.Authority, factor: float, reached: bool) -> None:
    begin, (_, most) = float(found.times[0]), found.momentum[0]
    replanner = fp.Replanner(plan, 200)
    robot = Drifting(plan, plan.angular_momentum * (1 + factor * most))
    robot.fly(replanner, begin, 400)
    for following in np.linspace(begin, plan.duration, 90)[1:].tolist():
        replanner.update(*robot.state(replanner))
        robot.fly(replanner, following)
    assert (abs(robot.orientation - plan.problem.final.orientation) < 1.5 * found.reached) == reached
