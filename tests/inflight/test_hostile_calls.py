"""Whatever is measured, and whenever: no exception, a motion that goes on, and the way back to good measurements."""

from __future__ import annotations

import math
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flown_plans import Drifting, forward_plan

import floatplan as fp
from floatplan.inflight.measurement import Measurement, Recovery
from floatplan.robot.urdf.tree import robots_folder

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
NAMES = ("t", "orientation", "orientation_rate", "positions", "velocities", "now", "com_position", "com_velocity")


class Raising:
    """What fails when it is read."""

    def __float__(self) -> float:
        raise RuntimeError

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        raise RuntimeError


def spoilt(good: Any, rng: np.random.Generator) -> Any:
    """Another value in the place of a good one: wrong, odd, or only a little off."""
    strange = [math.nan, math.inf, -math.inf, 1e308, -1e308, 1e-308, 10**400, None, "x", "", b"1", [], {}, (), True]
    strange += [1j, [1j, 2j], np.ma.masked, Decimal("sNaN"), Raising(), [[1.0, 2.0]], np.array([["a"]]), object()]
    kind = rng.integers(4)
    if kind == 0:
        return strange[rng.integers(len(strange))]
    if kind == 1 and good is not None:
        return np.asarray(good, dtype=float) + rng.standard_normal() * 10.0 ** rng.uniform(-6, 6)
    if kind == 2:
        return 10.0 ** rng.uniform(-300, 300) * rng.choice([-1.0, 1.0], 2)
    return good


def noisy(state: tuple[Any, ...], rng: np.random.Generator, angles: float = 0.002) -> tuple[Any, ...]:
    """A measurement with noise of its angles, rad, and ten times that, in 1/s, of its rates."""
    t, angle, rate, positions, velocities = state
    of_angles, of_rates = angles * rng.standard_normal(3), 10 * angles * rng.standard_normal(3)
    return t, angle + of_angles[0], rate + of_rates[0], positions + of_angles[1:], velocities + of_rates[1:]


@pytest.mark.filterwarnings("ignore::numpy.exceptions.ComplexWarning")
def test_hostile_calls(plan: fp.Plan, replanner: fp.Replanner) -> None:
    """All through a flight; from single instants of every family below."""
    rng = np.random.default_rng(0)
    robot = Drifting(plan, 1.05 * plan.angular_momentum)
    path = plan.ballistics
    taken = 0
    for following in (plan.duration * np.arange(1, 91) / 90).tolist():
        now = np.array([robot.time])
        good = dict(
            zip(
                NAMES,
                (
                    *robot.state(replanner),
                    robot.time,
                    *(values[0] for values in (path.positions(now), path.velocities(now))),
                ),
                strict=True,
            )
        )
        for _ in range(4):
            bad = {name: spoilt(value, rng) if rng.random() < 0.3 else value for name, value in good.items()}
            before, landing = replanner.motion, replanner.landing
            correction = replanner.update(**bad)
            assert correction.status in ("applied", "limited", "refused", "invalid")
            if correction.status == "invalid":
                assert replanner.motion is before
                assert replanner.landing == landing
            reference = replanner.reference(robot.time)
            assert np.isfinite(reference.feedforward).all()
            assert math.isfinite(correction.predicted_miss)
        taken += replanner.update(**good).status != "invalid"
        robot.fly(replanner, following, 2)
    assert taken > 0


@pytest.mark.parametrize(("when", "kick"), [(0.3, 0.3), (0.6, 0.15), (0.3, 0.05), (0.2, -0.12)])
def test_a_kick_is_made_up_for(plan: fp.Plan, replanner: fp.Replanner, when: float, kick: float) -> None:
    robot = Drifting(plan, plan.angular_momentum)
    rng = np.random.default_rng(0)
    kicked = False
    for following in (plan.duration * np.arange(1, 221) / 220).tolist():
        if robot.time >= when and not kicked:
            robot.momentum, kicked = robot.momentum * (1 + kick), True
        replanner.update(*noisy(robot.state(replanner), rng))
        robot.fly(replanner, following, 3)
    assert abs(robot.orientation - plan.problem.final.orientation) < math.radians(0.2)


def jumped(plan: fp.Plan, replanner: fp.Replanner, offset: float, frozen: bool = False) -> list[str]:
    """Statuses of measurements whose orientation is off from 0.2 s on, or whose values stand still."""
    robot = Drifting(plan, plan.angular_momentum)
    statuses: list[str] = []
    held: tuple[Any, ...] = ()
    for following in (plan.duration * np.arange(1, 101) / 220).tolist():
        t, angle, *rest = robot.state(replanner)
        if robot.time >= 0.2:
            held = held or (angle + offset, *rest)
            measured = held if frozen else (angle + offset, *rest)
            statuses.append(replanner.update(t, *measured).status)
        else:
            replanner.update(t, angle, *rest)
        robot.fly(replanner, following, 3)
    return statuses


