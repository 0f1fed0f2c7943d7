"""The same bits whatever the number of threads that BLAS may use; and that number is the user's again afterwards."""

import json
import os
import subprocess
import sys

import pytest
from places import ROOT

import floatplan as fp
from floatplan import pool

PROBLEM = "moving_hoop"  # whose sums are long enough to be shared among threads
STUDY = """
problem = "{problem}"
[vary]
"flight.angular_momentum" = {{ from = 2.8, to = 4.4, count = 6 }}
"flight.duration" = {{ from = 0.9, to = 1.4, count = 4 }}
"""
ANSWERS = """
import json, sys
import floatplan as fp
from floatplan.inflight import authority
authority.LARGEST = 0.02
folder, problem = sys.argv[1:]
plan = fp.load_plan(fp.plan(fp.load_problem(problem), prove=True).save(f"{folder}/plan.json"))
content = json.load(open(f"{folder}/plan.json"))
del content["solver"]["seconds"], content["certificate"]["seconds"]
print(json.dumps(content))
print(plan.at(plan.duration / 3).torques.tolist(), fp.authority(plan).momentum.tolist())
"""
TABLE = """
import sys
import floatplan as fp
folder, study, jobs = sys.argv[1:]
if __name__ == "__main__":
    jobs = int(jobs)
    print(fp.study(study, folder=f"{folder}/made", jobs=jobs).table.drop_columns(["milliseconds"]).to_pylist())
"""


def told(code, wanted, folder, *arguments):
    """What a script prints where BLAS may use so many threads; None: as many as it likes."""
    folder.mkdir()
    (folder / "script.py").write_text(code)
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    if wanted is not None:
        environment["OPENBLAS_NUM_THREADS"] = wanted
    command = [sys.executable, str(folder / "script.py"), str(folder), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout


@pytest.mark.long
def test_plans_are_the_same_bit_for_bit(tmp_path):
    problem = str(ROOT / "problems" / f"{PROBLEM}.toml")
    one, *others = (told(ANSWERS, wanted, tmp_path / f"{wanted}", problem) for wanted in ("1", "2", None))
    assert json.loads(one.splitlines()[0])["certificate"]["verdict"] == "proved"
    assert all(other == one for other in others)


@pytest.mark.long
def test_studies_are_the_same_bit_for_bit(tmp_path):
    """Whatever the number of their processes, too."""
    study = tmp_path / "study.toml"
    study.write_text(STUDY.format(problem=ROOT / "problems" / "somersault.toml"))
    one, two = (told(TABLE, wanted, tmp_path / wanted, str(study), wanted) for wanted in ("1", "2"))
    assert len(one) > 1000
    assert two == one


@pytest.mark.parametrize(
    "compute", [fp.plan, lambda problem: fp.plan_many([problem]), fp.takeoff], ids=["plan", "plan_many", "takeoff"]
)
def test_public_calls_hold_numpys_library_and_give_it_back(compute, monkeypatch):
    (blas, *_) = pool._libraries()
    problem = fp.load_problem(ROOT / "problems" / "obstacle.toml")
    seen = []
    monkeypatch.setattr(type(blas), "set_num_threads", lambda _, count: seen.append(count))
    monkeypatch.setattr(type(blas), "num_threads", 4)
    compute(problem)
    assert seen[0] == 1
    assert seen[-1] == 4
