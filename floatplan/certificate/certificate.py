"""The certificate: is a plan true, for every instant? The plan may be alive, a record, or a file.

What is proved depends on the record, only the URDF and its meshes; of a robot from MJCF on the URDF that the record
holds, as MuJoCo resolved it: that this is what the MJCF says is not proved, and a finding says so. A loaded robot is
needed only for the capsules around collision geometry, which the certificate assumes. See
``docs/certificate.md`` for the statement.
"""

import cmath
import math
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import optional, whole
from floatplan.arguments import path as as_path
from floatplan.arrays import read_only
from floatplan.certificate.branch_and_bound import RECORDED_CLEARANCE, Minimum, at_most
from floatplan.certificate.enclosure import Balls
from floatplan.certificate.limits import at_ends, boundary_findings, limit_findings
from floatplan.certificate.planar.clearance import LinkShape, ShapeWeights, shape_weights
from floatplan.certificate.planar.flight import fly
from floatplan.certificate.planar.inertia import PlanarRobot, cached_robot
from floatplan.certificate.planar.limits import flight_findings, orientation_findings
from floatplan.certificate.planar.obstacles import Surroundings, ground_finding, obstacle_finding, self_finding
from floatplan.certificate.robots.taken import NotReadError
from floatplan.certificate.spatial import findings as spatial_findings
from floatplan.certificate.spatial import flight as spatial_flight
from floatplan.certificate.spatial import robot as spatial_robot
from floatplan.certificate.spatial.findings import attitude_findings, clearance_findings
from floatplan.certificate.spatial.robot import SpatialRobot
from floatplan.errors import InputError, naming
from floatplan.plans.reading import Recorded, check_meshes, check_parts, checked, find_robot, recorded, recorded_robot
from floatplan.plans.record import PlanRecord, RobotRecord
from floatplan.plans.verdicts import Certificate, Finding, Verdict, worst
from floatplan.pool import one_thread
from floatplan.robot.robot import LinkCapsule, Robot
from floatplan.robot.urdf.packages import robot_content
from floatplan.robot.urdf.tree import urdf_path
from floatplan.tables import Range

BUDGET = 4096  # cells of time
_ONE_AT_A_TIME = threading.Lock()  # Arb's precision is one for all threads


@one_thread
def certify(
    plan: Recorded | PlanRecord | str | Path, *, urdf: str | Path | None = None, budget: int = BUDGET
) -> Certificate:
    """Prove or refute a plan for every instant of its flight.

    Parameters
    ----------
    plan : Plan, PlanRecord, or path of a plan file
    urdf : path, optional
        The robot's file, where it is no longer where the plan says. Its SHA-256 has to be the recorded one.
    budget : int
        Most cells of time; with fewer than it needs, the proof may end undecided.

    Returns
    -------
    Certificate
        Its ``verdict`` is "proved", "refuted" or "undecided"; see ``docs/certificate.md`` for the statement.

    Raises
    ------
    InputError
        The plan, its URDF or a collision mesh is missing, damaged, or they do not match.
    """
    urdf = optional(as_path)(urdf, "urdf")
    budget = whole(Range(0, 2**63 - 1, ""))(budget, "budget")
    record, file, robot = recorded(plan)
    with naming(file):
        path = urdf_path(find_robot(record.robot, file) if urdf is None else urdf, record.robot.kind)
        record = checked(record)
        shapes: list[Sequence[LinkShape] | None] = [None, None]
        unknown: list[str] = []
        if record.asks_clearance and not record.in_space:
            robot = robot or recorded_robot(record.robot, file, path)
            check_meshes(robot, record.robot, file)
            if record.robot.resolved is not None and robot.xml != record.robot.resolved["urdf"]:
                return _undecided(
                    record.robot,
                    "the shapes are of the URDF that MuJoCo makes of the MJCF here, and robot.resolved is another",
                )
            unknown = sorted(set(robot.meshes) - set(record.robot.meshes))
            if "<collision" in robot.xml:
                flight = record.problem["flight"]
                standing = [_frame_of(robot, end, flight[end]["frame"]) for end in ("takeoff", "landing")]
                shapes = [shapes_of(robot), shapes_of(robot, robot.hulls(standing, robot.limb_ends))]
        return prove(record, path, shapes, unknown, budget)


