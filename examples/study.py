"""A study: how weak may the motors be, and how long the flight? A table on disk, which is resumed, and read later.

A study file names a problem and what varies; `floatplan study` and `fp.study` plan every row, on all processors or
many machines, in chunks that a killed run leaves whole. The table is Parquet, so whatever reads that can go on with
it; any row is a plan, proved when asked for. Needs the extra `study`.
"""

import sys
from pathlib import Path

import floatplan as fp

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/study")
STUDY = f"""
problem = "{(PROBLEMS / "new_configuration_midpoint.toml").as_posix()}"

[vary]
"limits.torque.q1" = {{ from = 1.2, to = 2.6, count = 15 }}  # N m
"flight.duration" = {{ from = 0.9, to = 1.4, count = 11 }}   # s

[result]
map = ["limits.torque.q1", "flight.duration", "utilisation"]
"""


def main() -> None:
    """Plan all rows, look at the best."""
    OUT.mkdir(parents=True, exist_ok=True)
    file = OUT / "weak_motors.toml"
    file.write_text(STUDY, encoding="utf-8")
    study = fp.study(file, folder=OUT / "results")
    print(", ".join(f"{count} {status}" for status, count in study.statuses.items()))

    again = fp.study(file, folder=OUT / "results")  # all rows are there: none is planned again
    print(f"resumed: {len(again)} rows, {again.table.num_columns} columns")

    (row,) = again.best(1, by="torque_peak.q1").to_pylist()
    plan = again.plan(row["index"])
    assert plan.certificate is not None
    asked = f"T = {row['flight.duration']} s with {row['limits.torque.q1']:.1f} N m"
    print(f"the least torque of q1 is {row['torque_peak.q1']:.2f} N m: {asked}; {plan.certificate.verdict}")
    study.heatmap("limits.torque.q1", "flight.duration", "status").savefig(OUT / "study.png", dpi=200)


if __name__ == "__main__":  # the processes that plan import this file
    main()
