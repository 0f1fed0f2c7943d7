"""Corrections of the rest of a flight, compiled and in NumPy: one law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from needed import skip_or_fail
from plain_problems import plain_problems

import floatplan as fp
from floatplan.inflight.law import SETTLED, SHORTER, Law
from floatplan.inflight.motion import Rewriting
from floatplan.inflight.outlook import Outlook, Present, Views
from floatplan.kernel import library
from floatplan.kernel.rest import Rest, RestSolver, Weights

SIGMA = 0.003


def rest_solver(plan: fp.Plan, views: Views) -> RestSolver:
    found = library.kernel()
    assert found is not None
    return RestSolver(found, plan.robot.tree, plan.centre, plan.amplitude, views.whitening, views.grid.nodes)


def rest_of(outlook: Outlook) -> Rest:
    motion, present = outlook.motion, outlook.present
    return Rest(
        motion.remaining, present.angular_momentum, outlook.change, motion.coefficients, *present.dynamics.masses
    )


@pytest.fixture(scope="module")
def plans() -> list[fp.Plan]:
    """Chains and trees, mirrored planes, coupled joints: the next plan found of every seventh problem."""
    if library.kernel() is None:
        skip_or_fail("the kernel is not compiled: python -m floatplan.kernel.build")
    found = [fp.plan(problem) for problem in plain_problems(96)[8::7]]
    return [plan for plan in found if plan.ok]


def perturbed(plan: fp.Plan, rng: np.random.Generator) -> tuple[Views, Outlook]:
    """A view of the rest of a flight without limits, with another momentum, orientation and masses than planned."""
    rewriting = Rewriting(plan)
    views = Views(plan, rewriting.form)
    views.rows = ()
    now = float(rng.uniform(0.0, 0.8)) * plan.duration
    motion = rewriting.from_now(rewriting.first, now, plan.duration)
    coupling, inertia = views.flight.equations.masses
    scale = rng.uniform(0.95, 1.05, len(inertia))
    dynamics = views.flight.equations.adapted(scale[:, None] * coupling * scale, inertia * scale)
    positions, velocities, _ = plan.joint_motion(np.linspace(0.0, now, 200))
    turned = np.trapezoid(dynamics.base_rate(positions, velocities, plan.angular_momentum), dx=now / 199)
    present = Present(
        now,
        plan.problem.initial.orientation + float(turned) + float(rng.normal(0.0, 0.02)),
        plan.angular_momentum * float(rng.uniform(0.97, 1.03)),
        plan.ballistics,
        dynamics,
    )
    return views, Outlook(views, motion, present)


def test_the_miss_and_the_correction_are_those_of_numpy(plans: list[fp.Plan]) -> None:
    rng = np.random.default_rng(3)
    compared = 0
    for plan in plans:
        views, present = perturbed(plan, rng)
        compiled = rest_solver(plan, views)
        scale = float(rng.uniform(5.0, 50.0))
        stiffness = 1 / (scale * present.motion.remaining**2) ** 2
        here = Weights(SIGMA, stiffness, SETTLED, SHORTER, 0)
        y, miss = compiled.corrected(rest_of(present), here)
        assert not y.any()
        assert miss == pytest.approx(present.miss, rel=1e-9, abs=1e-11)
        outlook, expected = Law(SIGMA, scale, ())._solved(present, 12)
        y, miss = compiled.corrected(rest_of(present), replace(here, evaluations=12))
        np.testing.assert_allclose(y, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())
        assert miss == pytest.approx(outlook.miss, rel=1e-6, abs=1e-10)
        compared += bool(expected.any())
    assert compared >= len(plans) // 2


def test_limits_are_kept_as_without_the_kernel(plans: list[fp.Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    """Far from limits it is used; near them NumPy's law answers: the same corrections either way."""
    plan = plans[-1]
    answers = []
    for way in ("on", "off"):
        monkeypatch.setenv(library.SWITCH, way)
        replanner = fp.Replanner(plan)
        found = []
        for share in (0.0, 0.2, 0.4, 0.6, 0.8):
            time = share * plan.duration
            state = plan.at(time)
            correction = replanner.update(
                time, state.orientation + 0.02, 1.02 * state.orientation_rate, state.positions, state.velocities
            )
            found.append((correction.status, correction.predicted_miss, *correction.torque_peak.tolist()))
        answers.append(found)
    for one, other in zip(*answers, strict=True):
        assert one[0] == other[0]
        assert one[1:] == pytest.approx(other[1:], rel=1e-5, abs=1e-9)
