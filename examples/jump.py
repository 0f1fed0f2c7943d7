"""A whole jump: a gymnast stands on its foot, turns a somersault, and stands again, within its motors' limits.

The flight is proved, the stances are checked 2000 times a second: torques, rates, friction, and that the foot only
pushes. The pictures show the forces on the foot in their friction cones, and what of its motors the jump uses. Needs
the extra `jump`.
"""

import sys
from pathlib import Path

import numpy as np

import floatplan as fp

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/jump")

jump = fp.jump(PROBLEMS / "jumps" / "gymnast.toml")
assert jump.flight is not None, jump.explanation
print(f"flight {fp.certify(jump.flight).verdict}; {jump.explanation}")
for phase in jump.phases:
    standing = f"on {' and '.join(phase.contacts)}" if phase.contacts else "in the air"
    print(f"{phase.begin:.3f} to {phase.end:.3f} s: {standing}")

pushes = jump.forces(np.linspace(0.0, jump.duration, 2000))["foot"] @ jump.problem.robot.plane.vertical
weight = jump.problem.robot.mass * 9.81
print(f"the foot pushes with {pushes[0] / weight:.3f} of the weight standing, {pushes.max() / weight:.1f} at most")

jump.save(OUT / "jump.json")
drawn = jump.figures()
drawn["moments"].savefig(OUT / "jump.png", dpi=200)
for name in ("forces", "torque_use"):
    drawn[name].savefig(OUT / f"jump_{name}.png", dpi=200)
