"""A compiled kernel that ends too early, as after a full disk: floatplan does without."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from elsewhere import told
from needed import skip_or_fail

from floatplan.kernel import library

ROOT = Path(__file__).resolve().parents[2]
DESCRIBE = "from floatplan.kernel.library import description; print(description())"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    if library.kernel() is None:
        skip_or_fail("the kernel is not compiled")
    shutil.copytree(ROOT / "floatplan", tmp_path / "floatplan", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


@pytest.mark.parametrize("share", [0.0, 1e-4, 0.01, 0.3, 0.9, 0.9999])
def test_it_is_not_loaded(copy: Path, share: float) -> None:
    path = copy / "floatplan" / "kernel" / "_kernel.so"
    content = path.read_bytes()
    path.unlink()
    path.write_bytes(content[: int(share * len(content))])
    assert "Python solver (compiled kernel " in told(DESCRIBE, copy)
