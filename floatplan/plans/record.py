"""What is answered, as data: exactly what a plan file holds, its keys, and what each may be. No physics.

The file is JSON, format ``floatplan.plan/1``. Numbers are written so that they read back bit for bit; a number that
does not exist (no obstacle, no limit) is ``null``. A key of its problem that the certificate does not know is something
that it would not prove, and a value of another kind something that it would pass over: both are refused, and so are the
few numbers that have to fit each other.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from floatplan.arguments import (
    FINITE,
    Check,
    by_joint,
    by_name,
    flag,
    many,
    one_of,
    optional,
    pair,
    positive,
    text,
    whole,
)
from floatplan.arguments import number as number_in
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.files import plain, write_atomically
from floatplan.tables import JOINT_LIMITS, MOST_OBSTACLES, OBJECTIVES, REST, ROBOT_KINDS, Range, RobotKind

FORMAT, FORMAT_IN_SPACE = "floatplan.plan/1", "floatplan.plan/2"
CLEARANCES = ("obstacles", "self_clearance", "ground")
SOLVER = ("iterations", "evaluations", "seconds", "seed", "starts", "solved")  # numbers, where the table has them
NO_KEY = "must not be there: a plan file has no such key"
NOT_PROVED = "is not known, and so cannot be proved"
UNIT = 1e-9  # [-] of the length of a quaternion, and 1

number = FINITE
non_negative = number_in(Range(0.0, math.inf, ""))


@dataclass(frozen=True, kw_only=True)
class RobotRecord:
    """Which robot the plan is for, and how it was read: the arguments of ``Robot.from_urdf`` or ``from_mjcf``.

    Exactly one of ``urdf`` and ``mjcf`` is given: the path (or the address in a package) as resolved when planned;
    ``sha256`` is that of the file (of a xacro file, of the URDF that it makes), ``meshes`` are those of the collision
    meshes that its shapes are around, by their file names in the file, and of an MJCF also those of all else that it is
    read with, such as included files;
    ``resolved``, of an MJCF, is the URDF that the robot was planned as, and its SHA-256: {"urdf", "sha256"};
    ``armature``, kg m^2, and ``damping``, N m s/rad, are by joint, where the file or the caller gave them;
    ``balance_inertias`` and ``payload`` are there where they were asked for: whether inertias that no body can have
    were balanced, and point masses that links carry: {"link", "mass", "at"}, kg and m in the link's frame;
    ``resting`` is its reference posture, rad; empty in files without it. In space ``base`` is "free-flyer", and
    ``plane`` is not there.
    """

    urdf: str | None = None
    mjcf: str | None = None
    sha256: str
    joints: tuple[str, ...]
    plane: str | None = None
    base: str | None = None
    coupled: Mapping[str, Any] = field(default_factory=dict)
    locked: Mapping[str, float] = field(default_factory=dict)
    meshes: Mapping[str, str] = field(default_factory=dict)
    armature: Mapping[str, float] = field(default_factory=dict)
    damping: Mapping[str, float] = field(default_factory=dict)
    resting: tuple[float, ...] = ()
    resolved: Mapping[str, str] | None = None
    balance_inertias: bool | None = None
    payload: tuple[Mapping[str, Any], ...] | None = None

    @property
    def kind(self) -> RobotKind:
        """What its file is."""
        return "urdf" if self.mjcf is None else "mjcf"

    @property
    def file(self) -> str:
        """Its file, whatever that is."""
        return self.urdf or self.mjcf or ""

    @classmethod
    def from_dict(cls, content: Any) -> RobotRecord:
        """Rebuild a record from what :meth:`to_dict` returned; InputError where it is none."""
        table(content, "robot")
        ROBOTS["mjcf" if "mjcf" in content else "urdf", "base" in content](content, "robot")
        values: dict[str, Any] = {n: tuple(value) if isinstance(value, list) else value for n, value in content.items()}
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """Return what files of plans and jumps hold: the key of the other kind of file is not there."""
        content: dict[str, Any] = plain({name: value for name, value in vars(self).items() if value is not None})
        return content


@dataclass(frozen=True, eq=False)
class PlanRecord:
    """A plan as data. Arrays are read-only, lists follow ``robot.joints``.

    Attributes
    ----------
    status : "optimal", "feasible", "infeasible" or "interrupted", where Ctrl-C ended the search before a plan was found
    ok : whether every constraint holds
    explanation : one or more sentences; empty where there is nothing to explain
    problem : the problem as resolved: the tables of a problem file, in rad, lists in joint order
    angular_momentum : kg m^2/s; (3,) in space, in the world's axes
    angular_momentum_bounds : (low, high) of (9), kg m^2/s; None in space
    centre, amplitude : (n,) rad, of ``q_i = centre_i + amplitude_i sin(p_i(t))``
    coefficients : (n, k+1), powers of t in seconds of p_i
    orientation : {"start", "end", "goal"}, rad; in space {"quaternion_xyzw": (4,)} each
    com : {"position0": (2,) m, "velocity0": (2,) m/s, "gravity": m/s^2}; (3,) in space
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
    angular_momentum: Any
    angular_momentum_bounds: tuple[float, float] | None
    centre: Array
    amplitude: Array
    coefficients: Array
    orientation: Mapping[str, Any]
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
    def in_space(self) -> bool:
        """Whether it is a flight in space."""
        return self.format == FORMAT_IN_SPACE

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
        content: dict[str, Any] = plain({**first, **vars(self), "robot": self.robot.to_dict()})
        return content

    def to_json(self) -> str:
        """The content of the plan file."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"

    def save(self, path: str | Path) -> Path:
        """Write the plan file; it appears whole or not at all."""
        return write_atomically(path, self.to_json())


def table(value: Any, element: str) -> None:
    """Check that something is a table."""
    if not isinstance(value, Mapping):
        raise InputError(f"must be a table, not {value!r}", element=element)


@dataclass(frozen=True)
class KeyedTable:
    """A table with these keys and no others, unless ``unknown``, what is said of others, is left empty."""

    keys: Mapping[str, Check]
    optional: Mapping[str, Check] = field(default_factory=dict)
    unknown: str = NOT_PROVED

    def __call__(self, value: Any, element: str) -> None:
        """Refuse everything else."""
        table(value, element)
        inside = f"{element}." if element else ""
        for name, item in value.items():
            check = self.keys.get(name) or self.optional.get(name)
            if check is not None:
                check(item, inside + name)
            elif self.unknown:
                raise InputError(self.unknown, element=f"{inside}{name}")
        for name in self.keys:
            if name not in value:
                raise InputError("is missing", element=inside + name)


POINT = pair(number)


def direction(value: Any, element: str) -> None:
    """Check that something is two numbers that are not both zero."""
    POINT(value, element)
    if not any(value):
        raise InputError("has length zero", element=element)


def quaternion(value: Any, element: str) -> None:
    """Check a unit quaternion."""
    pair(number, count=4)(value, element)
    if not abs(math.hypot(*value) - 1) < UNIT:
        raise InputError(f"must have length 1, not {math.hypot(*value):g}", element=element)


def nothing(value: Any, element: str) -> None:
    """Check that there is none."""
    if value is not None:
        raise InputError(f"must be null, not {value!r}", element=element)


def _anything(value: Any, element: str) -> None:
    """What is checked elsewhere: arrays by their shapes, the problem's tables where they are proved."""


