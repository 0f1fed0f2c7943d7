"""Your own robot: a URDF, here one written on the spot, is all that floatplan needs to know of it.

A platform carries an arm of two links, and nothing holds the platform: it floats. The arm moves so that the platform
turns by 20 degrees while the arm comes back to where it was, without any angular momentum: as a falling cat does it.
"""

import sys
from math import radians
from pathlib import Path

import floatplan as fp

OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/own_robot")
LINK = """
<link name="{name}"><inertial>
  <origin xyz="{center} 0 0"/><mass value="{mass}"/>
  <inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/>
</inertial></link>"""
JOINT = """
<joint name="{name}" type="revolute">
  <parent link="{parent}"/><child link="{child}"/><origin xyz="{place} 0 0"/><axis xyz="0 0 1"/>
  <limit lower="-2.6" upper="2.6" effort="5" velocity="12"/>
</joint>"""

text = "".join(
    [
        '<robot name="floater">',
        LINK.format(name="platform", center=0.0, mass=4.0, inertia=0.05),
        LINK.format(name="upper_arm", center=0.2, mass=1.5, inertia=0.02),
        LINK.format(name="forearm", center=0.2, mass=1.0, inertia=0.014),
        JOINT.format(name="shoulder", parent="platform", child="upper_arm", place=0.15),
        JOINT.format(name="elbow", parent="upper_arm", child="forearm", place=0.4),
        "</robot>",
    ]
)
OUT.mkdir(parents=True, exist_ok=True)
path = OUT / "floater.urdf"
path.write_text(text, encoding="utf-8")

robot = fp.Robot.from_urdf(path)  # plane=, joints=, locked= and coupled= settle what a file leaves open
print(f"{robot.name}: plane {robot.plane.name}, joints {', '.join(robot.joints)}, {robot.mass} kg")

tucked = {"shoulder": 0.4, "elbow": 0.8}
problem = fp.Problem(
    robot,
    start=fp.Posture(0.0, tucked),
    goal=fp.Posture(radians(20), tucked),
    flight=fp.Flight(duration=2.0, angular_momentum=0.0, gravity=0.0),
    limits=fp.Limits(torque="urdf", velocity="urdf"),
    name="turn",
)
plan = fp.plan(problem)
print(f"{plan.status}: {plan.explanation or 'the platform turns'}")
for use in plan.utilisation:
    print(f"{use.joint}: at most {use.torque_peak:.2f} of {use.torque_limit} N m")
plan.figures()["kinogram"].savefig(OUT / "own_robot.png", dpi=220)
