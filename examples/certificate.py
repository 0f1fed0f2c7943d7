"""How sharp is a proof? The same flight past a pole, judged for margins that it keeps, and for some that it does not.

The proof encloses the whole flight by ball arithmetic, from the plan's file and its URDF alone: it shares no dynamics
with the planner. What it says is "proved", "refuted", with the instant, or "undecided", never a guess. Here the plan
keeps 20 mm; it is asked whether it keeps a little less, and a little more. The picture shows the distance along the
flight, and where the line between the two falls.
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/certificate")

plan = fp.plan(fp.load_problem(HERE.parent / "problems" / "obstacle.toml"))
times = np.linspace(0.0, plan.duration, 2000)
clearance = plan.clearances(times)
print(f"nearest of {len(times)} instants: {1000 * clearance.min():.6f} mm")


def judged(margin: float) -> fp.Certificate:
    """The same motion, asked to keep another distance, m."""
    (pole,) = plan.problem.obstacles
    return fp.certify(replace(plan, problem=replace(plan.problem, obstacles=(replace(pole, margin=margin),))))


for less in (1e-3, 1e-6, 1e-9, -1e-6, -1e-3):
    found = judged(0.02 - less)
    where = [finding.instant for finding in found.findings if finding.verdict == "refuted"]
    print(f"margin {1000 * (0.02 - less):11.6f} mm: {found.verdict}" + (f" at {where[0]:.4f} s" if where else ""))
certificate = judged(0.02)
low, high = certificate.orientation_end
print(f"orientation at landing enclosed to {high - low:.0e} rad")
print(f"torques at most {np.round(certificate.torque_peak, 3)} N m")

OUT.mkdir(parents=True, exist_ok=True)
near = np.linspace(0.7, 0.745, 300)
with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure()
    flight, closer = figure.subplots(1, 2)
    flight.plot(times, clearance)
    flight.set(xlabel="time (s)", ylabel="distance from the pole (m)", xlim=(0, plan.duration), ylim=(0, None))
    closer.plot(near, 1000 * plan.clearances(near))
    closer.axhspan(19, 20, color="#009E73", alpha=0.2, linewidth=0, label="margins that are proved")
    closer.axhspan(20, 23, color="#D55E00", alpha=0.2, linewidth=0, label="margins that are refuted")
    closer.set(xlabel="time (s)", ylabel="distance, or margin (mm)", xlim=near[[0, -1]], ylim=(19.5, 22))
    figure.legend(*closer.get_legend_handles_labels(), loc="outside upper right", ncols=2)
    figure.savefig(OUT / "certificate.png")
