"""Replay of flights in space: MuJoCo on a free joint agrees with Pinocchio and with the plan; many are a table."""

import json
from pathlib import Path

import numpy as np
import pytest

import floatplan as fp
from floatplan.inflight import authority as authority_module
from floatplan.simulation import closed_loop, replay
from floatplan.simulation.replay import landing_rows, replays


@pytest.fixture(scope="module", autouse=True)
def coarse():
    """Controllers at 500 Hz: what they do between is half of the work, and changes little."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(closed_loop, "PERIOD", 2e-3)
        yield


@pytest.fixture(scope="module")
def diver(planned):
    return planned("space/diver_half_twist")


def test_mujoco_agrees_with_the_plan(diver):
    """The diver's shoulders have a link without mass between their joints."""
    flown = fp.replay(diver, engine="mujoco")
    assert flown.landed
    assert max(flown.orientation_error, *flown.position_error) < 1e-8
    assert flown.com_error < 1e-10
    assert flown.momentum_drift < 1e-8
    assert flown.balanced == {}
    assert flown.step is None
    assert flown.spatial is None


@pytest.mark.long
@pytest.mark.parametrize("perturb", ["h=2%,torque=1%", "mass=3%", "inertia=5%"])
def test_both_engines_fly_the_same_perturbed_robot(diver, perturb):
    engines = [fp.replay(diver, engine=engine, perturb=perturb, seed=3) for engine in ("pinocchio", "mujoco")]
    errors = [[each.orientation_error, *each.position_error, each.com_error] for each in engines]
    np.testing.assert_allclose(*errors, atol=1e-5)
    assert engines[0].orientation_error > 1e-3
    assert not engines[1].landed


def test_many_flights_are_a_table(diver, floatplan, monkeypatch):
    """Each has the next seed; none begins after the time given."""
    first, second = replays(diver, 2, 4, budget=60.0, perturb="h=1%")
    assert second.orientation_error == fp.replay(diver, perturb="h=1%", seed=5).orientation_error
    flown = {4: first, 5: second}
    monkeypatch.setattr(replay, "replay", lambda *_, seed, **__: flown[seed])  # the commands fly none again
    assert (
        landing_rows([first, second])[0][2]
        == f"{np.degrees(max(first.orientation_error, second.orientation_error)):.3g} deg"
    )
    asked = ("replay", diver.save("plan.json"), "--perturb", "h=1%", "--seed", "4", "--runs", "2", "--budget", "1e-9")
    told = floatplan(*asked)
    assert told.code == 0
    assert "0 of 1 landed, of 2 asked for" in told.stdout
    assert landing_rows([first])[0][1] in told.stdout
    content = json.loads(floatplan(*asked, "--json").stdout)
    assert content["asked"] == 2
    assert [each["orientation_error"] for each in content["flights"]] == [first.orientation_error]
    refused = floatplan(*asked, "--save")
    assert refused.code == 2
    assert "--save" in refused.stderr


def test_corrected_flights(diver, floatplan, monkeypatch):
    """By forward dynamics: within half a degree, where without corrections they miss by many."""
    monkeypatch.setattr(authority_module, "LARGEST", 0.01)
    monkeypatch.setattr(authority_module, "SHARES", (0.0,))
    found = fp.authority(diver)
    monkeypatch.setattr(fp, "authority", lambda _: found)
    path = diver.save("plan.json")
    options = ("--flights", 1, "--perturb", "h=2%,noise=0.05deg,delay=5ms", "--seed", 2)
    run = floatplan("replay", path, "--replan", 100, *options, "--authority", "--json", "-o", "out")
    assert run.code == 0
    facts = json.loads(run.stdout)
    assert facts["corrected"]["orientation_error_worst"] < np.radians(0.5)
    assert facts["uncorrected"]["orientation_error_worst"] > np.radians(5)
    assert np.array(facts["authority"]["momentum"]).shape == (1, 3, 2)
    assert Path("out/flights.html").read_text(encoding="utf-8").count("data:image/png") == 1
    told = floatplan("replay", path, "--authority")
    assert told.code == 0
    assert "momentum y" in " ".join(told.stdout.split())


def test_a_go2_lands_with_another_momentum(planned):
    plan = planned("space/go2_barrel_roll")
    flown = fp.closed_loop(plan, perturb="h=10%", flights=1, seed=1)
    assert flown.perturbation.h == 0.1
    assert (flown.corrected.orientation < np.radians(0.5)).all()
    assert (flown.uncorrected.orientation > np.radians(20)).all()
    assert (flown.corrected.torque_peak < flown.effort).all()
    assert flown.corrected.joints.max() < np.radians(0.5)


@pytest.mark.long
def test_mujoco_flies_the_same_corrected_robot(diver):
    flown = [
        fp.closed_loop(diver, perturb="h=2%", flights=1, seed=1, engine=engine) for engine in ("pinocchio", "mujoco")
    ]
    assert all(each.corrected.orientation[0] < np.radians(0.5) for each in flown)
    np.testing.assert_allclose(*(each.uncorrected.orientation for each in flown), atol=1e-3)