PAYLOAD = KeyedTable({"link": text, "mass": number_in("mass"), "at": pair(number_in("place"), count=3)}, unknown=NO_KEY)
ROBOTS = {  # by what the file is, and whether the robot flies in space
    (kind, in_space): KeyedTable(
        {
            kind: text,
            "sha256": text,
            "joints": many(text, "names"),
            **({"base": one_of("free-flyer")} if in_space else {"plane": text}),
        },
        {
            "coupled": by_name(KeyedTable({"leader": text, "ratio": number, "offset": number}, unknown=NO_KEY)),
            "locked": by_name(number),
            "meshes": by_name(text),
            "resting": many(number, "numbers"),
            "balance_inertias": flag,
            "payload": many(PAYLOAD, "payloads"),
            **dict.fromkeys(("armature", "damping"), by_name(non_negative)),
            **(
                {"resolved": KeyedTable(dict.fromkeys(("urdf", "sha256"), text), unknown=NO_KEY)}
                if kind == "mjcf"
                else {}
            ),
        },
        NO_KEY,
    )
    for kind in ROBOT_KINDS
    for in_space in (False, True)
}


TRIPLE, ATTITUDE = pair(number, count=3), KeyedTable({"quaternion_xyzw": quaternion}, unknown=NO_KEY)
IN_PLANE: Mapping[str, Check] = {
    "angular_momentum": number,
    "angular_momentum_bounds": POINT,
    "orientation": KeyedTable(dict.fromkeys(("start", "end", "goal"), number), unknown=NO_KEY),
    "com": KeyedTable({"position0": POINT, "velocity0": POINT, "gravity": number}, unknown=NO_KEY),
}
IN_SPACE: Mapping[str, Check] = {
    "angular_momentum": TRIPLE,
    "angular_momentum_bounds": nothing,
    "orientation": KeyedTable(dict.fromkeys(("start", "end", "goal"), ATTITUDE), unknown=NO_KEY),
    "com": KeyedTable({"position0": TRIPLE, "velocity0": TRIPLE, "gravity": number}, unknown=NO_KEY),
}
FILES = {FORMAT: IN_PLANE, FORMAT_IN_SPACE: IN_SPACE}
FILE = KeyedTable(
    {
        "format": one_of(*FILES),
        "status": one_of("optimal", "feasible", "infeasible", "interrupted"),
        "ok": flag,
        "explanation": text,
        "problem": KeyedTable({"flight": KeyedTable({"duration": positive()}, unknown="")}, unknown=""),
        "robot": table,
        **dict.fromkeys(IN_PLANE, _anything),
        **dict.fromkeys(("centre", "amplitude", "coefficients", "torque_peak", "velocity_peak"), _anything),
        "objective": KeyedTable({"name": text, "value": number}, unknown=NO_KEY),
        "clearance_min": optional(number),
        "solver": KeyedTable({}, dict.fromkeys(SOLVER, optional(number)), unknown=""),
        "problem_file": optional(text),
    },
    {
        "motor_torque_peak": optional(by_name(number)),
        **dict.fromkeys(("warnings", "utilisation"), optional(many(table, "tables"))),
        "out_of_plane_leak": optional(number),
        **dict.fromkeys(("certificate", "replay"), optional(table)),
        "floatplan": text,
    },
    NO_KEY,
)

