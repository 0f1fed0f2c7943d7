"""What holds at single instants, and what the numbers of the file say twice: (2), (3), (6), (13)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import flint
import numpy as np

from floatplan.arrays import IntArray
from floatplan.certificate.enclosure import PRECISION, Balls, products, stack
from floatplan.certificate.findings import SAME, at_most, deviations, near
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.inertia import PlanarRobot
from floatplan.certificate.vectors import Vectors
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding, Kind, Subject
from floatplan.tables import AT_REST, BOUNDARY, ORIENTATION, PLACE

ENDS = ("start", "goal")
QUANTITIES = ("positions", "velocities", "accelerations")


def boundary_findings(record: PlanRecord) -> list[Finding]:
    """Positions, velocities and accelerations at both ends, (13), in Arb."""
    instants = (0.0, record.duration)
    rows = [
        (end, quantity, tolerance, instant)
        for end, instant in zip(ENDS, instants, strict=True)
        for quantity, tolerance in zip(QUANTITIES, BOUNDARY, strict=True)
    ]
    wanted = np.array([_listed(record, record.problem[end], end, quantity) for end, quantity, _, _ in rows])
    bounds = (bound.tolist() for bound in deviations(_joint_states(record, instants), wanted))
    return [
        at_most(end, (quantity,), upper, attained, 0.0, tolerance, instant)
        for (end, quantity, tolerance, instant), upper, attained in zip(rows, *bounds, strict=True)
    ]


def _joint_states(record: PlanRecord, instants: Sequence[float]) -> Balls:
    """Rows (3 instants, n): positions, velocities and accelerations of the joints, at each instant."""
    states: list[list[list[Any]]] = [[[], [], []] for _ in instants]
    with flint.ctx.workprec(PRECISION):
        rows = zip(record.coefficients.tolist(), record.centre.tolist(), record.amplitude.tolist(), strict=True)
        for row, centre, amplitude in rows:
            polynomial = flint.arb_poly(row)
            first = polynomial.derivative()
            second = first.derivative()
            for (positions, velocities, accelerations), instant in zip(states, instants, strict=True):
                t = flint.arb(instant)
                dp = first(t)
                sine, cosine = polynomial(t).sin_cos()
                positions.append(centre + amplitude * sine)
                velocities.append(amplitude * cosine * dp)
                accelerations.append(amplitude * (cosine * second(t) - sine * dp * dp))
        values = [value for at in states for of_joints in at for value in of_joints]
        return Balls.from_arb(values, (len(instants) * len(QUANTITIES), len(record.centre)))


def _listed(record: PlanRecord, posture: Mapping[str, Any], end: str, quantity: str) -> Any:
    values = np.array(posture[quantity], dtype=np.float64)
    if values.shape != (len(record.robot.joints),) or not np.isfinite(values).all():
        raise ValueError(f"problem.{end}.{quantity} should be one number per joint")
    return values


def orientation_findings(record: PlanRecord, flight: FlightEnclosure) -> tuple[list[Finding], Balls]:
    """The orientation at the end, and what the file says of it."""
    last = flight.orientation[-1].at_end(1.0)
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
    frames = (takeoff["frame"], landing["frame"])
    place, landed = _frame_places(robot, record, flight, frames)
    found = [
        near("takeoff", ("position",), place, takeoff["position"], PLACE, 0.0),
        near("landing", ("height",), landed[1:], [landing["height"]], PLACE, duration),
        _same("stated", ("com", "gravity"), com["gravity"], asked["gravity"], None),
        _same("stated", ("com", "velocity0"), com["velocity0"][0], asked["horizontal_velocity"], 0.0),
    ]
    at_rest = [bool(record.problem[end].get("velocities_asked")) for end in ENDS]
    if any(at_rest):
        velocities = _frame_velocities(robot, record, flight, frames)
        kinds: tuple[Kind, Kind] = ("takeoff", "landing")
        for kind, velocity, rest, instant in zip(kinds, velocities, at_rest, (0.0, duration), strict=True):
            if rest:
                found.append(near(kind, ("frame_velocity",), velocity, [0.0, 0.0], AT_REST, instant))
    if not isinstance(asked["angular_momentum"], str):
        found.append(_same("angular_momentum", (), record.angular_momentum, asked["angular_momentum"], None))
    return found


def com_polynomials(record: PlanRecord, sigma: float) -> tuple[Any, Any]:
    """The centre of mass's path, in the plane's mirror image where sigma is -1: polynomials of t."""
    (x, y), (dx, dy) = record.com["position0"], record.com["velocity0"]
    half_gravity = flint.arb(record.com["gravity"]) / 2
    return flint.arb_poly([x, dx]), flint.arb_poly([sigma * y, sigma * dy, -sigma * half_gravity])


def _frame_places(
    robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure, frames: tuple[str, str]
) -> tuple[Balls, Balls]:
    """Place (2,) of one frame at the beginning and of another at the end, horizontal and vertical."""
    ends, joints = _end_cells(flight), flight.joints
    points = robot.frame_weights(frames).times(joints.cos[ends], joints.sin[ends])
    return _in_world(robot, record, flight, points, com_polynomials(record, robot.sigma))


def _frame_velocities(
    robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure, frames: tuple[str, str]
) -> tuple[Balls, Balls]:
    """Velocity (2,) of one frame at the beginning and of another at the end.

    The derivative of the place, ``i sum_b w_b zeta_b phi_b'``, in the frame that turns with the base, as the place.
    """
    ends, joints = _end_cells(flight), flight.joints
    turns = joints.velocities[ends].linear(robot.turns) + joints.rate[ends]
    swing = robot.frame_weights(frames).times(joints.cos[ends] * turns, joints.sin[ends] * turns)
    rates = [polynomial.derivative() for polynomial in com_polynomials(record, robot.sigma)]
    return _in_world(robot, record, flight, Vectors(-swing.y, swing.x), rates)


def _end_cells(flight: FlightEnclosure) -> IntArray:
    return np.array([0, len(flight.cells) - 1])


def _in_world(
    robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure, vectors: Vectors, of_com: Sequence[Any]
) -> tuple[Balls, Balls]:
    """Two vectors of the frame that turns with the base, turned as the base is, and what is the CM's added.

    ``vectors`` (K, 2, 2) are on the first cell and the last: the first one is wanted at the beginning, the second at
    the end; horizontal and vertical. ``of_com`` are two polynomials of t.
    """
    ends, each = _end_cells(flight), np.arange(2)
    at = vectors.picked(each, each)
    cos, sin = flight.cos[ends, 0], flight.sin[ends, 0]
    cos_x, sin_y, cos_y, sin_x = products([(cos, at.x), (sin, at.y), (cos, at.y), (sin, at.x)])
    both = stack([cos_x - sin_y, cos_y + sin_x])
    found = []
    with flint.ctx.workprec(PRECISION):
        for end, (u, instant) in enumerate(((-1.0, 0.0), (1.0, record.duration))):
            at_end = both[end::2].at_end(u)
            of_frame = [flint.arb(mid, rad) for mid, rad in zip(at_end.mid.tolist(), at_end.rad.tolist(), strict=True)]
            place = [polynomial(flint.arb(instant)) + part for polynomial, part in zip(of_com, of_frame, strict=True)]
            found.append(Balls.from_arb([place[0], robot.sigma * place[1]], (2,)))
    return found[0], found[1]


def _same(kind: Kind, subject: Subject, number: float, other: float, instant: float | None) -> Finding:
    """Two numbers of the file that should be one."""
    scale, deviation = max(1.0, abs(number), abs(other)), abs(number - other)
    radius = 2.0**-51 * (abs(number) + deviation)
    return at_most(kind, subject, deviation + radius, max(0.0, deviation - radius), 0.0, SAME * scale, instant)