def _frame_of(robot: Robot, end: str, frame: object) -> str:
    """The frame that a plan file names at an end of its flight, which the robot has."""
    if not isinstance(frame, str) or frame not in robot.frames:
        raise InputError(f"the robot has no frame {frame!r}", element=f"problem.flight.{end}.frame")
    return frame


def shapes_of(robot: Robot, capsules: Sequence[LinkCapsule] | None = None) -> list[LinkShape]:
    """Shapes of a loaded robot, left out the capsules around its collision geometry, as ``certify`` takes them."""
    shapes: list[LinkShape] = []
    for shape in robot.shapes if capsules is None else capsules:
        origin = robot.frames[shape.link].local
        rotation = cmath.exp(1j * robot.tree.turn * float(robot.tree.offsets[shape.body]))
        start, end = ((point - origin) * rotation for point in (shape.start, shape.end))
        shapes.append((shape.link, (start.real, start.imag), (end.real, end.imag), shape.radius))
    return shapes


def prove(
    record: PlanRecord,
    path: Path,
    shapes: Sequence[Sequence[LinkShape] | None],
    unknown_meshes: Sequence[str],
    budget: int,
) -> Certificate:
    """Prove a record that is ``checked`` for the URDF at ``path``, one thread at a time.

    Another that computes with Arb meanwhile sees its precision change.

    Parameters
    ----------
    shapes : of the links, and their hulls: what stands on the ground
        Capsules, m: places are (horizontal, vertical) from the link's origin, along the root link's axes in the posture
        with all planned positions zero. Of None, a link is the segments from its origin to its children's joints; a
        robot that has ``<collision>`` elements needs them.
    unknown_meshes : files that these are around and whose hashes the record lacks: they leave clearances undecided
    """
    with _ONE_AT_A_TIME:
        start_time = time.perf_counter()
        try:
            if record.robot.kind == "mjcf":
                check_parts(record.robot, path)
            content = robot_content(path)
            if record.in_space:
                flying = spatial_robot.cached_robot(content, path, record.robot)
            else:
                robot = cached_robot(content, path, record.robot)
        except NotReadError as error:
            return _undecided(record.robot, str(error))
        try:
            with np.errstate(all="ignore"):
                if record.in_space:
                    certificate = _proved_in_space(flying, record, budget)
                else:
                    certificate = _proved(robot, record, shapes, unknown_meshes, budget)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            if isinstance(error, InputError):
                raise
            reason = f"cannot be read as a problem: {type(error).__name__} {error}"
            raise InputError(reason, element="problem") from error
        return replace(certificate, seconds=time.perf_counter() - start_time)


def _proved(
    robot: PlanarRobot,
    record: PlanRecord,
    shapes: Sequence[Sequence[LinkShape] | None],
    unknown_meshes: Sequence[str],
    budget: int,
) -> Certificate:
    obstacles = record.problem.get("obstacles") or []
    windows = []
    for obstacle in obstacles:
        if obstacle.get("window"):
            begin, end = map(float, obstacle["window"])
            begin = max(begin, 0.0)
            end = min(end, record.duration)
            if begin <= end:
                windows.append((begin, end))
    flight = fly(robot, record, windows, budget)
    orientation, last = orientation_findings(record, flight)
    limits, peaks = limit_findings(robot, record, flight.joints, flight.cells)
    states = at_ends(record)
    ends = [*boundary_findings(record, states), *flight_findings(robot, record, flight, states)]
    clear: list[Finding] = []
    clearance = None
    if not obstacles and record.clearance_min is not None:
        clear.append(Finding("recorded", ("clearance_min",), "refuted", record.clearance_min))
    if record.asks_clearance:
        of_links, of_hulls = shapes
        surroundings = Surroundings(robot, record, flight, _weights(robot, of_links))
        requested: list[Finding] = []
        if obstacles:
            requested, clearance = _clearances(surroundings, obstacles)
        requested += [self_finding(surroundings, pair) for pair in record.problem.get("self_clearance") or []]
        if record.problem.get("ground"):
            standing = None if of_hulls is None else _weights(robot, of_hulls)
            requested.append(ground_finding(surroundings, robot, standing))
        if unknown_meshes:  # the shapes may not be those that were planned with: clearances are unknown
            unknown = [Finding("mesh", (name,), "undecided", None) for name in unknown_meshes]
            requested = unknown + [replace(finding, verdict="undecided") for finding in requested]
            clearance = None
        clear += requested
    certificate = _certificate(record, robot.motors, [*orientation, *ends, *limits, *clear], peaks, len(flight.cells))
    return replace(certificate, orientation_end=_enclosure(last), clearance_min=clearance)


