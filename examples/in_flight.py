"""Corrections in flight: a gymnast takes off with a tenth too much angular momentum, and lands as planned all the
same.

The loop in `fly` is the one that runs on a robot. Here a simulation stands in for sensors and motors: joints that do
what they are told, and a base that turns as the angular momentum makes it turn.
"""

import sys
from math import degrees
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/in_flight")
PERIOD = 0.005  # [s]

plan = fp.plan(fp.load_problem(HERE.parent / "problems" / "somersault.toml"))
momentum = 1.1 * plan.angular_momentum  # what the robot really took off with


def fly(correct: bool) -> np.ndarray:
    """Fly with or without corrections; time, orientation, and positions of the joints, row by row."""
    replanner = fp.Replanner(plan, rate=1 / PERIOD)
    orientation, t, flown = plan.problem.initial.orientation, 0.0, []
    while t < replanner.landing - 1e-9:
        reference = replanner.reference(t)  # positions, velocities and motors go to the joints' control
        rate = plan.dynamics.base_rate(reference.positions[None], reference.velocities[None], momentum)[0]
        flown.append((t, orientation, *reference.positions))
        if correct:
            found = replanner.update(t, orientation, rate, reference.positions, reference.velocities)
            if found.status != "applied":
                print(f"{t:.3f} s: {found.status}, {found.reason}; {degrees(found.predicted_miss):.2f} degrees off")
        middle = replanner.reference(t + PERIOD / 2)
        orientation += PERIOD * plan.dynamics.base_rate(middle.positions[None], middle.velocities[None], momentum)[0]
        t += PERIOD
    return np.array([*flown, (t, orientation, *replanner.reference(t).positions)])


blind, corrected = fly(False), fly(True)
missed, met = (abs(degrees(flown[-1, 1] - plan.problem.final.orientation)) for flown in (blind, corrected))
print(f"without corrections {missed:.1f} degrees off, with them {met:.2f}: lands as planned")

OUT.mkdir(parents=True, exist_ok=True)
with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure(figsize=(7.0, 3.2))
    body, *joints = figure.subplots(1, 3)
    body.plot(corrected[:, 0], np.degrees(corrected[:, 1] - plan.orientation(corrected[:, 0])), label="corrected")
    body.plot(blind[:, 0], np.degrees(blind[:, 1] - plan.orientation(blind[:, 0])), "--", label="as planned")
    body.set(title="body, off the plan (degrees)", xlabel="time (s)")
    for index, (axes, name) in enumerate(zip(joints, plan.robot.joints, strict=True)):
        axes.plot(corrected[:, 0], np.degrees(corrected[:, 2 + index]))
        axes.plot(blind[:, 0], np.degrees(blind[:, 2 + index]), "--")
        axes.set(title=f"{name} (degrees)", xlabel="time (s)")
    figure.legend(*body.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    figure.savefig(OUT / "in_flight.png")
