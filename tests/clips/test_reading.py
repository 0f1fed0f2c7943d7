"""Recorded motions are read from every format, and from what the project writes itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import clip_samples as samples
import numpy as np
import pytest

import floatplan as fp

FORMATS = ("unitree-csv", "mjlab-npz", "loco-mujoco", "isaac-amp", "gmr-pkl", "mimickit-pkl")
FPS = 50.0


@pytest.fixture(scope="module")
def hop() -> samples.Sample:
    return samples.hops(FPS)


@pytest.fixture(scope="module")
def files(hop: samples.Sample, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return samples.write_all(hop, tmp_path_factory.mktemp("clips"))


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_the_same_motion(
    name: str, files: dict[str, Path], hop: samples.Sample, robot: fp.Robot
) -> None:
    clip = fp.load_clip(files[name], model=robot, fps=FPS if name == "unitree-csv" else None)
    assert clip.layout.format == name
    assert clip.fps == FPS
    assert clip.joints == samples.JOINTS
    np.testing.assert_allclose(clip.base_position, hop.places, rtol=0, atol=1e-6)
    np.testing.assert_allclose(clip.base_quaternion, hop.attitudes.as_quat(), rtol=0, atol=1e-6)
    np.testing.assert_allclose(clip.positions, hop.joints, rtol=0, atol=1e-6)
    check = fp.check_clip(clip)
    assert [judged.verdict for judged in check.flights] == ["physical"]


@pytest.mark.parametrize("form", ["motion-csv", "loco-mujoco", "isaac-amp"])
def test_what_floatplan_exports_is_read_back(
    form: str, handstand: fp.Plan, tmp_path: Path, floatplan: Callable[..., Any], root: Path
) -> None:
    plan_file = handstand.save(tmp_path / "plan.json")
    path = Path(floatplan("export", plan_file, "--format", form, "--rate", 100).stdout.strip())
    model = root / "urdf" / "gymnast.urdf"
    clip = fp.load_clip(path, model=model, fps=100.0)
    assert clip.frames == int(handstand.duration * 100) + 1
    np.testing.assert_allclose(clip.positions, handstand.q(clip.times)[:, -2:], rtol=0, atol=1e-6)
    (judged,) = fp.check_clip(clip).flights
    assert judged.verdict == "physical"
    assert judged.fall.fall == pytest.approx(9.81, abs=1e-3)


def test_a_robot_from_mjcf(files: dict[str, Path], tmp_path: Path) -> None:
    model = tmp_path / "hopper.xml"
    model.write_text(samples.mjcf_text())
    clip = fp.load_clip(files["loco-mujoco"], model=model)
    (judged,) = fp.check_clip(clip).flights
    assert judged.verdict == "physical"


@pytest.mark.parametrize("names", [samples.JOINTS, samples.BY_LEVELS])
def test_the_order_of_joints_is_told_by_bodies(
    names: tuple[str, ...], hop: samples.Sample, robot: fp.Robot, tmp_path: Path
) -> None:
    np.savez(tmp_path / "clip.npz", **samples.mjlab_data(hop, names))
    clip = fp.load_clip(tmp_path / "clip.npz", model=robot)
    np.testing.assert_allclose(clip.positions, hop.joints, rtol=0, atol=1e-12)
    assert clip.layout.joints == names
    assert any("the file names no joints" in remark for remark in clip.remarks)


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_the_order_of_quaternions_is_told_by_the_feet(order: str, robot: fp.Robot, tmp_path: Path) -> None:
    leaning = samples.hops(FPS, tilt=0.2)
    path = samples.write_csv(leaning, tmp_path / "clip.csv", order)
    found = fp.load_clip(path, model=robot, fps=FPS)
    assert found.layout.quaternion == order
    np.testing.assert_allclose(found.base_quaternion, leaning.attitudes.as_quat(), rtol=0, atol=1e-5)
    given = fp.load_clip(path, model=robot, fps=FPS, quaternion=order)
    np.testing.assert_array_equal(given.base_quaternion, found.base_quaternion)