def _proved_in_space(robot: SpatialRobot, record: PlanRecord, budget: int) -> Certificate:
    flight = spatial_flight.fly(robot, record, budget)
    attitude = attitude_findings(record, flight)
    limits, peaks = limit_findings(robot, record, flight, flight.cells)
    states = at_ends(record)
    ends = [*boundary_findings(record, states), *spatial_findings.flight_findings(robot, record, flight, states)]
    clear = clearance_findings(record)
    certificate = _certificate(record, robot.motors, [*attitude, *ends, *limits, *clear], peaks, len(flight.cells))
    return replace(certificate, attitude_bound=flight.attitude.bound)


def _certificate(
    record: PlanRecord,
    motors: Sequence[str],
    findings: Sequence[Finding],
    peaks: Mapping[str, Sequence[Minimum]],
    cells: int,
) -> Certificate:
    """What is proved of flights in a plane and in space alike, with the peaks that ``limit_findings`` gives."""
    resolved = [Finding("resolved", (), "proved", None)] if record.robot.kind == "mjcf" else []
    bounds = {}
    for name, minima in peaks.items():
        bounds[name] = [-peak.bound for peak in minima]
    return Certificate(
        verdict=worst([*resolved, *findings]),
        orientation_end=(-math.inf, math.inf),
        clearance_min=None,
        torque_peak=read_only(bounds["torque_peak"]),
        velocity_peak=read_only(bounds["velocity_peak"]),
        motor_torque_peak=dict(zip(motors, bounds["motor_torque_peak"], strict=True)),
        findings=(*resolved, *findings),
        subintervals=cells,
        seconds=0.0,
    )


def _undecided(robot: RobotRecord, reason: str) -> Certificate:
    """All is unknown of a robot that is not read."""
    unknown = read_only([math.inf] * len(robot.joints))
    return Certificate(
        verdict="undecided",
        orientation_end=(-math.inf, math.inf),
        attitude_bound=None if robot.base is None else math.inf,
        clearance_min=None,
        torque_peak=unknown,
        velocity_peak=unknown,
        motor_torque_peak=dict.fromkeys((*robot.joints, *robot.coupled), math.inf),
        findings=(Finding("robot", (reason,), "undecided", None),),
        subintervals=0,
        seconds=0.0,
    )


def _enclosure(ball: Balls) -> tuple[float, float]:
    """Numbers around the first of a ball's; infinite where it is unknown."""
    low = float(ball.mid[0] - ball.rad[0])
    high = float(ball.mid[0] + ball.rad[0])
    if not low <= high:
        return -math.inf, math.inf
    return math.nextafter(low, -math.inf), math.nextafter(high, math.inf)


def _weights(robot: PlanarRobot, shapes: Sequence[LinkShape] | None) -> ShapeWeights:
    if shapes is None:
        if robot.with_collision:
            reason = f'link "{min(robot.with_collision)}" has a <collision> element, so its shape has to be given'
            raise InputError(reason, element="shapes")
        return shape_weights(robot, None)
    return shape_weights(robot, tuple((link, tuple(start), tuple(end), radius) for link, start, end, radius in shapes))


def _clearances(surroundings: Surroundings, obstacles: Sequence[Any]) -> tuple[list[Finding], float]:
    """One finding per obstacle, one on the recorded minimum, and the proved minimum."""
    findings, least = zip(
        *(obstacle_finding(surroundings, index, obstacle) for index, obstacle in enumerate(obstacles)), strict=True
    )
    bound = min(item.bound for item in least)
    attained = min(item.attained for item in least)
    recorded = surroundings.record.clearance_min
    kind = "recorded"
    subject = ("clearance_min",)
    if recorded is None:  # nothing was near, because no obstacle exists during the flight
        verdict: Verdict = "proved" if bound == math.inf else "refuted" if attained < math.inf else "undecided"
        return [*findings, Finding(kind, subject, verdict, bound, None, None)], bound
    farthest = max(abs(recorded - bound), abs(recorded - attained))
    nearest = max(0.0, recorded - attained, bound - recorded)
    return [*findings, at_most(kind, subject, farthest, nearest, 0.0, RECORDED_CLEARANCE, None)], bound
