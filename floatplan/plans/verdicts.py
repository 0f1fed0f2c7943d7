"""What was proved of a plan, as data: the verdict on each constraint, and on all of them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from floatplan.arguments import html_table, short
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.files import json_value

Verdict: TypeAlias = Literal["proved", "refuted", "undecided"]
Tone: TypeAlias = Literal["good", "bad", "open"]
Kind: TypeAlias = str
Subject: TypeAlias = tuple[str | int, ...]

TONES: Mapping[Verdict, Tone] = {"proved": "good", "refuted": "bad", "undecided": "open"}
MOST_SHOWN = 6  # [-] constraints in a representation

LABELS: Mapping[Kind, str] = {  # of the other kinds: the kind and the subject, with spaces between
    "start": "start.{}",
    "goal": "goal.{}",
    "takeoff": "takeoff.{}",
    "landing": "landing.{}",
    "attitude": "attitude.{}",
    "out_of_plane": "out_of_plane.{}",
    "stated": "{}.{}",
    "obstacle": "obstacles[{}] {}",
    "self_clearance": "self_clearance {} {}",
    "mesh": "hash of mesh {}",
    "robot": "robot: {}",
    "resolved": "robot.resolved: the proof is of this URDF, not of the MJCF that it was made from",
}


@dataclass(frozen=True)
class Finding:
    """The verdict on one constraint.

    Attributes
    ----------
    kind : which constraint
        "start", "goal", "takeoff" and "landing" hold at an end of the flight; "attitude" are the terms of the theorem
        by which flights in space are proved: "residual" (rad), "amplification", "condition" and "bound" (rad);
        "position", "velocity", "torque", "generalized_torque", "motor" and "orientation_rate" are limits; "obstacle",
        "self_clearance", "ground" and "mesh" belong to clearances; "out_of_plane" bounds what a robot in a plane does
        in space, rad, and decides nothing; "robot" is what of its file is not read; "resolved"
        says that the proof is of the URDF that the plan file holds of an MJCF; "recorded" is what the file claims of
        the motion, "stated" and "angular_momentum" are numbers that the file gives twice.
    subject : whose
        The joint, the obstacle's index and kind, both links, the mesh file, or the quantity's key; empty where the kind
        says everything.
    verdict : "proved", "refuted" or "undecided"
    bound : the proved bound; where refuted, a value that is attained
    instant : s, where the bound is nearly attained, or the violation is; None where it belongs to no instant
    limit : what the bound is compared with
    gap : where undecided, the distance between what is proved and what is required
    """

    kind: Kind
    subject: Subject
    verdict: Verdict
    bound: float | None
    instant: float | None = None
    limit: float | None = None
    gap: float | None = None

    @property
    def label(self) -> str:
        """The constraint's name for a person."""
        template = LABELS.get(self.kind)
        return template.format(*self.subject) if template else " ".join((self.kind, *map(str, self.subject)))

    def to_dict(self) -> dict[str, Any]:
        """Return numbers; ``gap`` only where undecided."""
        values = {"label": self.label, "verdict": self.verdict, "bound": self.bound, "instant": self.instant}
        values |= {"limit": self.limit}
        return values | ({"gap": self.gap} if self.verdict == "undecided" else {})

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Finding:
        """Rebuild a finding from what :meth:`to_dict` returned."""
        kind, subject = _constraint(content["label"])
        numbers = (_number(content.get(key), None) for key in ("bound", "instant", "limit", "gap"))
        return cls(kind, subject, _verdict(content["verdict"]), *numbers)


