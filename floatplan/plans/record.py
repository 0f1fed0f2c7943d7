"""What is answered, as data: exactly what a plan file holds. No physics.

The file is JSON, format ``floatplan.plan/1``. Numbers are written so that they read back bit for bit; a number that
does not exist (no obstacle, no limit) is ``null``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from floatplan.arrays import Array
from floatplan.files import plain, write_atomically

FORMAT = "floatplan.plan/1"
CLEARANCES = ("obstacles", "self_clearance", "ground")


@dataclass(frozen=True)
class RobotRecord:
    """Which robot the plan is for, and how it was read: the arguments of ``Robot.from_urdf``.

    ``urdf`` is the path (or ``example-robot-data:`` address) as resolved when planned, ``sha256`` that of the file;
    ``meshes`` are the SHA-256 of the collision meshes that its shapes are around, by their file names in the URDF;
    ``armature``, kg m^2, and ``damping``, N m s/rad, are by joint, where the file or the caller gave them;
    ``resting`` is its reference posture, rad; empty in files without it.
    """

    urdf: str
    sha256: str
    joints: tuple[str, ...]
    plane: str
    coupled: Mapping[str, Any] = field(default_factory=dict)
    locked: Mapping[str, float] = field(default_factory=dict)
    meshes: Mapping[str, str] = field(default_factory=dict)
    armature: Mapping[str, float] = field(default_factory=dict)
    damping: Mapping[str, float] = field(default_factory=dict)
    resting: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class PlanRecord:
    """A plan as data. Arrays are read-only, lists follow ``robot.joints``.

    Attributes
    ----------
    status : "optimal", "feasible", "infeasible" or "interrupted", where Ctrl-C ended the search before a plan was found
    ok : whether every constraint holds
    explanation : one or more sentences; empty where there is nothing to explain
    problem : the problem as resolved: the tables of a problem file, in rad, lists in joint order
    angular_momentum : kg m^2/s
    angular_momentum_bounds : (low, high) of (9), kg m^2/s
    centre, amplitude : (n,) rad, of ``q_i = centre_i + amplitude_i sin(p_i(t))``
    coefficients : (n, k+1), powers of t in seconds of p_i
    orientation : {"start", "end", "goal"}, rad
    com : {"position0": (2,) m, "velocity0": (2,) m/s, "gravity": m/s^2}
    objective : {"name", "value"}
    torque_peak, velocity_peak : (n,) N m, rad/s; largest magnitudes over the flight
    clearance_min : m, surface to surface, margin not subtracted; None without obstacles
    solver : {"iterations", "evaluations", "seconds", "seed", ...}
    motor_torque_peak : motor's joint -> N m, the largest magnitude of its own torque; None in files without it
    warnings : what the plan does beside what was asked: {"kind", "subject", "value", "limit", "unit", "instant",
        "message"} each; None in files without it
    utilisation : how much of its limits each motor uses, worst first; None in files without it
    out_of_plane_leak : largest angular momentum out of the plane over that in it; None in files without it
    problem_file : the problem file as its user wrote it; None where there was none
    certificate, replay : what the checks found, None where they were not run
    """

    status: str
    ok: bool
    explanation: str
    problem: Mapping[str, Any]
    robot: RobotRecord
    angular_momentum: float
    angular_momentum_bounds: tuple[float, float]
    centre: Array
    amplitude: Array
    coefficients: Array
    orientation: Mapping[str, float]
    com: Mapping[str, Any]
    objective: Mapping[str, Any]
    torque_peak: Array
    velocity_peak: Array
    clearance_min: float | None
    solver: Mapping[str, Any]
    motor_torque_peak: Mapping[str, float] | None = None
    warnings: Sequence[Mapping[str, Any]] | None = None
    utilisation: Sequence[Mapping[str, Any]] | None = None
    out_of_plane_leak: float | None = None
    problem_file: str | None = None
    certificate: Mapping[str, Any] | None = None
    replay: Mapping[str, Any] | None = None
    format: str = FORMAT
    floatplan: str = ""

    @property
    def duration(self) -> float:
        """Flight time, s."""
        return float(self.problem["flight"]["duration"])

    @property
    def asks_clearance(self) -> bool:
        """Whether the problem asks for a distance, so that the links' shapes matter."""
        return any(self.problem.get(name) for name in CLEARANCES)

    def with_checks(
        self, certificate: Mapping[str, Any] | None = None, replay: Mapping[str, Any] | None = None
    ) -> PlanRecord:
        """Return the record with the findings of its checks."""
        return replace(self, certificate=certificate or self.certificate, replay=replay or self.replay)

    def to_dict(self) -> dict[str, Any]:
        """Return what the file holds, as plain lists, numbers and ``None``."""
        first = {"format": self.format, "floatplan": self.floatplan}
        content: dict[str, Any] = plain({**first, **vars(self), "robot": vars(self.robot)})
        return content

    def to_json(self) -> str:
        """The content of the plan file."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"

    def save(self, path: str | Path) -> Path:
        """Write the plan file; it appears whole or not at all."""
        return write_atomically(path, self.to_json())
