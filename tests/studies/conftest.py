from collections.abc import Callable
from pathlib import Path

import pytest

import floatplan as fp

ROOT = Path(__file__).resolve().parents[2]
GRID = """
[vary]
"flight.angular_momentum" = { from = 2.8, to = 4.4, count = 12 }
"flight.duration" = { from = 0.9, to = 1.4, count = 8 }
"""


@pytest.fixture
def without_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their files are what test_maps.py is about, and half of the time of a small study."""
    monkeypatch.setattr("floatplan.studies.maps.write_maps", lambda *_: [])


@pytest.fixture(scope="session")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, fp.Study]:
    """The file of a small study of the somersault, and what came of it in this process."""
    path = tmp_path_factory.mktemp("done") / "asked.toml"
    path.write_text(f'problem = "{ROOT / "problems" / "somersault.toml"}"\n{GRID}')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("floatplan.studies.maps.write_maps", lambda *_: [])
        return path, fp.study(path, folder=path.parent / "out", jobs=1)


@pytest.fixture
def study_file(tmp_path: Path) -> Callable[..., Path]:
    """Write a study file about the somersault, or another problem."""

    def write(text: str = GRID, problem: str = "somersault", name: str = "asked") -> Path:
        path = tmp_path / f"{name}.toml"
        path.write_text(f'problem = "{ROOT / "problems" / problem}.toml"\n{text}', encoding="utf-8")
        return path

    return write
