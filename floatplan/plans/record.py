"""What is answered, as data: exactly what a plan file holds, its keys, and what each may be. No physics.

The file is JSON, format ``floatplan.plan/1``. Numbers are written so that they read back bit for bit; a number that
does not exist (no obstacle, no limit) is ``null``. A key of its problem that the certificate does not know is something
that it would not prove, and a value of another kind something that it would pass over: both are refused, and so are the
few numbers that have to fit each other.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, get_args

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
    without_none,
)
from floatplan.arguments import number as number_in
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.files import json_value, write_atomically
from floatplan.keys import Keyed, is_needed
from floatplan.tables import (
    FLIGHT_EVENTS,
    JOINT_LIMITS,
    JOINT_VALUES,
    MOST_OBSTACLES,
    OBJECTIVE_TABLE,
    Key,
    MomentumWord,
    MomentumWordInPlane,
    Range,
    RobotKind,
)

FORMAT, FORMAT_IN_SPACE = "floatplan.plan/1", "floatplan.plan/2"
NO_KEY = "must not be there: a plan file has no such key"

number = FINITE
non_negative = number_in(Range(0.0, math.inf, ""))


def table(value: Any, element: str) -> None:
    """Check that something is a table."""
    if not isinstance(value, Mapping):
        raise InputError(f"must be a table, not {value!r}", element=element)


@dataclass(frozen=True)
class KeyedTable:
    """A table with these keys and no others, unless ``unknown``, the message about others, is left empty."""

    keys: Mapping[str, Check]
    optional: Mapping[str, Check] = field(default_factory=dict)
    unknown: str = "is unknown, and so cannot be proved"

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


POINT, TRIPLE = (pair(number, count=count) for count in (2, 3))


def direction(numbers: Check) -> Check:
    """Numbers that are not all zero."""

    def check(value: Any, element: str) -> None:
        numbers(value, element)
        if not any(value):
            raise InputError("has length zero", element=element)

    return check


def quaternion(value: Any, element: str) -> None:
    """Check a unit quaternion."""
    pair(number, count=4)(value, element)
    if not abs(math.hypot(*value) - 1) < 1e-9:  # rounding of a file's digits
        raise InputError(f"must have length 1, not {math.hypot(*value):g}", element=element)


def nothing(value: Any, element: str) -> None:
    """Check that there is none."""
    if value is not None:
        raise InputError(f"must be null, not {value!r}", element=element)


def anything(value: Any, element: str) -> None:
    """Pass what is checked elsewhere: arrays by their shapes, the problem's tables where they are proved."""


class Record(Keyed):
    """A dataclass whose fields are the keys of a table in plan files; it is checked where it is read, not when made."""

    def __post_init__(self) -> None:
        """Check nothing."""

    @classmethod
    def in_files(
        cls, needed: Collection[str], absent: Collection[str] = (), others: Mapping[str, Check] | None = None
    ) -> KeyedTable:
        """Return what a file may hold: keys without a default are needed there, as the ``needed`` ones are.

        ``absent`` are keys that this file has not; ``others`` are checks instead of the fields' own.
        """
        checks = {**cls.checks, **(others or {})}
        keys = dict[str, Check]()
        optional_keys = dict[str, Check]()
        for key, _ in cls.keyed_fields():
            if key.name in needed or is_needed(key):
                keys[key.name] = checks[key.name]
            elif key.name not in absent:
                optional_keys[key.name] = checks[key.name]
        return KeyedTable(keys, optional_keys, NO_KEY)


AT_ENDS = ("start", "end", "goal")


