"""Kills a study at random moments and resumes it: ``scripts/kill_study.py [--kills 20] [--jobs 2] [--seed 0]``.

The runs that were killed have to end with the table of a run left alone, bit for bit but for the rows' times.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pyarrow.parquet as pq

ROOT = Path(__file__).resolve().parents[1]
STUDY = f"""
problem = "{ROOT / "problems" / "somersault.toml"}"
[vary]
"flight.angular_momentum" = {{ from = 3.2, to = 4.0, count = 100 }}
"flight.duration" = {{ from = 0.95, to = 1.15, count = 100 }}
[plan]
starts = 32
"""


def started(study: Path, folder: Path, jobs: int) -> subprocess.Popen[bytes]:
    """Start the study, or go on with it."""
    command = [sys.executable, "-m", "floatplan", "study", str(study), "-o", str(folder), "--jobs", str(jobs), "-q"]
    return subprocess.Popen(command, cwd=ROOT)


def main() -> None:
    """Kill and compare; exit code 1 where the tables differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as made:
        study, alone, killed = (Path(made) / name for name in ("asked.toml", "alone", "killed"))
        study.write_text(STUDY, encoding="utf-8")
        began = time.monotonic()
        started(study, alone, options.jobs).wait()
        seconds = time.monotonic() - began
        expected = pq.read_table(alone / "results.parquet").drop_columns(["milliseconds"])
        for number in range(options.kills):
            process = started(study, killed, options.jobs)
            life = rng.uniform(0, seconds)
            try:
                process.wait(life)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            chunks = sorted((killed / "chunks").glob("*.parquet"))
            rows = sum(pq.read_metadata(chunk).num_rows for chunk in chunks)
            print(f"{number + 1}: killed after {life:.2f} s, {rows} of {len(expected)} rows kept", flush=True)
            if process.returncode == 0 or rows == len(expected):  # there is to be something left to do
                for chunk in rng.sample(chunks, 1 + len(chunks) // 2):
                    chunk.unlink()
        if started(study, killed, options.jobs).wait() != 0:
            raise SystemExit("the last run failed")
        same = pq.read_table(killed / "results.parquet").drop_columns(["milliseconds"]).equals(expected)
    print("the same table" if same else "another table")
    raise SystemExit(0 if same else 1)


if __name__ == "__main__":
    main()
