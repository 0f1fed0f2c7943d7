"""Problems with inequalities that are followed in one call have the answers that each has alone, bit for bit."""

from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from long_cases import cases

import floatplan as fp
from floatplan.planning import many
from floatplan.planning.kernel_input.numbers import is_batchable_family
from floatplan.plans.plans import COUNTS, NUMBERS

BAR = fp.Bar(start=(1.2, 4.2), end=(1.9, 4.6), radius=0.1, margin=0.01)
WALL = fp.HalfPlane(point=(0.0, -1.0), normal=(0.1, 1.0), velocity=(0.1, 0.0))


@pytest.fixture(scope="module")
def weak(root):
    return fp.load_problem(root / "problems" / "studies" / "weak_motors_problem.toml")


def assert_as_alone(problems, monkeypatch):
    together = fp.plan_many(problems, attempts=3)
    with monkeypatch.context() as patched:
        patched.setattr(many, "is_batchable_family", lambda family: False)
        patched.setattr(many, "is_batchable", lambda problem: problem.is_plain)
        alone = fp.plan_many(problems, attempts=3)
    assert together.status.tolist() == alone.status.tolist()
    assert together.messages == alone.messages
    for name in (*NUMBERS, *COUNTS, "coefficients"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name), err_msg=name)
    return together


VARIED = {
    "durations and limits": {"flight.duration": (1.2, 1.65), "limits.torque.q1": (2.5, 9.0)},
    "one limit of all": {"limits.torque": (3.0, 9.0), "flight.gravity": (9.0, 10.0)},
    "obstacles": {
        "obstacles.0.center.0": (-0.4, 3.6),
        "obstacles.0.radius": (0.1, 0.3),
        "obstacles.0.margin": (0, 0.1),
    },
    "a bar and a wall": {"obstacles.1.start.1": (3.4, 4.6), "obstacles.2.point.1": (-3.0, -0.6)},
    "ends": {"start.positions.q1": (0.2, 0.6), "goal.velocities.q2": (0.0, 0.8), "goal.orientation": (-1.8, -1.4)},
    "the path": {"flight.takeoff.position.1": (0.0, 0.5), "flight.horizontal_velocity": (1.5, 2.5)},
    "the landing": {"flight.landing.height": (0.0, 0.4), "flight.angular_momentum": (-2.0, -0.5)},
}


@pytest.mark.parametrize("kind", cases(VARIED, {"one limit of all", "the path"}))
def test_a_family(kind, weak, monkeypatch):
    base = replace(weak, obstacles=(*weak.obstacles, BAR, WALL)) if "wall" in kind else weak
    rng = np.random.default_rng(3)
    family = fp.Family(base, {path: rng.uniform(*ends, 8) for path, ends in VARIED[kind].items()})
    assert is_batchable_family(family)
    assert assert_as_alone(family, monkeypatch).ok.any()
    resolved = [each.name for each in fields(base) if not each.init]
    for problem in family:  # of a family it is resolved again only what depends on the parts that differ
        for name in resolved:
            np.testing.assert_equal(*(_plain(getattr(each, name)) for each in (problem, replace(problem))), name)


def _plain(value):
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return vars(value) if is_dataclass(value) else value


@pytest.mark.parametrize("degree", [5, (5, 8), (9, 6), "auto"])
def test_degrees(degree, weak, monkeypatch):
    base = replace(weak, motion=fp.Motion(degree=degree))
    assert_as_alone(fp.Family(base, {"flight.duration": [1.35, 1.4, 1.45]}), monkeypatch)


@pytest.mark.parametrize(
    "path", ["obstacles.0.window.1", "limits.position.q1.1", "limits.motor.q1.stall", "limits.velocity.q1"]
)
def test_what_is_not_told_together_goes_alone(path, weak):
    """Windows, ranges, motors' curves, and limits that the base does not have."""
    obstacle = replace(weak.obstacles[0], window=(0.0, 1.0))
    limits = replace(weak.limits, motor={"q1": fp.Motor(9.0, 0.1)})
    base = replace(weak, obstacles=(obstacle,)) if "window" in path else replace(weak, limits=limits)
    family = fp.Family(base, {path: [1.3, 1.31]})
    assert not is_batchable_family(family)
    plans = fp.plan_many(family, attempts=2)
    assert [plan.status for plan in plans if plan.ok] == [s for s in plans.status if s in ("optimal", "feasible")]
