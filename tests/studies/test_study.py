"""Studies run: rows, statuses, measures, resumption; whatever happens to processes, disks and rows."""

import errno
import json
import os
import random
import signal
import sys
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pyarrow
import pytest
from places import ROOT
from slow_study import ROWS, killed_after, timeless

import floatplan as fp
from floatplan import InputError, files
from floatplan.studies import driver, rows

pytestmark = pytest.mark.usefixtures("without_maps")
COLUMNS = [
    *("index", "flight.angular_momentum", "flight.duration", "status", "objective", "angular_momentum"),
    *("torque_peak", "torque_peak.q1", "torque_peak.q2", "utilisation", "clearance", "explanation", "starts"),
    *("milliseconds", "coefficients"),
]
WHOLE = """
[vary]
"obstacles.0.center.0" = { from = 0.9, to = 1.7, count = 3 }
"goal.positions.q1" = [0, 200]
"""


def test_the_table_has_its_columns_units_and_rows(done):
    _, study = done
    table = study.table
    assert table.column_names == COLUMNS
    units = {field.name: (field.metadata or {}).get(b"unit") for field in table.schema}
    assert units["flight.duration"] == b"s"
    assert units["torque_peak.q1"] == b"N m"
    assert table["index"].to_pylist() == list(range(96))
    assert sum(study.statuses.values()) == len(study) == 96
    assert set(study.statuses) <= {"optimal", "feasible", "not_found"}
    assert all(table["explanation"].to_pylist())
    assert pyarrow.parquet.read_table(study.folder / "results.parquet").equals(table)


