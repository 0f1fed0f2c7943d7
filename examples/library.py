"""A library of flips: Go2 backflips within the motors' limits, each proved, as reference motions for learning.

`problems/studies/go2_library.toml` asks for 100 000, over seven numbers: flight time, angular momentum, speed, takeoff,
and how the feet meet the ground. This plans the first 100, or as many as the second argument says, in one process,
writes their motions, and measures how long the whole would take. The whole is one command, which goes on where it was
interrupted: `floatplan study problems/studies/go2_library.toml --export isaac-amp --rate 60`. Needs the extra `study`.
"""

import json
import sys
import time
from pathlib import Path

import floatplan as fp

STUDIES = Path(__file__).resolve().parents[1] / "problems" / "studies"
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/library")
ROWS = int(sys.argv[2] if sys.argv[2:] else 100)
ALL = 100_000


def flips(rows: int) -> fp.Study:
    """The first rows of the study, planned in this process: a row is the same whatever their number is."""
    text = (STUDIES / "go2_library.toml").read_text(encoding="utf-8")
    text = text.replace('problem = "', f'problem = "{STUDIES.as_posix()}/')
    file = OUT / f"first_{rows}.toml"
    file.write_text(text.replace(f"samples = {ALL:_}", f"samples = {rows}"), encoding="utf-8")
    return fp.study(file, folder=OUT / file.stem, restart=True, jobs=1)


OUT.mkdir(parents=True, exist_ok=True)
flips(2).export("isaac-amp", 60, jobs=1)  # so that what is loaded does not count
began = time.process_time()
study = flips(ROWS)
planned = time.process_time() - began
verdicts = study.table["verdict"].to_pylist()
print(f"{len(study)} flips asked for, {verdicts.count('proved')} planned and proved")

began = time.process_time()
index = study.export("isaac-amp", 60, jobs=1)
written = time.process_time() - began
motions = json.loads(index.read_text(encoding="utf-8"))["motions"]
size = sum((index.parent / motion["file"]).stat().st_size for motion in motions)
print(f"a flip: {1e3 * planned / ROWS:.0f} ms to plan and prove, {1e3 * written / ROWS:.0f} ms to write, on one core")
print(f"{ALL} of them, extrapolated: {ALL * (planned + written) / ROWS / 2 / 3600:.1f} hours on two cores,")
print(f"{ALL * size / len(motions) / 1e9:.0f} GB")

(least,) = study.best(1, by="torque_peak").to_pylist()
duration, momentum = least["flight.duration"], least["flight.angular_momentum"]
print(f"least torque: {least['torque_peak']:.1f} N m, in a flight of {duration:.2f} s with {momentum:.2f} kg m^2/s")
study.heatmap("flight.duration", "flight.angular_momentum", "torque_peak").savefig(OUT / "library.png", dpi=200)
