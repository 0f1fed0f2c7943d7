"""Robots that the certificate has read, cached by what they depend on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from floatplan.certificate.robots.taken import NotReadError
from floatplan.certificate.robots.urdf import Urdf, read_urdf
from floatplan.errors import InputError
from floatplan.files import check_hash, json_value
from floatplan.plans.record import RobotRecord

MOST = 8  # robots in the cache
R = TypeVar("R")

_cache: dict[str, Any] = {}


def cached_robot(content: bytes, path: Path, record: RobotRecord, make: Callable[[Urdf, RobotRecord], R]) -> R:
    """Return the robot of a record; robots are cached by their file's content and the record's roles.

    The content's hash is compared with the record's every time. Of an MJCF so is that of the URDF that
    the record holds, and the robot is that of this URDF.
    For one thread at a time, as proofs are.

    Parameters
    ----------
    content : of the file at ``path``; of a xacro file, the URDF that it makes
    make : function that makes the robot of a file's links and joints, and of a record

    Raises
    ------
    InputError
        The content has another SHA-256; or as ``make`` and
        :func:`~floatplan.certificate.robots.urdf.read_urdf`.
    NotReadError
        The record holds no URDF of an MJCF; or as :func:`~floatplan.certificate.robots.taken.as_recorded`.
    """
    check_hash(content, record.sha256, path)
    digest = record.sha256
    if record.kind == "mjcf":
        path = Path("robot.resolved.urdf")
        content, digest = _resolved(record)
    roles = [record.plane, record.base, record.joints, record.coupled, record.locked, record.armature]
    taken = [record.balance_inertias, record.payload]
    key = json.dumps(json_value([make.__name__, record.kind, digest, *roles, *taken]))
    if key not in _cache:
        robot = make(read_urdf(content, path), record)
        if len(_cache) >= MOST:
            del _cache[next(iter(_cache))]
        _cache[key] = robot
    robot_of_record: R = _cache[key]
    return robot_of_record


def _resolved(record: RobotRecord) -> tuple[bytes, str]:
    """The URDF that a record holds of an MJCF, and its SHA-256."""
    if record.resolved is None:
        raise NotReadError("the MJCF", ": the plan file does not hold the URDF that it was resolved to; plan again")
    content = record.resolved["urdf"].encode(errors="surrogatepass")
    digest = record.resolved["sha256"]
    if hashlib.sha256(content).hexdigest() != digest:
        raise InputError(
            "its SHA-256 differs from robot.resolved.sha256", element="robot.resolved.urdf", advice="plan again"
        )
    return content, digest
