"""What a plan file's problem may ask: which keys there are, and what each may hold.

A key that the certificate does not know is something that it would not prove, and a value of another kind something
that it would pass over: both are refused, and so are the few numbers that have to fit each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from floatplan.errors import InputError
from floatplan.plans.kinds import (
    POINT,
    Check,
    ListOf,
    OneOf,
    OrNull,
    Table,
    boolean,
    check_table,
    direction,
    non_negative,
    number,
    positive,
    text,
    whole,
)
from floatplan.plans.reading import as_written
from floatplan.plans.record import PlanRecord
from floatplan.tables import JOINT_LIMITS, MOST_OBSTACLES, OBJECTIVES, REST

MOMENTUM = ("midpoint", "free")


def check_asked(record: PlanRecord) -> None:
    """Refuse what the certificate would pass over.

    Raises
    ------
    InputError
        A table of the problem holds a key that is not known or lacks one, a value is of the wrong kind, a list is not
        one entry per joint; or degree, objective and coefficients do not fit together.
    """
    joints = record.robot.joints
    if len(set(joints)) != len(joints):
        raise InputError("names a joint twice", element="robot.joints")
    _problem_table(joints, (*joints, *record.robot.coupled))(record.problem, "problem")
    for name in ("obstacles", "self_clearance"):
        count = len(record.problem.get(name) or ())
        if count > MOST_OBSTACLES:
            raise InputError(f"{count} of them, more than {MOST_OBSTACLES}", element=f"problem.{name}")
    _check_degree(record)
    objective = record.problem["motion"]["objective"]
    if record.objective["name"] != objective:
        raise InputError(f"is {record.objective['name']!r}, but {objective!r} is asked", element="objective.name")


def checked(record: PlanRecord) -> PlanRecord:
    """Return a record as its file would be read, having seen that nothing in it would be passed over.

    Raises
    ------
    InputError
        As :func:`floatplan.plans.reading.as_written` and :func:`check_asked`.
    """
    written = as_written(record)
    check_asked(written)
    return written


SHARED: Mapping[str, Check] = {"margin": non_negative, "velocity": POINT, "window": OrNull(POINT)}
OBSTACLES: Mapping[str, Mapping[str, Check]] = {
    "circle": {"center": POINT, "radius": non_negative},
    "half-plane": {"point": POINT, "normal": direction},
    "capsule": {"start": POINT, "end": POINT, "radius": non_negative},
}


@lru_cache(maxsize=8)
def _problem_table(joints: tuple[str, ...], moving: tuple[str, ...]) -> Table:
    n = len(joints)
    numbers = ListOf(number, n)
    limits = ListOf(OrNull(number), n)
    motor: Check = Table({"stall": positive, "slope": non_negative})
    postures = {
        end: Table(
            {"orientation": number, "positions": numbers, "velocities": numbers, "accelerations": numbers},
            optional={"velocities_asked": OneOf((rest,)), "accelerations_asked": OneOf(("free",))},
        )
        for end, rest in REST.items()
    }
    return Table(
        {
            **postures,
            "flight": Table(
                {
                    "duration": positive,
                    "angular_momentum": _angular_momentum,
                    "takeoff": Table({"frame": text, "position": POINT}),
                    "landing": Table({"frame": text, "height": number}),
                    "horizontal_velocity": number,
                    "gravity": number,
                }
            ),
            "motion": Table({"degree": _degree(n), "objective": OneOf(OBJECTIVES)}),
            "limits": Table(
                {"position": ListOf(POINT, n), "torque": limits, **_joint_limits(limits, required=True)},
                {
                    **_joint_limits(limits, required=False),
                    "motor": Table({}, dict.fromkeys(moving, motor)),
                    "motor_torque": Table({}, dict.fromkeys(moving, positive)),
                    "orientation_rate": OrNull(number),
                },
            ),
        },
        {"name": text, "ground": boolean, "obstacles": ListOf(_obstacle), "self_clearance": ListOf(_pair)},
    )


def _joint_limits(limits: Check, required: bool) -> dict[str, Check]:
    """Limits that every plan file has, or those that may be left out."""
    return {row.key: limits for row in JOINT_LIMITS if row.always == required}


def _angular_momentum(value: Any, element: str) -> None:
    (OneOf(MOMENTUM) if isinstance(value, str) else number)(value, element)


def _degree(n: int) -> Check:
    def check(value: Any, element: str) -> None:
        if isinstance(value, str):
            OneOf(("auto",))(value, element)
        elif isinstance(value, list | tuple):
            ListOf(whole, n)(value, element)
        else:
            whole(value, element)

    return check


def _obstacle(value: Any, element: str) -> None:
    check_table(value, element)
    kind = value.get("kind")
    OneOf(tuple(OBSTACLES))(kind, f"{element}.kind")
    Table({"kind": text, **OBSTACLES[kind]}, SHARED)(value, element)
    window = value.get("window")
    if window is not None and not window[0] <= window[1]:
        raise InputError(f"ends at {window[1]} s before it begins at {window[0]} s", element=f"{element}.window")


def _pair(value: Any, element: str) -> None:
    Table({"links": ListOf(text, 2)}, {"margin": non_negative})(value, element)
    if value["links"][0] == value["links"][1]:
        raise InputError("names one link twice", element=f"{element}.links")


def _check_degree(record: PlanRecord) -> None:
    """The coefficients are those of polynomials of the degrees asked for, (12)."""
    degree, n = record.problem["motion"]["degree"], len(record.robot.joints)
    if isinstance(degree, str):
        return
    degrees = list(degree) if isinstance(degree, list | tuple) else [degree] * n
    written = record.coefficients.shape[1] - 1
    if max(degrees, default=written) != written:
        raise InputError(f"is {degree}, but the coefficients are of degree {written}", element="problem.motion.degree")
    for joint, row, own in zip(record.robot.joints, record.coefficients, degrees, strict=True):
        if row[own + 1 :].any():
            raise InputError(f"is {own} for {joint}, whose coefficients go beyond", element="problem.motion.degree")
