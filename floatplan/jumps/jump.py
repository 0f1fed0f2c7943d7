"""The result: a jump from standing to standing, with its check, and its file, ``jump.json``.

JSON, format ``floatplan.jump/1``: ``status``, ``explanation``, ``robot`` and ``problem`` as in plan files, ``flight``,
an unchanged plan file or ``null``, and ``stances``, each with ``side``, ``contacts``, ``place`` of its first contact,
and arrays over its instants, between which quintics are: ``times``, ``y``, ``v``, ``a`` (orientation and joints with
their derivatives), ``ratios``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import flag, many, number, numbers, one_of, optional, text
from floatplan.arguments import path as as_path
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, naming, refuse, single
from floatplan.files import check_finite, json_value, read_json, write_atomically
from floatplan.jumps.check import JumpCheck, check_jump
from floatplan.jumps.contacts import GroundContact
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import Grid, Stance
from floatplan.planning.repair import judged
from floatplan.plans.outputs import Outputs
from floatplan.plans.plan import rebuild
from floatplan.plans.reading import LARGEST, check_size, record_from_dict, recorded_robot, robot_record
from floatplan.plans.record import POINT, KeyedTable, RobotRecord, table
from floatplan.plans.verdicts import Certificate, Tone, verdict_in_words
from floatplan.pool import one_thread
from floatplan.problem.file import problem_from_dict, problem_to_dict
from floatplan.problem.jump import JumpRequest
from floatplan.robot import Robot
from floatplan.robot.standing import SOLE_ENDS, TIP, Spot
from floatplan.tables import Range

FORMAT = "floatplan.jump/1"
ARRAYS = ("times", "y", "v", "a", "ratios")
UNKNOWN = "must not be there: a jump's file has no such key"
CONTACT = KeyedTable(
    {
        "frames": many(text, "names of frames"),
        "suffix": one_of("", *SOLE_ENDS, TIP),
        "places": many(POINT, "places"),
        "depth": number(Range(0.0, 10.0, "m")),  # of a foot's point: no robot's foot is larger
        "vertical": flag,
    },
    {"rolls": flag},
    UNKNOWN,
)
STANCE = KeyedTable(
    {
        "side": one_of("takeoff", "landing"),
        "contacts": many(CONTACT, "tables"),
        "place": POINT,
        **dict.fromkeys(ARRAYS, many(lambda value, _: value, "numbers")),
    },
    unknown=UNKNOWN,
)
JUMP = KeyedTable(
    {
        "format": one_of(FORMAT),
        "status": text,
        "explanation": text,
        "robot": table,
        "problem": table,
        "flight": optional(table),
        "stances": many(STANCE, "tables"),
    },
    unknown="",
)


@dataclass(frozen=True, eq=False, repr=False)
class Jump(Outputs, JumpMotion):
    """A jump from standing to standing: a motion that can be evaluated at any time, and whether it holds.

    Attributes
    ----------
    problem : Problem, as it was passed
    request : JumpRequest
    flight : the Plan in its middle, whose t = 0 is the takeoff; None where there is no jump
    before, after : stances of takeoff and landing, in order of time
    status : "found" or "not_found"
    explanation : sentences for a person
    """

    status: str = "not_found"
    explanation: str = ""

    @property
    def ok(self) -> bool:
        """Whether a jump was found, and its stances passed the check."""
        return self.status == "found" and self.check.ok

    @cached_property
    @one_thread
    def check(self) -> JumpCheck:
        """The stances, judged at 2 kHz; see :func:`floatplan.jumps.check.check_jump`."""
        if self.flight is None:
            return JumpCheck(False, {}, ("no jump was found",))
        return check_jump(self)

    def with_certificate(self, certificate: Certificate) -> Jump:
        """Return the same jump with what was proved of its flight, which both files then hold."""
        if self.flight is None:
            return self
        certified = copy(self)  # with its check
        object.__setattr__(certified, "flight", judged(self.flight, certificate))
        return certified

    def refuse_unless_ok(self, action: str) -> None:
        """Raise InputError where there is no jump to "fly", say, or it is no motion that its robot can make."""
        super().refuse_unless_ok(action)
        if not self.ok:
            fault = self.check.sentences[0] if self.status == "found" else f"its status is {self.status!r}"
            reason = f"a jump that does not hold is none to {action}: {fault}"
            raise InputError(reason, element="stances", advice="plan it again")

    @property
    def verdict(self) -> str:
        """The verdict, for a person: "flight proved, stances checked" only where both are true."""
        if self.flight is None:
            return "no jump found"
        flight, _ = verdict_in_words(self.flight.ok, self.flight.certificate, False)
        stances = "stances checked" if self.check.ok else "stances not within limits"
        return ", ".join([flight, stances, *(["with warnings"] if self.warnings else [])])

    @property
    def tone(self) -> Tone:
        """Whether the verdict is good, bad or open."""
        assert self.flight is not None
        if not self.check.ok:
            return "bad"
        return verdict_in_words(self.flight.ok, self.flight.certificate, bool(self.warnings))[1]

    def refuse_unless_shown(self) -> None:
        """Raise InputError where no jump was found, so that pictures have nothing to show."""
        if self.flight is None:
            raise InputError(f"{self.verdict}, so there is nothing to show")

    def to_dict(self) -> dict[str, Any]:
        """Return the result as builtin data: what ``floatplan jump --json`` prints."""
        facts: dict[str, Any] = json_value(
            {
                "status": self.status,
                "ok": self.ok,
                "verdict": self.verdict,
                "explanation": self.explanation,
                "duration": self.duration,
                "warnings": [warning.to_dict() for warning in self.warnings],
                "phases": [vars(phase) for phase in self.phases],
                "figures": dict(self.check.figures),
                "sentences": self.check.sentences,
            }
        )
        return facts

    def save(self, path: str | Path) -> Path:
        """Write ``jump.json``; it appears whole or not at all."""
        return write_atomically(as_path(path, "path"), self.to_json())

    def to_json(self) -> str:
        """The content of ``jump.json``."""
        sides = (("takeoff", self.before), ("landing", self.after))
        content = {
            "format": FORMAT,
            "status": self.status,
            "explanation": self.explanation,
            "robot": robot_record(self.problem.robot).to_dict(),
            "problem": problem_to_dict(self.problem),
            "flight": None if self.flight is None else self.flight.record.to_dict(),
            "stances": [{"side": side, **_stance(stance)} for side, stances in sides for stance in stances],
        }
        return json.dumps(json_value(content), indent=1, allow_nan=False) + "\n"

    def __repr__(self) -> str:
        checked = "" if self.flight is None else f", stances {'checked' if self.check.ok else 'not within limits'}"
        return f"Jump({self.status}{checked}, {self.duration:.3g} s)\n  {self.explanation[:300]}"


def _stance(stance: Stance) -> dict[str, Any]:
    return {
        "contacts": [_contact(contact) for contact in stance.contacts],
        "place": [stance.anchor_position.real, stance.anchor_position.imag],
        **{name: getattr(stance.grid, name) for name in ARRAYS},
    }


def _contact(contact: GroundContact) -> dict[str, Any]:
    return {
        "frames": list(contact.frames),
        "suffix": contact.suffix,
        "places": [[spot.place.real, spot.place.imag] for spot in contact.spots],
        "depth": contact.depth,
        "vertical": contact.vertical,
        "rolls": contact.radius > 0,
    }


@one_thread
def load_jump(path: str | Path, urdf: str | Path | None = None) -> Jump:
    """Read a jump's file and the URDF that it names, or the same URDF elsewhere.

    Raises
    ------
    InputError
        Either is missing, damaged, or does not belong to the other.
    """
    path = as_path(path, "path")
    content = read_json(path, kind="a jump file")
    with naming(path):
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise InputError(f"is no jump file: its format is not {FORMAT!r}", element="format")
        check_finite(content)
    urdf_path = optional(as_path)(urdf, "urdf")
    with naming(path), _within():
        return _read(content, path, urdf_path)


def _read(content: Mapping[str, Any], path: Path, urdf: str | Path | None) -> Jump:
    JUMP(content, "")
    flight = None
    if content["flight"] is not None:
        with _within("flight"):
            flight = rebuild(record_from_dict(content["flight"]), path, urdf)
    record = RobotRecord.from_dict(content["robot"])
    robot = recorded_robot(record, path, urdf) if flight is None else flight.robot
    if robot.sha256 != record.sha256:
        advice = "take the jump's file as it was written, or plan it again"
        raise InputError("is not the robot of the flight", element="robot.sha256", advice=advice)
    if isinstance(content["problem"].get("jump"), dict):  # a file without this key requires nothing of it
        content["problem"]["jump"].setdefault("pitch_error", 0.0)
    with _within("problem"):
        problem = problem_from_dict(content["problem"], robot)
    request = problem.jump or JumpRequest()
    check_size(content["stances"], "stances", LARGEST)
    sides: dict[str, list[Stance]] = {"takeoff": [], "landing": []}
    for index, table_of_stance in enumerate(content["stances"]):
        stance = _read_stance(table_of_stance, robot, problem.flight.gravity, f"stances[{index}]")
        sides[table_of_stance["side"]].append(stance)
    jump = Jump(
        problem,
        request,
        flight,
        before=tuple(sides["takeoff"]),
        after=tuple(sides["landing"]),
        status=content["status"],
        explanation=content["explanation"],
    )
    for contact in jump.contacts:
        if request.feet != "auto" and (contact.radius > 0) != (request.feet == "rolling"):
            raise InputError(f"do not fit problem.jump.feet, {request.feet!r}", element="stances")
    if (flight is None) == all(sides.values()):
        raise InputError("do not fit the flight", element="stances")
    return jump


@contextmanager
def _within(element: str | None = None) -> Iterator[None]:
    """Name the table of a jump's file in which an error is, and advise, where nothing else is, to take a whole file."""
    try:
        yield
    except InputError as error:
        errors = []
        for one in single(error):
            inner = one.within(element=element)
            advice = inner.advice or "take the file as it was written, or plan the jump again"
            errors.append(InputError(inner.reason, source=inner.source, element=inner.element, advice=advice))
        refuse(errors)


