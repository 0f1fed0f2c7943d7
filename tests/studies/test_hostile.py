"""Study files spoiled at random: a message and exit code 2, or rows that each have a status."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest
from fuzz_mutations import spoiled
from fuzz_runs import judge
from long_cases import cases

from floatplan.studies import file, maps

ROOT = Path(__file__).resolve().parents[2]
CASES, BATCH = 40, 20
TEXT = """
sampling = "grid"
seed = 3
[vary]
"flight.angular_momentum" = { from = 3.0, to = 4.0, count = 2 }
"goal.positions.q1" = [-60, -50]
[plan]
starts = 1
prove = false
[result]
folder = "out"
map = ["flight.angular_momentum", "goal.positions.q1", "torque_peak"]
"""


@pytest.mark.parametrize("first", cases(range(0, CASES, BATCH), [BATCH]))
def test_every_promise_is_kept(first, floatplan, tmp_path, monkeypatch):
    monkeypatch.setattr(file, "MOST_ROWS", 60)
    monkeypatch.setattr(maps, "DPI_OF_MAPS", 20)
    path = tmp_path / "asked.toml"
    broken = []
    for seed in range(first, first + BATCH):
        path.write_text(f'problem = "{ROOT / "problems" / "somersault.toml"}"\n{TEXT}', encoding="utf-8")
        path.write_bytes(spoiled(random.Random(seed), path))
        arguments = ["study", str(path), "-o", str(tmp_path / f"out{seed}"), "--jobs", "1", "--json"]
        began = time.process_time()
        run = floatplan(*arguments)
        broken += judge(seed, arguments, run.code, run.stdout, run.stderr, time.process_time() - began)
        assert run.code != 1, run.stderr
    assert not broken, "\n".join(map(str, broken))
