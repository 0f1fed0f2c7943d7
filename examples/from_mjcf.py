"""A robot from MJCF: a kangaroo, tipped forwards in the air, rights itself with its legs, its arms and its tail.

The file is MuJoCo's own format, compiled by MuJoCo: bodies, joints and their ranges, motors, masses from densities,
shapes. There is no angular momentum to turn with, so joints swing out and come back another way. The proof reads the
file without MuJoCo, which then flies the torques. Needs the extra `mjcf`.
"""

import sys
from math import degrees, radians
from pathlib import Path

import mujoco

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/from_mjcf")
FILE = HERE.parent / "urdf" / "kangaroo.xml"
TUCKED = {"hip": -60, "knee": 100, "ankle": -30, "shoulder": -60, "tail": 0}  # degrees

robot = fp.Robot.from_mjcf(FILE)
weighed = mujoco.MjModel.from_xml_path(str(FILE)).body_mass.sum()
print(f"{robot.name}: {', '.join(robot.joints)}; {robot.mass:.6f} kg, in MuJoCo {weighed:.6f} kg")

tucked = {name: radians(angle) for name, angle in TUCKED.items()}
problem = fp.Problem(
    robot,
    start=fp.Posture(radians(40), tucked),
    goal=fp.Posture(0.0, tucked),
    flight=fp.Flight(duration=0.6, angular_momentum=0.0),
    motion=fp.Motion(degree=9),
    limits=fp.Limits(torque="urdf"),
    name="righting",
)
plan = fp.plan(problem)
print(f"{plan.status}, {fp.certify(plan).verdict}")
for use in plan.utilisation:
    print(f"  {use.joint:8} {use.torque_peak:5.0f} of {use.torque_limit:.0f} N m")

landing = fp.replay(plan, engine="mujoco")
print(f"flown by MuJoCo, the trunk ends {degrees(landing.orientation_error):.0e} degrees off")

OUT.mkdir(parents=True, exist_ok=True)
plan.figures()["kinogram"].savefig(OUT / "from_mjcf.png", dpi=220)
