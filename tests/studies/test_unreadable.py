"""What cannot be read is never deleted or replaced, whatever the reason; what was read and is damaged is made anew."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import floatplan as fp
from floatplan.studies import folder as study_folder

pytest.importorskip("pyarrow")
GRID = '[vary]\n"flight.duration" = { from = 0.95, to = 1.25, count = 10 }\n'
REASONS = [errno.EACCES, errno.EIO, errno.EMFILE, errno.ESTALE]


@pytest.fixture(autouse=True)
def without_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("floatplan.studies.maps.write_maps", lambda *_: [])


@pytest.fixture
def path(study_file: Callable[..., Path]) -> Path:
    return study_file(GRID)


@pytest.fixture
def unreadable(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Let the system refuse to open a file, as tests that root runs need it: root may read all."""
    opened = os.open

    def refuse(refused: Path, reason: int = errno.EACCES) -> None:
        def open_others(path: Any, *arguments: Any, **options: Any) -> int:
            if Path(os.fsdecode(path)) == refused:
                raise OSError(reason, os.strerror(reason), str(path))
            return opened(path, *arguments, **options)

        monkeypatch.setattr(os, "open", open_others)

    return refuse


def contents(folder: Path) -> dict[Path, bytes]:
    """All files of a folder, without locks."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != ".lock")
    return {path: path.read_bytes() for path in files}


def shards(path: Path, out: Path, floatplan: Any, count: int = 3) -> list[Path]:
    """Plan all shards of a study; their chunks."""
    for number in range(1, count + 1):
        done = floatplan("study", path, "-o", out, "--shard", f"{number}/{count}", "--jobs", 1, "-q")
        assert done.code == 0, done.stderr
    return sorted((out / "shards").glob("*/chunks/*.parquet"))


@pytest.mark.parametrize("reason", REASONS)
def test_a_study_that_goes_on_deletes_no_chunk_that_it_cannot_read(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unreadable: Callable[..., None], reason: int
) -> None:
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


@pytest.mark.parametrize("name", ["ArrowMemoryError", "ArrowNotImplementedError"])
def test_nor_one_that_cannot_be_decoded_here(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Memory runs out, or this pyarrow lacks what another one wrote it with."""
    out = tmp_path / "out"
    fp.study(path, folder=out, jobs=1)
    (chunk,) = (out / "chunks").iterdir()

    content, real = chunk.read_bytes(), study_folder.read_table

    def read(given: bytes) -> Any:
        if given == content:
            raise getattr(study_folder.arrow()[0], name)("not here")
        return real(given)

    monkeypatch.setattr(study_folder, "read_table", read)
    with pytest.raises(fp.InputError, match=f"{chunk.name}: cannot be read: not here"):
        fp.study(path, folder=out, jobs=1)
    assert chunk.exists()


@pytest.mark.parametrize("name", ["chunks", "study.json", "results.parquet"])
def test_restart_discards_all_or_nothing(
    path: Path, tmp_path: Path, unreadable: Callable[..., None], name: str
) -> None:
    out = tmp_path / "out"
    fp.study(path, folder=out, jobs=1)
    refused = next((out / "chunks").iterdir()) if name == "chunks" else out / name
    before = contents(out)
    unreadable(refused)
    with pytest.raises(fp.InputError, match=f"{refused.name}: cannot be read: Permission denied; it is not discarded"):
        fp.study(path, folder=out, restart=True, jobs=1)
    assert contents(out) == before


def test_a_record_that_cannot_be_read_is_no_reason_to_restart(
    path: Path, tmp_path: Path, unreadable: Callable[..., None]
) -> None:
    out = tmp_path / "out"
    fp.study(path, folder=out, jobs=1)
    unreadable(out / "study.json")
    with pytest.raises(fp.InputError, match="cannot be read: Permission denied") as told:
        fp.study(path, folder=out, jobs=1)
    assert "--restart" not in str(told.value)


