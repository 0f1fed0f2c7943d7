import pytest
from places import ROOT

import floatplan as fp

GRID = """
[vary]
"flight.angular_momentum" = { from = 2.8, to = 4.4, count = 12 }
"flight.duration" = { from = 0.9, to = 1.4, count = 8 }
"""


@pytest.fixture
def without_maps(monkeypatch):
    """Their files are what test_maps.py is about, and half of the time of a small study."""
    monkeypatch.setattr("floatplan.studies.maps.write_maps", lambda *_: [])


@pytest.fixture(scope="session")
def done(tmp_path_factory):
    """The file of a small study of the somersault, and what came of it in this process."""
    path = tmp_path_factory.mktemp("done") / "asked.toml"
    path.write_text(f'problem = "{ROOT / "problems" / "somersault.toml"}"\n{GRID}')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("floatplan.studies.maps.write_maps", lambda *_: [])
        return path, fp.study(path, folder=path.parent / "out", jobs=1)


@pytest.fixture
def study_file(tmp_path):
    """Write a study file about the somersault, or another problem."""

    def write(text=GRID, problem="somersault", name="asked"):
        path = tmp_path / f"{name}.toml"
        path.write_text(f'problem = "{ROOT / "problems" / problem}.toml"\n{text}', encoding="utf-8")
        return path

    return write
