"""Study files: what varies, by path, unit and range; all that is wrong is told with its path."""

import json
import math
import shutil
import tomllib

import jsonschema
import numpy as np
import pytest
from elsewhere import told
from places import ROOT

from floatplan import FloatplanError, InputError
from floatplan.studies import rows
from floatplan.studies.file import MOST_ROWS, load_study_file, versions
from floatplan.studies.rows import packed, planned_rows
from floatplan.studies.schema import study_schema

STUDIES = sorted((ROOT / "problems" / "studies").glob("*.toml"))
RANGE = "{ from = 0.9, to = 1.4, count = 3 }"


def load(study_file, text, problem="somersault"):
    return load_study_file(study_file(text, problem))


def test_a_grid_runs_through_its_last_key_first(study_file):
    asked = load(study_file, f'[vary]\n"flight.angular_momentum" = [3.0, 4.0]\n"flight.duration" = {RANGE}')
    values = asked.samples.values(0, len(asked))
    assert values["flight.angular_momentum"].tolist() == [3.0] * 3 + [4.0] * 3
    np.testing.assert_allclose(values["flight.duration"], [0.9, 1.15, 1.4] * 2, rtol=1e-15)
    middle = asked.samples.values(2, 5)
    assert all((middle[path] == values[path][2:5]).all() for path in values)


def test_angles_are_in_the_unit_of_the_problem_file(study_file):
    asked = load(study_file, '[vary]\n"goal.positions.q1" = [-60.0, -30.0]\n"start.velocities.q2" = [90.0]')
    assert asked.units == {"goal.positions.q1": "deg", "start.velocities.q2": "deg/s"}
    problem = asked.family(1, 2)[0]
    assert problem.final.positions[0] == math.radians(-30.0)
    assert problem.initial.velocities[1] == math.radians(90.0)


@pytest.mark.parametrize("sampling", ["random", "sobol"])
def test_samples_repeat_and_do_not_depend_on_their_number(study_file, sampling):
    def text(count, seed):
        ranges = '[vary]\n"flight.duration" = { from = 0.9, to = 1.4 }\n"goal.orientation" = { from = 500, to = 540 }\n'
        return f'sampling = "{sampling}"\nsamples = {count}\nseed = {seed}\n{ranges}'

    few, many, other = (load(study_file, text(*each)).samples.values(0, 20) for each in ((20, 1), (50, 1), (20, 2)))
    assert all((few[path] == many[path]).all() for path in few)
    assert not any((few[path] == other[path]).any() for path in few)
    assert all(0.9 <= value <= 1.4 for value in few["flight.duration"])
    assert few["goal.orientation"].min() >= 500
    assert few["goal.orientation"].max() <= 540


