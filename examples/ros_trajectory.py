"""To ROS 2, and how many points it takes: a JointTrajectory, and what a controller makes of it between its points.

A joint trajectory controller joins points by lines where they have positions alone, by cubics where they have
velocities, and by polynomials of degree five where they have accelerations, as this file's do. In flight an error of
the joints is more than that: the body turns by what the joints really do. What each way costs, over the rate of the
points. Needs `pyyaml`.
"""

import sys
from math import degrees
from pathlib import Path

import matplotlib.style
import numpy as np
import yaml
from matplotlib.figure import Figure
from scipy.interpolate import BPoly

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/ros_trajectory")
RATES = (5, 10, 20, 50, 100)  # points a second
KEYS = ("positions", "velocities", "accelerations")
WAYS = {"lines": KEYS[:1], "with velocities": KEYS[:2], "with accelerations too": KEYS}

plan = fp.plan(fp.load_problem(HERE.parent / "problems" / "somersault.toml"))
times = np.linspace(0.0, plan.duration, 20001)


def controlled(rate: float, keys: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """What a controller makes of so much of the file: positions and velocities (N, n) of the planned joints."""
    message = yaml.safe_load(plan.export("ros", OUT / f"trajectory_{rate}.yaml", rate=rate).read_text())
    order = [message["joint_names"].index(name) for name in plan.robot.joints]
    points = message["points"]
    at = [point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in points]
    known = np.array([[point[key] for key in keys] for point in points])
    joined = BPoly.from_derivatives(at, known[:, :, order])
    return joined(times), joined.derivative()(times)


def missed(positions: np.ndarray, velocities: np.ndarray) -> float:
    """By how much the body misses its orientation at landing, degrees."""
    rates = plan.dynamics.base_rate(positions, velocities, plan.angular_momentum)
    return abs(degrees(plan.problem.initial.orientation + np.trapezoid(rates, times) - plan.final_orientation))


print(f"{'points a second':32}" + "".join(f"{rate:9}" for rate in RATES))
misses = {}
for name, keys in WAYS.items():
    misses[name] = [missed(*controlled(rate, keys)) for rate in RATES]
    print(f"{name:32}" + "".join(f"{miss:9.1e}" for miss in misses[name]))
print("(degrees that the body lands off)")

with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure(figsize=(5.6, 3.2))
    axes = figure.subplots()
    for name, miss in misses.items():
        axes.loglog(RATES, miss, "o-", label=name)
    axes.set(xlabel="points a second", ylabel="body off at landing (degrees)")
    axes.set_xticks(RATES, map(str, RATES))
    axes.minorticks_off()
    axes.legend()
    figure.savefig(OUT / "ros_trajectory.png")