class TestMerge:
    def test_deletes_nothing_that_it_cannot_read(
        self, path: Path, tmp_path: Path, floatplan: Any, unreadable: Callable[..., None]
    ) -> None:
        chunks = shards(path, tmp_path / "out", floatplan)
        before = contents(tmp_path / "out")
        unreadable(chunks[1])
        run = floatplan("study", "merge", path, "-o", tmp_path / "out")
        assert run.code == 2
        assert f"{chunks[1].name}: cannot be read: Permission denied" in run.stderr
        assert contents(tmp_path / "out") == before

    def test_nor_what_is_damaged(self, path: Path, tmp_path: Path, floatplan: Any) -> None:
        chunks = shards(path, tmp_path / "out", floatplan)
        chunks[2].write_bytes(chunks[2].read_bytes()[:-50])
        before = contents(tmp_path / "out")
        run = floatplan("study", "merge", path, "-o", tmp_path / "out")
        assert run.code == 2
        assert f"lacks 4 rows of shard 3/3; {chunks[2].name} is damaged; plan it again" in run.stderr
        assert contents(tmp_path / "out") == before

    def test_nor_rows_that_the_study_has_already(
        self, path: Path, tmp_path: Path, floatplan: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Rows that it lacks are added, whatever the chunks that it has."""
        monkeypatch.setattr("floatplan.studies.driver.FIRST_CHUNK", 4)
        monkeypatch.setattr("floatplan.studies.driver.MOST_IN_CHUNK", 4)
        whole = fp.study(path, folder=tmp_path / "out", jobs=1)
        kept = sorted((tmp_path / "out" / "chunks").iterdir())
        kept.pop(1).unlink()
        before = contents(tmp_path / "out" / "chunks")
        shards(path, tmp_path / "out", floatplan)
        run = floatplan("study", "merge", path, "-o", tmp_path / "out")
        assert run.code == 0, run.stderr
        assert contents(tmp_path / "out" / "chunks").items() >= before.items()
        monkeypatch.setattr("floatplan.studies.rows.planned_together", None)  # nothing is planned again
        merged = fp.study(path, folder=tmp_path / "out", jobs=1).table
        assert merged.drop_columns(["milliseconds"]).equals(whole.table.drop_columns(["milliseconds"]))

    def test_nor_a_damaged_chunk_of_the_study(self, path: Path, tmp_path: Path, floatplan: Any) -> None:
        fp.study(path, folder=tmp_path / "out", jobs=1)
        (chunk,) = (tmp_path / "out" / "chunks").iterdir()
        chunk.write_bytes(b"PAR1")
        shards(path, tmp_path / "out", floatplan)
        before = contents(tmp_path / "out")
        run = floatplan("study", "merge", path, "-o", tmp_path / "out")
        assert run.code == 2
        assert f"{chunk.name}: is damaged" in run.stderr
        assert contents(tmp_path / "out") == before

    def test_reads_folders_that_cannot_be_written_to(
        self, path: Path, tmp_path: Path, floatplan: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """As on a disk that is mounted for reading alone."""
        shards(path, tmp_path / "theirs", floatplan)
        parts = sorted((tmp_path / "theirs" / "shards").iterdir())
        for part in parts:
            (part / ".lock").unlink(missing_ok=True)
        access = os.access

        def mounted(place: Any, mode: int, **options: Any) -> bool:
            return not (Path(place) in parts and mode & os.W_OK) and access(place, mode, **options)

        monkeypatch.setattr(os, "access", mounted)
        run = floatplan("study", "merge", path, *parts, "-o", tmp_path / "out")
        assert run.code == 0, run.stderr
        assert not any((part / ".lock").exists() for part in parts)


class TestMotions:
    @pytest.mark.parametrize("name", ["index.json", "motion"])
    def test_of_a_study_stay(self, path: Path, tmp_path: Path, unreadable: Callable[..., None], name: str) -> None:
        done = fp.study(path, folder=tmp_path / "out", jobs=1)
        index = done.export("csv", jobs=1)
        refused = index if name == "index.json" else sorted(index.parent.glob("*.csv"))[1]
        before = contents(index.parent)
        unreadable(refused)
        for rate in (None, 20.0):  # to go on, and to make other files
            with pytest.raises(fp.InputError, match=f"{refused.name}: cannot be read: Permission denied"):
                done.export("csv", rate, jobs=1)
        assert contents(index.parent) == before


@pytest.mark.parametrize("name", ["plan.json", "trajectory.csv", "report.html", "figures/momentum.png"])
def test_results_of_another_run_stay(
    floatplan: Any, tmp_path: Path, unreadable: Callable[..., None], name: str
) -> None:
    """All of them, where one of those that would go cannot be read."""
    problem = Path(__file__).resolve().parents[2] / "problems" / "somersault.toml"
    out = tmp_path / "out"
    out.mkdir()
    for each in ("plan.json", "trajectory.csv", "report.html", "figures/momentum.png"):
        (out / each).parent.mkdir(exist_ok=True)
        (out / each).write_text("{}")
    before = contents(out)
    unreadable(out / name)
    run = floatplan("plan", problem, "-o", out, "--no-figures", "--no-certify")
    assert run.code == 2
    assert f"{name}: cannot be read: Permission denied" in run.stderr
    assert contents(out) == before


def test_an_exported_file_takes_the_place_of_none_that_cannot_be_read(
    tmp_path: Path, unreadable: Callable[..., None]
) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("mine")
    plan = fp.plan(fp.load_problem(Path(__file__).resolve().parents[2] / "problems" / "somersault.toml"))
    unreadable(path)
    with pytest.raises(fp.InputError, match=r"mine\.csv: cannot be read: Permission denied; it is not replaced"):
        plan.export("csv", path=path)
    assert path.read_text() == "mine"
