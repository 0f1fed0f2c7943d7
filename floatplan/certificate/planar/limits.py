"""What holds of the base and its path: both ends of the orientation, (2), (3) and (6)."""

from collections.abc import Sequence
from typing import Any

import flint

from floatplan.certificate.branch_and_bound import near
from floatplan.certificate.enclosure import PRECISION, Balls, Taylor
from floatplan.certificate.limits import ENDS, JointState, same
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.inertia import PlanarRobot
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding, Kind
from floatplan.tables import CLEARANCE, FRAME_SPEED, ORIENTATION


def orientation_findings(record: PlanRecord, flight: FlightEnclosure) -> tuple[list[Finding], Balls]:
    """The orientation at the end, and what the file says of it."""
    last = flight.orientation[-1].at_end(1.0)
    goal = float(record.problem["goal"]["orientation"])
    recorded = record.orientation
    start = float(record.problem["start"]["orientation"])
    findings = [
        near("goal", ("orientation",), last, [goal], ORIENTATION, record.duration),
        same("stated", ("orientation", "start"), recorded["start"], start, 0.0),
        same("stated", ("orientation", "goal"), recorded["goal"], goal, record.duration),
        near("recorded", ("orientation.end",), last, [recorded["end"]], ORIENTATION, record.duration),
    ]
    return findings, last


def flight_findings(
    robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure, states: Sequence[JointState]
) -> list[Finding]:
    """The centre of mass leaves the takeoff frame where requested, and brings the landing frame down to its height.

    ``states`` are those of :func:`at_ends`.
    """
    requested = record.problem["flight"]
    com = record.com
    instants = (0.0, record.duration)
    kinds: tuple[Kind, Kind] = ("takeoff", "landing")
    left, left_at = _frame_motion(robot, record, flight, states[0], requested["takeoff"]["frame"], 0)
    landed, landed_at = _frame_motion(robot, record, flight, states[1], requested["landing"]["frame"], 1)
    findings = [
        near("takeoff", ("position",), left, requested["takeoff"]["position"], CLEARANCE, 0.0),
        near("landing", ("height",), landed[1:], [requested["landing"]["height"]], CLEARANCE, record.duration),
        same("stated", ("com", "gravity"), com["gravity"], requested["gravity"], None),
        same("stated", ("com", "velocity0"), com["velocity0"][0], requested["horizontal_velocity"], 0.0),
    ]
    for end, kind, velocity, instant in zip(ENDS, kinds, (left_at, landed_at), instants, strict=True):
        if record.problem[end].get("velocities_asked"):
            findings.append(near(kind, ("frame_velocity",), velocity, [0.0, 0.0], FRAME_SPEED, instant))
    if not isinstance(requested["angular_momentum"], str):
        findings.append(same("angular_momentum", (), record.angular_momentum, requested["angular_momentum"], None))
    return findings


def com_polynomials(record: PlanRecord, sigma: float) -> tuple[Any, Any]:
    """The centre of mass's path, in the plane's mirror image where sigma is -1: polynomials of t."""
    (x, y) = record.com["position0"]
    (dx, dy) = record.com["velocity0"]
    half_gravity = flint.arb(record.com["gravity"]) / 2
    return flint.arb_poly([x, dx]), flint.arb_poly([sigma * y, sigma * dy, -sigma * half_gravity])


def _frame_motion(
    robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure, state: JointState, frame: str, end: int
) -> tuple[Balls, Balls]:
    """Position and velocity of a frame at the beginning (end 0) or the end (1): (2,) each, in Arb.

    The position is ``c + sum_b w_b exp(i phi_b)``, with c of the centre of mass and horizontal parts first. Of all this
    only the orientation and its rate come from the models.
    """
    if frame not in robot.frames:
        raise ValueError(f'the robot has no frame "{frame}"')
    at = flint.arb((0.0, record.duration)[end])
    u = (-1.0, 1.0)[end]
    with flint.ctx.workprec(PRECISION):
        sine, cosine = _at_end(flight.orientation[-end], u).sin_cos()
        rotation = flint.acb(cosine, sine)
        rate = _at_end(flight.joints.rate[-end], u)
        swung = moved = flint.acb(0)
        for weight, turned_by in zip(robot.weights_of(robot.frames[frame]), robot.turned_by, strict=True):
            angle = speed = flint.arb(0)
            for joint, factor in turned_by:
                angle += factor * state[0][joint]
                speed += factor * state[1][joint]
            sine, cosine = angle.sin_cos()
            arm = weight * flint.acb(cosine, sine)
            swung += arm
            moved += arm * (rate + speed)
        com = com_polynomials(record, robot.sigma)
        x, y = com
        offset = rotation * swung
        position = Balls.from_arb([x(at) + offset.real, robot.sigma * (y(at) + offset.imag)], (2,))
        dx, dy = x.derivative(), y.derivative()
        offset_rate = rotation * flint.acb(0, 1) * moved
        velocity = Balls.from_arb([dx(at) + offset_rate.real, robot.sigma * (dy(at) + offset_rate.imag)], (2,))
    return position, velocity


def _at_end(model: Taylor, u: float) -> Any:
    """The one value of a model (K, 1) at the beginning or end of its cell, in Arb."""
    balls = model.at_end(u)
    return flint.arb(float(balls.mid[0]), float(balls.rad[0]))
