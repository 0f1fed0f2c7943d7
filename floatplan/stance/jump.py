"""The answer: a jump from standing to standing, what its check found, and its file, ``jump.json``.

JSON, format ``floatplan.jump/1``: ``status``, ``explanation``, ``robot`` and ``problem`` as in plan files, ``flight``,
an unchanged plan file or ``null``, and ``stances``, each with ``side``, ``contacts``, ``place`` of its first contact,
and arrays over its instants, between which quintics are: ``times``, ``y``, ``v``, ``a`` (orientation and joints with
their derivatives), ``ratios``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import optional
from floatplan.arguments import path as as_path
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, naming
from floatplan.files import check_finite, plain, read_json, write_atomically
from floatplan.planning.repair import judged
from floatplan.plans.outputs import Outputs, output
from floatplan.plans.plan import rebuild
from floatplan.plans.reading import LARGEST, check_size, record_from_dict, recorded_robot, robot_record
from floatplan.plans.record import RobotRecord
from floatplan.plans.verdicts import Certificate, verdict_in_words
from floatplan.pool import one_thread
from floatplan.problem.file import problem_from_dict, problem_to_dict
from floatplan.problem.jump import JumpRequest
from floatplan.robot import Robot
from floatplan.robot.standing import Spot
from floatplan.stance.check import JumpCheck, check_jump
from floatplan.stance.contacts import Contact
from floatplan.stance.jump_motion import JumpMotion
from floatplan.stance.motion import Grid, Stance

FORMAT = "floatplan.jump/1"
KEYS = ("format", "status", "explanation", "robot", "problem", "flight", "stances")
ARRAYS = ("times", "y", "v", "a", "ratios")
LONGEST_EXPLANATION = 300  # [characters] in a representation


@dataclass(frozen=True, eq=False, repr=False)
class Jump(Outputs, JumpMotion):
    """A jump from standing to standing: a motion that can be evaluated at any time, and whether it holds.

    Attributes
    ----------
    problem : Problem, as given
    request : JumpRequest
    flight : the Plan in its middle, whose t = 0 is the takeoff; None where nothing was found
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
        """The stances, judged at 2 kHz; see :func:`floatplan.stance.check.check_jump`."""
        if self.flight is None:
            return JumpCheck(False, {}, ("no jump was found",))
        return check_jump(self)

    def with_certificate(self, certificate: Certificate) -> Jump:
        """Return the same jump with what was proved of its flight, which both files then hold."""
        if self.flight is None:
            return self
        found = copy(self)  # with its check
        object.__setattr__(found, "flight", judged(self.flight, certificate))
        return found

    def refuse_unless_ok(self, action: str) -> None:
        """Raise InputError where there is no jump to "fly", say, or it is no motion that its robot can make."""
        super().refuse_unless_ok(action)
        if not self.ok:
            fault = self.check.sentences[0] if self.status == "found" else f"its status is {self.status!r}"
            reason = f"a jump that does not hold is none to {action}: {fault}"
            raise InputError(reason, source=self.problem.name, element="stances", advice="plan it again")

    @property
    def verdict(self) -> str:
        """What was found out, for a person: "flight proved, stances checked" only where both are true."""
        if self.flight is None:
            return "no jump found"
        flight, _ = verdict_in_words(self.flight.ok, self.flight.certificate, False)
        stances = "stances checked" if self.check.ok else "stances not within limits"
        return ", ".join([flight, stances, *(["with warnings"] if self.warnings else [])])

    @property
    def view(self) -> Any:
        """The jump as pictures take it; InputError where none was found."""
        return output("JumpView")(self, self.check, self.verdict)

    def to_dict(self) -> dict[str, Any]:
        """Return what was found out, as plain data: what ``floatplan jump --json`` prints."""
        told = {name: getattr(self, name) for name in ("status", "ok", "verdict", "explanation", "duration")}
        phases = [vars(phase) for phase in self.phases]
        facts: dict[str, Any] = plain(
            {
                **told,
                "warnings": [warning.to_dict() for warning in self.warnings],
                "phases": phases,
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
            "stances": [{"side": side, **_stance(each)} for side, stances in sides for each in stances],
        }
        return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"

    def __repr__(self) -> str:
        checked = "" if self.flight is None else f", stances {'checked' if self.check.ok else 'not within limits'}"
        return f"Jump({self.status}{checked}, {self.duration:.3g} s)\n  {self.explanation[:LONGEST_EXPLANATION]}"


def _stance(stance: Stance) -> dict[str, Any]:
    return {
        "contacts": [
            {
                "frames": list(each.frames),
                "suffix": each.suffix,
                "places": [[spot.place.real, spot.place.imag] for spot in each.spots],
                "depth": each.depth,
                "vertical": each.vertical,
                "rolls": each.radius > 0,
            }
            for each in stance.contacts
        ],
        "place": [stance.place.real, stance.place.imag],
        **{name: getattr(stance.grid, name) for name in ARRAYS},
    }


@one_thread
def load_jump(path: str | Path, urdf: str | Path | None = None) -> Jump:
    """Read a jump's file and the URDF that it names, or another place of the same file.

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
        missing = [name for name in KEYS if name not in content]
        if missing:
            raise InputError("is missing", element=missing[0])
    try:
        return _read(content, path, optional(as_path)(urdf, "urdf"))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, InputError):
            raise error.within(source=path) from None
        raise InputError(f"is damaged: {error}", source=path) from None


def _read(content: Mapping[str, Any], path: Path, urdf: str | Path | None) -> Jump:
    flight = None if content["flight"] is None else rebuild(record_from_dict(content["flight"]), path, urdf)
    found = RobotRecord.from_dict(content["robot"])
    robot = recorded_robot(found, path, urdf) if flight is None else flight.robot
    if robot.sha256 != found.sha256:
        raise InputError("is not the robot of the flight", element="robot.sha256")
    problem = problem_from_dict(content["problem"], robot, path)
    request = problem.jump or JumpRequest()
    check_size(content["stances"], "stances", LARGEST)
    sides: dict[str, list[Stance]] = {"takeoff": [], "landing": []}
    for index, each in enumerate(content["stances"]):
        sides[each["side"]].append(_read_stance(each, robot, problem.flight.gravity, f"stances[{index}]"))
    rolls = {each.radius > 0 for stances in sides.values() for stance in stances for each in stance.contacts}
    if rolls - {request.feet == "rolling"}:
        raise InputError(f"do not fit problem.jump.feet, {request.feet!r}", element="stances")
    if (flight is None) == all(sides.values()):
        raise InputError("do not fit the flight", element="stances")
    answer = {"status": str(content["status"]), "explanation": str(content["explanation"])}
    return Jump(problem, request, flight, tuple(sides["takeoff"]), tuple(sides["landing"]), **answer)


def _read_stance(content: Mapping[str, Any], robot: Robot, gravity: float, element: str) -> Stance:
    if not content["contacts"] or not all(each["frames"] for each in content["contacts"]):
        raise InputError("must name what stands", element=f"{element}.contacts")
    contacts = tuple(
        Contact(
            tuple(each["frames"]),
            str(each["suffix"]),
            tuple(
                Spot(robot.frames[frame].body, complex(*place), each["depth"] if each.get("rolls") is True else 0.0)
                for frame, place in zip(each["frames"], each["places"], strict=True)
            ),
            float(each["depth"]),
            bool(each["vertical"]),
        )
        for each in content["contacts"]
    )
    times = np.asarray(content["times"], dtype=np.float64)
    if times.ndim != 1 or len(times) < 2 or not (np.diff(times) > 0).all():
        raise InputError("must be increasing instants", element=f"{element}.times")
    rows = {"y": 1 + len(robot.joints), "ratios": len(contacts) - 1}
    arrays: dict[str, Array] = {}
    for name in ("y", "v", "a", "ratios"):
        shape = (rows.get(name, rows["y"]), len(times))
        values = np.asarray(content[name], dtype=np.float64).reshape(-1, len(times))
        if values.shape != shape:
            raise InputError(f"has shape {values.shape}, not {shape}", element=f"{element}.{name}")
        if not np.isfinite(values).all():
            raise InputError("must be finite numbers", element=f"{element}.{name}")
        arrays[name] = read_only(values)
    return Stance(robot, float(gravity), contacts, complex(*content["place"]), Grid(read_only(times), **arrays))