def test_consistent_measurements_are_believed_again(plan: fp.Plan, replanner: fp.Replanner) -> None:
    statuses = jumped(plan, replanner, 1.0)
    assert set(statuses[:4]) == {"invalid"}
    assert "invalid" not in statuses[4:]


def test_a_dead_sensor_is_never_believed(plan: fp.Plan, replanner: fp.Replanner) -> None:
    assert set(jumped(plan, replanner, -1.0, frozen=True)) == {"invalid"}


@pytest.mark.parametrize("turns", [-2, -1, 1])
def test_whole_turns_do_not_matter(plan: fp.Plan, replanner: fp.Replanner, turns: int) -> None:
    robot = Drifting(plan, 1.1 * plan.angular_momentum)
    for following in (plan.duration * np.arange(1, 51) / 100).tolist():
        t, angle, *rest = robot.state(replanner)
        correction = replanner.update(t, angle + 2 * math.pi * turns, *rest)
        assert correction.status == "applied"
        robot.fly(replanner, following, 3)
    alone = Drifting(plan, 1.1 * plan.angular_momentum)
    alone.time, alone.orientation = robot.time, robot.orientation
    alone.fly(replanner, plan.duration, 400)
    assert alone.orientation - plan.problem.final.orientation == pytest.approx(correction.predicted_miss, abs=1e-3)


@pytest.mark.parametrize("size", [-0.5, -0.2, 0.2, 0.5])
def test_an_orientation_far_from_what_the_filter_knows_is_an_outlier(
    plan: fp.Plan, replanner: fp.Replanner, size: float
) -> None:
    """One of ten: each is refused, and no other; the flight lands as without them."""
    robot, rng = Drifting(plan, 1.1 * plan.angular_momentum), np.random.default_rng(2)
    for number, following in enumerate((plan.duration * np.arange(1, 201) / 200).tolist()):
        t, angle, *others = noisy(robot.state(replanner), rng)
        outlier = number % 10 == 4
        correction = replanner.update(t, angle + outlier * size, *others)
        assert (correction.status == "invalid") == outlier
        robot.fly(replanner, following, 3)
    assert abs(robot.orientation - plan.problem.final.orientation) < math.radians(0.3)


