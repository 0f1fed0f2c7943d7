"""The result: a jump from standing to standing, with its check, and its file, ``jump.json``.

JSON, format ``floatplan.jump/1``: ``status``, ``explanation``, ``robot`` and ``problem`` as in plan files, ``flight``,
an unchanged plan file or ``null``, and ``stances``, each with ``side``, ``contacts``, ``place`` of its first contact,
and arrays over its instants, between which quintics are: ``times``, ``y``, ``v``, ``a`` (orientation and joints with
their derivatives), ``ratios``. A sequence has ``flights`` too, those after the first, each with its ``plan``, the
``shift`` of its world in the jump's, m, and the ``stances`` that follow it. There, and in ``stances``, those before the
next flight have the side "landing" too.
"""

from __future__ import annotations

import json
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

from floatplan.arguments import path as as_path
from floatplan.errors import InputError
from floatplan.files import json_value, write_atomically
from floatplan.jumps.check import JumpCheck, check_jump
from floatplan.jumps.contacts import GroundContact
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import Stance
from floatplan.planning.repair import judged
from floatplan.plans.outputs import Outputs
from floatplan.plans.reading import robot_record
from floatplan.plans.verdicts import Certificate, Tone, verdict_in_words
from floatplan.pool import one_thread
from floatplan.problem.file import problem_to_dict

FORMAT = "floatplan.jump/1"
ARRAYS = ("times", "y", "v", "a", "ratios")


@dataclass(frozen=True, eq=False, repr=False)
class Jump(Outputs, JumpMotion):
    """A jump from standing to standing: a motion that can be evaluated at any time, and whether it holds.

    Attributes
    ----------
    problem : Problem, as it was passed
    request : JumpRequest
    flight : the Plan in its middle, whose t = 0 is the takeoff; None where there is no jump
    before, after : stances before that flight and after it, in order of time; in a sequence up to the next flight, so
        that ``after`` has those of its takeoff too
    status : "found" or "not_found"
    explanation : sentences for a person
    """

    status: str = "not_found"
    explanation: str = ""
    _format: ClassVar[str] = FORMAT

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

    @property
    def proved(self) -> bool:
        """Whether all its flights were proved."""
        certificates = [plan.certificate for plan in self.flights]
        return bool(certificates) and all(own is not None and own.proved for own in certificates)

    def with_certificate(self, certificate: Certificate, *others: Certificate) -> Jump:
        """Return the same jump with what was proved of its flight, which both files then hold.

        Of a sequence there are certificates of all flights, in order of time.
        """
        if self.flight is None:
            return self
        certified = copy(self)  # with its check
        object.__setattr__(certified, "flight", judged(self.flight, certificate))
        more = []
        for following, own in zip(self.more, others, strict=bool(others)):
            more.append(replace(following, flight=judged(following.flight, own)))
        if others:
            object.__setattr__(certified, "more", tuple(more))
            for name in ("timed_flights", "pieces"):  # which hold the plans without
                vars(certified).pop(name, None)
        return certified

    def explained(self, explanation: str) -> Self:
        """Return the same jump with another explanation, and with its check."""
        other = replace(self, explanation=explanation)
        vars(other)["check"] = self.check  # which replace() leaves out, since it is no field
        return other

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
        flight, _ = self._verdict_of_flights(warned=False)
        stances = "stances checked" if self.check.ok else "stances not within limits"
        return ", ".join([flight, stances, *(["with warnings"] if self.warnings else [])])

    @property
    def tone(self) -> Tone:
        """Whether the verdict is good, bad or open."""
        assert self.flight is not None
        if not self.check.ok:
            return "bad"
        return self._verdict_of_flights(bool(self.warnings))[1]

    def _verdict_of_flights(self, warned: bool) -> tuple[str, Tone]:
        """The verdict on all flights, in words and as a tone: that of the one of which least is true."""
        tones: list[Tone] = ["bad", "open", "good"]  # the worst first
        verdicts = [verdict_in_words(plan.ok, plan.certificate, warned) for plan in self.flights]
        words, tone = min(verdicts, key=lambda verdict: tones.index(verdict[1]))
        return words.replace("flight ", "flights ") if len(verdicts) > 1 else words, tone

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
        flights = []
        for following in self.more:
            stances = [{"side": "landing", **self.stance_table(stance)} for stance in following.after]
            flights.append({"plan": following.flight.record.to_dict(), "shift": following.shift, "stances": stances})
        content = {
            "format": self._format,
            "status": self.status,
            "explanation": self.explanation,
            "robot": robot_record(self.problem.robot).to_dict(),
            "problem": problem_to_dict(self.problem),
            "flight": None if self.flight is None else self.flight.record.to_dict(),
            "stances": [{"side": side, **self.stance_table(stance)} for side, stances in sides for stance in stances],
            **({"flights": flights} if flights else {}),
        }
        return json.dumps(json_value(content), indent=1, allow_nan=False) + "\n"

    def stance_table(self, stance: Any) -> dict[str, Any]:
        """What the file holds of a stance."""
        return _stance(stance)

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
