"""Which part each joint of a URDF has in a plan: planned, coupled or locked, with a motor of its own or without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from floatplan.arrays import Array
from floatplan.certificate.planar.urdf import Joint, Urdf
from floatplan.errors import InputError
from floatplan.plans.record import RobotRecord


def check_roles(urdf: Urdf, record: RobotRecord) -> None:
    """Refuse a record that leaves a moving joint of the file without a role, or gives one two or none it can have."""
    moving = {joint.name: joint for joint in urdf.joints if joint.kind != "fixed"}
    roles = [*record.joints, *record.coupled, *record.locked]
    for name in roles:
        if name not in moving:
            raise InputError(f'the robot has no joint "{name}" that moves', element="robot")
    if len(set(roles)) != len(roles):
        raise InputError("a joint has two roles", element="robot")
    for name, joint in moving.items():
        if name not in roles:
            raise InputError(f'joint "{name}" is neither planned, nor coupled, nor locked', element="robot")
        if joint.kind == "prismatic" and name not in record.locked:
            raise InputError(f'joint "{name}" is prismatic and can only be locked', element="robot")
    for name, coupling in record.coupled.items():
        if not isinstance(coupling, Mapping) or coupling.get("leader") not in record.joints:
            raise InputError("its leader must be a planned joint", element=f"robot.coupled.{name}")


def motors_of(urdf: Urdf, record: RobotRecord) -> tuple[str, ...]:
    """The planned joints, and the coupled ones less those that the file itself couples just so."""
    by_name = {joint.name: joint for joint in urdf.joints}
    return (*record.joints, *(name for name in record.coupled if not _is_geared(by_name, record, name)))


def _is_geared(joints: Mapping[str, Joint], record: RobotRecord, name: str) -> bool:
    """Whether the file's ``<mimic>``, followed to the joint that leads, says what the record's coupling says."""
    ratio, offset, leader, settled = 1.0, 0.0, name, {*record.joints, *record.locked}
    for _ in joints:
        mimic = joints[leader].mimic
        if mimic is None or leader in settled:
            break
        ratio, offset, leader = ratio * mimic.multiplier, offset + ratio * mimic.offset, mimic.leader
        if leader not in joints:
            return False
    coupling = record.coupled[name]
    said = (coupling["leader"], float(coupling.get("ratio", 1.0)), float(coupling.get("offset", 0.0)))
    return leader != name and said == (leader, ratio, offset)


def motor_ratios(record: RobotRecord, motors: Sequence[str]) -> Array:
    """Ratios (m, n) of the motors' positions to those of the planned joints."""
    ratios = np.zeros((len(motors), len(record.joints)))
    for index, name in enumerate(motors):
        coupling = record.coupled.get(name, {"leader": name})
        ratios[index, record.joints.index(coupling["leader"])] = float(coupling.get("ratio", 1.0))
    return ratios


def position_at_zero(joint: Joint, record: RobotRecord) -> float:
    """Position of a joint, rad or m, where the planned ones are at zero."""
    if joint.name in record.coupled:
        return float(record.coupled[joint.name].get("offset", 0.0))
    return float(record.locked.get(joint.name, 0.0))
