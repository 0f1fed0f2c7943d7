"""Studies beyond one machine: shards that share nothing are merged into the same table, and any executor plans rows."""

from __future__ import annotations

import json
import math
import shutil
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import pytest
import slow_study
from long_cases import cases

import floatplan as fp
from floatplan.studies import driver, rows
from floatplan.studies.folder import Shard, StudyFolder

pytest.importorskip("pyarrow")
ROOT = Path(__file__).resolve().parents[2]
SOME = """
[vary]
"flight.angular_momentum" = { from = 2.8, to = 4.4, count = 12 }
"flight.duration" = { from = 0.9, to = 1.4, count = 8 }
"""
WHOLE = '[vary]\n"obstacles.0.center.0" = [0.9, 1.3, 1.7, 50.0]\n'


@pytest.fixture(autouse=True)
def without_maps(monkeypatch):
    monkeypatch.setattr("floatplan.studies.maps.write_maps", lambda *_: [])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A small study, planned without shards."""
    path = tmp_path_factory.mktemp("whole") / "asked.toml"
    path.write_text(f'problem = "{ROOT / "problems" / "somersault.toml"}"\n{SOME}')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("floatplan.studies.maps.write_maps", lambda *_: [])
        return path, fp.study(path, folder=path.parent / "whole", jobs=1)


@pytest.fixture
def asked(whole, tmp_path):
    """A study file, its folder, and what its rows are without shards."""
    path = tmp_path / "asked.toml"
    path.write_bytes(whole[0].read_bytes())
    return path, tmp_path / "out", timeless(whole[1].table)


@pytest.fixture
def shard(asked, floatplan):
    """Plan a shard of it; the folder."""
    path, out, _ = asked

    def run(words: str, *more: object) -> Path:
        done = floatplan("study", path, "-o", out, "--shard", words, "--jobs", 1, "-q", *more)
        assert done.code == 0, done.stderr
        return Path(out) / "shards" / words.replace("/", "-of-")

    return run


def timeless(table):
    return table.drop_columns(["milliseconds"])


@pytest.mark.parametrize(("total", "count"), [(96, 1), (96, 7), (7, 7), (10**6, 64)])
def test_shards_are_all_rows_once_and_as_equal_as_can_be(total, count):
    ranges = [Shard(number, count).rows(total) for number in range(1, count + 1)]
    assert [first for first, _ in ranges] == [0, *(stop for _, stop in ranges[:-1])]
    assert ranges[-1][1] == total
    assert {stop - first for first, stop in ranges} <= {total // count, -(-total // count)}


@pytest.mark.parametrize(
    "words", ["0/0", "5/4", "0/4", "1/97", "1", "a/b", "-1/4", "1/4/4", "\u00b2/4", "1/" + "9" * 50]
)
def test_a_shard_that_cannot_be_is_refused_and_nothing_is_made(asked, floatplan, words):
    path, out, _ = asked
    run = floatplan("study", path, "-o", out, "--shard", words)
    assert run.code == 2
    assert run.stderr.startswith("error: --shard: ")
    assert not out.exists()


def test_merged_they_are_the_table_without_shards(asked, shard, floatplan, monkeypatch):
    path, out, table = asked
    for words in ("3/3", "1/3", "2/3"):
        shard(words)
    run = floatplan("study", "merge", path, "-o", out)
    assert run.code == 0, run.stderr
    monkeypatch.setattr(rows, "planned_together", None)  # nothing is planned again
    study = fp.study(path, folder=out, jobs=1)
    assert timeless(study.table).equals(table)
    assert timeless(study.table).schema.equals(table.schema, check_metadata=True)
    assert floatplan("study", "merge", path, "-o", out, "-q").code == 0


def test_folders_of_other_machines_are_merged(asked, shard, floatplan, tmp_path):
    path, out, table = asked
    elsewhere = tmp_path / "elsewhere"
    shutil.move(shard("1/2"), elsewhere)
    run = floatplan("study", "merge", path, shard("2/2"), elsewhere, "-o", out, "-q")
    assert run.code == 0, run.stderr
    assert timeless(fp.study(path, folder=out, jobs=1).table).equals(table)


class TestMergeRefuses:
    @pytest.fixture
    def refused(self, asked, floatplan):
        path, out, _ = asked

        def merge(*parts: object) -> str:
            run = floatplan("study", "merge", path, *parts, "-o", out)
            assert run.code == 2
            assert not (out / "results.parquet").exists()
            assert not (out / "study.json").exists()
            return str(run.stderr)

        return merge

    def test_none(self, refused):
        assert "shards are missing: 1/1" in refused()

    def test_missing_ones(self, shard, refused):
        shard("2/4")
        assert "shards are missing: 1/4, 3/4, 4/4" in refused()

    def test_twice_the_same(self, shard, refused, tmp_path):
        shutil.copytree(shard("1/2"), tmp_path / "copy")
        shard("2/2")
        assert "is shard 1/2, as" in refused(*(tmp_path / "out" / "shards").iterdir(), tmp_path / "copy")

    def test_those_of_another_cut(self, shard, refused):
        shard("1/2")
        shard("2/3")
        assert "shards are missing: 1/3, 3/3" in refused(), "beside 1/2"

    def test_those_of_another_version_of_the_file(self, asked, shard, refused):
        shard("1/2")
        path, _, _ = asked
        path.write_text(path.read_text().replace("4.4", "4.5"))
        shard("2/2")
        assert "holds no shard of this study" in refused()

    def test_what_is_no_shard(self, whole, refused, tmp_path):
        assert "holds no shard" in refused(tmp_path)
        assert "holds no shard" in refused(whole[1].folder)

    @pytest.mark.parametrize("record", ["[]", "{}", '"x"', "["])
    def test_spoiled_records(self, shard, refused, record):
        (shard("1/1") / "study.json").write_text(record)
        refused()

    @pytest.mark.parametrize("number", [[1], [0, 1], [2, 1], ["1", "1"], None, [1, 1000]])
    def test_spoiled_numbers(self, shard, refused, number):
        record = shard("1/1") / "study.json"
        record.write_text(json.dumps({**json.loads(record.read_text()), "shard": number}))
        assert "holds no shard" in refused()

    def test_one_that_was_killed_until_it_has_gone_on(self, asked, shard, refused, floatplan):
        path, out, table = asked
        part = shard("1/1")
        for chunk in (part / "chunks").iterdir():
            chunk.write_bytes(chunk.read_bytes()[:100])
        assert "lacks 96 rows of shard 1/1" in refused()
        shard("1/1")
        assert floatplan("study", "merge", path, "-o", out, "-q").code == 0
        assert timeless(fp.study(path, folder=out, jobs=1).table).equals(table)


def test_two_at_once_and_the_same_one_is_refused(asked, shard, floatplan):
    path, out, _ = asked
    with StudyFolder(out / "shards" / "1-of-2", (0, 48)).locked():
        shard("2/2")
        run = floatplan("study", path, "-o", out, "--shard", "1/2", "--jobs", 1)
    assert run.code == 2
    assert "another run is at work" in run.stderr


def test_files_of_motions_are_for_the_whole_study(asked, floatplan):
    path, out, _ = asked
    run = floatplan("study", path, "-o", out, "--shard", "1/2", "--export", "csv")
    assert run.code == 2
    assert "merge the shards first" in run.stderr


@pytest.mark.parametrize("kind", cases(["threads", "spawned"], {"spawned"}))
def test_any_executor_makes_the_same_table(asked, kind):
    path, out, table = asked
    pool: Executor = ThreadPoolExecutor(3) if kind == "threads" else ProcessPoolExecutor(1, get_context("spawn"))
    with pool:
        assert timeless(fp.study(path, folder=out, executor=pool, jobs=3).table).equals(table)
        assert pool.submit(int, "3").result() == 3, "it is not shut down"


def test_threads_search_as_one_does(study_file, tmp_path):
    path = study_file(WHOLE, "obstacle")
    alone = fp.study(path, folder=tmp_path / "alone", jobs=1).table
    with ThreadPoolExecutor(4) as pool:
        assert timeless(fp.study(path, folder=tmp_path / "out", executor=pool, jobs=4).table).equals(timeless(alone))


class Breaking(Executor):
    """Takes a few tasks, and breaks in one."""

    def __init__(self, left: int) -> None:
        self.left = left

    def submit(self, fn, /, *args, **kwargs):
        self.left -= 1
        if self.left < 0:
            raise BrokenProcessPool("broken")
        future: Future = Future()
        if self.left:
            future.set_result(fn(*args, **kwargs))
        else:
            future.set_exception(BrokenProcessPool("died"))
        return future


def test_an_executor_that_breaks_loses_nothing_that_is_done(asked, monkeypatch):
    path, out, table = asked
    monkeypatch.setattr(driver, "FIRST_CHUNK", 16)
    monkeypatch.setattr(driver, "MOST_IN_CHUNK", 16)
    with pytest.raises(fp.FloatplanError, match="takes no more tasks"):
        fp.study(path, folder=out, executor=Breaking(3))
    assert len(list((out / "chunks").iterdir())) >= 1
    assert timeless(fp.study(path, folder=out, jobs=1).table).equals(table)


def test_one_that_was_shut_down_is_told(asked):
    path, out, _ = asked
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.raises(fp.FloatplanError, match="takes no more tasks"):
        fp.study(path, folder=out, executor=pool)


class Faulty(Executor):
    """Does the first tasks as it should, and has a fault from there on."""

    def __init__(self, right: int) -> None:
        self.right = right

    def submit(self, fn, /, *args, **kwargs):
        self.right -= 1
        future: Future = Future()
        if self.right >= 0:
            future.set_result(fn(*args, **kwargs))
            return future
        return self.faulty(future, fn, *args, **kwargs)

    def faulty(self, future, fn, *args, **kwargs):
        raise NotImplementedError


class RaisesInSubmit(Faulty):
    fault = r"the executor's submit raised ValueError: no room; what is done stays"

    def faulty(self, *_, **__):
        raise ValueError("no room")


class ReturnsNoFuture(Faulty):
    fault = r"the executor's submit returned 'int', not a concurrent.futures.Future; what is done stays"

    def faulty(self, *_, **__):
        return 7


class RaisesInATask(Faulty):
    fault = r"task .*raised OSError: \[Errno 28\] No space left; what is done stays"

    def faulty(self, future, *_, **__):
        future.set_exception(OSError(28, "No space left"))
        return future


class Junk(Faulty):
    fault = r"the executor returned 'str' in the place of rows \d+ to \d+; what is done stays"

    def faulty(self, future, *_, **__):
        future.set_result("done")
        return future


class Damaged(Faulty):
    fault = r"the executor returned rows \d+ to \d+ damaged"

    def faulty(self, future, fn, *args, **_):
        done = fn(*args)
        middle = len(done.content) // 2
        content = done.content[:middle] + bytes([done.content[middle] ^ 1]) + done.content[middle + 1 :]
        future.set_result(replace(done, content=content))
        return future


class OtherRows(Faulty):
    fault = r"the executor returned rows \d+ to \d+ damaged, or others in their place"

    def faulty(self, future, fn, *args, **_):
        study, first, values = args
        future.set_result(fn(study, first + 1, values))
        return future


class Timeless(Faulty):
    fault = "the executor returned 'PlannedChunk' in the place of rows"

    def faulty(self, future, fn, *args, **_):
        future.set_result(replace(fn(*args), seconds=math.nan))
        return future


@pytest.mark.parametrize("kind", [RaisesInSubmit, ReturnsNoFuture, RaisesInATask, Junk, Damaged, OtherRows, Timeless])
def test_what_an_executor_does_wrong_is_one_error_and_loses_nothing(asked, monkeypatch, kind):
    path, out, table = asked
    monkeypatch.setattr(driver, "FIRST_CHUNK", 16)
    monkeypatch.setattr(driver, "MOST_IN_CHUNK", 16)
    with pytest.raises(fp.FloatplanError, match=kind.fault):
        fp.study(path, folder=out, executor=kind(right=5), jobs=1)
    kept = list((out / "chunks").iterdir())
    assert kept, "what was done before the fault"
    assert timeless(fp.study(path, folder=out, jobs=1).table).equals(table)
    assert all(chunk.exists() for chunk in kept)


@pytest.mark.parametrize("kind", [RaisesInSubmit, ReturnsNoFuture, RaisesInATask])
def test_so_is_what_it_does_wrong_at_once(asked, kind):
    path, out, _ = asked
    with pytest.raises(fp.FloatplanError, match=kind.fault):
        fp.study(path, folder=out, executor=kind(right=0))


def test_one_that_cancels_its_tasks_is_told(asked):
    path, out, _ = asked

    class Cancels(Faulty):
        def faulty(self, future, *_, **__):
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    with pytest.raises(fp.FloatplanError, match="the executor cancelled its first task"):
        fp.study(path, folder=out, executor=Cancels(right=0))


@pytest.mark.parametrize("options", [{"executor": "threads"}, {"executor": ThreadPoolExecutor, "engine": "dask"}])
def test_what_is_no_executor_is_refused(asked, options):
    path, out, _ = asked
    with pytest.raises(fp.InputError, match="executor: must be a concurrent"):
        fp.study(path, folder=out, **options)


def test_a_killed_shard_goes_on(asked, shard, floatplan):
    path, out, table = asked
    process = slow_study.started(str(path), str(out), 3, "1/2")
    chunks = out / "shards" / "1-of-2" / "chunks"
    while process.is_alive() and len(list(chunks.glob("*.parquet"))) < 3:
        time.sleep(0.005)
    process.kill()
    process.join()
    assert len(list(chunks.glob("*.parquet"))) == 3, "killed in the middle"
    shard("2/2")
    run = floatplan("study", "merge", path, "-o", out)
    assert "rows of shard 1/2; plan it again" in run.stderr
    shard("1/2")
    assert floatplan("study", "merge", path, "-o", out, "-q").code == 0
    assert timeless(fp.study(path, folder=out, jobs=1).table).equals(table)