JOINTS_AT_ENDS = ("positions", "velocities", "accelerations")
DEGREE = by_joint(whole(Range(-math.inf, math.inf, "")), "auto", mapping=False)
SHARED: Mapping[str, Check] = {"margin": non_negative, "velocity": POINT, "window": optional(POINT)}
OBSTACLES: Mapping[str, Mapping[str, Check]] = {
    "circle": {"center": POINT, "radius": non_negative},
    "half-plane": {"point": POINT, "normal": direction},
    "capsule": {"start": POINT, "end": POINT, "radius": non_negative},
}


@lru_cache(maxsize=8)
def problem_table(joints: tuple[str, ...], moving: tuple[str, ...], in_space: bool = False) -> KeyedTable:
    """What a problem may hold whose planned joints are ``joints``, and those with a motor ``moving``."""
    n = len(joints)
    numbers = many(number, "numbers", n)
    limits = many(optional(number), "numbers", n)
    postures = {
        end: KeyedTable(
            {"orientation": table if in_space else number, **dict.fromkeys(JOINTS_AT_ENDS, numbers)},
            optional={"velocities_asked": one_of(rest), "accelerations_asked": one_of("free")},
        )
        for end, rest in REST.items()
    }
    flight: dict[str, Check] = {
        "duration": positive(),
        "angular_momentum": _anything if in_space else one_of("midpoint", "free", or_number=number),
        "takeoff": KeyedTable({"frame": text, "position": TRIPLE if in_space else POINT}),
        "landing": KeyedTable({"frame": text, "height": number}),
        "horizontal_velocity": _anything if in_space else number,
        "gravity": number,
    }
    kept: dict[str, Check] = {"position": many(POINT, "ranges", n), "torque": limits}
    motor = KeyedTable({"stall": positive(), "slope": non_negative})
    may_be_kept: dict[str, Check] = {
        "motor": KeyedTable({}, dict.fromkeys(moving, motor)),
        "motor_torque": KeyedTable({}, dict.fromkeys(moving, positive())),
        "orientation_rate": optional(number),
    }
    for row in JOINT_LIMITS:
        (kept if row.always else may_be_kept)[row.key] = limits
    return KeyedTable(
        {
            **postures,
            "flight": KeyedTable(flight),
            "motion": KeyedTable({"degree": DEGREE, "objective": one_of(*OBJECTIVES)}),
            "limits": KeyedTable(kept, may_be_kept),
        },
        {
            "name": text,
            "ground": flag,
            "obstacles": many(_obstacle, "obstacles"),
            "self_clearance": many(_pair, "tables"),
            "jump": table,  # around the flight, of which nothing is proved
        },
    )


