"""The certificate: is the plan true, for every instant?

:func:`certify_record` reads a plan record and its URDF, nothing else. See ``docs/certificate.md`` for the statement.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arrays import read_only
from floatplan.certificate.enclosure import Balls
from floatplan.certificate.findings import RECORDED_CLEARANCE, at_most
from floatplan.certificate.planar.boundary import at_ends, boundary_findings, flight_findings, orientation_findings
from floatplan.certificate.planar.inertia import PlanarRobot
from floatplan.certificate.planar.limits import limit_findings, quantities, range_findings, recorded_peaks
from floatplan.certificate.planar.obstacles import Surroundings, ground_finding, obstacle_finding, self_finding
from floatplan.certificate.planar.refine import fly
from floatplan.certificate.planar.robots import recorded_robot
from floatplan.certificate.planar.shapes import LinkShape, ShapeWeights, given_shapes, place_shapes, urdf_shapes
from floatplan.errors import InputError
from floatplan.plans.reading import checked
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Certificate, Finding, Verdict, worst
from floatplan.robot.urdf.example_robots import urdf_path

BUDGET = 4096  # cells of time
_ONE_AT_A_TIME = threading.Lock()  # Arb's precision is one for all threads


def certify_record(
    record: PlanRecord,
    urdf: str | Path | None = None,
    *,
    shapes: Sequence[LinkShape] | None = None,
    hulls: Sequence[LinkShape] | None = None,
    budget: int = BUDGET,
) -> Certificate:
    """Prove or refute a plan, one thread at a time; another that computes with Arb meanwhile sees its precision change.

    Parameters
    ----------
    record : PlanRecord
    urdf : path, optional
        The robot's file; left out, ``record.robot.urdf``. Its SHA-256 has to be the recorded one.
    shapes : sequence of (link, start, end, radius), optional
        Capsules, m; places are (x, y, z) in the link's frame, or (horizontal, vertical) from the link's origin, along
        the root link's axes in the posture with all planned positions zero. Left out, a link is the segments from
        its origin to its children's joints; a robot that has ``<collision>`` elements needs them given.
    hulls : the same, optional
        Capsules whose ends reach as far down as the links: what stands on the ground. Left out, ``shapes``.
    budget : int
        Most cells of time; with fewer than it needs, the proof may end undecided.

    Raises
    ------
    InputError
        The URDF is missing, another, or does not fit the record; or the record's problem lacks something.
    """
    return prove(checked(record), urdf, shapes=shapes, hulls=hulls, budget=budget)


def prove(
    record: PlanRecord,
    urdf: str | Path | None = None,
    *,
    shapes: Sequence[LinkShape] | None = None,
    hulls: Sequence[LinkShape] | None = None,
    unknown_meshes: Sequence[str] = (),
    budget: int = BUDGET,
) -> Certificate:
    """Do what :func:`certify_record` does with a record that is ``checked``; the same parameters and errors.

    ``unknown_meshes`` are files that the shapes are around and whose hashes the record lacks: they leave clearances
    undecided.
    """
    with _ONE_AT_A_TIME:
        began = time.perf_counter()
        path = urdf_path(record.robot.urdf if urdf is None else urdf)
        robot = recorded_robot(path, record.robot)
        try:
            with np.errstate(all="ignore"):
                return _prove(robot, record, (shapes, hulls), unknown_meshes, budget, began)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(
                f"cannot be read as a problem: {type(error).__name__} {error}", element="problem"
            ) from error


def _prove(
    robot: PlanarRobot,
    record: PlanRecord,
    shapes: tuple[Sequence[LinkShape] | None, Sequence[LinkShape] | None],
    unknown_meshes: Sequence[str],
    budget: int,
    began: float,
) -> Certificate:
    problem = record.problem
    obstacles, pairs = problem.get("obstacles") or [], problem.get("self_clearance") or []
    flight = fly(robot, record, _windows(obstacles, record.duration), budget)
    orientation, last = orientation_findings(record, flight)
    ranges, beyond = range_findings(record)
    limited = quantities(robot, record, flight, beyond)
    limits, peaks = limit_findings(limited.found, flight)
    velocity, torque, motor = (
        [peaks[i] for i in chosen] for chosen in (limited.velocities, limited.torques, limited.motors)
    )
    states = at_ends(record)
    ends = [*boundary_findings(record, states), *flight_findings(robot, record, flight, states)]
    found = [*orientation, *ends, *ranges, *limits]
    found.append(recorded_peaks("velocity_peak", record.velocity_peak, velocity))
    found.append(recorded_peaks("torque_peak", record.torque_peak, torque))
    if record.motor_torque_peak is not None:
        claimed = [_claimed(record.motor_torque_peak, name) for name in robot.motors]
        found.append(recorded_peaks("motor_torque_peak", np.array(claimed), motor))
    clearance = None
    if not obstacles and record.clearance_min is not None:
        found.append(Finding("recorded", ("clearance_min",), "refuted", record.clearance_min))
    if record.asks_clearance:
        capsules, hulls = shapes
        chosen = _shapes(robot, capsules)
        surroundings = Surroundings(record, flight, place_shapes(flight, chosen), robot.sigma)
        clear = [self_finding(surroundings, pair) for pair in pairs]
        if problem.get("ground"):
            standing = surroundings.shapes if hulls is None else place_shapes(flight, _shapes(robot, hulls))
            clear.append(ground_finding(surroundings, robot, standing))
        if obstacles:
            to_obstacles, clearance = _clearances(surroundings, obstacles)
            clear = to_obstacles + clear
        if unknown_meshes:
            clear, clearance = _undecided(clear, unknown_meshes), None
        found += clear
    findings = tuple(found)
    return Certificate(
        verdict=worst(findings),
        orientation_end=_enclosure(last),
        clearance_min=clearance,
        torque_peak=read_only([-peak.bound for peak in torque]),
        velocity_peak=read_only([-peak.bound for peak in velocity]),
        motor_torque_peak={name: -peak.bound for name, peak in zip(robot.motors, motor, strict=True)},
        findings=findings,
        subintervals=len(flight.cells),
        seconds=time.perf_counter() - began,
    )


def _enclosure(ball: Balls) -> tuple[float, float]:
    """Numbers around the first of a ball's; infinite where it is not known."""
    low, high = float(ball.mid[0] - ball.rad[0]), float(ball.mid[0] + ball.rad[0])
    if not low <= high:
        return -math.inf, math.inf
    return math.nextafter(low, -math.inf), math.nextafter(high, math.inf)


