"""What a plan file's problem may ask: a key that the certificate does not know is something that it would not prove."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from floatplan.errors import InputError
from floatplan.plan_record import PlanRecord

POSTURE = ("orientation", "positions", "velocities", "accelerations")
KEYS: Mapping[str, Collection[str]] = {
    "problem": ("name", "ground", "start", "goal", "flight", "motion", "limits", "obstacles", "self_clearance"),
    "problem.start": POSTURE,
    "problem.goal": POSTURE,
    "problem.flight": ("duration", "angular_momentum", "takeoff", "landing", "horizontal_velocity", "gravity"),
    "problem.flight.takeoff": ("frame", "position"),
    "problem.flight.landing": ("frame", "height"),
    "problem.limits": ("position", "velocity", "torque", "motor_torque", "motor", "orientation_rate"),
}
MOTOR, PAIR, COUPLING = ("stall", "slope"), ("links", "margin"), ("leader", "ratio", "offset")
OBSTACLE = ("kind", "margin", "velocity", "window")
KINDS: Mapping[Any, Collection[str]] = {
    "circle": ("center", "radius"),
    "half-plane": ("point", "normal"),
    "capsule": ("start", "end", "radius"),
}
MOMENTUM = ("midpoint", "free")


def check_asked(record: PlanRecord) -> None:
    """Refuse what the certificate would pass over.

    Raises
    ------
    InputError
        A table holds a key that is not known, limits are not one per joint, or the angular momentum is a word that is
        none.
    """
    for element, table, known in _tables(record):
        if not isinstance(table, Mapping):
            raise InputError("is no table", element=element)
        unknown = sorted(set(table) - set(known))
        if unknown:
            raise InputError("is not known, and so cannot be proved", element=f"{element}.{unknown[0]}")
    limits = record.problem["limits"]
    for name in ("position", "velocity", "torque"):
        if not isinstance(limits[name], list | tuple) or len(limits[name]) != len(record.robot.joints):
            raise InputError("does not hold one entry per joint", element=f"problem.limits.{name}")
    momentum = record.problem["flight"]["angular_momentum"]
    if isinstance(momentum, str) and momentum not in MOMENTUM:
        raise InputError(f'"{momentum}" is no angular momentum', element="problem.flight.angular_momentum")


def _tables(record: PlanRecord) -> Iterator[tuple[str, Any, Collection[str]]]:
    """Where each table is, the table, and the keys that it may have."""
    for element, keys in KEYS.items():
        table: Any = {"problem": record.problem}
        for name in element.split("."):
            table = table[name]
        yield element, table, keys
    for joint, motor in (record.problem["limits"].get("motor") or {}).items():
        yield f"problem.limits.motor.{joint}", motor, MOTOR
    for index, obstacle in enumerate(record.problem.get("obstacles") or []):
        yield f"problem.obstacles[{index}]", obstacle, (*OBSTACLE, *KINDS.get(obstacle["kind"], ()))
    for index, pair in enumerate(record.problem.get("self_clearance") or []):
        yield f"problem.self_clearance[{index}]", pair, PAIR
    for joint, coupling in record.robot.coupled.items():
        yield f"robot.coupled.{joint}", coupling, COUPLING
