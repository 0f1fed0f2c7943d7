"""What holds at single instants, and what the numbers of the file say twice: (2), (3), (6), (13)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import flint
import numpy as np

from floatplan.certificate.enclosure import PRECISION, Balls
from floatplan.certificate.findings import SAME, near
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.inertia import ComplexBalls, PlanarRobot
from floatplan.certificate.planar.shapes import turned
from floatplan.certificate.vectors import Vectors
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding, Kind, Subject
from floatplan.tables import AT_REST, BOUNDARY, ORIENTATION, PLACE

ENDS = ("start", "goal")
QUANTITIES = ("positions", "velocities", "accelerations")


def boundary_findings(record: PlanRecord) -> list[Finding]:
    """Positions, velocities and accelerations at both ends, (13), in Arb."""
    found = []
    for end, instant in zip(ENDS, (0.0, record.duration), strict=True):
        states = _joint_states(record, instant)
        for quantity, values, tolerance in zip(QUANTITIES, states, BOUNDARY, strict=True):
            wanted = _listed(record, record.problem[end], end, quantity)
            found.append(near(end, (quantity,), values, wanted, tolerance, instant))
    return found


def _joint_states(record: PlanRecord, instant: float) -> tuple[Balls, ...]:
    """Positions, velocities and accelerations of the joints at an instant."""
    states: list[list[Any]] = [[], [], []]
    with flint.ctx.workprec(PRECISION):
        t = flint.arb(instant)
        rows = zip(record.coefficients.tolist(), record.centre.tolist(), record.amplitude.tolist(), strict=True)
        for row, centre, amplitude in rows:
            polynomial = flint.arb_poly(row)
            p, dp = polynomial(t), polynomial.derivative()(t)
            ddp = polynomial.derivative().derivative()(t)
            sine, cosine = p.sin_cos()
            states[0].append(centre + amplitude * sine)
            states[1].append(amplitude * cosine * dp)
            states[2].append(amplitude * (cosine * ddp - sine * dp * dp))
        return tuple(Balls.from_arb(values, (len(values),)) for values in states)


def _listed(record: PlanRecord, posture: Mapping[str, Any], end: str, quantity: str) -> Any:
    values = np.array(posture[quantity], dtype=np.float64)
    if values.shape != (len(record.robot.joints),) or not np.isfinite(values).all():
        raise ValueError(f"problem.{end}.{quantity} should be one number per joint")
    return values


def orientation_findings(record: PlanRecord, flight: FlightEnclosure) -> tuple[list[Finding], Balls]:
    """The orientation at the end, and what the file says of it."""
    last = flight.orientation.at_end(1.0)[-1]
    goal = float(record.problem["goal"]["orientation"])
    recorded = record.orientation
    start = float(record.problem["start"]["orientation"])
    found = [
        near("goal", ("orientation",), last, [goal], ORIENTATION, record.duration),
        _same("stated", ("orientation", "start"), recorded["start"], start, 0.0),
        _same("stated", ("orientation", "goal"), recorded["goal"], goal, record.duration),
        near("recorded", ("orientation.end",), last, [recorded["end"]], ORIENTATION, record.duration),
    ]
    return found, last


def flight_findings(robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure) -> list[Finding]:
    """The centre of mass leaves the takeoff frame where asked, and brings the landing frame down to its height."""
    asked, com, duration = record.problem["flight"], record.com, record.duration
    takeoff, landing = asked["takeoff"], asked["landing"]
    place = _frame_place(robot, record, flight, takeoff["frame"], last=False)
    landed = _frame_place(robot, record, flight, landing["frame"], last=True)
    found = [
        near("takeoff", ("position",), place, takeoff["position"], PLACE, 0.0),
        near("landing", ("height",), landed[1:], [landing["height"]], PLACE, duration),
        _same("stated", ("com", "gravity"), com["gravity"], asked["gravity"], None),
        _same("stated", ("com", "velocity0"), com["velocity0"][0], asked["horizontal_velocity"], 0.0),
    ]
    for end, kind, frame, last in (("start", "takeoff", takeoff, False), ("goal", "landing", landing, True)):
        if record.problem[end].get("velocities_asked"):
            velocity = _frame_velocity(robot, record, flight, frame["frame"], last=last)
            instant = duration if last else 0.0
            found.append(near(kind, ("frame_velocity",), velocity, [0.0, 0.0], AT_REST, instant))
    if not isinstance(asked["angular_momentum"], str):
        found.append(_same("angular_momentum", (), record.angular_momentum, asked["angular_momentum"], None))
    return found


def com_polynomials(record: PlanRecord, sigma: float) -> tuple[Any, Any]:
    """The centre of mass's path, in the plane's mirror image where sigma is -1: polynomials of t."""
    (x, y), (dx, dy) = record.com["position0"], record.com["velocity0"]
    half_gravity = flint.arb(record.com["gravity"]) / 2
    return flint.arb_poly([x, dx]), flint.arb_poly([sigma * y, sigma * dy, -sigma * half_gravity])


def _frame_place(robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure, frame: str, *, last: bool) -> Balls:
    """Place (2,) of a frame at the beginning or the end, horizontal and vertical."""
    weights, pick = _weights(robot, frame), _end_cell(flight, last=last)
    point = turned(weights, flight.joints.cos[pick], flight.joints.sin[pick])
    return _in_world(robot, record, flight, point, com_polynomials(record, robot.sigma), last=last)


def _frame_velocity(
    robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure, frame: str, *, last: bool
) -> Balls:
    """Velocity (2,) of a frame at the beginning or the end: the derivative of its place, ``i sum_b w_b zeta_b phi_b'``.

    In the frame that turns with the base, as the place.
    """
    weights, pick = _weights(robot, frame), _end_cell(flight, last=last)
    joints = flight.joints
    turns = joints.velocities[pick].linear(robot.turns) + joints.rate[pick]
    swing = turned(weights, joints.cos[pick] * turns, joints.sin[pick] * turns)
    rates = tuple(polynomial.derivative() for polynomial in com_polynomials(record, robot.sigma))
    return _in_world(robot, record, flight, Vectors(-swing.y, swing.x), rates, last=last)


def _weights(robot: PlanarRobot, frame: str) -> ComplexBalls:
    if frame not in robot.frames:
        raise ValueError(f'the robot has no frame "{frame}"')
    return robot.point_weights([robot.frames[frame]])


def _end_cell(flight: FlightEnclosure, *, last: bool) -> slice:
    cell = len(flight.cells) - 1 if last else 0
    return slice(cell, cell + 1)


def _in_world(
    robot: PlanarRobot,
    record: PlanRecord,
    flight: FlightEnclosure,
    vector: Vectors,
    of_com: Sequence[Any],
    *,
    last: bool,
) -> Balls:
    """A vector (2,) of the frame that turns with the base, turned as the base is, and what is the CM's added.

    At the beginning or the end; horizontal and vertical. ``of_com`` are two polynomials of t.
    """
    pick = _end_cell(flight, last=last)
    cos, sin = flight.cos[pick], flight.sin[pick]
    world = (cos * vector.x - sin * vector.y, cos * vector.y + sin * vector.x)
    x, y = (model.at_end(1.0 if last else -1.0)[0, 0] for model in world)
    with flint.ctx.workprec(PRECISION):
        t = flint.arb(record.duration if last else 0.0)
        com = [polynomial(t) for polynomial in of_com]
        values = [com[0] + flint.arb(float(x.mid), float(x.rad)), com[1] + flint.arb(float(y.mid), float(y.rad))]
        return Balls.from_arb([values[0], robot.sigma * values[1]], (2,))


def _same(kind: Kind, subject: Subject, number: float, other: float, instant: float | None) -> Finding:
    """Two numbers of the file that should be one."""
    scale = max(1.0, abs(number), abs(other))
    return near(kind, subject, Balls.exact([number]), [other], SAME * scale, instant)
