"""Something in the way: a pole, seen end on, in the path of the flight into a handstand; and a wall.

There are several ways past; a search from several starts takes the best that it finds. The plan keeps its distance at
every instant, also between those that the search looks at, and the proof says so. Where no plan is found, the answer
says what is missing.
"""

import sys
from dataclasses import replace
from pathlib import Path
from textwrap import fill

import numpy as np

import floatplan as fp

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/obstacle")

problem = fp.load_problem(PROBLEMS / "handstand.toml")
free = fp.plan(problem, starts=4)

pole = fp.Circle(center=(1.485, 3.342), radius=0.2, margin=0.02)
times = np.linspace(0.0, free.duration, 500)
print(f"without heed of the pole the robot comes to {free.clearances(times, [pole]).min():.3f} m from it")

around = fp.plan(replace(problem, obstacles=(pole,), name="around"), starts=4)
print(f"with it: {around.status}, nearest {around.peaks.clearance:.4f} m; {fp.certify(around).verdict}")
print(f"objective {free.objective_value:.3f} without, {around.objective_value:.3f} with the pole")

wall = fp.Bar(start=(1.5, 0.0), end=(1.5, 9.0), radius=0.02)
blocked = fp.plan(replace(problem, obstacles=(wall,), name="blocked"))
print(fill(f"a wall: {blocked.explanation.partition('. ')[0]}.", 90))

OUT.mkdir(parents=True, exist_ok=True)
drawn = around.figures(compare=free)
drawn["snapshots"].savefig(OUT / "obstacle.png", dpi=220)
drawn["comparison"].savefig(OUT / "obstacle_beside.png", dpi=220)