@dataclass(frozen=True, kw_only=True)
class RobotRecord(Record):
    """Which robot the plan is for, and how it was read: the arguments of ``Robot.from_urdf`` or ``from_mjcf``.

    Exactly one of ``urdf`` and ``mjcf`` is there; ``plane`` of flights in a plane, ``base`` of those in space.
    """

    urdf: Annotated[str | None, Key("The robot's file as resolved when planned: a path, or an address", check=text)] = (
        None
    )
    mjcf: Annotated[str | None, Key("The same, of an MJCF", check=text)] = None
    sha256: Annotated[str, Key("Of the file; of a xacro file, of the URDF that it makes", check=text)]
    joints: Annotated[tuple[str, ...], Key("Planned joints, in the order of all lists", check=many(text, "names"))]
    plane: Annotated[str | None, Key("Horizontal and vertical axis", check=text)] = None
    base: Annotated[str | None, Key("How the base moves, if not in a plane", check=one_of("free-flyer"))] = None
    coupled: Annotated[
        Mapping[str, Any],
        Key(
            "Joints that follow others",
            check=by_name(KeyedTable({"leader": text, "ratio": number, "offset": number}, unknown=NO_KEY)),
        ),
    ] = field(default_factory=dict)
    locked: Annotated[Mapping[str, float], Key("Positions of joints that stay", "rad or m", check=by_name(number))] = (
        field(default_factory=dict)
    )
    meshes: Annotated[
        Mapping[str, str],
        Key(
            "SHA-256 of the collision meshes that the shapes are around, by their names in the file; of an MJCF also "
            "those of all else that it is read with, such as included files",
            check=by_name(text),
        ),
    ] = field(default_factory=dict)
    armature: Annotated[
        Mapping[str, float], Key("Of rotors, by joint, where there was any", "kg m^2", check=by_name(non_negative))
    ] = field(default_factory=dict)
    damping: Annotated[
        Mapping[str, float], Key("Of joints, where there was any", "N m s/rad", check=by_name(non_negative))
    ] = field(default_factory=dict)
    resting: Annotated[
        tuple[float, ...],
        Key("The reference posture; empty in files without it", "rad", check=many(number, "numbers")),
    ] = ()
    resolved: Annotated[
        Mapping[str, str] | None,
        Key(
            "Of an MJCF, the URDF that the robot was planned as, and its SHA-256",
            check=KeyedTable(dict.fromkeys(("urdf", "sha256"), text), unknown=NO_KEY),
        ),
    ] = None
    balance_inertias: Annotated[
        bool | None, Key("Whether inertias that no body can have were balanced, where that was requested", check=flag)
    ] = None
    payload: Annotated[
        tuple[Mapping[str, Any], ...] | None,
        Key(
            "Point masses that links carry, where they do: kg, and m in the link's frame",
            check=many(
                KeyedTable(
                    {"link": text, "mass": number_in("mass"), "at": pair(number_in("place"), count=3)}, unknown=NO_KEY
                ),
                "payloads",
            ),
        ),
    ] = None

    @property  # a table of a problem file may be of several kinds, this one is not
    def kind(self) -> RobotKind:  # type: ignore[override]
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
        kind = "mjcf" if "mjcf" in content else "urdf"
        space = "base" if "base" in content else "plane"
        absent = {"urdf", "mjcf", "plane", "base"} - {kind, space}
        cls.in_files(needed={kind, space}, absent=absent | ({"resolved"} if kind == "urdf" else set()))(
            content, "robot"
        )
        values: dict[str, Any] = {}
        for name, value in content.items():
            values[name] = tuple(value) if isinstance(value, list) else value
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """Return what files of plans and jumps hold: the key of the other kind of file is not there."""
        content: dict[str, Any] = json_value(without_none(vars(self)))
        return content


