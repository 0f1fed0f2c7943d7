"""Which angular momentum, and how much time? 2400 somersaults, planned at once, and which is the calmest.

`fp.plan_many` takes one problem and arrays of what differs. Without obstacles and limits on rates and torques a
compiled kernel plans them all together. The answers are arrays, with NaN where no plan was found; any of them is a
plan that can be drawn, proved and flown.
"""

import sys
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/sweep")

problem = fp.load_problem(HERE.parent / "problems" / "somersault.toml")
momenta, durations = np.linspace(2.8, 4.4, 60), np.linspace(0.9, 1.4, 40)  # kg m^2/s, s
asked = np.stack(np.meshgrid(momenta, durations), axis=-1).reshape(-1, 2)
family = fp.Family(problem, {"flight.angular_momentum": asked[:, 0], "flight.duration": asked[:, 1]})

plans = fp.plan_many(family)
swing = plans.objective  # (17), the norm of all coefficients; NaN where no plan was found
best = plans[int(np.nanargmin(swing))]
print(f"{np.count_nonzero(plans.ok)} of {len(asked)} found, with {plans.evaluations.sum()} motions evaluated")
print(f"calmest: h = {best.angular_momentum:.3f} kg m^2/s, T = {best.duration:.3f} s")
print(f"it takes {best.peaks.torque.max():.1f} N m at most")
print(f"that plan is {fp.certify(best).verdict}")

OUT.mkdir(parents=True, exist_ok=True)
with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure(figsize=(5.6, 3.4))
    axes = figure.subplots()
    cells = swing.reshape(len(durations), -1)
    drawn = axes.pcolormesh(momenta, durations, cells, cmap="viridis_r", shading="nearest", norm=LogNorm())
    axes.plot(best.angular_momentum, best.duration, "*", color="white", markersize=12, markeredgecolor="black")
    axes.set(xlabel="angular momentum h (kg m²/s)", ylabel="duration T (s)")
    axes.grid(False)
    figure.colorbar(drawn, label="objective (17): calm below, wild above")
    figure.savefig(OUT / "sweep.png")
best.figures()["kinogram"].savefig(OUT / "sweep_best.png", dpi=220)
