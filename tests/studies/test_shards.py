"""Studies beyond one machine: shards that share nothing are merged into the same table, and any executor plans rows."""

import shutil
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest
from long_cases import cases
from slow_study import killed_after, timeless

import floatplan as fp
from floatplan.studies import driver, rows
from floatplan.studies.folder import Shard

pytestmark = pytest.mark.usefixtures("without_maps")


@pytest.fixture
def asked(done, tmp_path):
    """A study file, its folder, and what its rows are without shards."""
    path = tmp_path / "asked.toml"
    path.write_bytes(done[0].read_bytes())
    return path, tmp_path / "out", timeless(done[1].table)


@pytest.fixture
def shard(asked, floatplan):
    """Plan a shard of it; the folder."""
    path, out, _ = asked

    def run(words, *more):
        done = floatplan("study", path, "-o", out, "--shard", words, "--jobs", 1, "-q", *more)
        assert done.code == 0, done.stderr
        return Path(out) / "shards" / words.replace("/", "-of-")

    return run


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
    monkeypatch.setattr(rows, "plan_batches", None)  # nothing is planned again
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

        def merge(*parts):
            run = floatplan("study", "merge", path, *parts, "-o", out)
            assert run.code == 2
            assert not (out / "results.parquet").exists()
            assert not (out / "study.json").exists()
            return str(run.stderr)

        return merge

    def test_missing_ones(self, shard, refused):
        shard("2/4")
        assert "shards are missing: 1/4, 3/4, 4/4" in refused()

    def test_twice_the_same(self, shard, refused, tmp_path):
        shutil.copytree(shard("1/2"), tmp_path / "copy")
        shard("2/2")
        assert "is shard 1/2, as" in refused(*(tmp_path / "out" / "shards").iterdir(), tmp_path / "copy")

    def test_those_of_another_version_of_the_file(self, asked, shard, refused):
        shard("1/2")
        path, _, _ = asked
        path.write_text(path.read_text().replace("4.4", "4.5"))
        shard("2/2")
        assert "holds no shard of this study" in refused()

    def test_what_is_no_shard(self, done, refused, tmp_path):
        assert "holds no shard" in refused(tmp_path)
        assert "holds no shard" in refused(done[1].folder)

    def test_one_that_was_killed_until_it_has_gone_on(self, asked, shard, refused, floatplan):
        path, out, table = asked
        part = shard("1/1")
        for chunk in (part / "chunks").iterdir():
            chunk.write_bytes(chunk.read_bytes()[:100])
        assert "lacks 96 rows of shard 1/1" in refused()
        shard("1/1")
        assert floatplan("study", "merge", path, "-o", out, "-q").code == 0
        assert timeless(fp.study(path, folder=out, jobs=1).table).equals(table)


@pytest.mark.parametrize("kind", cases(["threads", "spawned"], {"spawned"}))
def test_any_executor_makes_the_same_table(asked, kind):
    path, out, table = asked
    pool = ThreadPoolExecutor(3) if kind == "threads" else ProcessPoolExecutor(1, get_context("spawn"))
    with pool:
        assert timeless(fp.study(path, folder=out, executor=pool, jobs=3).table).equals(table)
        assert pool.submit(int, "3").result() == 3, "it is not shut down"


class Faulty(Executor):
    """Does the first tasks as it should, and has a full disk from there on."""

    def __init__(self, right):
        self.right = right

    def submit(self, fn, /, *args, **kwargs):
        self.right -= 1
        future = Future()
        if self.right >= 0:
            future.set_result(fn(*args, **kwargs))
        else:
            future.set_exception(OSError(28, "No space left"))
        return future


def test_what_an_executor_does_wrong_is_one_error_and_loses_nothing(asked, monkeypatch):
    path, out, table = asked
    monkeypatch.setattr(driver, "FIRST_CHUNK", 16)
    monkeypatch.setattr(driver, "MOST_IN_CHUNK", 16)
    with pytest.raises(fp.FloatplanError, match=r"raised OSError: \[Errno 28\] No space left; what is done stays"):
        fp.study(path, folder=out, executor=Faulty(right=5), jobs=1)
    kept = list((out / "chunks").iterdir())
    assert kept, "what was done before the fault"
    assert timeless(fp.study(path, folder=out, jobs=1).table).equals(table)
    assert all(chunk.exists() for chunk in kept)


def test_a_killed_shard_goes_on(asked, shard, floatplan):
    path, out, table = asked
    killed_after(3, path, out, shard="1/2")
    chunks = out / "shards" / "1-of-2" / "chunks"
    assert len(list(chunks.glob("*.parquet"))) == 3, "killed in the middle"
    shard("2/2")
    run = floatplan("study", "merge", path, "-o", out)
    assert "rows of shard 1/2; plan it again" in run.stderr
    shard("1/2")
    assert floatplan("study", "merge", path, "-o", out, "-q").code == 0
    assert timeless(fp.study(path, folder=out, jobs=1).table).equals(table)
