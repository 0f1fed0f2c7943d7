"""What holds at single instants, and what the numbers of the file say twice: (2), (3), (6), (13)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import flint
import numpy as np

from floatplan.certificate.enclosure import PRECISION, Balls, Taylor
from floatplan.certificate.findings import SAME, at_most, deviations, near
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.inertia import PlanarRobot
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding, Kind, Subject
from floatplan.tables import AT_REST, BOUNDARY, ORIENTATION, PLACE

JointState: TypeAlias = tuple[list[Any], list[Any], list[Any]]

ENDS = ("start", "goal")
QUANTITIES = ("positions", "velocities", "accelerations")


def boundary_findings(record: PlanRecord, states: Sequence[JointState]) -> list[Finding]:
    """Positions, velocities and accelerations at both ends, (13), in Arb; ``states`` are those of :func:`at_ends`."""
    rows = [
        (end, quantity, tolerance, instant)
        for end, instant in zip(ENDS, (0.0, record.duration), strict=True)
        for quantity, tolerance in zip(QUANTITIES, BOUNDARY, strict=True)
    ]
    wanted = np.array([record.problem[end][quantity] for end, quantity, _, _ in rows], dtype=np.float64)
    values = [value for state in states for of_joints in state for value in of_joints]
    bounds = (bound.tolist() for bound in deviations(Balls.from_arb(values, wanted.shape), wanted))
    return [
        at_most(end, (quantity,), upper, attained, 0.0, tolerance, instant)
        for (end, quantity, tolerance, instant), upper, attained in zip(rows, *bounds, strict=True)
    ]


def at_ends(record: PlanRecord) -> list[JointState]:
    """Positions, velocities and accelerations (n), in Arb, at the beginning and at the end."""
    instants = (0.0, record.duration)
    states: list[JointState] = [([], [], []) for _ in instants]
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
    return states


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


def flight_findings(
    robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure, states: Sequence[JointState]
) -> list[Finding]:
    """The centre of mass leaves the takeoff frame where asked, and brings the landing frame down to its height.

    ``states`` are those of :func:`at_ends`.
    """
    asked, com, instants = record.problem["flight"], record.com, (0.0, record.duration)
    kinds: tuple[Kind, Kind] = ("takeoff", "landing")
    frames = [asked[kind]["frame"] for kind in kinds]
    (left, left_at), (landed, landed_at) = (
        _frame_motion(robot, record, flight, state, frame, end)
        for end, (state, frame) in enumerate(zip(states, frames, strict=True))
    )
    findings = [
        near("takeoff", ("position",), left, asked["takeoff"]["position"], PLACE, 0.0),
        near("landing", ("height",), landed[1:], [asked["landing"]["height"]], PLACE, record.duration),
        _same("stated", ("com", "gravity"), com["gravity"], asked["gravity"], None),
        _same("stated", ("com", "velocity0"), com["velocity0"][0], asked["horizontal_velocity"], 0.0),
    ]
    for end, kind, velocity, instant in zip(ENDS, kinds, (left_at, landed_at), instants, strict=True):
        if record.problem[end].get("velocities_asked"):
            findings.append(near(kind, ("frame_velocity",), velocity, [0.0, 0.0], AT_REST, instant))
    if not isinstance(asked["angular_momentum"], str):
        findings.append(_same("angular_momentum", (), record.angular_momentum, asked["angular_momentum"], None))
    return findings


def com_polynomials(record: PlanRecord, sigma: float) -> tuple[Any, Any]:
    """The centre of mass's path, in the plane's mirror image where sigma is -1: polynomials of t."""
    (x, y), (dx, dy) = record.com["position0"], record.com["velocity0"]
    half_gravity = flint.arb(record.com["gravity"]) / 2
    return flint.arb_poly([x, dx]), flint.arb_poly([sigma * y, sigma * dy, -sigma * half_gravity])


def _frame_motion(
    robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure, state: JointState, frame: str, end: int
) -> tuple[Balls, Balls]:
    """Place and velocity of a frame at the beginning (end 0) or the end (1): (2,) each, in Arb.

    The place is ``c + sum_b w_b exp(i phi_b)``, with c of the centre of mass and horizontal parts first. Of all this
    only the orientation and its rate come from the models.
    """
    if frame not in robot.frames:
        raise ValueError(f'the robot has no frame "{frame}"')
    at, u = flint.arb((0.0, record.duration)[end]), (-1.0, 1.0)[end]
    with flint.ctx.workprec(PRECISION):
        sine, cosine = _at_end(flight.orientation[-end], u).sin_cos()
        turn, rate = flint.acb(cosine, sine), _at_end(flight.joints.rate[-end], u)
        swung = moved = flint.acb(0)
        for weight, turned_by in zip(robot.weights_of(robot.frames[frame]), robot.turned_by, strict=True):
            angle, speed = (
                sum((factor * values[joint] for joint, factor in turned_by), start=flint.arb(0)) for values in state[:2]
            )
            sine, cosine = angle.sin_cos()
            swing = weight * flint.acb(cosine, sine)
            swung += swing
            moved += swing * (rate + speed)
        com = com_polynomials(record, robot.sigma)
        relative = ((com, turn * swung), ([each.derivative() for each in com], turn * flint.acb(0, 1) * moved))
        place, velocity = (
            Balls.from_arb([x(at) + part.real, robot.sigma * (y(at) + part.imag)], (2,)) for (x, y), part in relative
        )
    return place, velocity


def _at_end(model: Taylor, u: float) -> Any:
    """The one value of a model (K, 1) at the beginning or end of its cell, in Arb."""
    balls = model.at_end(u)
    return flint.arb(float(balls.mid[0]), float(balls.rad[0]))


def _same(kind: Kind, subject: Subject, number: float, other: float, instant: float | None) -> Finding:
    """Two numbers of the file that should be one."""
    scale, deviation = max(1.0, abs(number), abs(other)), abs(number - other)
    radius = 2.0**-51 * (abs(number) + deviation)
    return at_most(kind, subject, deviation + radius, max(0.0, deviation - radius), 0.0, SAME * scale, instant)
