"""How far a plan in a plane leaves it: joints that move as planned, and a base that turns in space as it must.

Planar theory takes a robot for its own mirror image in the plane. What is enclosed here is the solution of (S1) for the
planned joints, with the planned angular momentum along the plane's normal, and takeoff in the plane. A rotation about
the normal before takeoff changes neither, and turns the whole flight: it is enclosed from the attitude 1 on, and what
the base has turned since takeoff is compared with what it was planned to turn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import flint
import numpy as np

from floatplan.arrays import Array
from floatplan.certificate.branch_and_bound import Minimum
from floatplan.certificate.enclosure import PRECISION, Balls, Taylor, stack
from floatplan.certificate.limits import LimitedQuantity, least_of
from floatplan.certificate.spatial.findings import angle_between
from floatplan.certificate.spatial.flight import SpatialEnclosure, fly
from floatplan.certificate.spatial.robot import SpatialRobot
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding

LEAST = 1e-30  # [-] sine of a tilt, so that there is something to divide by


def out_of_plane_findings(
    robot: SpatialRobot, record: PlanRecord, normal: Array, orientation_end: tuple[float, float], budget: int
) -> list[Finding]:
    """Bounds, rad, on the tilt of the base out of its plane, and on how far it lands from its planned attitude.

    Parameters
    ----------
    robot : the record's robot in space
    record : of a plan in a plane
    normal : (3,) of the plane
        A unit vector along plus or minus one of the root link's axes, as angles turn about it.
    orientation_end : what encloses the planned orientation at landing, rad
    budget : most cells of time
    """
    duration = record.duration
    spatial = replace(
        record,
        angular_momentum=record.angular_momentum * normal,
        orientation={"start": {"quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}},
    )
    flight = fly(robot, spatial, (), budget)
    axis = int(np.argmax(np.abs(normal)))
    steepest = _steepest(flight, axis)
    with flint.ctx.workprec(PRECISION):
        last = flight.last_quaternion
        across = _length([last[k] for k in range(3) if k != axis])
        tilt = 2 * flint.arb.atan2(across, _length([last[axis], last[3]]))
        low, high = (flint.arb(end) - record.orientation["start"] for end in orientation_end)
        planned = _about(axis, float(normal[axis]) * low.union(high))
        off = angle_between(last, planned)
    return [
        _finding("flight", _angle_of_sine(-steepest.bound), steepest.instant),
        _finding("landing", _upper(tilt, flight.attitude.bound), duration),
        _finding("attitude", _upper(off, flight.attitude.bound), duration),
    ]


def _steepest(flight: SpatialEnclosure, axis: int) -> Minimum:
    """Minus the largest sine of the angle between the plane's normal and what was along it at takeoff.

    The squares of the other two entries of that column of R are added, in units of about the largest, so that a
    small sine is known as sharply as a large one.
    """
    attitudes = flight.attitude.attitudes
    entries = []
    for row in range(3):
        if row != axis:
            coefficients = attitudes.c[:, :, :, row, axis].transpose(2, 0, 1)
            entries.append(Taylor(coefficients, attitudes.entries[:, :, row, axis]))
    across = stack(entries)
    largest = float(np.max(across.size + across.e))
    if not math.isfinite(largest):
        return Minimum(bound=-math.inf, attained=0.0, instant=0.0, member=0)
    unit = 2.0 ** math.ceil(math.log2(max(largest, LEAST)))
    scaled = across.times(Balls.exact(1.0 / unit))
    square = LimitedQuantity("out_of_plane", ("flight",), (scaled * scaled).sum(), math.inf, power=2)
    (least,) = least_of([square], flight.cells)
    sine = unit * square.root(-least.bound, math.inf)
    return replace(least, bound=-sine)


def _angle_of_sine(sine: float) -> float:
    """The largest tilt, which is zero at takeoff, where its sine is never larger than this; unknown beyond 1."""
    return math.asin(sine) * (1.0 + 1e-12) if sine < 1.0 else math.inf


def _length(numbers: Sequence[Any]) -> Any:
    """The length of a vector of Arb's numbers."""
    return sum((number * number for number in numbers), start=flint.arb(0)).nonnegative_part().sqrt()


def _about(axis: int, angle: Any) -> list[Any]:
    """The quaternion of a rotation about one of the axes by an angle, rad, in Arb."""
    sine, cosine = (angle / 2).sin_cos()
    about = [flint.arb(0)] * 3
    about[axis] = sine
    return [*about, cosine]


def _upper(angle: Any, radius: float) -> float:
    """The upper end of an angle in Arb that is off by at most a radius, rad; infinite where it is not known."""
    upper = float(angle.upper()) + radius
    return math.nextafter(upper, math.inf) if math.isfinite(upper) else math.inf


def _finding(subject: str, bound: float, instant: float) -> Finding:
    """A bound that nothing limits; one that is not known proves nothing."""
    return Finding("out_of_plane", (subject,), "proved" if math.isfinite(bound) else "undecided", bound, instant)
