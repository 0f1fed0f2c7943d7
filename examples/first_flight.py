"""A first flight: a gymnast jumps from its feet into a handstand, and the plan is proved.

Run it in any folder; it leaves ``handstand.json`` (the plan) and ``handstand.html`` (a page that plays it) there.
"""

from math import radians
from pathlib import Path

import floatplan as fp

ROBOTS = Path(__file__).resolve().parents[1] / "urdf"

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

plan.save("handstand.json")
plan.show("handstand.html", browse=False)
