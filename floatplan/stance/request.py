"""What is asked of a whole jump beside its flight: contacts, margins, friction, and what the flight keeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

from floatplan.arguments import FINITE, Check, Checked, by_name, many, one_of, optional, pair, positive, text
from floatplan.errors import InputError

Groups: TypeAlias = Sequence[Sequence[str]]

FIXABLE = ("duration", "angular_momentum", "start", "goal")
MARGIN = {"torque": 0.85, "velocity": 0.88}  # [-] of the limits
NAMES = many(many(text, "frames"), "phases")
BOUNDS = many(optional(pair(positive(100.0, "s"), "durations")), "pairs")
STEEPEST = 10.0  # [-] of a friction coefficient


def _margin(value: Any, element: str) -> dict[str, float]:
    if not isinstance(value, Mapping):
        raise InputError(f"{value!r} is not a mapping", element=element, advice=f"give {MARGIN}")
    unknown = [name for name in value if name not in MARGIN]
    if unknown:
        raise InputError(f"{unknown[0]!r} is not a margin", element=element, advice=f"margins: {', '.join(MARGIN)}")
    return {name: positive(1.0)(value.get(name, share), f"{element}.{name}") for name, share in MARGIN.items()}


@dataclass(frozen=True)
class JumpRequest(Checked):
    """A jump around a flight: from standing, through phases of contact, to standing again.

    Parameters
    ----------
    friction : float
        Coefficient of the ground.
    margin : mapping
        Shares of the limits that stances may use: of "torque" (torque-speed curves too) and "velocity".
    contacts : pair of sequences of sequences of str, optional
        Frames that stand in each phase before takeoff and after landing, in order of time; those coupled to them stand
        too. One or two phases each; a frame with a sole stands on heel and toe, "<frame>.toe" on its toe alone. Left
        out: all feet, then the rear ones for a turn backwards, or the front ones forwards; landing in reverse.
    durations : sequence of pairs, optional
        Bounds of the durations of all phases, the flight's among them, s; None for usual ones.
    standing : mapping of joints to rad, optional
        Where the robot stands, before and after, the base level; the nearest posture that is static is taken. Joints
        left out are where the reference posture has them.
    fixed : sequence of str
        What the flight of the problem keeps, of "duration", "angular_momentum", "start", "goal"; else it is optimised.

    Raises
    ------
    InputError
        A value is wrong, or a foot would leave the ground and return, or come and leave again.
    """

    friction: float = 0.6
    margin: Mapping[str, float] = field(default_factory=lambda: dict(MARGIN))
    contacts: tuple[Groups, Groups] | None = None
    durations: Sequence[tuple[float, float] | None] | None = None
    standing: Mapping[str, float] | None = None
    fixed: Sequence[str] = ()
    checks: ClassVar[Mapping[str, Check]] = {
        "friction": positive(STEEPEST),
        "margin": _margin,
        "contacts": optional(pair(NAMES, "sequences of phases")),
        "durations": optional(BOUNDS),
        "standing": optional(by_name(FINITE)),
        "fixed": many(one_of(*FIXABLE), "words"),
    }

    def contradictions(self) -> Any:
        """Phases that contradict each other."""
        for index, bounds in enumerate(self.durations or ()):
            if bounds is not None and bounds[0] > bounds[1]:
                yield f"durations[{index}]", f"low {bounds[0]} is above high {bounds[1]}"
        if self.contacts is None:
            return
        for side, groups in zip(("takeoff", "landing"), self.contacts, strict=True):
            if not 1 <= len(groups) <= 2 or not all(groups):
                yield f"contacts.{side}", "must be one or two phases, each with a frame at least"
                continue
            outer, inner = (groups[0], groups[-1]) if side == "takeoff" else (groups[-1], groups[0])
            extra = [name for name in inner if name not in outer and name.partition(".")[0] not in outer]
            if extra:
                yield f"contacts.{side}", f"{extra[0]!r} would leave the ground and return"
