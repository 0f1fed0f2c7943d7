"""Something in the way: the flight of the first example, around a bar seen end on, and what passing it costs.

Searches from several starts find the better of several ways past.

The plan keeps its distance at every instant, also between those that the search looks at.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import floatplan as fp

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"

problem = fp.load_problem(PROBLEMS / "handstand.toml")
free = fp.plan(problem, starts=4)

bar = fp.Circle(center=(1.485, 3.342), radius=0.2, margin=0.02)
times = np.linspace(0.0, free.duration, 500)
print(f"without heed of the bar the robot comes to {free.clearances(times, [bar]).min():.3f} m from it")

around = fp.plan(replace(problem, obstacles=(bar,), name="around"), starts=4)
print(f"with it: {around.status}, nearest {around.peaks.clearance:.4f} m; {fp.certify(around).verdict}")
print(f"objective {free.objective_value:.3f} without, {around.objective_value:.3f} with the bar")

wall = fp.Bar(start=(1.5, 0.0), end=(1.5, 9.0), radius=0.02)
blocked = fp.plan(replace(problem, obstacles=(wall,), name="blocked"))
print(f"a wall: {blocked.explanation}")
