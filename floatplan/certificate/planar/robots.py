"""Robots read once: what follows from a URDF file's content and a record's roles alone is kept for the next proof."""

from __future__ import annotations

import json
from pathlib import Path

from floatplan.certificate.planar.inertia import PlanarRobot, planar_robot
from floatplan.certificate.planar.urdf import read_urdf, recorded_content
from floatplan.plans.record import RobotRecord

MOST = 8  # robots kept

_kept: dict[str, PlanarRobot] = {}


def recorded_robot(path: Path, record: RobotRecord) -> PlanarRobot:
    """Return the robot of a record. Its file is read, and its hash compared with the record's, every time.

    For one thread at a time, as proofs are.

    Raises
    ------
    InputError
        As :func:`~floatplan.certificate.planar.urdf.recorded_urdf` and
        :func:`~floatplan.certificate.planar.inertia.planar_robot`.
    """
    content = recorded_content(path, record.sha256)
    key = json.dumps([record.sha256, record.plane, record.joints, record.coupled, record.locked])
    robot = _kept.get(key)
    if robot is None:
        robot = planar_robot(read_urdf(content, path), record)
        if len(_kept) >= MOST:
            del _kept[next(iter(_kept))]
        _kept[key] = robot
    return robot