def _read_stance(content: Mapping[str, Any], robot: Robot, gravity: float, element: str) -> Stance:
    contacts = []
    for index, table_of_contact in enumerate(content["contacts"]):
        contacts.append(_read_contact(table_of_contact, robot, f"{element}.contacts[{index}]"))
    if not contacts:
        raise InputError("must name what stands", element=f"{element}.contacts")
    times = _array(content["times"], f"{element}.times", (None,))
    if len(times) < 2 or not (np.diff(times) > 0).all():
        raise InputError("must be increasing instants", element=f"{element}.times")
    size = 1 + len(robot.joints)
    count = len(times)
    y, v, a = (_array(content[name], f"{element}.{name}", (size, count)) for name in ("y", "v", "a"))
    ratios = _array(content["ratios"], f"{element}.ratios", (len(contacts) - 1, count))
    grid = Grid(times, y, v, a, ratios)
    return Stance(robot, float(gravity), tuple(contacts), complex(*content["place"]), grid)


def _read_contact(content: Mapping[str, Any], robot: Robot, element: str) -> GroundContact:
    frames = tuple(content["frames"])
    places = content["places"]
    if not frames or len(places) != len(frames):
        reason = f"has {len(frames)} frames and {len(places)} places, not as many of both"
        raise InputError(reason, element=element)
    radius = float(content["depth"]) if content.get("rolls") is True else 0.0
    spots = []
    for name, point in zip(frames, places, strict=True):
        if name not in robot.frames:
            raise InputError(f"the robot has no frame {name!r}", element=f"{element}.frames")
        spots.append(Spot(robot.frames[name].body, complex(*point), radius))
    return GroundContact(frames, content["suffix"], tuple(spots), float(content["depth"]), content["vertical"])


def _array(value: Any, element: str, shape: tuple[int | None, ...]) -> Array:
    """Finite numbers of a shape, in which None is any size; lists of no numbers have any other sizes."""
    array = numbers(value, element) if value != [] else np.zeros([size or 0 for size in shape])
    has_shape = len(array.shape) == len(shape)
    for own, size in zip(array.shape, shape, strict=False):
        if size is not None and own != size:
            has_shape = False
    if not has_shape:
        reason = f"has shape {array.shape}, not {shape}"
        raise InputError(reason, element=element)
    if not np.isfinite(array).all():
        raise InputError("must be finite numbers", element=element)
    return read_only(array.astype(np.float64))
