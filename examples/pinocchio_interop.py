"""A plan in Pinocchio: ``plan.q``, ``plan.v``, ``plan.a`` and ``plan.tau`` are in the order of its free-flyer model.

So whatever is written on Pinocchio takes a plan as it is: here inverse dynamics, the centroidal momentum, and the place
of a frame.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin

import floatplan as fp

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"

plan = fp.plan(fp.load_problem(PROBLEMS / "handstand.toml"))
model = pin.buildModelFromUrdf(str(plan.robot.path), pin.JointModelFreeFlyer())
data = model.createData()

times = np.linspace(0.0, plan.duration, 50)
rows = zip(plan.q(times), plan.v(times), plan.a(times), plan.tau(times), strict=True)
wrench = momentum = 0.0
for q, v, a, tau in rows:
    torques = pin.rnea(model, data, q, v, a)
    assert np.allclose(torques, tau)
    wrench = max(wrench, float(np.abs(torques[:6]).max()))
    h = plan.robot.plane.normal @ pin.computeCentroidalMomentum(model, data, q, v).angular
    momentum = max(momentum, abs(float(h) - plan.angular_momentum))
print(f"nothing pushes the base: {wrench:.1e} N and N m at most")
print(f"the angular momentum is kept to {momentum:.1e} kg m^2/s")

pin.framesForwardKinematics(model, data, plan.q(plan.duration))
hand = data.oMf[model.getFrameId("hand")].translation
print(f"the hand lands at {hand.round(4)} m")
