"""Weak motors: the same flight, with four fifths of the torque that it took without limits.

The plan with limits pushes harder at the beginning, where there was room, so that less is left to stop at the end. A
motor may also lose torque with speed, as all do: `fp.Motor` has a stall torque and a slope. Limits hold at every
instant, and the proof says so.
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/weak_motors")

problem = fp.load_problem(HERE.parent / "problems" / "new_configuration.toml")
free = fp.plan(problem)
wanted = dict(zip(problem.robot.joints, 0.8 * free.peaks.torque, strict=True))
weak = fp.plan(replace(problem, limits=fp.Limits(position="full", torque=wanted), name="weak motors"))
motors = {joint: fp.Motor(stall=1.3 * torque, slope=0.12) for joint, torque in wanted.items()}
fading = fp.plan(replace(problem, limits=fp.Limits(position="full", motor=motors), name="fading motors"))

for name, plan in (("without limits", free), ("four fifths of it", weak), ("fading with speed", fading)):
    print(f"{name:18} {plan.status:8} torques up to {plan.peaks.torque.round(2)} N m, {fp.certify(plan).verdict}")

OUT.mkdir(parents=True, exist_ok=True)
times = np.linspace(0.0, problem.flight.duration, 400)
with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure(figsize=(7.0, 3.2))
    for index, (axes, joint) in enumerate(zip(figure.subplots(1, 2), problem.robot.joints, strict=True)):
        axes.plot(times, free.at(times).torques[:, index], "--", label="without limits")
        axes.plot(times, weak.at(times).torques[:, index], label="four fifths of the torque")
        axes.plot(times, fading.at(times).torques[:, index], label="fading with speed")
        for sign in (-1, 1):
            axes.axhline(sign * wanted[joint], color="#D55E00", linewidth=0.8, linestyle=(0, (6, 3)))
        axes.set(title=joint, xlabel="time (s)", ylabel="torque (N m)", xlim=(0, times[-1]))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    figure.savefig(OUT / "weak_motors.png")
