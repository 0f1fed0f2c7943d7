"""The robot of the clips that are tested."""

from __future__ import annotations

from pathlib import Path

import clip_samples as samples
import pytest

import floatplan as fp


@pytest.fixture(scope="session")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its URDF."""
    path = tmp_path_factory.mktemp("robot") / "hopper.urdf"
    path.write_text(samples.robot_text())
    return path


@pytest.fixture(scope="session")
def robot(model: Path) -> fp.Robot:
    """The robot itself, with a free base."""
    return fp.Robot.from_urdf(model, base="free-flyer")
