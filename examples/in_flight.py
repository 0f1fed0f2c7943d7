"""Corrections in flight: a gymnast takes off with a tenth too much angular momentum, and lands as planned all the same.

The loop below is the one that runs on a robot. Here a simulation stands in for sensors and motors: joints that do what
they are told, and a base that turns as the angular momentum makes it turn.
"""

from math import degrees
from pathlib import Path

import floatplan as fp

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"
PERIOD = 0.005  # [s]

plan = fp.plan(fp.load_problem(PROBLEMS / "somersault.toml"))
momentum = 1.1 * plan.angular_momentum  # what the robot really took off with


def fly(correct: bool) -> float:
    """Fly with or without corrections; by how much the landing misses, degrees."""
    replanner = fp.Replanner(plan, rate=1 / PERIOD)
    orientation, t = plan.problem.initial.orientation, 0.0
    while t < replanner.landing - 1e-9:
        reference = replanner.reference(t)  # positions, velocities and motors go to the joints' control
        rate = plan.dynamics.base_rate(reference.positions[None], reference.velocities[None], momentum)[0]
        if correct:
            found = replanner.update(t, orientation, rate, reference.positions, reference.velocities)
            if found.status != "applied":
                print(f"{t:.3f} s: {found.status}, {found.reason}; {degrees(found.predicted_miss):.2f} degrees off")
        middle = replanner.reference(t + PERIOD / 2)
        orientation += PERIOD * plan.dynamics.base_rate(middle.positions[None], middle.velocities[None], momentum)[0]
        t += PERIOD
    return degrees(orientation - plan.problem.final.orientation)


print(f"without corrections {abs(fly(False)):.1f} degrees off, with them {abs(fly(True)):.2f}: lands as planned")
