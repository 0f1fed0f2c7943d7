"""Findings on a flight in space: attitude, turns, takeoff and landing, and what the file says of them.

The true attitude is within a proved bound of the approximation, which at both ends of the flight is a quaternion whose
parts are sums of doubles: all that is said of the ends is computed from these in Arb. Quaternions are lists x, y, z,
w.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import flint
import numpy as np

from floatplan.arrays import Array
from floatplan.certificate.branch_and_bound import SAME, at_most, near
from floatplan.certificate.enclosure import PRECISION, Balls, Taylor
from floatplan.certificate.limits import JointState, LimitedQuantity, least_of, same
from floatplan.certificate.robots.columns import LETTERS
from floatplan.certificate.spatial.attitude import rotation
from floatplan.certificate.spatial.bound import LARGEST
from floatplan.certificate.spatial.flight import MOST_CELLS_UNKNOWN, SpatialEnclosure
from floatplan.certificate.spatial.robot import SpatialRobot
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding, Kind, Subject
from floatplan.tables import A_TURN_OFF, CLEARANCE, LARGEST_MIDDLE_ANGLE, ORIENTATION

SHARP = 1e-10  # [rad] of a residual that more cells do not make much smaller
TILT = 1e-2  # [rad] by which the tilt may pass its limit between the instants at which the search sees it
STEP = 1.0  # [rad] by which first and third angle change at most between the instants at which they are counted
MOST_INSTANTS = 100_000  # [-] at which they are
SEEN = 1e-6  # [rad] that doubles are off by, by far, where angles are counted
NEAR_A_QUARTER = 1e-3  # [-] cosine of a tilt below which nothing is counted


def attitude_findings(record: PlanRecord, flight: SpatialEnclosure) -> list[Finding]:
    """What the theorem needs and gives, and the attitude at both ends."""
    problem = record.problem
    recorded = record.orientation
    duration = record.duration
    eps = flight.attitude.bound
    with flint.ctx.workprec(PRECISION):
        start, goal = (_asked(problem[end]["orientation"]) for end in ("start", "goal"))
        stated = {}
        for name, attitude in recorded.items():
            stated[name] = [flint.arb(part) for part in attitude["quaternion_xyzw"]]
        last = flight.last_quaternion
        reached = _angle_finding("goal", ("orientation",), angle_between(last, goal), eps, ORIENTATION, duration)
        return [
            *_theorem(flight, is_enough=reached.verdict != "undecided"),
            reached,
            *_turn_findings(record, flight),
            _angle_finding("stated", ("orientation", "start"), angle_between(stated["start"], start), 0.0, SAME, 0.0),
            _angle_finding("stated", ("orientation", "goal"), angle_between(stated["goal"], goal), 0.0, SAME, duration),
            _angle_finding(
                "recorded", ("orientation.end",), angle_between(last, stated["end"]), eps, ORIENTATION, duration
            ),
        ]


def _theorem(flight: SpatialEnclosure, is_enough: bool) -> list[Finding]:
    """The terms of (S3), and, where they do not prove enough, which of them is too coarse and what would help."""
    attitude = flight.attitude
    terms = (("residual", attitude.residual), ("amplification", attitude.amplification))
    findings = []
    for name, value in terms:
        findings.append(Finding("attitude", (name,), "proved" if math.isfinite(value) else "undecided", value))
    findings += [
        _below("condition", attitude.condition, 1.0),
        _below("bound", attitude.bound, LARGEST),
    ]
    if not is_enough or any(finding.verdict != "proved" for finding in findings):
        findings.append(Finding("attitude", (_advice(flight),), "undecided", None))
    return findings


def _below(name: str, value: float, limit: float) -> Finding:
    """A term that has to be below a limit; what is not is no violation, it only proves nothing."""
    if value < limit:
        return Finding("attitude", (name,), "proved", value, None, limit)
    return Finding("attitude", (name,), "undecided", value, None, limit, value - limit)


def _advice(flight: SpatialEnclosure) -> str:
    """Which term is too coarse, and what would help."""
    attitude = flight.attitude
    more = "a larger budget of cells of time may help"
    if not math.isfinite(attitude.residual):
        return f"the motion is too coarse in {len(flight.cells)} cells; {more}"
    grows = f"{attitude.amplification:.0f} times"
    if not math.isfinite(attitude.amplification):
        grows = "without a bound"
    if not math.isfinite(attitude.amplification) and len(flight.cells) < MOST_CELLS_UNKNOWN:
        return f"the transitions are too coarse in {len(flight.cells)} cells; {more}"
    if attitude.residual > SHARP:
        return f"the residual of {attitude.residual:.1e} rad is too coarse; {more}"
    return (
        f"the goal to within {ORIENTATION:g} rad is beyond double precision: a small turn grows {grows} in flight; "
        "fewer turns or a shorter flight may help, and in flight it needs corrections"
    )


def _turn_findings(record: PlanRecord, flight: SpatialEnclosure) -> list[Finding]:
    """Where the goal is given as angles: that the flight makes these turns, and that they are defined all along.

    The magnitude of ``e_a . R e_c``, with the first axis a and the third axis c, is the sine of the tilt, whether c is
    another axis than a or a itself. First and third angle change by ``|omega| / cos(tilt)`` at most: the angle between
    their axes has that sine, and the axis between is square to both.
    """
    goal = record.problem["goal"]["orientation"]
    axes = goal.get("axes")
    if axes is None:
        return []
    first, third = LETTERS.index(axes[0]), LETTERS.index(axes[2])
    matrices = flight.attitude.attitudes
    entry = Taylor(
        np.ascontiguousarray(matrices.c[..., first, third].transpose(2, 0, 1)), matrices.entries[..., first, third]
    )
    sine = math.sin(LARGEST_MIDDLE_ANGLE + TILT)
    (least,) = least_of([LimitedQuantity("goal", ("tilt",), entry, sine)], flight.cells)
    sine, attained = -least.bound, -least.attained
    tilt = math.asin(min(1.0, sine)) + SEEN if sine >= 0.0 else math.inf
    seen = math.asin(max(0.0, min(1.0, attained))) - SEEN
    tilts = at_most("goal", ("tilt",), tilt, seen, LARGEST_MIDDLE_ANGLE, TILT, least.instant)
    cosine = math.sqrt(max(0.0, 1.0 - sine * sine))
    turns: Finding = Finding("goal", ("turns",), "undecided", math.inf, record.duration, 0.0, math.inf)
    if math.isfinite(flight.attitude.bound) and cosine > NEAR_A_QUARTER:
        off = _turns_off(record, flight, axes, cosine)
        if off is not None:
            slack = SEEN + 2.0 * flight.attitude.bound / cosine
            turns = at_most("goal", ("turns",), off + slack, off - slack, 0.0, A_TURN_OFF, record.duration)
    return [turns, tilts]


def _turns_off(record: PlanRecord, flight: SpatialEnclosure, axes: str, cosine: float) -> float | None:
    """By how much, rad, the three angles change otherwise than asked; None where that takes too many instants.

    They are counted from instant to instant, so close that first and third change by less than half a turn between two.
    """
    start, goal = record.problem["start"]["orientation"], record.problem["goal"]["orientation"]
    lengths = flight.cells.high - flight.cells.low
    counts = np.ceil(flight.rate.norm[:, 0] * lengths / (cosine * STEP)) + 1.0
    if not counts.sum() <= MOST_INSTANTS:
        return None
    attitudes = []
    for count, quaternion in zip(counts, flight.quaternions, strict=True):
        instants = np.linspace(-1.0, 1.0, int(count) + 1)[:, None]
        attitudes.append(rotation(instants ** np.arange(len(quaternion)) @ quaternion))
    angles = _angles(axes, np.concatenate(attitudes))
    angles[:, [0, 2]] = np.unwrap(angles[:, [0, 2]], axis=0)
    with flint.ctx.workprec(PRECISION):
        at_start = np.array([float(part) for part in _asked(start)])
    begins = start["angles"] if start.get("axes") == axes else _angles(axes, rotation(at_start[None]))[0]
    change = np.array(goal["angles"], dtype=np.float64) - np.array(begins, dtype=np.float64)
    return float(np.abs(angles[-1] - angles[0] - change).max())


def _angles(axes: str, rotations: Array) -> Array:
    """Angles (N, 3), rad, of ``R_a(first) R_b(second) R_c(third)`` from rotations (N, 3, 3).

    The second is between -90 and 90 degrees where c is another axis than a, between 0 and 180 where it is a.
    """
    a, b, c = (LETTERS.index(letter) for letter in axes)
    unit = np.eye(3)
    along, inwards = rotations[:, :, c], rotations[:, a, :]  # R e_c, and R^T e_a
    if a != c:
        second = np.arcsin(np.clip(along[:, a] * (np.cross(unit[b], unit[c]) @ unit[a]), -1.0, 1.0))
        first = np.arctan2(along @ np.cross(unit[a], unit[c]), along[:, c])
        third = np.arctan2(-(inwards @ np.cross(unit[c], unit[a])), inwards[:, a])
    else:
        across = np.cross(unit[b], unit[a])
        second = np.arccos(np.clip(along[:, a], -1.0, 1.0))
        first = np.arctan2(along[:, b], along @ across)
        third = np.arctan2(inwards[:, b], -(inwards @ across))
    return np.stack([first, second, third], axis=1)


def flight_findings(
    robot: SpatialRobot, record: PlanRecord, flight: SpatialEnclosure, states: Sequence[JointState]
) -> list[Finding]:
    """The centre of mass leaves the takeoff frame where asked, and brings the landing frame down to its height.

    ``states`` are those of :func:`~floatplan.certificate.limits.at_ends`.
    """
    asked = record.problem["flight"]
    duration = record.duration
    com = record.com
    with flint.ctx.workprec(PRECISION):
        first = [flint.arb(part) for part in record.orientation["start"]["quaternion_xyzw"]]
        left = _frame_place(robot, record, states[0], asked["takeoff"]["frame"], 0.0, first, 0.0)
        landed = _frame_place(
            robot, record, states[1], asked["landing"]["frame"], duration, flight.last_quaternion, flight.attitude.bound
        )
    across = asked["horizontal_velocity"]
    findings = [
        near("takeoff", ("position",), left, asked["takeoff"]["position"], CLEARANCE, 0.0),
        near("landing", ("height",), landed[2:], [asked["landing"]["height"]], CLEARANCE, duration),
        same("stated", ("com", "gravity"), com["gravity"], asked["gravity"], None),
        _same_vector(("com", "velocity0"), com["velocity0"][:2], _vector(across, 2), "stated"),
    ]
    if not isinstance(asked["angular_momentum"], str):
        h = _vector(asked["angular_momentum"], 3)
        findings.append(_same_vector((), record.angular_momentum.tolist(), h, "angular_momentum"))
    for end, kind in (("start", "takeoff"), ("goal", "landing")):
        if record.problem[end].get("velocities_asked"):  # not planned for in space, and so not known how to prove
            findings.append(Finding(kind, ("frame_velocity",), "undecided", None))
    return findings


def _vector(value: Any, count: int) -> list[float]:
    """Numbers as a problem gives them: a list, or 0 for all."""
    return [float(part) for part in value] if isinstance(value, list | tuple) else [float(value)] * count


def _same_vector(subject: Subject, numbers: Sequence[float], others: Sequence[float], kind: Kind) -> Finding:
    """The worst of pairs of numbers that should be the same."""
    found = [same(kind, subject, number, other, None) for number, other in zip(numbers, others, strict=True)]
    verdicts = ("proved", "undecided", "refuted")
    return max(found, key=lambda finding: (verdicts.index(finding.verdict), finding.bound))


def _asked(orientation: Mapping[str, Any]) -> list[Any]:
    """An attitude of the problem as a quaternion of any length, in Arb."""
    if orientation.get("quaternion_xyzw") is not None:
        return [flint.arb(float(part)) for part in orientation["quaternion_xyzw"]]
    found = [flint.arb(0), flint.arb(0), flint.arb(0), flint.arb(1)]
    for letter, angle in zip(orientation["axes"], orientation["angles"], strict=True):
        sine, cosine = (flint.arb(float(angle)) / 2).sin_cos()
        about = [flint.arb(0)] * 3
        about[LETTERS.index(letter)] = sine
        found = _times(found, [*about, cosine])
    return found


def _times(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """The product of two quaternions."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by + ay * bw + az * bx - ax * bz,
        aw * bz + az * bw + ax * by - ay * bx,
        aw * bw - ax * bx - ay * by - az * bz,
    ]


