"""Which angular momentum, and how much time? Torques over both, in a table.

Each cell is the largest torque, N m, of a plan for that angular momentum h and that duration T; "-" where none was
found in a second.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import floatplan as fp

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"
DURATIONS = np.linspace(1.2, 1.6, 3)  # s
MOMENTA = np.linspace(-1.75, -0.75, 5)  # kg m^2/s

problem = fp.load_problem(PROBLEMS / "handstand.toml")


def torque(momentum: float, duration: float) -> float:
    """Return the largest torque of the plan, N m; infinite where none is found."""
    flight = replace(problem.flight, angular_momentum=momentum, duration=duration)
    plan = fp.plan(replace(problem, flight=flight), budget=1.0)
    return float(plan.peaks.torque.max()) if plan.ok else np.inf


table = np.array([[torque(float(h), float(duration)) for h in MOMENTA] for duration in DURATIONS])

print("T, s  h: " + "".join(f"{h:8.2f}" for h in MOMENTA))
for duration, row in zip(DURATIONS, table, strict=True):
    print(f"{duration:8.2f} " + "".join(f"{value:8.2f}" if np.isfinite(value) else "       -" for value in row))
best = np.unravel_index(np.argmin(table), table.shape)
print(f"least torque {table[best]:.2f} N m: T = {DURATIONS[best[0]]:.2f} s, h = {MOMENTA[best[1]]:.2f} kg m^2/s")