def test_rows_are_what_plan_many_and_plans_say(done):
    _, study = done
    table = study.table.to_pylist()
    base = fp.load_problem(ROOT / "problems" / "somersault.toml")
    keys = ("flight.angular_momentum", "flight.duration")
    plans = fp.plan_many(fp.Family(base, {key: [row[key] for row in table] for key in keys}))
    assert [row["status"] for row in table] == plans.status.tolist()
    solved = np.flatnonzero(plans.ok)
    assert len(solved) > len(table) / 2
    for index in solved[:: len(solved) // 4].tolist():
        row, plan = table[index], plans[index]
        assert row["objective"] == plans.objective[index]
        np.testing.assert_allclose(row["coefficients"], plan.coefficients, rtol=0, atol=0)
        np.testing.assert_allclose([row["torque_peak.q1"], row["torque_peak.q2"]], plan.peaks.motor_torque, rtol=1e-7)
        assert row["torque_peak"] == max(row["torque_peak.q1"], row["torque_peak.q2"])
    for row in table:
        if row["status"] == "not_found":
            assert row["torque_peak"] is row["objective"] is row["utilisation"] is None


def test_the_best_rows_hold_plans_that_are_proved(done):
    _, study = done
    best = study.best(3, by="torque_peak")
    torques = [value for value in study.table["torque_peak"].to_pylist() if value is not None]
    assert best["torque_peak"].to_pylist() == sorted(torques)[:3]
    plan = study.plan(best["index"][0].as_py())
    assert plan.ok
    assert plan.certificate.proved
    assert plan.peaks.motor_torque.max() == pytest.approx(best["torque_peak"][0].as_py(), rel=1e-7)
    with pytest.raises(InputError, match="is no column of numbers"):
        study.best(by="status")


@pytest.mark.parametrize("sizes", [(5, 7), (64, 32)])
def test_the_table_does_not_depend_on_chunks(done, tmp_path, monkeypatch, sizes):
    path, study = done
    first, most = sizes
    monkeypatch.setattr(driver, "FIRST_CHUNK", first)
    monkeypatch.setattr(driver, "MOST_IN_CHUNK", most)
    again = fp.study(path, folder=tmp_path / "out", jobs=1)
    assert len(list((tmp_path / "out" / "chunks").iterdir())) >= 2
    assert timeless(again.table).equals(timeless(study.table))


def test_two_processes_make_the_same_table(done, tmp_path):
    path, study = done
    again = fp.study(path, folder=tmp_path / "out", jobs=2)
    assert timeless(again.table).equals(timeless(study.table))


def test_the_share_of_the_limits_is_that_of_the_worst_motor(study_file, tmp_path):
    study = fp.study(
        study_file('[vary]\n"flight.gravity" = [9.7, 9.8]', "torque_limited"), folder=tmp_path / "out", jobs=1
    )
    for index, share in enumerate(study.table["utilisation"].to_pylist()):
        assert share == pytest.approx(max(use.worst for use in study.plan(index).utilisation), rel=1e-7)


def test_a_whole_search_isolates_bad_rows(study_file, tmp_path):
    study = fp.study(study_file(WHOLE, "obstacle"), folder=tmp_path / "out", jobs=1)
    table = study.table.to_pylist()
    assert [row["status"] for row in table[1::2]] == ["error"] * 3
    assert all("goal.positions.q1" in row["explanation"] for row in table[1::2])
    found = [row for row in table[::2] if row["status"] in ("optimal", "feasible")]
    assert found
    for row in found:
        assert row["clearance"] >= 0.02 - 1e-8
    with pytest.raises(InputError, match="outside the joint"):
        study.plan(1)


def test_a_row_that_raises_anything_loses_no_other(done, tmp_path, monkeypatch):
    path, study = done
    together = rows.plan_batches

    def failing(problems, *how):
        if (abs(problems.arrays["flight.angular_momentum"] - 4.4) < 1e-9).any():
            raise ZeroDivisionError("a bug")
        return together(problems, *how)

    monkeypatch.setattr(rows, "plan_batches", failing)
    again = fp.study(path, folder=tmp_path / "out", jobs=1)
    assert again.statuses["error"] == 8
    bad = [row for row in again.table.to_pylist() if row["status"] == "error"]
    assert {row["explanation"] for row in bad} == {"ZeroDivisionError: a bug"}
    for row, same in zip(again.table.to_pylist(), study.table.to_pylist(), strict=True):
        assert row["status"] in (same["status"], "error")


def test_a_row_whose_proof_is_refuted_has_no_solution(study_file, tmp_path, monkeypatch):
    together = rows.plan_batches

    def refuting(problems, *how):
        plans = together(problems, *how)
        assert set(plans.verdict) == {"proved"}
        return replace(plans, verdict=np.where(np.arange(len(plans)) == 0, "refuted", plans.verdict))

    monkeypatch.setattr(rows, "plan_batches", refuting)
    asked = study_file('[vary]\n"flight.duration" = [1.0, 1.1]\n[plan]\nprove = true')
    study = fp.study(asked, folder=tmp_path / "out", jobs=1)
    assert study.table["status"].to_pylist() == ["not_found", "optimal"]
    assert study.table["verdict"].to_pylist() == ["refuted", "proved"]


class Fragile:
    """An engine whose processes die of one row."""

    is_callers = False

    def __init__(self, fatal):
        self.fatal = fatal

    def submit(self, call, work, first, values):
        future = ThreadPoolExecutor(1).submit(lambda: None)
        future = type(future)()
        size = len(next(iter(values.values())))
        if first <= self.fatal < first + size:
            future.set_exception(BrokenProcessPool("died"))
        else:
            future.set_result(call(work, first, values))
        return future

    def capacity(self):
        return 2

    def begin(self):
        return nullcontext(self)

    isolated = begin


def test_a_row_that_ends_its_process_is_found_and_told(done, tmp_path, monkeypatch):
    path, study = done
    monkeypatch.setattr("floatplan.studies.study.started", lambda *_: nullcontext(Fragile(37)))
    again = fp.study(path, folder=tmp_path / "out")
    assert again.table["status"].to_pylist()[37] == "error"
    assert "ended the process" in again.table["explanation"].to_pylist()[37]
    keep = [index for index in range(96) if index != 37]
    assert timeless(again.table).take(keep).equals(timeless(study.table).take(keep))


def test_what_is_there_is_not_planned_again(done, monkeypatch):
    path, study = done
    monkeypatch.setattr(rows, "plan_batches", None)
    again = fp.study(path, folder=study.folder, jobs=1)
    assert again.table.equals(study.table)


def test_a_full_disk_keeps_what_is_there(done, tmp_path, monkeypatch):
    path, study = done
    monkeypatch.setattr(driver, "FIRST_CHUNK", 16)
    monkeypatch.setattr(driver, "MOST_IN_CHUNK", 16)
    real = os.fdopen
    left = [3]

    def full(*arguments, **options):
        left[0] -= arguments[1:] == ("wb",)
        if left[0] < 0:
            os.close(arguments[0])
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(files.os, "fdopen", full)
        with pytest.raises(InputError, match="No space left") as told:
            fp.study(path, folder=tmp_path / "out", jobs=1)
    assert str(tmp_path / "out") in str(told.value)
    assert list((tmp_path / "out" / "chunks").glob("*.parquet"))
    assert not list((tmp_path / "out").rglob(".floatplan-*"))
    assert timeless(fp.study(path, folder=tmp_path / "out", jobs=1).table).equals(timeless(study.table))


def flipped(content):
    """One bit of the pages is another; the first page's header is about 30 bytes."""
    return content[:60] + bytes([content[60] ^ 1]) + content[61:]


class TestFolder:
    def test_of_another_study_is_refused(self, done, tmp_path, study_file, floatplan):
        _, study = done
        other = study_file('[vary]\n"flight.duration" = [1.0, 1.1]')
        run = floatplan("study", other, "-o", study.folder)
        assert run.code == 2
        assert "holds results of another study" in run.stderr
        assert "--restart" in run.stderr

    def test_of_unknown_origin_is_refused(self, study_file, tmp_path):
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "results.parquet").write_text("mine")
        with pytest.raises(InputError, match="holds results of no known study"):
            fp.study(study_file(), folder=tmp_path / "out", jobs=1)

    def test_restart_discards_what_a_study_leaves_and_no_more(self, study_file, tmp_path, floatplan):
        out = tmp_path / "out"
        for text in ('[vary]\n"flight.duration" = [1.0, 1.1]', '[vary]\n"flight.duration" = [1.2]'):
            run = floatplan("study", study_file(text), "-o", out, "--jobs", 1, "--restart", "--json")
            assert run.code == 0
            (out / "notes.txt").write_text("mine")
        assert json.loads(run.stdout)["rows"] == 1
        assert (out / "notes.txt").read_text() == "mine"

    @pytest.mark.parametrize("damage", [lambda content: content[:100], flipped])
    def test_damaged_chunks_are_planned_again(self, study_file, tmp_path, damage):
        path, out = study_file('[vary]\n"flight.duration" = [1.0, 1.1]'), tmp_path / "out"
        first = fp.study(path, folder=out, jobs=1)
        (chunk,) = (out / "chunks").iterdir()
        chunk.write_bytes(damage(chunk.read_bytes()))
        assert timeless(fp.study(path, folder=out, jobs=1).table).equals(timeless(first.table))

    def test_at_work_is_refused(self, study_file, tmp_path):
        from floatplan.studies.folder import StudyFolder

        with StudyFolder(tmp_path / "out", 1).locked(), pytest.raises(InputError, match="another run is at work"):
            fp.study(study_file(), folder=tmp_path / "out", jobs=1)


