"""An arm in space: it unfolds from a satellite that no thruster holds, and the antenna points home all the same.

With no angular momentum at all, whatever the arm does turns the satellite. Moved straight from stowed to reaching, it
would leave the antenna pointing elsewhere; the plan takes the way round that brings the satellite back.
"""

import sys
from math import degrees, radians
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/space_arm")
STOWED = {"shoulder": radians(120), "elbow": radians(-140), "wrist": radians(-60)}
REACHING = {"shoulder": radians(-10), "elbow": radians(50), "wrist": radians(20)}

robot = fp.Robot.from_urdf(HERE.parent / "urdf" / "space_arm.urdf")
problem = fp.Problem(
    robot,
    start=fp.Posture(0.0, STOWED),
    goal=fp.Posture(0.0, REACHING),
    flight=fp.Flight(duration=20.0, angular_momentum=0.0, gravity=0.0),
    limits=fp.Limits(velocity="urdf", torque="urdf"),
    name="space_arm",
)
plan = fp.plan(problem)
certificate = fp.certify(plan)
off = max(map(abs, certificate.orientation_end))
print(f"{plan.status}, {certificate.verdict}: the antenna ends at most {off:.0e} rad off")

# the same two postures, with every joint going straight from one to the other
times = np.linspace(0.0, plan.duration, 400)
begin, end = plan.joint_motion(times[[0, -1]])[0]
share = times / plan.duration
straight = begin + np.outer(share**3 * (10 - 15 * share + 6 * share**2), end - begin)
rates = np.gradient(straight, times, axis=0)
turning = plan.dynamics.base_rate(straight, rates, 0.0)
turned = np.append(0.0, np.cumsum(np.diff(times) * (turning[1:] + turning[:-1]) / 2))
print(f"straight there, it would end {degrees(turned[-1]):.1f} degrees off")

OUT.mkdir(parents=True, exist_ok=True)
plan.figures()["kinogram"].savefig(OUT / "space_arm.png", dpi=220)
with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure()
    axes = figure.subplots()
    axes.plot(times, np.degrees(plan.orientation(times)), label="as planned")
    axes.plot(times, np.degrees(turned), "--", label="straight from posture to posture")
    axes.set(xlabel="time (s)", ylabel="satellite turned by (degrees)", xlim=(0, plan.duration))
    axes.legend()
    figure.savefig(OUT / "space_arm_turns.png")
