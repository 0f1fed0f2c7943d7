"""The motion nearest to a clip within limits of torques: the quick search finds the one that the usual one does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import clip_samples as samples
import numpy as np
import pytest

import floatplan as fp
from floatplan.clips.repaired_flight import flight_problem, repaired_duration

FPS = 60.0
SHARE = 0.7  # [-] of what the nearest motion takes without limits


@pytest.fixture
def problem(robot: fp.Robot, tmp_path: Path) -> fp.Problem:
    """Of a hop in which the legs bend and stretch again, within less torque than that takes."""
    still = samples.hops(FPS, (0.5,), gravity=7.0)
    s = np.clip((np.arange(still.frames) / FPS - samples.REST) / 0.5, 0.0, 1.0)
    bent = still.joints + 0.5 * np.sin(np.pi * s)[:, None] ** 2 * np.array([-1.0, 1.0, -0.6, 0.8])
    path = samples.write_csv(replace(still, joints=bent), tmp_path / "clip.csv", digits=9)
    clip = fp.load_clip(path, model=robot, fps=FPS, quaternion="xyzw")
    judged = fp.check_clip(clip).flights[0]
    of_flight = flight_problem(clip, judged.flight, repaired_duration(clip, judged, "retime"))
    plan = fp.plan(of_flight)
    torques = np.abs(plan.full_motion(np.linspace(0.0, plan.duration, 200)).torques).max(axis=0)
    limits = dict(zip(robot.motors, (SHARE * torques).tolist(), strict=True))
    return replace(of_flight, limits=replace(of_flight.limits, torque=limits))


def test_it_is_the_motion_that_the_usual_search_finds(problem: fp.Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    quick = fp.plan(problem)
    assert quick.ok
    torques = quick.full_motion(np.linspace(0.0, quick.duration, 1001)).torques
    limits = np.array(list(dict(problem.limits.torque).values()))
    share = np.abs(torques) / limits
    assert share.max() == pytest.approx(1.0, abs=1e-4)
    monkeypatch.setattr("floatplan.planning.kernel_problem.near_recorded", lambda exchange: exchange)
    usual = fp.plan(problem)
    assert usual.ok
    assert quick.objective_value == pytest.approx(usual.objective_value, rel=1e-3)
    assert quick.solver["iterations"] < usual.solver["iterations"]
