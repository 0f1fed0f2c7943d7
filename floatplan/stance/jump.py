"""The answer: a jump from standing to standing, what its check found, and its file, ``jump.json``.

JSON, format ``floatplan.jump/1``: ``status``, ``explanation``, ``robot`` and ``problem`` as in plan files, ``flight``,
an unchanged plan file or ``null``, and ``stances``, each with ``side``, ``contacts``, ``place`` of its first contact,
and arrays over its instants, between which quintics are: ``times``, ``y``, ``v``, ``a`` (orientation and joints with
their derivatives), ``ratios``.
"""

from __future__ import annotations

import json
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from floatplan.arguments import path as as_path
from floatplan.files import plain, write_atomically
from floatplan.planning.repair import judged
from floatplan.plans.outputs import Outputs, output
from floatplan.plans.reading import robot_record
from floatplan.plans.verdicts import Certificate, verdict_in_words
from floatplan.pool import one_thread
from floatplan.problem.file import problem_to_dict
from floatplan.stance.check import JumpCheck, check_jump
from floatplan.stance.jump_motion import JumpMotion
from floatplan.stance.motion import Stance

FORMAT = "floatplan.jump/1"
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

    @property
    def verdict(self) -> str:
        """What was found out, for a person: "flight proved, stances checked" only where both are true."""
        if self.flight is None:
            return "no jump found"
        flight, _ = verdict_in_words(self.flight.ok, self.flight.certificate, False)
        stances = "stances checked" if self.check.ok else "stances not within limits"
        return ", ".join([flight, stances, *(["with warnings"] if self.flight.warnings else [])])

    @property
    def view(self) -> Any:
        """The jump as pictures take it; InputError where none was found."""
        return output("JumpView")(self, self.check, self.verdict)

    def to_dict(self) -> dict[str, Any]:
        """Return what was found out, as plain data: what ``floatplan jump --json`` prints."""
        told = {name: getattr(self, name) for name in ("status", "ok", "verdict", "explanation", "duration")}
        phases = [vars(phase) for phase in self.phases]
        facts: dict[str, Any] = plain(
            {**told, "phases": phases, "figures": dict(self.check.figures), "sentences": self.check.sentences}
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
            "robot": vars(robot_record(self.problem.robot)),
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