def angle_between(one: Sequence[Any], other: Sequence[Any]) -> Any:
    """The angle between two attitudes, in Arb, of quaternions of any length."""
    x, y, z, w = _times(one, [-other[0], -other[1], -other[2], other[3]])
    return 2 * flint.arb.atan2((x * x + y * y + z * z).nonnegative_part().sqrt(), abs(w))


def _angle_finding(
    kind: Kind, subject: Subject, angle: Any, radius: float, tolerance: float, instant: float
) -> Finding:
    """A finding on an angle, known to within a radius, that should be zero."""
    upper = float((angle + flint.arb(radius)).upper()) if math.isfinite(radius) else math.inf
    lower = float((angle - flint.arb(radius)).lower()) if math.isfinite(radius) else 0.0
    return at_most(kind, subject, math.nextafter(upper, math.inf), math.nextafter(lower, -1.0), 0.0, tolerance, instant)


def _frame_place(
    robot: SpatialRobot,
    record: PlanRecord,
    state: JointState,
    frame: str,
    instant: float,
    quaternion: Sequence[Any],
    radius: float,
) -> Balls:
    """Place (3,) of a frame at one end of the flight: ``c + R sum_b R_b w_b``, with R known to within a radius."""
    if frame not in robot.frames:
        raise ValueError(f'the robot has no frame "{frame}"')
    weights = robot.weights_of(robot.frames[frame])
    bodies = [flint.arb_mat([[1, 0, 0], [0, 1, 0], [0, 0, 1]])]
    for joint, (still, by_sine, by_cosine) in enumerate(robot.turns):
        angle = robot.ratio[joint] * state[0][robot.leader[joint]] + robot.offset[joint]
        sine, cosine = angle.sin_cos()
        bodies.append(bodies[robot.parent[joint]] * (still + by_sine * sine + by_cosine * cosine))
    relative = flint.arb_mat(3, 1)
    for body, turned in enumerate(bodies):
        relative += turned * flint.arb_mat(3, 1, weights[3 * body : 3 * body + 3])
    length = sum((part * part for part in relative.entries()), start=flint.arb(0)).sqrt()
    off = flint.arb(0, float((length * radius).upper())) if math.isfinite(radius) else flint.arb(0, math.inf)
    t = flint.arb(instant)
    fall = [flint.arb(0), flint.arb(0), flint.arb(record.com["gravity"]) / 2 * t * t]
    com = zip(record.com["position0"], record.com["velocity0"], fall, strict=True)
    path = [flint.arb(float(place)) + flint.arb(float(rate)) * t - fallen for place, rate, fallen in com]
    turned = _matrix(quaternion) * relative
    return Balls.from_arb([path[k] + turned[k, 0] + off for k in range(3)], (3,))


def _matrix(quaternion: Sequence[Any]) -> Any:
    """The rotation (3, 3) of a quaternion of any length."""
    x, y, z, w = quaternion
    square = x * x + y * y + z * z + w * w
    across = flint.arb_mat([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    one = flint.arb_mat([[1, 0, 0], [0, 1, 0], [0, 0, 1]])
    return one + (across * w + across * across) * (2 / square)