@dataclass(frozen=True, eq=False, repr=False)
class Certificate:
    """What was proved of a plan.

    Attributes
    ----------
    verdict : "proved", "refuted" or "undecided"
    orientation_end : (low, high) rad
        Encloses the orientation at the end; of flights in space, which have no such number, infinite.
    attitude_bound : rad
        Of flights in space: at all times the attitude is within it of what the plan's numbers say; None of others.
    clearance_min : float or None
        No link comes nearer to an obstacle, surface to surface, m.
    torque_peak, velocity_peak : (n,)
        No magnitude exceeds these, N m, rad/s; torques are generalised: a leader's is the sum over its group.
    motor_torque_peak : motor's joint -> N m
        The same of each motor's own torque.
    findings : one per constraint
    subintervals : number of cells of time
    seconds : time that the proof took
    """

    verdict: Verdict
    orientation_end: tuple[float, float]
    clearance_min: float | None
    torque_peak: Array
    velocity_peak: Array
    motor_torque_peak: Mapping[str, float]
    findings: tuple[Finding, ...]
    subintervals: int
    seconds: float
    attitude_bound: float | None = None

    @property
    def proved(self) -> bool:
        """Whether every constraint is proved."""
        return self.verdict == "proved"

    @property
    def unproved(self) -> tuple[Finding, ...]:
        """What is refuted or undecided."""
        return tuple(finding for finding in self.findings if finding.verdict != "proved")

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the attitude of a flight in space is not proved, and what may help."""
        terms = [finding for finding in self.unproved if finding.kind == "attitude" and finding.bound is None]
        return tuple(str(finding.subject[0]) for finding in terms)

    def __repr__(self) -> str:
        """A line, and one for each of the first constraints that are not proved."""
        lines = [
            f"Certificate({self.verdict}, {len(self.findings)} constraints, {self.subintervals} intervals of time)"
        ]
        lines += [f"  {finding.verdict}: {finding.label}" for finding in self.unproved[:MOST_SHOWN]]
        more = len(self.unproved) - MOST_SHOWN
        return "\n".join([*lines, f"  and {more} more"] if more > 0 else lines)

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Return titles and cells of a table of all constraints; what is not proved comes first."""
        ordered = sorted(self.findings, key=lambda finding: finding.verdict == "proved")
        cells: list[list[str]] = []
        for finding in ordered:
            bound = short(finding.bound, 5)
            limit = short(finding.limit, 5)
            cells.append([finding.label, finding.verdict, bound, limit, short(finding.instant, 5)])
        return ["constraint", "", "bound", "limit", "at, s"], cells

    def _repr_html_(self) -> str:
        """A table of all constraints, as notebooks show it."""
        titles, cells = self.table()
        return html_table(f"{self.verdict}, {self.subintervals} intervals of time", cells, titles)

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file and ``floatplan certify --json`` hold; numbers that are not finite are null."""
        values: dict[str, Any] = json_value(
            {**vars(self), "findings": [finding.to_dict() for finding in self.findings]}
        )
        return values

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Certificate:
        """Rebuild a certificate from what a plan file holds; a bound that is null is infinite.

        Raises
        ------
        InputError
            A key is missing, or its value is of the wrong kind.
        """
        try:
            low, high = content["orientation_end"]
            motors = (content.get("motor_torque_peak") or {}).items()
            torques = list(map(_number, content["torque_peak"]))
            rates = list(map(_number, content["velocity_peak"]))
            return cls(
                verdict=_verdict(content["verdict"]),
                orientation_end=(_number(low, -math.inf), _number(high)),
                clearance_min=_number(content["clearance_min"], None),
                torque_peak=read_only(torques),
                velocity_peak=read_only(rates),
                motor_torque_peak={str(name): _number(peak) for name, peak in motors},
                findings=tuple(map(Finding.from_dict, content["findings"])),
                subintervals=int(content["subintervals"]),
                seconds=_number(content["seconds"]),
                attitude_bound=_number(content.get("attitude_bound"), None),
            )
        except KeyError as error:
            raise InputError("is missing", element=f"certificate.{error.args[0]}") from None
        except (AttributeError, OverflowError, TypeError, ValueError) as error:
            raise InputError(f"must be what floatplan certify --save writes: {error}", element="certificate") from None


def verdict_in_words(has_plan: bool, certificate: Certificate | None, warned: bool) -> tuple[str, Tone]:
    """The verdict on a plan as summary, report and studio say it, and its tone.

    Parameters
    ----------
    has_plan : whether there is a plan
    certificate : what was proved of it; None where nothing was
    warned : whether it has warnings
    """
    if not has_plan:
        return "no plan found", "bad"
    if certificate is None:
        return "planned, not proved yet", "open"
    if certificate.proved and warned:
        return "flight proved, with warnings", "open"
    words = {"proved": "flight proved", "undecided": "planned, proof undecided", "refuted": "refuted"}
    return words[certificate.verdict], TONES[certificate.verdict]


def worst(findings: Sequence[Finding]) -> Verdict:
    """Refuted if anything is, else undecided if anything is, else proved."""
    return max(
        (finding.verdict for finding in findings), key=("proved", "undecided", "refuted").index, default="proved"
    )


def _constraint(label: str) -> tuple[Kind, Subject]:
    """The kind and the subject that a label was made from."""
    for kind, template in LABELS.items():
        word = r"(\w+)" if kind == "stated" else "(.+?)"
        match = re.fullmatch(re.escape(template).replace(r"\{\}", word), label, re.DOTALL)
        if match:
            words: Subject = match.groups()
            return kind, (int(words[0]), *words[1:]) if kind == "obstacle" else words
    kind, *subject = label.split(" ", 1)
    return kind, tuple(subject)


def _verdict(value: Any) -> Verdict:
    if value not in get_args(Verdict):
        raise ValueError(f"a verdict must be {' or '.join(map(repr, get_args(Verdict)))}, not {value!r}")
    verdict: Verdict = value
    return verdict


def _number(value: Any, unknown: Any = math.inf) -> Any:
    return unknown if value is None else float(value)
