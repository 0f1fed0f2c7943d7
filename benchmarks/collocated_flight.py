"""What collocation of the equations of motion does to the angular momentum of a flight.

    python benchmarks/collocated_flight.py

A trajectory optimiser that has accelerations by forward dynamics, with torques and contact forces as its variables,
knows the angular momentum only through its own rule of integration. The gymnast's handstand is put into such programs:
at N + 1 nodes the joints move as planned, and the base follows by the rule, as in any solution of the program with
these joints, whatever solver found it. Printed is by how much the angular momentum changes over the nodes, and by how
much the base lands off where these joints bring it in truth.

In a plane the momentum about the centre of mass is h = D0(q) theta' + D(q) q', whatever the orientation theta. So the
unactuated row of the equations of motion is theta'' = f(q, q', q'', theta'), whose f is linear in theta'.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin

import floatplan as fp
from floatplan.arrays import Array

ROOT = Path(__file__).resolve().parents[1]
INTERVALS = (10, 20, 40, 80)
ROUNDING = 1e-12  # [-] of the momentum: less is none


class Base:
    """The base's turning at given instants of a plan, from Pinocchio: D0, D q' and the row of the equations of motion.

    Attributes
    ----------
    inertia : (N,) kg m^2, D0
    of_joints : (N,) kg m^2/s, D q'
    damping, forcing : (N,) theta'' = -damping theta' - forcing, 1/s and rad/s^2
    """

    def __init__(self, plan: fp.Plan, times: Array) -> None:
        model = plan.robot.free_flyer()
        data = model.createData()
        turn = np.zeros(model.nv)
        turn[3:6] = plan.robot.plane.normal  # in the base's axes as in the world's
        rows = []
        for q, v, a in zip(plan.q(times), plan.v(times), plan.a(times), strict=True):
            rates = np.concatenate((np.zeros(6), v[6:]))
            accelerations = np.concatenate((np.zeros(6), a[6:]))
            row = plan.robot.plane.normal @ pin.computeCentroidalMap(model, data, q)[3:]
            # dh/dt = D0 theta'' + D q'' + bias(theta'), the bias linear in theta'
            pin.dccrba(model, data, q, rates + turn)
            turning = plan.robot.plane.normal @ data.dAg[3:] @ (rates + turn)
            pin.dccrba(model, data, q, rates)
            still = plan.robot.plane.normal @ data.dAg[3:] @ rates
            rows.append((row @ turn, row @ rates, turning - still, row @ accelerations + still))
        inertia, self.of_joints, linear, rest = np.array(rows).T
        self.inertia = inertia
        self.damping = linear / inertia
        self.forcing = rest / inertia


def trapezoidal(base: Base, rate: float, step: float) -> Array:
    """Rates (N + 1,) of the base, rad/s: each step adds the mean of the accelerations at both ends."""
    rates = [rate]
    for k in range(len(base.inertia) - 1):
        known = rates[-1] - 0.5 * step * (base.damping[k] * rates[-1] + base.forcing[k] + base.forcing[k + 1])
        rates.append(known / (1.0 + 0.5 * step * base.damping[k + 1]))
    return np.array(rates)


def euler(base: Base, rate: float, step: float) -> Array:
    """The same where each step adds the acceleration at its beginning."""
    rates = [rate]
    for k in range(len(base.inertia) - 1):
        rates.append(rates[-1] - step * (base.damping[k] * rates[-1] + base.forcing[k]))
    return np.array(rates)


def of_momentum(base: Base, momentum: float) -> Array:
    """The same with the momentum as an equation at each node."""
    rates: Array = (momentum - base.of_joints) / base.inertia
    return rates


def drift_and_miss(plan: fp.Plan, intervals: int, rule: str) -> tuple[float, float]:
    """Change of the momentum over the nodes as a share of it, and by how much the base lands off, deg."""
    times = np.linspace(0.0, plan.duration, intervals + 1)
    step = plan.duration / intervals
    base = Base(plan, times)
    start = float(plan.at(0.0).orientation_rate)
    if rule == "momentum":
        rates = of_momentum(base, plan.angular_momentum)
    else:
        rates = {"trapezoidal": trapezoidal, "Euler": euler}[rule](base, start, step)
    momenta = base.inertia * rates + base.of_joints
    # Euler's is semi-implicit, as simulators have it; with the momentum the rates are integrated by trapezoids
    turned = step * (rates[1:].sum() if rule == "Euler" else np.sum(0.5 * (rates[1:] + rates[:-1])))
    start_angle, end_angle = plan.orientation(np.array([0.0, plan.duration]))
    return float(np.ptp(momenta) / abs(plan.angular_momentum)), math.degrees(turned - (end_angle - start_angle))


def main() -> None:
    """Print a row of the page's table for each number of intervals."""
    plan = fp.plan(fp.load_problem(ROOT / "problems" / "handstand.toml"))
    print("| intervals | Euler: h changes by, lands off by | trapezoidal | momentum at each node |")
    print("| ---: | ---: | ---: | ---: |")
    for intervals in INTERVALS:
        cells = [str(intervals)]
        for rule in ("Euler", "trapezoidal", "momentum"):
            drift, miss = drift_and_miss(plan, intervals, rule)
            cells.append(f"{100 * drift if drift > ROUNDING else 0:.3g} %, {miss:+.2g}°")
        print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