def _obstacle(value: Any, element: str) -> None:
    table(value, element)
    kind = one_of(*OBSTACLES)(value.get("kind"), f"{element}.kind")
    KeyedTable({"kind": text, **OBSTACLES[kind]}, SHARED)(value, element)
    window = value.get("window")
    if window is not None and not window[0] <= window[1]:
        raise InputError(f"ends at {window[1]} s before it begins at {window[0]} s", element=f"{element}.window")


def _pair(value: Any, element: str) -> None:
    KeyedTable({"links": pair(text, "names of links")}, {"margin": non_negative})(value, element)
    if value["links"][0] == value["links"][1]:
        raise InputError("names one link twice", element=f"{element}.links")


def check_asked(record: PlanRecord) -> None:
    """Refuse what the certificate would pass over.

    Raises
    ------
    InputError
        A table of the problem holds a key that is not known or lacks one, a value is of the wrong kind, a list is not
        one entry per joint; or degree, objective and coefficients do not fit together.
    """
    joints, problem = record.robot.joints, record.problem
    if len(set(joints)) != len(joints):
        raise InputError("names a joint twice", element="robot.joints")
    problem_table(joints, (*joints, *record.robot.coupled), record.in_space)(problem, "problem")
    for name in ("obstacles", "self_clearance"):
        count = len(problem.get(name) or ())
        if count > MOST_OBSTACLES:
            raise InputError(f"{count} of them, more than {MOST_OBSTACLES}", element=f"problem.{name}")
    _check_degree(record)
    objective = problem["motion"]["objective"]
    if record.objective["name"] != objective:
        raise InputError(f"is {record.objective['name']!r}, but {objective!r} is asked", element="objective.name")


def _check_degree(record: PlanRecord) -> None:
    """The coefficients are those of polynomials of the degrees asked for, (12)."""
    degree, joints = record.problem["motion"]["degree"], record.robot.joints
    if isinstance(degree, str):
        return
    degrees = list(degree) if isinstance(degree, list | tuple) else [degree] * len(joints)
    if len(degrees) != len(joints):
        raise InputError(f"must have {len(joints)} entries, not {len(degrees)}", element="problem.motion.degree")
    written = record.coefficients.shape[1] - 1
    if max(degrees, default=written) != written:
        raise InputError(f"is {degree}, but the coefficients are of degree {written}", element="problem.motion.degree")
    for joint, row, own in zip(joints, record.coefficients, degrees, strict=True):
        if row[own + 1 :].any():
            raise InputError(f"is {own} for {joint}, whose coefficients go beyond", element="problem.motion.degree")
