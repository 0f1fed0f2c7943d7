"""The bench: disturbed robots follow jumps and recorded motions."""

from __future__ import annotations

import inspect
import json
from dataclasses import replace
from pathlib import Path

import clip_samples
import numpy as np
import pytest
from clip_landings import swung
from drawn_hops import draw_hops
from jumps import GO2, backflip
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import floatplan as fp
from floatplan.cli import clips
from floatplan.cli.commands import app
from floatplan.errors import InputError
from floatplan.simulation.contact.tracked_motion import PERIOD, tracked_jump
from floatplan.simulation.motion_run import MotionControl
from floatplan.simulation.perturbation import given_perturbation
from floatplan.tracking.tracked_clip import tracked_clip


def recorded(folder: Path, rate: float) -> fp.Clip:
    """The Go2's backflip as a recorded motion of so many frames a second."""
    path = backflip().export("mjlab-npz", folder / "flip.npz", rate)
    return fp.load_clip(path, model=GO2)


def test_a_jump_lands() -> None:
    result = fp.bench(backflip(), flights=1)
    assert result.landed == result.clean == 1
    assert result.ok
    facts = result.to_dict()
    assert facts["landed"] == 1
    assert facts["perturbation"]["delay"] == 4e-3
    assert facts["control"]["torques"] == "of the jump"
    assert 0 < facts["pitch_rms"] < np.deg2rad(10)


def test_a_robot_that_is_too_soft_does_not() -> None:
    result = fp.bench(backflip(), flights=1, gains=(1.0, 0.0))
    assert result.landed == 0
    assert not result.ok


def test_a_recorded_jump_takes_the_torques_of_the_jump(tmp_path: Path) -> None:
    """They are by inverse dynamics of frames; next to where contacts change they are smoothed."""
    of_clip = tracked_clip(recorded(tmp_path, 200.0), friction=0.7)
    of_jump, _ = tracked_jump(backflip())
    order = [of_jump.reduced.joints.index(name) for name in of_clip.reduced.joints]
    rows = slice(0, int(of_jump.duration / PERIOD))
    shares = np.abs(of_clip.torques - of_jump.torques[: len(of_clip.torques), order])[rows] / of_clip.motors.effort
    [(takeoff, landing)] = of_jump.flights
    in_air = slice(int(takeoff / PERIOD) + 20, int(landing / PERIOD) - 20)
    assert shares[in_air].max() < 0.01
    assert np.percentile(shares, 90) < 0.05
    assert of_clip.shapes.ground == pytest.approx(of_jump.shapes.ground, abs=2e-3)
    assert of_clip.flights[0][1] == pytest.approx(landing, abs=0.02)


def test_who_stands_still_has_not_turned_twice(tmp_path: Path) -> None:
    """A Go2 that stands while its motion's base turns twice, after which all attitudes are as before."""
    clip = recorded(tmp_path, 50.0)
    stands = {}
    for name in ("base_position", "base_quaternion", "positions"):
        stands[name] = np.tile(getattr(clip, name)[0], (10, 1))
    tracked = tracked_clip(replace(clip, contacts=None, contact_names=(), **stands), friction=0.8)
    positions = tracked.positions.copy()
    angles = 4 * np.pi * np.clip(np.arange(len(positions)) / 80, 0.0, 1.0)
    turns = Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0])
    positions[:, 3:7] = (turns * Rotation.from_quat(positions[:, 3:7])).as_quat()
    control = MotionControl(replace(tracked, positions=positions), np.full((2, 12), [[57.0], [0.98]]))
    landing = control.run_once(fp.Perturbation(), 0.8, 0, 0).landing
    assert landing["touched"] == ()
    assert landing["pitch"] < 0.1
    assert not landing["stands"]


def test_help_and_page_state_what_differs() -> None:
    """The default is written in three places."""
    default = inspect.signature(fp.bench).parameters["perturb"].default
    sizes = given_perturbation(default)
    assert f"{default} if left out" in inspect.getsource(clips.bench)
    page = (Path(__file__).parents[2] / "docs" / "howto" / "bench.md").read_text(encoding="utf-8")
    for words in (
        f"| mass and inertia of every body | {100 * sizes.mass:g} %",
        f"| {100 * sizes.friction:g} %",
        f"| from 0 to {sizes.armature:g} kg m^2 |",
        f"| noise of {np.rad2deg(sizes.noise):g} degree and {np.rad2deg(sizes.noise_of_rates):g} degree/s |",
        f"| {1e3 * sizes.delay:g} ms late |",
    ):
        assert words in page


def test_what_cannot_be_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = tmp_path / "hopper.urdf"
    model.write_text(clip_samples.robot_text())
    path = clip_samples.write_csv(clip_samples.hops(50.0, (0.4,), steps=(0.2,)), tmp_path / "box.csv")
    with pytest.raises(InputError, match=r"box\.csv.*levels that are 0\.2 m apart"):
        fp.bench(path, model)
    with pytest.raises(InputError, match="model: is needed for a recorded motion"):
        fp.bench(path)
    with pytest.raises(InputError, match="model: is for files of recorded motions"):
        fp.bench(backflip(), model)
    with pytest.raises(InputError, match="perturb: h: is for plans"):
        fp.bench(path, model, perturb="h=1%")
    for name in ("flights", "seed", "perturb", "friction", "gains", "progress", "motion"):
        for strange in (object(), -1.0, float("nan"), "\0", [1, "x"], 10**400):
            with pytest.raises(InputError):
                fp.bench(**{"motion": backflip(), "flights": 1, name: strange})
    monkeypatch.setattr("floatplan.simulation.contact.tracked_motion.MOST_PERIODS", 750)  # 0.5 s
    with pytest.raises(InputError, match=r"box\.csv.*lasts"):
        fp.bench(path, model)


@pytest.mark.long
def test_a_spoiled_motion_scores_worse_than_its_repair() -> None:
    """A hop of a Go2 that is played too slowly, while its base swings as no body in the air does, and repaired."""
    (hop,) = draw_hops("go2", 1)
    spoiled = swung(hop, 50.0, 1.45, 15.0, np.array([1.0, 0.0, 0.0]))
    repaired, told = fp.repair_clip(spoiled, rate=50.0)
    assert told.ok
    assert told.changed
    before, after = (fp.bench(motion, flights=5) for motion in (spoiled, repaired))
    assert before.clean == 0
    assert after.clean == 5
    assert after.landings.pitch_rms < 0.75 * before.landings.pitch_rms


@pytest.mark.long
def test_the_command(tmp_path: Path) -> None:
    clip = recorded(tmp_path, 100.0)
    jump = backflip().save(tmp_path / "jump.json")
    words = ["bench", str(jump), str(clip.path), "--model", GO2, "--flights", "2", "--json"]
    result = CliRunner().invoke(app, words)
    motions = json.loads(result.stdout)["motions"]
    assert {motion["motion"] for motion in motions} == {str(jump), str(clip.path)}
    landed = [motion["landed"] for motion in motions]
    assert landed == sorted(landed)
    assert result.exit_code == (0 if min(landed) == 2 else 1)
    table = CliRunner().invoke(app, ["bench", str(jump), "--flights", "1"])
    assert "1 of 1" in table.stdout
    refused = CliRunner().invoke(app, ["bench", str(jump), "--model", GO2])
    assert refused.exit_code == 2
