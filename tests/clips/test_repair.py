"""Clips repaired: their flights fly, near to the clip, and what was right is left alone."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import clip_samples as samples
import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

import floatplan as fp
from floatplan.cli.commands import app
from floatplan.clips.stance_forces import stance_figures
from floatplan.clips.writing import write_clip


def clip_of(sample: samples.Sample, robot: fp.Robot, folder: Path) -> fp.Clip:
    path = samples.write_csv(sample, folder / "clip.csv", digits=9)
    return fp.load_clip(path, model=robot, fps=sample.fps, quaternion="xyzw")


@pytest.mark.parametrize("gravity", [5.0, 8.5, 14.0])
def test_a_flight_that_falls_wrongly_is_retimed(gravity: float, robot: fp.Robot, tmp_path: Path) -> None:
    clip = clip_of(samples.hops(60, (0.5,), gravity=gravity), robot, tmp_path)
    repaired, told = fp.repair_clip(clip, "retime")
    assert told.ok
    (each,) = told.flights
    assert each.repaired is not None
    expected = clip.flights[0].duration * math.sqrt(gravity / 9.81)
    assert each.repaired.duration == pytest.approx(expected, rel=0.02)
    assert each.repaired.joints_rms < math.radians(0.5)
    (judged,) = fp.check_clip(repaired).flights
    assert judged.verdict == "physical"
    assert judged.fall.fall == pytest.approx(9.81, abs=1e-9)
    assert each.seam_base < 1e-6
    assert each.seam_turn < 1e-6
    assert each.seam_foot < 1e-4


def test_a_flight_that_hardly_rises_is_raised(robot: fp.Robot, tmp_path: Path) -> None:
    # legs are bent in the air, while the base moves up by 6 mm and aside by 6 cm and back
    hop = samples.hops(60, (0.4,), gravity=0.3)
    s = np.clip((np.arange(hop.frames) / hop.fps - samples.REST) / 0.4, 0.0, 1.0)
    bump = np.sin(np.pi * s)[:, None] ** 2
    aside = replace(
        hop,
        places=hop.places + bump * np.array([0.0, 0.06, 0.0]),
        joints=hop.joints + bump * np.array([0.4, -0.8, -0.4, 0.8]),
    )
    clip = clip_of(aside, robot, tmp_path)
    assert [judged.verdict for judged in fp.check_clip(clip).flights] == ["unphysical"]
    same, told = fp.repair_clip(clip, "retime")
    assert same is clip
    (retimed,) = told.flights
    assert retimed.repaired is not None
    assert "too short for a flight" in retimed.repaired.reason
    repaired, told = fp.repair_clip(clip)
    (raised,) = told.flights
    assert raised.repaired is not None
    assert raised.repaired.choice == "raise"
    assert [judged.verdict for judged in fp.check_clip(repaired).flights] == ["physical"]


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_a_share_between_both(share: float, robot: fp.Robot, tmp_path: Path) -> None:
    clip = clip_of(samples.hops(60, (0.5,), gravity=6.0), robot, tmp_path)
    _, told = fp.repair_clip(clip, share)
    (each,) = told.flights
    assert each.repaired is not None
    (retimed,) = fp.repair_clip(clip, "retime")[1].flights
    assert retimed.repaired is not None
    expected = share * clip.flights[0].duration + (1 - share) * retimed.repaired.duration
    assert each.repaired.duration == pytest.approx(expected, rel=1e-9)
    for wrong in (-0.1, 1.5):
        with pytest.raises(fp.InputError, match="choice"):
            fp.repair_clip(clip, wrong)


def test_the_same_motion_at_another_rate(robot: fp.Robot, tmp_path: Path) -> None:
    clip = clip_of(samples.hops(60, (0.5,), gravity=6.0), robot, tmp_path)
    coarse, _ = fp.repair_clip(clip)
    fine, told = fp.repair_clip(clip, rate=240.0)
    assert told.ok
    assert fine.fps == 240.0
    shared = fine.configurations[::4][: coarse.frames]
    np.testing.assert_allclose(shared, coarse.configurations[: len(shared)], atol=1e-9)
    assert [each.verdict for each in fp.check_clip(fine).flights] == ["physical"]
    true = clip_of(samples.hops(60, (0.5,)), robot, tmp_path)
    faster, nothing = fp.repair_clip(true, rate=120.0)
    assert not nothing.changed
    np.testing.assert_allclose(faster.configurations[::2], true.configurations, atol=1e-9)
    with pytest.raises(fp.InputError, match="rate"):
        fp.repair_clip(true, rate=0.0)


@pytest.mark.parametrize("beyond", [-0.03, 0.0, 0.04])
def test_where_a_stance_presses(beyond: float, robot: fp.Robot, tmp_path: Path) -> None:
    sample = samples.hops(100, (0.4,), posture=np.array([0.7, -1.0, -0.3, 1.0]))
    clip = clip_of(sample, robot, tmp_path)
    clip = fp.load_clip(clip.path, model=robot, fps=100.0, quaternion="xyzw", ground=0.0)
    times = np.arange(9) / 100.0
    q = np.tile(clip.configurations[0], (len(times), 1))
    data = robot.model.createData()
    com = pin.centerOfMass(robot.model, data, q[0])
    feet = clip.curve.poses(times[:1])
    places = [feet.points(solid.body, solid.points)[0] for solids in clip.scene.foot_solids.groups for solid in solids]
    standing = np.concatenate(places)
    still = stance_figures(clip, q, times, 0.01, 9.81)
    assert still.vertical_least == pytest.approx(1.0)
    assert still.friction == pytest.approx(0.0, abs=1e-9)
    lowest = standing[standing[:, 2] < standing[:, 2].min() + 0.01]
    outside = max(lowest[:, 0].min() - com[0], com[0] - lowest[:, 0].max(), 0.0)
    assert still.pressure_outside == pytest.approx(outside, rel=0.02, abs=1e-6)
    # pushed along the ground it presses as far behind as the force has its lever
    q[:, 0] += 0.5 * (beyond * 9.81 / com[2]) * times**2
    moved = stance_figures(clip, q, times, 0.01, 9.81)
    assert moved.friction == pytest.approx(abs(beyond) / com[2], rel=1e-6, abs=1e-9)
    behind = com[0] - beyond
    expected = max(lowest[:, 0].min() - behind, behind - lowest[:, 0].max(), 0.0)
    assert moved.pressure_outside == pytest.approx(expected, rel=0.05, abs=2e-3)


def test_contacts_are_written_where_there_is_room(robot: fp.Robot, tmp_path: Path) -> None:
    data = samples.amp_data(samples.hops(60, (0.5,), gravity=6.5))
    del data["contacts"], data["contact_names"]
    np.savez(tmp_path / "clip.npz", **data)
    repaired, told = fp.repair_clip(fp.load_clip(tmp_path / "clip.npz", model=robot))
    assert told.changed
    written = fp.load_clip(write_clip(repaired, tmp_path / "out.npz"), model=robot)
    assert written.contacts is not None
    assert set(written.contact_names) == {"l_shank", "r_shank"}
    assert [each.verdict for each in fp.check_clip(written).flights] == ["physical"]
    assert written.contacts[0].all()
    assert not written.contacts[written.frames // 2].any()


def test_a_page_plays_both(model: Path, tmp_path: Path, floatplan: Callable[..., Any]) -> None:
    path = samples.write_csv(samples.hops(50, (0.5, 0.4), gravity=7.0), tmp_path / "slow<b>.csv")
    run = floatplan("clip", "repair", path, "--model", model, "--fps", 50, "--report", "-q")
    assert run.code == 0
    page = Path("runs/slow<b>_repaired/report.html").read_text()
    assert "slow<b>" not in page
    data = json.loads(page.split('id="data">')[1].split("</script>")[0])
    first, second = (each["motion"] for each in data["pair"])
    assert second["duration"] < first["duration"]
    assert len(first["columns"]["com_z"]) > 50 * first["duration"]
    assert "7.00 ±" in page
    assert "9.81 ±" in page


def test_momentum_is_constant_in_a_repaired_flight(robot: fp.Robot, tmp_path: Path) -> None:
    sample = samples.hops(60, (0.5,), gravity=7.0, tilt=math.radians(8))
    repaired, told = fp.repair_clip(clip_of(sample, robot, tmp_path))
    (flight,) = repaired.flights
    assert told.ok
    assert repaired.velocities is not None
    inside = slice(flight.first + 1, flight.last)
    data = robot.model.createData()
    momenta = []
    for q, v in zip(repaired.configurations[inside], repaired.velocities[inside], strict=True):
        pin.ccrba(robot.model, data, q, v)
        momenta.append(data.hg.angular.copy())
    spread = np.ptp(np.array(momenta), axis=0).max()
    assert spread < 1e-6 * max(float(np.abs(momenta).max()), 1e-3)


def test_true_flights_are_left_alone(robot: fp.Robot, tmp_path: Path) -> None:
    clip = clip_of(samples.hops(60, (0.4, 0.5)), robot, tmp_path)
    same, told = fp.repair_clip(clip)
    assert same is clip
    assert not told.changed
    assert told.ok


def test_a_repaired_clip_needs_no_repair(robot: fp.Robot, tmp_path: Path) -> None:
    clip = clip_of(samples.hops(60, (0.4, 0.5, 0.4), gravity=7.0, steps=(0.2, -0.1, -0.1)), robot, tmp_path)
    repaired, told = fp.repair_clip(clip)
    assert told.ok
    assert [each.repaired is not None for each in told.flights] == [True] * 3
    again, nothing = fp.repair_clip(repaired)
    assert again is repaired
    assert not nothing.changed


def test_an_unphysical_flight_that_was_left_is_no_success(model: Path, tmp_path: Path) -> None:
    path = samples.write_csv(samples.hops(60, (0.5, 0.4), gravity=7.0), tmp_path / "clip.csv", digits=9)
    robot = fp.Robot.from_urdf(model, base="free-flyer")
    clip = fp.load_clip(path, model=robot, fps=60.0, quaternion="xyzw")
    repaired, told = fp.repair_clip(clip, flights=[1])
    assert [judged.verdict for judged in told.after.flights] == ["unphysical", "physical"]
    assert told.after.clip is repaired
    assert not told.ok
    words = ["clip", "repair", str(path), "--model", str(model), "--fps", "60", "--flights", "1"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 1
    assert "of the result is unphysical: the centre of mass falls at 7" in " ".join(done.stdout.split())


def test_every_format_is_written_back(robot: fp.Robot, model: Path, tmp_path: Path) -> None:
    sample = samples.hops(50, (0.5,), gravity=6.5)
    for name, path in samples.write_all(sample, tmp_path).items():
        out = tmp_path / f"repaired_{name}{path.suffix}"
        words = ["clip", "repair", str(path), "--model", str(model), "-o", str(out), "--json"]
        done = CliRunner().invoke(app, [*words, "--fps", "50"])
        assert done.exit_code == 0, done.output
        facts = json.loads(done.stdout)
        assert facts["repairs"][0]["changed"] is True
        clip = fp.load_clip(out, model=robot, fps=50)
        assert clip.layout.format == name
        assert [each.verdict for each in fp.check_clip(clip).flights] == ["physical"], name


def test_a_flight_can_be_planned_as_a_problem(model: Path, tmp_path: Path) -> None:
    path = samples.write_csv(samples.hops(60, (0.5,), gravity=6.5), tmp_path / "clip.csv")
    words = ["clip", "repair", str(path), "--model", str(model), "--fps", "60", "--problem", "0"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    plan = fp.plan(tmp_path / "clip_flight0.toml")
    assert plan.ok
    assert plan.objective_value < math.radians(0.5)
    saved = plan.save(tmp_path / "plan.json")
    assert fp.load_plan(saved).objective_value == pytest.approx(plan.objective_value, rel=1e-12)


def test_what_cannot_be_repaired_says_why(robot: fp.Robot, tmp_path: Path) -> None:
    sample = samples.hops(60, (0.8,), gravity=2.0, tilt=math.radians(80))
    clip = clip_of(sample, robot, tmp_path)
    same, told = fp.repair_clip(clip, "raise")
    (each,) = told.flights
    assert each.repaired is not None
    if not each.repaired.repairable:
        assert same is clip
        assert each.repaired.reason
        assert not told.ok