@pytest.mark.long
def test_killed_at_random_moments_it_ends_with_the_same_table(done, tmp_path):
    path, study = done
    rng, kept = random.Random(5), 0
    for _ in range(4):
        killed_after(kept + rng.randint(1, 4), path, tmp_path / "out", more=1)
        kept = len(list((tmp_path / "out" / "chunks").glob("*.parquet")))
    assert 0 < kept < 96 / ROWS, "killed in the middle"
    assert timeless(fp.study(path, folder=tmp_path / "out", jobs=1).table).equals(timeless(study.table))


@pytest.mark.long
def test_dask_with_a_worker_killed_in_the_middle(done, tmp_path, monkeypatch):
    import dask
    import distributed

    path, study = done
    monkeypatch.setattr(driver, "PATIENCE", 600)
    monkeypatch.setattr(driver, "FIRST_CHUNK", 6)
    monkeypatch.setattr(driver, "MOST_IN_CHUNK", 6)
    killed = []
    dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"})  # with the package loaded already
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):

        def kill(progress):
            if not killed and progress.done >= 12:
                killed.extend(client.run(os.getpid).values())
                os.kill(killed[0], signal.SIGKILL)

        again = fp.study(
            path, folder=tmp_path / "out", engine="dask", scheduler=cluster.scheduler_address, progress=kill
        )
    assert killed
    assert timeless(again.table).equals(timeless(study.table))


def test_without_pyarrow_it_says_what_to_install(study_file, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pyarrow is not installed: .*install it: .*\[study\]"):
        fp.study(study_file(), folder=tmp_path / "out")
