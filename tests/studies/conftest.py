from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
GRID = """
[vary]
"flight.angular_momentum" = { from = 2.8, to = 4.4, count = 12 }
"flight.duration" = { from = 0.9, to = 1.4, count = 8 }
"""


@pytest.fixture
def study_file(tmp_path: Path) -> Callable[..., Path]:
    """Write a study file about the somersault, or another problem."""

    def write(text: str = GRID, problem: str = "somersault", name: str = "asked") -> Path:
        path = tmp_path / f"{name}.toml"
        path.write_text(f'problem = "{ROOT / "problems" / problem}.toml"\n{text}', encoding="utf-8")
        return path

    return write