@dataclass(frozen=True, eq=False)
class PlanRecord(Record):
    """A plan as data. Arrays are read-only, lists follow ``robot.joints``; (n,) and (n, k+1) are checked by the reader.

    Of flights in space see :data:`IN_SPACE`.
    """

    status: Annotated[
        str,
        Key(
            '"interrupted" where Ctrl-C stopped the search before there was a plan',
            check=one_of("optimal", "feasible", "infeasible", "interrupted"),
        ),
    ]
    ok: Annotated[bool, Key("Whether every constraint holds", check=flag)]
    explanation: Annotated[str, Key("One or more sentences; empty where there is nothing to explain", check=text)]
    problem: Annotated[
        Mapping[str, Any],
        Key(
            "The problem as resolved: the tables of a problem file, in rad, lists in joint order",
            check=KeyedTable({"flight": KeyedTable({"duration": positive()}, unknown="")}, unknown=""),
        ),
    ]
    robot: Annotated[RobotRecord, Key("Which robot it is for", check=table)]
    angular_momentum: Annotated[Any, Key("About the centre of mass", "kg m^2/s", check=number)]
    angular_momentum_bounds: Annotated[tuple[float, float] | None, Key("Low and high, (9)", "kg m^2/s", check=POINT)]
    centre: Annotated[Array, Key("(n,), of ``q_i = centre_i + amplitude_i sin(p_i(t))``", "rad", check=anything)]
    amplitude: Annotated[Array, Key("(n,), as ``centre``", "rad", check=anything)]
    coefficients: Annotated[Array, Key("(n, k+1), powers of t in seconds of p_i", check=anything)]
    orientation: Annotated[
        Mapping[str, Any],
        Key("Start, end and goal", "rad", check=KeyedTable(dict.fromkeys(AT_ENDS, number), unknown=NO_KEY)),
    ]
    com: Annotated[
        Mapping[str, Any],
        Key(
            "The path of the centre of mass: m, m/s, m/s^2",
            check=KeyedTable({"position0": POINT, "velocity0": POINT, "gravity": number}, unknown=NO_KEY),
        ),
    ]
    objective: Annotated[
        Mapping[str, Any],
        Key("Its name and its value", check=KeyedTable({"name": text, "value": number}, unknown=NO_KEY)),
    ]
    torque_peak: Annotated[Array, Key("(n,), largest magnitudes over the flight", "N m", check=anything)]
    velocity_peak: Annotated[Array, Key("(n,), the same of rates", "rad/s", check=anything)]
    clearance_min: Annotated[
        float | None,
        Key("Surface to surface, margin not subtracted; None without obstacles", "m", check=optional(number)),
    ]
    solver: Annotated[
        Mapping[str, Any],
        Key(
            "What the search did",
            check=KeyedTable(
                {},
                dict.fromkeys(("iterations", "evaluations", "seconds", "seed", "starts", "solved"), optional(number)),
                unknown="",
            ),
        ),
    ]
    motor_torque_peak: Annotated[
        Mapping[str, float] | None,
        Key("Largest magnitude of each motor's own torque", "N m", check=optional(by_name(number))),
    ] = None
    warnings: Annotated[
        Sequence[Mapping[str, Any]] | None,
        Key(
            "What the plan does apart from the request: kind, subject, value, limit, unit, instant, message of each",
            check=optional(many(table, "tables")),
        ),
    ] = None
    utilisation: Annotated[
        Sequence[Mapping[str, Any]] | None,
        Key("How much of its limits each motor uses, worst first", check=optional(many(table, "tables"))),
    ] = None
    out_of_plane_leak: Annotated[
        float | None,
        Key("Largest angular momentum out of the plane over that in it", check=optional(number)),
    ] = None
    problem_file: Annotated[
        str | None,
        Key("The problem file as its user wrote it; None where there was none", check=optional(text)),
    ] = None
    certificate: Annotated[
        Mapping[str, Any] | None, Key("What was proved; None where nothing was", check=optional(table))
    ] = None
    replay: Annotated[Mapping[str, Any] | None, Key("Result of a replay; None without one", check=optional(table))] = (
        None
    )
    format: Annotated[str, Key("Of the file", check=one_of(FORMAT, FORMAT_IN_SPACE))] = FORMAT
    floatplan: Annotated[str, Key("Version that made it", check=text)] = ""

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
        return any(map(self.problem.get, ("obstacles", "self_clearance", "ground")))

    def with_checks(
        self, certificate: Mapping[str, Any] | None = None, replay: Mapping[str, Any] | None = None
    ) -> PlanRecord:
        """Return the record with the findings of its checks."""
        return replace(self, certificate=certificate or self.certificate, replay=replay or self.replay)

    def to_dict(self) -> dict[str, Any]:
        """Return what the file holds, as lists, numbers and ``None``."""
        first = {"format": self.format, "floatplan": self.floatplan}
        content: dict[str, Any] = json_value({**first, **vars(self), "robot": self.robot.to_dict()})
        return content

    def to_json(self) -> str:
        """The content of the plan file."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"

    def save(self, path: str | Path) -> Path:
        """Write the plan file; it appears whole or not at all."""
        return write_atomically(path, self.to_json())


IN_SPACE: Mapping[str, Check] = {  # what is another there
    "angular_momentum": TRIPLE,  # in the world's axes
    "angular_momentum_bounds": nothing,
    "orientation": KeyedTable(
        dict.fromkeys(AT_ENDS, KeyedTable({"quaternion_xyzw": quaternion}, unknown=NO_KEY)), unknown=NO_KEY
    ),
    "com": KeyedTable({"position0": TRIPLE, "velocity0": TRIPLE, "gravity": number}, unknown=NO_KEY),
}
FILES = {  # by their format
    FORMAT: PlanRecord.in_files({"format", "problem_file"}),
    FORMAT_IN_SPACE: PlanRecord.in_files({"format", "problem_file"}, others=IN_SPACE),
}


def attitude(value: Any, element: str) -> None:
    """Check an attitude of a problem in space: a quaternion of any length but zero, or three angles about axes."""
    KeyedTable({}, {"quaternion_xyzw": pair(number, count=4), "angles": TRIPLE, "axes": text})(value, element)
    if ("quaternion_xyzw" in value) == ("angles" in value) or ("angles" in value) != ("axes" in value):
        raise InputError("must have either quaternion_xyzw, or angles and axes", element=element)
    if "quaternion_xyzw" in value and not any(value["quaternion_xyzw"]):
        raise InputError("has length zero", element=f"{element}.quaternion_xyzw")
    axes = value.get("axes", "xyz")
    if len(axes) != 3 or not set(axes) <= set("xyz") or axes[0] == axes[1] or axes[1] == axes[2]:
        raise InputError("must be three of the letters x, y, z with neighbours that differ", element=f"{element}.axes")


def momentum_in_space(value: Any, element: str) -> None:
    """Check the angular momentum of a problem in space: a word, three numbers, or 0 for all of them."""
    if isinstance(value, list | tuple):
        TRIPLE(value, element)
    else:
        one_of(*get_args(MomentumWord), or_number=number)(value, element)


def speed_in_space(value: Any, element: str) -> None:
    """Check the horizontal velocity of a problem in space: two numbers, or 0 for both."""
    (POINT if isinstance(value, list | tuple) else number)(value, element)


SHARED: Mapping[str, Check] = {"margin": non_negative, "velocity": POINT, "window": optional(POINT)}
OBSTACLES: Mapping[str, Mapping[str, Check]] = {
    "circle": {"center": POINT, "radius": non_negative},
    "half-plane": {"point": POINT, "normal": direction(POINT)},
    "capsule": {"start": POINT, "end": POINT, "radius": non_negative},
}
OBSTACLES_IN_SPACE: Mapping[str, Mapping[str, Check]] = {
    "sphere": {"center": TRIPLE, "radius": positive()},
    "capsule": {"radius": positive(), "start": TRIPLE, "end": TRIPLE},
    "half-space": {"point": TRIPLE, "normal": direction(TRIPLE)},
    "box": {"center": TRIPLE, "size": pair(positive(), count=3)},
}


def _obstacle(value: Any, element: str) -> None:
    _check_obstacle(value, element, OBSTACLES, SHARED)


def _spatial_obstacle(value: Any, element: str) -> None:
    _check_obstacle(value, element, OBSTACLES_IN_SPACE, {**SHARED, "velocity": TRIPLE})


def _check_obstacle(
    value: Any, element: str, kinds: Mapping[str, Mapping[str, Check]], shared: Mapping[str, Check]
) -> None:
    table(value, element)
    kind = one_of(*kinds)(value.get("kind"), f"{element}.kind")
    KeyedTable({"kind": text, **kinds[kind]}, shared)(value, element)
    window = value.get("window")
    if window is not None and not window[0] <= window[1]:
        raise InputError(f"ends at {window[1]} s before it begins at {window[0]} s", element=f"{element}.window")


OF_FORMAT: dict[str, dict[str, Check]] = {  # what the two formats tell in other ways
    FORMAT: {
        "orientation": number,
        "angular_momentum": one_of(*get_args(MomentumWordInPlane), or_number=number),
        "position": POINT,
        "horizontal_velocity": number,
        "obstacle": _obstacle,
    },
    FORMAT_IN_SPACE: {
        "orientation": attitude,
        "angular_momentum": momentum_in_space,
        "position": TRIPLE,
        "horizontal_velocity": speed_in_space,
        "obstacle": _spatial_obstacle,
    },
}


@lru_cache(maxsize=8)
def problem_table(joints: tuple[str, ...], moving: tuple[str, ...], format_: str = FORMAT) -> KeyedTable:
    """What a problem may hold whose planned joints are ``joints``, and those with a motor ``moving``."""
    n = len(joints)
    own = OF_FORMAT[format_]
    numbers = many(number, "numbers", n)
    limits = many(optional(number), "numbers", n)
    postures = {}
    for end, event in FLIGHT_EVENTS.items():
        postures[end] = KeyedTable(
            {"orientation": own["orientation"], **dict.fromkeys(JOINT_VALUES, numbers)},
            optional={"velocities_asked": one_of(event), "accelerations_asked": one_of("free")},
        )
    flight: dict[str, Check] = {
        "duration": positive(),
        "angular_momentum": own["angular_momentum"],
        "takeoff": KeyedTable({"frame": text, "position": own["position"]}),
        "landing": KeyedTable({"frame": text, "height": number}),
        "horizontal_velocity": own["horizontal_velocity"],
        "gravity": number,
    }
    limit_checks: dict[str, Check] = {"position": many(POINT, "ranges", n), "torque": limits}
    motor = KeyedTable({"stall": positive(), "slope": non_negative})
    optional_limit_checks: dict[str, Check] = {
        "motor": KeyedTable({}, dict.fromkeys(moving, motor)),
        "motor_torque": KeyedTable({}, dict.fromkeys(moving, positive())),
        "orientation_rate": optional(number),
    }
    for row in JOINT_LIMITS:
        (limit_checks if row.always else optional_limit_checks)[row.key] = limits
    return KeyedTable(
        {
            **postures,
            "flight": KeyedTable(flight),
            "motion": KeyedTable(
                {
                    "degree": by_joint(whole(Range(-math.inf, math.inf, "")), "auto", mapping=False),
                    "objective": one_of(*OBJECTIVE_TABLE),
                },
                {"clip": table},
            ),
            "limits": KeyedTable(limit_checks, optional_limit_checks),
        },
        {
            "name": text,
            "ground": flag,
            "obstacles": many(own["obstacle"], "obstacles"),
            "self_clearance": many(_pair, "tables"),
            "jump": table,  # around the flight, of which nothing is proved
        },
    )


def _pair(value: Any, element: str) -> None:
    KeyedTable({"links": pair(text, "names of links")}, {"margin": non_negative})(value, element)
    if value["links"][0] == value["links"][1]:
        raise InputError("names one link twice", element=f"{element}.links")


def check_requested(record: PlanRecord) -> None:
    """Refuse what the certificate would pass over.

    Raises
    ------
    InputError
        A table of the problem holds an unknown key or lacks one, a value is of the wrong kind, a list is not
        one entry per joint; or degree, objective and coefficients do not fit together.
    """
    joints = record.robot.joints
    problem = record.problem
    if len(set(joints)) != len(joints):
        raise InputError("names a joint twice", element="robot.joints")
    problem_table(joints, (*joints, *record.robot.coupled), record.format)(problem, "problem")
    for name in ("obstacles", "self_clearance"):
        count = len(problem.get(name) or ())
        if count > MOST_OBSTACLES:
            raise InputError(f"{count} of them, more than {MOST_OBSTACLES}", element=f"problem.{name}")
    _check_degree(record)
    objective = problem["motion"]["objective"]
    if record.objective["name"] != objective:
        raise InputError(f"is {record.objective['name']!r}, but {objective!r} is requested", element="objective.name")


def _check_degree(record: PlanRecord) -> None:
    """The coefficients are those of polynomials of the requested degrees, (12)."""
    degree = record.problem["motion"]["degree"]
    joints = record.robot.joints
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
