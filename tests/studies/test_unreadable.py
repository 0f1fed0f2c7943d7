"""What cannot be read is never deleted or replaced, whatever the reason; what was read and is damaged is made anew."""

import errno
import os
from pathlib import Path

import pytest
from places import PROBLEMS

import floatplan as fp

GRID = '[vary]\n"flight.duration" = { from = 0.95, to = 1.25, count = 10 }\n'
pytestmark = pytest.mark.usefixtures("without_maps")
REASONS = [errno.EACCES, errno.EIO, errno.EMFILE, errno.ESTALE]


@pytest.fixture
def path(study_file):
    return study_file(GRID)


@pytest.fixture
def unreadable(monkeypatch):
    """Let the system refuse to open a file, as tests that root runs need it: root may read all."""
    opened = os.open

    def refuse(refused, reason=errno.EACCES):
        def open_others(path, *arguments, **options):
            if Path(os.fsdecode(path)) == refused:
                raise OSError(reason, os.strerror(reason), str(path))
            return opened(path, *arguments, **options)

        monkeypatch.setattr(os, "open", open_others)

    return refuse


def contents(folder):
    """All files of a folder, without locks."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != ".lock")
    return {path: path.read_bytes() for path in files}


def shards(path, out, floatplan, count=3):
    """Plan all shards of a study; their chunks."""
    for number in range(1, count + 1):
        done = floatplan("study", path, "-o", out, "--shard", f"{number}/{count}", "--jobs", 1, "-q")
        assert done.code == 0, done.stderr
    return sorted((out / "shards").glob("*/chunks/*.parquet"))


@pytest.mark.parametrize("reason", REASONS)
def test_a_study_that_goes_on_deletes_no_chunk_that_it_cannot_read(path, tmp_path, monkeypatch, unreadable, reason):
    """Nor one that is damaged beside it."""
    out = tmp_path / "out"
    monkeypatch.setattr("floatplan.studies.driver.FIRST_CHUNK", 4)
    monkeypatch.setattr("floatplan.studies.driver.MOST_IN_CHUNK", 4)
    fp.study(path, folder=out, jobs=1)
    first, *_, last = sorted((out / "chunks").iterdir())
    first.write_bytes(first.read_bytes()[:80])
    before = contents(out)
    unreadable(last, reason)
    with pytest.raises(fp.InputError, match=f"{last.name}: cannot be read: {os.strerror(reason)}; nothing was removed"):
        fp.study(path, folder=out, jobs=1)
    assert contents(out) == before


@pytest.mark.parametrize("name", ["chunks", "study.json", "results.parquet"])
def test_restart_discards_all_or_nothing(path, tmp_path, unreadable, name):
    out = tmp_path / "out"
    fp.study(path, folder=out, jobs=1)
    refused = next((out / "chunks").iterdir()) if name == "chunks" else out / name
    before = contents(out)
    unreadable(refused)
    with pytest.raises(fp.InputError, match=f"{refused.name}: cannot be read: Permission denied; it is not discarded"):
        fp.study(path, folder=out, restart=True, jobs=1)
    assert contents(out) == before


class TestMerge:
    def test_deletes_nothing_that_it_cannot_read(self, path, tmp_path, floatplan, unreadable):
        chunks = shards(path, tmp_path / "out", floatplan)
        before = contents(tmp_path / "out")
        unreadable(chunks[1])
        run = floatplan("study", "merge", path, "-o", tmp_path / "out")
        assert run.code == 2
        assert f"{chunks[1].name}: cannot be read: Permission denied" in run.stderr
        assert contents(tmp_path / "out") == before


def test_an_exported_file_takes_the_place_of_none_that_cannot_be_read(tmp_path, unreadable):
    path = tmp_path / "mine.csv"
    path.write_text("mine")
    plan = fp.plan(fp.load_problem(PROBLEMS / "somersault.toml"))
    unreadable(path)
    with pytest.raises(fp.InputError, match=r"mine\.csv: cannot be read: Permission denied; it is not replaced"):
        plan.export("csv", path=path)
    assert path.read_text() == "mine"