@pytest.mark.parametrize("degrees", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("error", [-0.15, 0.15])
def test_honest_measurements_are_not_refused(
    plan: fp.Plan, replanner: fp.Replanner, degrees: float, error: float
) -> None:
    """Noise, another momentum, late measurements: at most one in two hundred is invalid."""
    robot, rng = Drifting(plan, (1 + error) * plan.angular_momentum), np.random.default_rng(7)
    statuses = []
    waiting: tuple[Any, ...] = ()
    for following in (plan.duration * np.arange(1, 221) / 220).tolist():
        if waiting:
            statuses.append(replanner.update(*waiting, now=robot.time).status)
        waiting = noisy(robot.state(replanner), rng, math.radians(degrees))
        robot.fly(replanner, following, 5)
    assert statuses.count("invalid") <= len(statuses) / 200


SPOILT: dict[str, tuple[Any, str]] = {
    "swapped": (lambda values: values[::-1], "another order"),
    "degrees": (np.degrees, "degrees"),
}


@pytest.mark.parametrize("name", ["somersault", "obstacle", "handstand_ground"])
@pytest.mark.parametrize("case", SPOILT)
def test_joints_in_another_order_or_unit_are_noticed(name: str, case: str) -> None:
    """As soon as they differ by more than 0.1 rad from the right ones, and never believed again."""
    plan = forward_plan(fp.load_problem(PROBLEMS / f"{name}.toml"), size=0.1)
    spoil, reason = SPOILT[case]
    replanner, robot = fp.Replanner(plan), Drifting(plan, 1.05 * plan.angular_momentum)
    rng, noticed, expected = np.random.default_rng(4), 0, 0
    for following in (0.3 * plan.duration * np.arange(1, 61) / 60).tolist():
        t, angle, rate, positions, velocities = robot.state(replanner)
        wrong = spoil(positions)
        correction = replanner.update(
            t, angle, rate, wrong + 0.002 * rng.standard_normal(wrong.shape), spoil(velocities)
        )
        expected += bool(np.abs(wrong - positions).max() > 0.12)
        if correction.status == "invalid":
            assert reason in correction.reason
            noticed += 1
        robot.fly(replanner, following, 3)
    assert noticed >= expected > 5


def test_noise_does_not_make_the_masses_drift(plan: fp.Plan, replanner: fp.Replanner) -> None:
    robot = Drifting(plan, plan.angular_momentum)
    rng = np.random.default_rng(1)
    for following in (plan.duration * np.arange(1, 221) / 220).tolist():
        correction = replanner.update(*noisy(robot.state(replanner), rng))
        robot.fly(replanner, following, 1)
    assert correction.angular_momentum == pytest.approx(plan.angular_momentum, rel=0.02)


def test_memory_does_not_grow(plan: fp.Plan, replanner: fp.Replanner) -> None:
    import tracemalloc

    robot = Drifting(plan, 1.1 * plan.angular_momentum)
    sizes = []
    tracemalloc.start()
    for following in (plan.duration * np.arange(1, 130) / 130).tolist():
        replanner.update(*robot.state(replanner))
        robot.fly(replanner, following, 1)
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert max(sizes[105:]) < 1.1 * max(sizes[70:90])


FAMILIES = ["somersault", "obstacle", "torque_limited", "somersault_motors", "handstand_ground", "moving_hoop"]
FAMILIES += ["gallery/go2", "gallery/g1"]  # coupled joints, locked ones


@pytest.mark.filterwarnings("ignore::numpy.exceptions.ComplexWarning")
@pytest.mark.parametrize("name", FAMILIES)
def test_hostile_calls_of_every_family(name: str) -> None:
    """From any instant: none raises, an invalid one changes nothing, and good ones after them are taken in."""
    if name.startswith("gallery") and robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    plan = forward_plan(fp.load_problem(PROBLEMS / f"{name}.toml"), size=0.1)
    replanner, rng, path = fp.Replanner(plan), np.random.default_rng(9), plan.ballistics
    low, high = plan.problem.position_limits.T
    for begin in (0.0, 0.6):
        replanner.reset()
        robot = Drifting(plan, 1.03 * plan.angular_momentum)
        if begin:
            robot.fly(replanner, begin * plan.duration, 60)
        taken = 0
        for following in (plan.duration * (begin + (1 - begin) * np.arange(1, 7) / 8)).tolist():
            now = np.array([robot.time])
            com = path.positions(now)[0], path.velocities(now)[0]
            good = dict(zip(NAMES, (*robot.state(replanner), robot.time, *com), strict=True))
            hostile = [{key: spoilt(value, rng) if rng.random() < 0.3 else value for key, value in good.items()}]
            hostile += [{**good, "t": 0.9 * robot.time - 1e-6}, {**good, "orientation": math.nan}]
            hostile += [{**good, "positions": good["positions"][:-1]}, {**good, "velocities": good["velocities"] + 1e3}]
            for bad in hostile:
                before = replanner.motion
                correction = replanner.update(**bad)
                assert correction.status != "invalid" or replanner.motion is before
                taken += correction.status != "invalid"
                assert math.isfinite(correction.predicted_miss)
                assert np.isfinite(replanner.reference(robot.time).feedforward).all()
            assert all(replanner.update(**bad).status == "invalid" for bad in hostile[1:])
            taken += replanner.update(**good).status != "invalid"
            assert replanner.update(**good).status == "invalid", "repeated"
            positions = replanner.motion.at(np.linspace(robot.time, replanner.landing, 20))[0]
            assert (positions >= low - 1e-9).all()
            assert (positions <= high + 1e-9).all()
            robot.fly(replanner, following, 2)
        assert taken >= 3


def lagging(time: float, rng: np.random.Generator) -> Measurement:
    """A joint that is dragged 1.5 rad from its reference and back within 0.2 s; measured with a noise of 0.1 degree."""
    w = 10 * np.pi
    angles = np.array([0.0, 0.75 * (1 - np.cos(w * time))]) + math.radians(0.1) * rng.standard_normal(2)
    rates = np.array([0.0, 0.75 * w * np.sin(w * time)]) + math.radians(1.0) * rng.standard_normal(2)
    return Measurement(time, angles[0], rates[0], angles[1:], rates[1:])


def test_a_joint_that_lags_behind_is_believed_and_outliers_are_not() -> None:
    recovery, rng = Recovery(), np.random.default_rng(5)
    recovery.believe(lagging(0.0, rng))
    for number in range(1, 50):
        measured = lagging(0.004 * number, rng)
        outlier = number % 7 == 3
        measured.positions = measured.positions + 0.3 * outlier
        assert recovery.again(measured) != outlier
