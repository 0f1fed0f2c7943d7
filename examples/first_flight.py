"""A first flight: a gymnast jumps from its feet into a handstand, and the plan is proved.

A problem is a robot, a posture to start from, one to arrive at, and a flight between them. The answer is a motion of
the joints; the body turns as the angular momentum makes it turn. The script leaves the plan, a page that plays it,
and its picture.
"""

import sys
from math import radians
from pathlib import Path

import floatplan as fp

ROBOTS = Path(__file__).resolve().parents[1] / "urdf"
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/first_flight")

robot = fp.Robot.from_urdf(ROBOTS / "gymnast.urdf")
problem = fp.Problem(
    robot,
    start=fp.Posture(radians(72), {"q1": radians(18), "q2": radians(-45)}),
    goal=fp.Posture(radians(-90), {"q1": 0.0, "q2": 0.0}),
    flight=fp.Flight(duration=1.4, takeoff=fp.Takeoff("foot"), landing=fp.Landing("hand"), horizontal_velocity=2.0),
    limits=fp.Limits(position="full"),
    name="handstand",
)

plan = fp.plan(problem)
print(f"{plan.status}: {plan.explanation or 'a motion that reaches the goal'}")
print(f"angular momentum {plan.angular_momentum:.4f} kg m^2/s, largest torques {plan.peaks.torque.round(2)} N m")

certificate = fp.certify(plan)
print(f"for every instant of the flight: {certificate.verdict}")

plan.save(OUT / "handstand.json")  # enough to read it again: fp.load_plan
plan.show(OUT / "handstand.html", browse=False)
plan.figures()["snapshots"].savefig(OUT / "first_flight.png", dpi=220)
