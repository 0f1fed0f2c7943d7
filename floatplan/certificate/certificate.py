"""The certificate: is a plan true, for every instant? The plan may be alive, a record, or a file.

What is proved depends on the record, only the URDF and its meshes; of a robot from MJCF on the URDF that the record
holds, as MuJoCo resolved it: that this is what the MJCF says is not proved, and a finding says so. A loaded robot is
needed only for the capsules around collision geometry, which the certificate assumes. See
``docs/certificate.md`` for the statement.
"""

from __future__ import annotations

import cmath
import math
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from floatplan.arguments import flag, optional, whole
from floatplan.arguments import path as as_path
from floatplan.arrays import read_only
from floatplan.certificate.branch_and_bound import Minimum
from floatplan.certificate.clearance import clearance_findings, unfounded_claims, windows
from floatplan.certificate.enclosure import Balls
from floatplan.certificate.limits import at_ends, boundary_findings, limit_findings
from floatplan.certificate.planar.clearance import LinkShape, ShapeWeights, shape_weights
from floatplan.certificate.planar.flight import fly
from floatplan.certificate.planar.inertia import PlanarRobot, cached_robot
from floatplan.certificate.planar.limits import flight_findings, orientation_findings
from floatplan.certificate.planar.obstacles import Surroundings as PlanarSurroundings
from floatplan.certificate.robots.taken import NotReadError
from floatplan.errors import InputError, naming
from floatplan.plans.reading import Recorded, check_meshes, check_parts, checked, find_robot, recorded, recorded_robot
from floatplan.plans.record import PlanRecord, RobotRecord
from floatplan.plans.verdicts import Certificate, Finding, worst
from floatplan.pool import one_thread
from floatplan.robot.robot import LinkCapsule, Robot
from floatplan.robot.shapes.solids import link_placement
from floatplan.robot.urdf.packages import robot_content
from floatplan.robot.urdf.tree import urdf_path
from floatplan.tables import Range

if TYPE_CHECKING:  # see _proved_in_space()
    from floatplan.certificate.spatial.clearance import CapsuleShape, SolidShape

BUDGET = 4096  # [-] cells of time
_ONE_AT_A_TIME = threading.Lock()  # Arb's precision is one for all threads


@one_thread
def certify(
    plan: Recorded | PlanRecord | str | Path,
    *,
    urdf: str | Path | None = None,
    budget: int = BUDGET,
    out_of_plane: bool = False,
) -> Certificate:
    """Prove or refute a plan for every instant of its flight.

    Parameters
    ----------
    plan : Plan, PlanRecord, or path of a plan file
    urdf : path, optional
        The robot's file, where it is no longer where the plan says. Its SHA-256 has to be the recorded one.
    budget : int
        Most cells of time; with fewer than it needs, the proof may end undecided.
    out_of_plane : bool
        Of a plan in a plane, bound also how far the robot leaves it in space, where it is not its own mirror image:
        three findings, on which the verdict does not depend.

    Returns
    -------
    Certificate
        Its ``verdict`` is "proved", "refuted" or "undecided"; see ``docs/certificate.md`` for the statement.

    Raises
    ------
    InputError
        The plan, its URDF or a collision mesh is missing, damaged, or they do not belong together; or a flight in space
        is to be in a plane.
    """
    urdf = optional(as_path)(urdf, "urdf")
    budget = whole(Range(0, 2**63 - 1, ""))(budget, "budget")
    out_of_plane = flag(out_of_plane, "out_of_plane")
    record, file, robot = recorded(plan)
    with naming(file):
        path = urdf_path(find_robot(record.robot, file) if urdf is None else urdf, record.robot.kind)
        record = checked(record)
        shapes: list[Sequence[Any] | None] = [None, None]
        unknown: list[str] = []
        if record.asks_clearance:
            robot = robot or recorded_robot(record.robot, file, path)
            check_meshes(robot, record.robot, file)
            if record.robot.resolved is not None and robot.xml != record.robot.resolved["urdf"]:
                return _undecided(
                    record.robot,
                    "the shapes are of the URDF that MuJoCo makes of the MJCF here, and robot.resolved is another",
                )
            unknown = sorted(set(robot.meshes) - set(record.robot.meshes))
            if "<collision" in robot.xml and record.in_space:
                shapes = [capsules_of(robot), solids_of(robot)]
            elif "<collision" in robot.xml:
                flight = record.problem["flight"]
                standing = [_frame_of(robot, end, flight[end]["frame"]) for end in ("takeoff", "landing")]
                shapes = [shapes_of(robot), shapes_of(robot, robot.hulls(standing, robot.limb_ends))]
        return prove(record, path, shapes, unknown, budget, out_of_plane)


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


def capsules_of(robot: Robot) -> list[CapsuleShape]:
    """Capsules around the links of a loaded robot that flies in space, as ``certify`` takes them."""
    shapes: list[CapsuleShape] = []
    for shape in robot.solid_capsules:
        _, placement = link_placement(robot.model, shape.link)
        start, end = (placement.actInv(end).tolist() for end in (shape.start, shape.end))
        shapes.append((shape.link, start, end, shape.radius))
    return shapes