BAD = {
    "no such key": ("flight.speed", "1.0", "flight.speed: is no number of a problem file"),
    "a whole table": ("flight.takeoff", "1.0", "is no number"),
    "a word": ("motion.objective", "1.0", "is no number"),
    "a frame": ("flight.takeoff.frame", "1.0", "is no number"),
    "the robot": ("robot.locked.q1", "1.0", "is no number"),
    "no such joint": ("goal.positions.q9", "1.0", "no joint 'q9'"),
    "no such obstacle": ("obstacles.0.radius", "1.0", "there is none"),
    "out of range": ("flight.duration", "5e4", "vary.flight.duration: 50000 is outside 0.001 to 1000 s"),
    "degrees out of range": ("goal.orientation", "1e9", "deg"),
    "half a degree": ("motion.degree", "7.5", "7.5 is not a whole number"),
    "not a number": ("flight.duration", "nan", "vary.flight.duration[0]: nan is not a finite number"),
    "a text": ("flight.duration", '"long"', "vary.flight.duration[0]: 'long' is not a number"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_paths_and_numbers(study_file, case):
    path, value, message = BAD[case]
    with pytest.raises(InputError) as caught:
        load(study_file, f'[vary]\n"{path}" = [{value}]')
    assert message in str(caught.value)
    assert "asked.toml" in str(caught.value)


WRONG = {
    "nothing varies": ("[vary]", "varies nothing"),
    "no vary": ("", "vary: is missing"),
    "unknown key": (f'[vary]\n"flight.duration" = {RANGE}\n[plan]\nstart = 3', "plan.start: unknown key; did you mean"),
    "unknown key of a range": ('[vary]\n"flight.duration" = { from = 1, to = 2, counts = 3 }', "did you mean 'count'?"),
    "no count": ('[vary]\n"flight.duration" = { from = 1, to = 2 }', "vary.flight.duration.count: is missing"),
    "turned round": ('[vary]\n"flight.duration" = { from = 2, to = 1, count = 3 }', "from 2 is above to 1"),
    "a count of zero": ('[vary]\n"flight.duration" = { from = 1, to = 2, count = 0 }', "count: 0 is not positive"),
    "an empty list": ('[vary]\n"flight.duration" = []', "is an empty list"),
    "samples of a grid": (f'samples = 5\n[vary]\n"flight.duration" = {RANGE}', "samples: is not for a grid"),
    "no samples": ('sampling = "random"\n[vary]\n"flight.duration" = { from = 1, to = 2 }', "samples: is missing"),
    "a grid's count drawn": (f'sampling = "sobol"\nsamples = 4\n[vary]\n"flight.duration" = {RANGE}', "is for a grid"),
    "too many keys": ("[vary]\n" + "".join(f"k{number} = [1]\n" for number in range(33)), "33 keys, more than 32"),
    "too many rows": ('[vary]\n"flight.duration" = { from = 1, to = 2, count = 2000000 }', f"more than {MOST_ROWS}"),
    "a map of what does not vary": (
        f'[vary]\n"flight.duration" = {RANGE}\n[result]\nmap = ["flight.duration", "h", "torque_peak"]',
        "result.map: 'h' does not vary",
    ),
    "not TOML": ("[vary", "is not TOML"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_files(study_file, case):
    text, message = WRONG[case]
    with pytest.raises(InputError) as caught:
        load(study_file, text)
    assert message in str(caught.value)
    assert "asked.toml" in str(caught.value)


def test_all_that_is_wrong_is_told_at_once(study_file):
    with pytest.raises(InputError) as caught:
        load(study_file, '[vary]\n"flight.durations" = [1]\n"goal.positions.q7" = [1]\n"flight.gravity" = [-1]')
    assert str(caught.value).count("\n") == 2


def test_the_hash_is_of_what_the_rows_follow_from(study_file, tmp_path):
    text = f'[vary]\n"flight.duration" = {RANGE}\n'
    asked = [load(study_file, more + text) for more in ("", "# a remark\n", "seed = 1\n")]
    asked.append(load(study_file, text + '[result]\nfolder = "elsewhere"'))
    asked.append(load(study_file, text + "[plan]\nstarts = 2"))
    first, remark, seed, folder, starts = (each.digest() for each in asked)
    assert first == remark == folder
    assert len({first, seed, starts}) == 3


@pytest.fixture(scope="module")
def validator():
    jsonschema.Draft202012Validator.check_schema(study_schema())
    return jsonschema.Draft202012Validator(study_schema())


class TestSchema:
    @pytest.mark.parametrize(
        "path", [path for path in STUDIES if "vary" in path.read_text()], ids=lambda path: path.stem
    )
    def test_admits_every_study(self, validator, path):
        assert list(validator.iter_errors(tomllib.loads(path.read_text()))) == []

    @pytest.mark.parametrize("case", ["no such key", "a whole table", "a word", "a frame", "the robot", "a text"])
    def test_refuses_paths_and_values_that_the_program_refuses(self, validator, case):
        path, value, _ = BAD[case]
        assert not validator.is_valid({"problem": "a.toml", "vary": tomllib.loads(f'"{path}" = [{value}]')})

    def test_the_command_prints_it(self, floatplan):
        assert json.loads(floatplan("schema", "study").stdout) == study_schema()


@pytest.mark.long
def test_the_versions_are_of_the_code_itself(tmp_path):
    shutil.copytree(ROOT / "floatplan", tmp_path / "floatplan", ignore=shutil.ignore_patterns("__pycache__"))
    code = "from floatplan.studies.file import versions; print(versions())"
    assert told(code, tmp_path).strip() == str(versions())
    with (tmp_path / "floatplan" / "motion" / "quadrature.py").open("a") as module:
        module.write("# changed\n")
    assert told(code, tmp_path).strip() != str(versions())


def test_a_worker_of_other_code_is_refused(study_file, monkeypatch):
    study = load(study_file, '[vary]\n"flight.duration" = [1.0]')
    monkeypatch.setattr(rows, "versions", lambda: {**versions(), "code": "0123456789abcdef"})
    content = packed(study)
    monkeypatch.undo()
    with pytest.raises(FloatplanError, match=r"0123456789abcdef.*: install the same everywhere"):
        planned_rows(content, 0, {"flight.duration": np.array([1.0])})
