"""A compiled kernel that ends too early, as after a full disk: commands say so."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copytree(ROOT / "floatplan", tmp_path / "floatplan", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


@pytest.mark.parametrize("share", [0.0, 1e-4, 0.01, 0.3, 0.9, 0.9999])
def test_it_is_not_loaded(copy: Path, share: float) -> None:
    path = copy / "floatplan" / "kernel" / "_kernel.so"
    content = path.read_bytes()
    path.unlink()
    path.write_bytes(content[: int(share * len(content))])
    command = [
        sys.executable,
        "-P",
        "-m",
        "floatplan",
        "plan",
        str(ROOT / "problems" / "handstand.toml"),
        "-o",
        str(copy),
    ]
    run = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(copy)}, capture_output=True, text=True)
    assert run.returncode == 2, run.stderr
    assert run.stderr.startswith("error: the kernel cannot be used: ")
    assert "Traceback" not in run.stderr
