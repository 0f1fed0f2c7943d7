"""A plan in Pinocchio: `plan.q`, `plan.v`, `plan.a` and `plan.tau` are in the order of its free-flyer model.

So whatever is written on Pinocchio takes a plan as it is: here inverse dynamics, the centroidal momentum, the place
of a frame, and the kinetic energy. What of that is not the flight of the centre of mass changes by what the motors
put in and take out.
"""

import sys
from pathlib import Path

import matplotlib.style
import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure
from scipy.integrate import cumulative_trapezoid

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/pinocchio_interop")

plan = fp.plan(fp.load_problem(HERE.parent / "problems" / "handstand.toml"))
model = pin.buildModelFromUrdf(str(plan.robot.path), pin.JointModelFreeFlyer())
data = model.createData()

times = np.linspace(0.0, plan.duration, 400)
rows = zip(plan.q(times), plan.v(times), plan.a(times), plan.tau(times), strict=True)
wrench = momentum = 0.0
energy, power = [], []
for q, v, a, tau in rows:
    torques = pin.rnea(model, data, q, v, a)
    assert np.allclose(torques, tau)
    wrench = max(wrench, float(np.abs(torques[:6]).max()))
    h = plan.robot.plane.normal @ pin.computeCentroidalMomentum(model, data, q, v).angular
    momentum = max(momentum, abs(float(h) - plan.angular_momentum))
    pin.centerOfMass(model, data, q, v)
    energy.append(pin.computeKineticEnergy(model, data, q, v) - plan.robot.mass * data.vcom[0] @ data.vcom[0] / 2)
    power.append(tau[6:] @ v[6:])
work = cumulative_trapezoid(np.array(power), times, initial=0)
print(f"nothing pushes the base: {wrench:.1e} N and N m at most")
print(f"the angular momentum is kept to {momentum:.1e} kg m^2/s")
print(f"the work of the motors is the energy's change to {np.ptp(energy - work):.0e} J")

pin.framesForwardKinematics(model, data, plan.q(plan.duration))
hand = data.oMf[model.getFrameId("hand")].translation
print(f"the hand lands at {hand.round(4)} m")

OUT.mkdir(parents=True, exist_ok=True)
with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure()
    axes = figure.subplots()
    axes.plot(times, energy, linewidth=4, alpha=0.4, label="kinetic energy about the centre of mass, by Pinocchio")
    axes.plot(times, energy[0] + work, "--", label="at takeoff, and the work of the motors since")
    axes.set(xlabel="time (s)", ylabel="energy (J)", xlim=(0, plan.duration), ylim=(0, None))
    axes.legend()
    figure.savefig(OUT / "pinocchio_interop.png")
