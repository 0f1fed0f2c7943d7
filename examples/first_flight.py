"""A first flight: a gymnast flips backwards from its foot to its foot, and the plan is proved.

A problem is a robot, a posture to start from, one to arrive at, and a flight between them. The answer is a motion of
the joints; the body turns as the angular momentum makes it turn. A stance reaches its takeoff, and another follows its
landing: the example of whole jumps finds such. The script leaves the plan, a page that plays it, and its picture.
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
    start=fp.Posture(radians(145), {"q1": radians(-60), "q2": radians(-20)}, velocities="takeoff"),
    goal=fp.Posture(radians(390), {"q1": radians(80), "q2": radians(-65)}, velocities="landing"),
    flight=fp.Flight(
        duration=0.53,
        angular_momentum=5.5,
        takeoff=fp.Takeoff("foot"),
        landing=fp.Landing("foot"),
        horizontal_velocity=-1.0,
    ),
    motion=fp.Motion(objective="torque"),
    limits=fp.Limits(position=[(radians(-130), radians(130))] * 2, velocity=30.0, torque=140.0),
    self_clearances=(fp.SelfClearance(("body0", "body2"), margin=0.05),),  # legs and arms pass one another in the tuck
    ground=True,
    name="backflip",
)

plan = fp.plan(problem)
print(f"{plan.status}: {plan.explanation or 'a motion that reaches the goal'}")
print(f"angular momentum {plan.angular_momentum:.4f} kg m^2/s, largest torques {plan.peaks.torque.round(2)} N m")

certificate = fp.certify(plan)
warnings = [warning.message for warning in plan.warnings] or "none"
print(f"for every instant of the flight: {certificate.verdict}; warnings: {warnings}")

plan.save(OUT / "backflip.json")  # enough to read it again: fp.load_plan
plan.show(OUT / "backflip.html", browse=False)
plan.figures()["snapshots"].savefig(OUT / "first_flight.png", dpi=220)
