"""The interval for h by hand: equations (7) to (10) of the paper, for the gymnast's flight into a handstand.

Angular momentum is kept: D_0 theta' + D_1 q_1' + D_2 q_2' = h (4). If no joint turned back on its way, each term,
integrated over the flight, would lie between the change of its angle times the least and the greatest D_i that any
joint angles give (7), (8). So would h T: an interval for h (9), whose middle (10) is a good choice.
"""

import sys
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/bounds_by_hand")

problem = fp.load_problem(HERE.parent / "problems" / "handstand.toml")
plan = fp.plan(problem)

# D_i over all joint angles: what momentum base and joints make at a rate of 1 rad/s
angles = np.linspace(-np.pi, np.pi, 121)
grid = np.stack(np.meshgrid(angles, angles, indexing="ij"), axis=-1).reshape(-1, 2)
inertias = plan.dynamics.momentum_map(grid)
least, greatest = inertias.min(axis=0), inertias.max(axis=0)

start, goal = problem.initial, problem.final
changes = np.array([goal.orientation - start.orientation, *(goal.positions - start.positions)])
terms = np.sort(changes * np.array([least, greatest]) / plan.duration, axis=0)  # (2, 3) kg m^2/s: sorted, as a change
low, high = terms.sum(axis=1)  # backwards swaps the ends
names = ("base", *problem.robot.joints)
for name, *row in zip(names, np.degrees(changes), least, greatest, strict=True):
    print(f"{name:5} turns {row[0]:7.1f} degrees, D from {row[1]:6.3f} to {row[2]:.3f} kg m^2")
print(f"h from {low:.4f} to {high:.4f} (9), middle {(low + high) / 2:.4f} kg m^2/s (10)")
print(f"floatplan's, enclosed: {plan.angular_momentum_bounds}, {plan.angular_momentum:.4f}")

OUT.mkdir(parents=True, exist_ok=True)
with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure(figsize=(7.0, 4.0))
    maps, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.7, 1))[:, 0]
    along = np.degrees(plan.joint_motion(np.linspace(0.0, plan.duration, 300))[0])
    for index, axes in enumerate(maps.subplots(1, 3, sharey=True)):
        shown = inertias[:, index].reshape(len(angles), -1).T
        filled = axes.contourf(np.degrees(angles), np.degrees(angles), shown, levels=12, cmap="cividis")
        axes.plot(*along.T, color="white", linewidth=1.6)
        axes.plot(*along[0], "o", color="white", markerfacecolor="none", markersize=4)
        axes.plot(*along[-1], "o", color="white", markersize=4)
        axes.set(
            title=f"D_{index} (kg m²)", xlabel="q1 (degrees)", aspect="equal", ylabel="" if index else "q2 (degrees)"
        )
        axes.grid(False)
        maps.colorbar(filled, ax=axes, shrink=0.9)
    axes = below.subplots()
    for height, ends in enumerate((*terms.T, (low, high))):
        axes.barh(height, ends[1] - ends[0], left=ends[0], height=0.55, color="#222222" if height == 3 else "#0072B2")
    axes.plot((low + high) / 2, 3, "|", color="white", markersize=9)
    axes.margins(x=0.04)
    axes.set(yticks=range(4), yticklabels=(*names, "h (9)"), xlabel="kg m²/s")
    axes.invert_yaxis()
    figure.savefig(OUT / "bounds_by_hand.png")
