"""A falling cat: no angular momentum at all, and yet the body turns while the joints come back to where they began.

What turns it is the loop that the joints run through: the same loop run backwards turns it back, and a way there and
back along the same line turns nothing. The picture shows the loop in the plane of the two joints.
"""

import sys
from math import degrees
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/falling_cat")

plan = fp.plan(fp.load_problem(HERE.parent / "problems" / "falling_cat_apart.toml"), prove=True)
times = np.linspace(0.0, plan.duration, 600)
q, v, _ = plan.joint_motion(times)
print(f"angular momentum {plan.angular_momentum}; the body turns by {degrees(plan.final_orientation):.2f} degrees")


def turn(angles: np.ndarray) -> float:
    """By how much the body turns while the joints run along a way (K, 2) in the time of the plan, degrees."""
    rates = plan.dynamics.base_rate(angles, np.gradient(angles, times, axis=0), 0.0)
    return degrees(np.trapezoid(rates, times))


middle = len(times) // 2
there_and_back = np.concatenate((q[:middle], q[:middle][::-1]))
print(f"the loop run backwards: {turn(q[::-1]):.2f} degrees; there and back: {abs(turn(there_and_back)):.2f}")

OUT.mkdir(parents=True, exist_ok=True)
plan.figures()["kinogram"].savefig(OUT / "falling_cat.png", dpi=220)
with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure()
    left, right = figure.subplots(1, 2)
    left.plot(*np.degrees(q).T)
    for part in range(5, 100, 12):
        at = part * len(times) // 100
        left.annotate(
            "", np.degrees(q[at + 4]), np.degrees(q[at]), arrowprops={"arrowstyle": "-|>", "color": "#0072B2"}
        )
    left.plot(*np.degrees(q[0]), "ko", markersize=4)
    left.set(xlabel="q1 (degrees)", ylabel="q2 (degrees)", title="the loop of the joints")
    right.plot(times, np.degrees(plan.orientation(times)), color="#D55E00")
    right.set(xlabel="time (s)", ylabel="body (degrees)", title="what it turns", xlim=(0, plan.duration))
    figure.savefig(OUT / "falling_cat_loop.png")
