"""Libraries of motions: a file for each row that holds one, and an index that is true of them."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import floatplan as fp
from floatplan.errors import InputError
from floatplan.studies import motions, study

SOME = """
[vary]
"flight.angular_momentum" = [2.8, 3.4]
"flight.duration" = [0.9, 1.2]
"""


@pytest.fixture
def done(study_file, tmp_path):
    return fp.study(study_file(SOME), folder=tmp_path / "study", jobs=1)


def index_of(path):
    return json.loads(path.read_text())


def counted(monkeypatch):
    """Indices of the rows that are rebuilt from now on."""
    rebuilt = []
    plan = motions.row_plan

    def told(file, row, *more):
        rebuilt.append(row["index"])
        return plan(file, row, *more)

    monkeypatch.setattr(motions, "row_plan", told)
    return rebuilt


def test_each_plan_is_a_file_and_a_line_of_the_index(done):
    told = []
    path = done.export("isaac-amp", 40, jobs=1, progress=lambda count, total: told.append((count, total)))
    assert path == done.folder / "isaac-amp" / "index.json"
    content = index_of(path)
    assert (content["format"], content["form"], content["rate"]) == ("floatplan.motions/1", "isaac-amp", 40)
    assert content["units"] == {"flight.angular_momentum": "kg m^2/s", "flight.duration": "s"}
    table = done.table.to_pylist()
    solved = [row for row in table if row["status"] in ("optimal", "feasible")]
    assert 1 < len(solved) < len(table)  # one of them flies too short
    assert [entry["row"] for entry in content["motions"]] == [row["index"] for row in solved]
    assert told == [(count + 1, len(solved)) for count in range(len(solved))]
    assert {each.name for each in path.parent.iterdir()} == {"index.json", *(e["file"] for e in content["motions"])}
    for entry, row in zip(content["motions"], solved, strict=True):
        assert entry["values"] == {key: row[key] for key in content["units"]}
        assert entry["status"] == row["status"]
        plan = done.plan(entry["row"])
        assert (entry["verdict"], entry["proved"]) == (plan.certificate.verdict, plan.certificate.proved)
        written = (path.parent / entry["file"]).read_bytes()
        assert hashlib.sha256(written).hexdigest() == entry["sha256"]
        assert written == plan.export("isaac-amp", done.folder / "alone", 40).read_bytes()
        with np.load(path.parent / entry["file"], allow_pickle=False) as file:
            times = np.arange(len(file["dof_velocities"])) / 40
            np.testing.assert_array_equal(file["dof_velocities"], plan.v(times)[:, 6:])


def test_it_goes_on_where_it_ended(done, monkeypatch):
    path = done.export("motion-csv", jobs=1)
    before = path.read_bytes()
    files = sorted(each.name for each in path.parent.glob("*.csv"))
    rebuilt = counted(monkeypatch)
    assert done.export("motion-csv", jobs=1).read_bytes() == before
    assert rebuilt == []
    (path.parent / files[0]).write_text("0\n")  # spoiled
    (path.parent / files[-1]).unlink()
    (path.parent / "9999999.csv").write_text("0\n")  # of another study
    (path.parent / "notes.csv").write_text("mine\n")
    done.export("motion-csv", jobs=1)
    assert rebuilt == [int(Path(files[0]).stem), int(Path(files[-1]).stem)]
    assert path.read_bytes() == before
    assert sorted(each.name for each in path.parent.glob("*.csv")) == [*files, "notes.csv"]
    done.export("motion-csv", 25, jobs=1)  # at another rate all are other files
    assert len(rebuilt) == 2 + len(files)
    assert index_of(path)["rate"] == 25


def test_what_is_done_stays_where_a_row_fails(done, monkeypatch):
    rebuilt = counted(monkeypatch)
    plan = motions.row_plan

    def stopped(file, row, *more):
        if len(rebuilt) == 2:
            raise KeyboardInterrupt
        return plan(file, row, *more)

    monkeypatch.setattr(motions, "row_plan", stopped)
    with pytest.raises(KeyboardInterrupt):
        done.export("motion-csv", jobs=1)
    path = done.folder / "motion-csv" / "index.json"
    assert [entry["row"] for entry in index_of(path)["motions"]] == rebuilt
    monkeypatch.setattr(motions, "row_plan", plan)
    done.export("motion-csv", jobs=1)
    assert len(rebuilt) == len(set(rebuilt)) == len(index_of(path)["motions"])


def test_refusals(done, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="must be one of"):
        done.export("../isaac-amp")
    with pytest.raises(InputError, match=r"row \d.rate: 0.5 Hz give one frame"):
        done.export("motion-csv", 0.5, jobs=1)
    with pytest.raises(InputError, match="no such file"):
        done.export("motion-csv", model=tmp_path / "nowhere.urdf", jobs=1)
    monkeypatch.setattr(study, "MOST_MOTIONS", 2)
    with pytest.raises(InputError, match="rows hold a motion, more than 2"):
        done.export("motion-csv")


def test_the_command(floatplan, study_file, tmp_path, done):
    asked, folder = study_file(SOME), tmp_path / "study"
    model = tmp_path / "model.urdf"
    model.write_text(done.plan(1).robot.xml.replace('name="q2"', 'name="knee"'))
    run = floatplan("study", asked, "-o", folder, "--jobs", 1, "--export", "isaac-amp", "--rate", 30, "--json")
    assert run.code == 0
    index = folder / "isaac-amp" / "index.json"
    assert str(index) in json.loads(run.stdout)["files"]
    assert index_of(index)["rate"] == 30
    before = index.read_bytes()
    for wrong, said in (
        (["--export", "isaac-amp", "--model", model], "the motion has no joint knee"),
        (["--export", "bvh"], "format: must be one of csv"),
        (["--rate", 30], "--rate: is for --export"),
        (["--model", model], "--model: is for --export"),
    ):
        run = floatplan("study", asked, "-o", folder, "--jobs", 1, *wrong)
        assert run.code == 2, run
        assert said in run.stderr
    assert index.read_bytes() == before