def _claimed(peaks: Mapping[str, float], motor: str) -> float:
    if motor not in peaks:
        raise InputError("is missing", element=f"motor_torque_peak.{motor}")
    return float(peaks[motor])


def _shapes(robot: PlanarRobot, shapes: Sequence[LinkShape] | None) -> ShapeWeights:
    if shapes is not None:
        return given_shapes(
            robot, tuple((link, tuple(start), tuple(end), radius) for link, start, end, radius in shapes)
        )
    if robot.with_collision:
        reason = f'link "{min(robot.with_collision)}" has a <collision> element, so its shape has to be given'
        raise InputError(reason, element="shapes")
    return urdf_shapes(robot)


def _clearances(surroundings: Surroundings, obstacles: Sequence[Any]) -> tuple[list[Finding], float]:
    """One finding per obstacle, one on the recorded minimum, and the proved minimum."""
    found, least = zip(
        *(obstacle_finding(surroundings, index, obstacle) for index, obstacle in enumerate(obstacles)), strict=True
    )
    bound = min(item.bound for item in least)
    attained = min(item.attained for item in least)
    recorded = surroundings.record.clearance_min
    tolerance = RECORDED_CLEARANCE
    if recorded is None:  # nothing was near, because no obstacle exists during the flight
        verdict: Verdict = "proved" if bound == math.inf else "refuted" if attained < math.inf else "undecided"
        claim = Finding("recorded", ("clearance_min",), verdict, bound, None, None)
    else:
        off = max(0.0, recorded - attained, bound - recorded)
        claim = at_most(
            "recorded",
            ("clearance_min",),
            max(abs(recorded - bound), abs(recorded - attained)),
            off,
            0.0,
            tolerance,
            None,
        )
    return [*found, claim], bound


def _undecided(clear: Sequence[Finding], unknown_meshes: Sequence[str]) -> list[Finding]:
    """What is known of clearances where the shapes may not be those that were planned with: nothing."""
    unknown = [Finding("mesh", (name,), "undecided", None) for name in unknown_meshes]
    return unknown + [replace(finding, verdict="undecided") for finding in clear]


def _windows(obstacles: Sequence[Any], duration: float) -> list[tuple[float, float]]:
    """When obstacles exist that do not always exist, as far as the flight lasts."""
    asked = [obstacle["window"] for obstacle in obstacles if obstacle.get("window")]
    within = [(max(float(first), 0.0), min(float(last), duration)) for first, last in asked]
    return [(first, last) for first, last in within if first <= last]