def solids_of(robot: Robot) -> list[SolidShape]:
    """Solids of the links of a loaded robot that flies in space, by which they are as high over the ground as they are.

    Each is the convex hull of points (k, 3), grown by an ellipsoid whose semi-axes are the columns of a matrix (3, 3),
    m, in the axes of its link.
    """
    shapes: list[SolidShape] = []
    for solid in robot.solids:
        _, placement = link_placement(robot.model, solid.link)
        points = (solid.points - placement.translation) @ placement.rotation
        shapes.append((solid.link, points.tolist(), (placement.rotation.T @ solid.axes).tolist()))
    return shapes


def prove(
    record: PlanRecord,
    path: Path,
    shapes: Sequence[Sequence[Any] | None],
    unknown_meshes: Sequence[str],
    budget: int,
    out_of_plane: bool = False,
) -> Certificate:
    """Prove a record that is ``checked`` for the URDF at ``path``, one thread at a time.

    Another that computes with Arb meanwhile sees its precision change.

    Parameters
    ----------
    shapes : of the links, and their hulls: what stands on the ground
        Capsules, m: places are (horizontal, vertical) from the link's origin, along the root link's axes in the posture
        with all planned positions zero; of a flight in space (x, y, z) in the link's own axes, and the hulls are
        points and semi-axes, as :func:`solids_of` returns them. Of None, a link is the segments from its origin to its
        children's joints; a robot that has ``<collision>`` elements needs them.
    unknown_meshes : files that these are around and whose hashes the record lacks: they leave clearances undecided
    """
    with _ONE_AT_A_TIME:
        start_time = time.perf_counter()
        try:
            if record.robot.kind == "mjcf":
                check_parts(record.robot, path)
            content = robot_content(path)
            with np.errstate(all="ignore"):
                if record.in_space:
                    if out_of_plane:
                        raise InputError("is of plans in a plane, and this flight is in space", element="out_of_plane")
                    certificate = _proved_in_space(content, path, record, shapes, unknown_meshes, budget)
                else:
                    robot = cached_robot(content, path, record.robot)
                    certificate = _proved(robot, record, shapes, unknown_meshes, budget)
                    if out_of_plane:
                        from floatplan.certificate.spatial.out_of_plane import out_of_plane_findings
                        from floatplan.certificate.spatial.robot import cached_robot as cached_in_space

                        free = cached_in_space(content, path, record.robot)
                        end = certificate.orientation_end
                        leaving = out_of_plane_findings(free, record, robot.normal, end, budget)
                        certificate = replace(certificate, findings=(*leaving, *certificate.findings))
        except NotReadError as error:
            return _undecided(record.robot, str(error))
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
    flight = fly(robot, record, windows(record), budget)
    orientation, last = orientation_findings(record, flight)
    limits, peaks = limit_findings(robot, record, flight.joints, flight.cells)
    states = at_ends(record)
    ends = [*boundary_findings(record, states), *flight_findings(robot, record, flight, states)]
    clear = unfounded_claims(record)
    clearance = None
    if record.asks_clearance:
        of_links, of_hulls = shapes
        standing = None if of_hulls is None else _weights(robot, of_hulls)
        surroundings = PlanarSurroundings(robot, record, flight, _weights(robot, of_links), standing)
        distances, clearance = clearance_findings(record, surroundings, unknown_meshes)
        clear += distances
    certificate = _certificate(record, robot.motors, [*orientation, *ends, *limits, *clear], peaks, len(flight.cells))
    return replace(certificate, orientation_end=_enclosure(last), clearance_min=clearance)


def _proved_in_space(
    content: bytes,
    path: Path,
    record: PlanRecord,
    shapes: Sequence[Sequence[Any] | None],
    unknown_meshes: Sequence[str],
    budget: int,
) -> Certificate:
    # Here, because most flights are in a plane, and what follows takes longer to load than their proof.
    from floatplan.certificate.spatial.findings import attitude_findings
    from floatplan.certificate.spatial.findings import flight_findings as findings_in_space
    from floatplan.certificate.spatial.flight import fly as fly_in_space
    from floatplan.certificate.spatial.obstacles import Surroundings as SpatialSurroundings
    from floatplan.certificate.spatial.robot import cached_robot as cached_in_space

    robot = cached_in_space(content, path, record.robot)
    flight = fly_in_space(robot, record, windows(record), budget)
    attitude = attitude_findings(record, flight)
    limits, peaks = limit_findings(robot, record, flight, flight.cells)
    states = at_ends(record)
    ends = [*boundary_findings(record, states), *findings_in_space(robot, record, flight, states)]
    clear = unfounded_claims(record)
    clearance = None
    if record.asks_clearance:
        surroundings = SpatialSurroundings(robot, record, flight, *shapes)
        distances, clearance = clearance_findings(record, surroundings, unknown_meshes)
        clear += distances
    certificate = _certificate(record, robot.motors, [*attitude, *ends, *limits, *clear], peaks, len(flight.cells))
    return replace(certificate, attitude_bound=flight.attitude.bound, clearance_min=clearance)


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
