"""What a first flight is asked to be: options of ``floatplan init``, which are kept, or refused by their names."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from floatplan.arguments import number
from floatplan.errors import InputError
from floatplan.initial.feet import place, standing_height, upright
from floatplan.initial.robots import ChosenRobot
from floatplan.jumps.setup import usual_groups
from floatplan.problem.jump import Groups, JumpLanding, JumpRequest, JumpTakeoff, Standing
from floatplan.tables import Unit

GRAVITY = 9.81  # [m/s^2]
LEAST_RISE, MOST_RISE = 1e-3, 10.0  # [-] times the height of the centre of mass, standing, that a jump may rise
OPTIONS = {  # that may be to blame for a key of the problem, the likeliest first
    "jump.takeoff.from": ("posture", "reference"),
    "jump.takeoff": ("contacts", "takeoff", "posture"),
    "jump.landing": ("landing_contacts", "landing", "contacts", "takeoff"),
    "flight.takeoff": ("takeoff", "contacts"),
    "flight.landing": ("landing", "landing_contacts"),
}


@dataclass(frozen=True, kw_only=True)
class Asked:
    """Options by their names; None is left open. Turns are forwards unless ``backwards``, which alone is one.

    Landing contacts that are left open are those before takeoff in reverse, front and rear exchanged.
    """

    takeoff: str | None = None
    landing: str | None = None
    turns: int | None = None
    backwards: bool = False
    duration: float | None = None
    contacts: Groups | None = None
    landing_contacts: Groups | None = None
    posture: Mapping[str, float] | None = None  # of joints, rad
    angles: Unit = "rad"  # in which it is typed

    @property
    def given(self) -> dict[str, str]:
        """What is asked, as it is typed."""
        options = {name: value for name, value in asdict(self).items() if name != "angles"}
        if self.posture is not None and self.angles == "deg":
            options["posture"] = {joint: math.degrees(position) for joint, position in self.posture.items()}
        return {
            name: _typed(name, value) for name, value in options.items() if value is not None and value is not False
        }

    @property
    def foot(self) -> str | None:
        """The frame that is asked to take off."""
        return self.takeoff or (_frame(self.contacts[-1][0]) if self.contacts else None)

    def refuse_own(self, error: InputError) -> None:
        """Raise an error about a key that stands for an option which is given as one of that."""
        for key, names in OPTIONS.items():
            for name in names if (error.element or "").startswith(key) else ():
                if name in self.given:
                    raise wrong(name, error.reason, error.advice)

    def reason(self, error: InputError, chosen: ChosenRobot) -> str:
        """Return why there is no jump, of an error about what this chose itself: by options, not by keys."""
        if not (error.element or "").startswith("jump."):
            return f"{error}."
        postures = f", or --reference with one of its file: {', '.join(chosen.postures)}" if chosen.postures else ""
        static = f" ({error.advice})" if error.advice and error.advice.startswith("static") else ""
        return f"{error.reason}{static}; give --posture with a stance{postures}."

    def check(self, chosen: ChosenRobot) -> None:
        """Refuse what contradicts itself, frames that the robot has not, and durations of no jump, by the option."""
        if self.turns == 0 and self.backwards:
            raise wrong("backwards", "no turn is neither forwards nor backwards", "leave it out, or give --turns 1")
        ends = (("takeoff", self.takeoff, "contacts", -1), ("landing", self.landing, "landing_contacts", 0))
        for side, frame, other, last in ends:
            phases: Groups = getattr(self, other) or ()
            for option, each in [(side, frame), *((other, each) for group in phases for each in group)]:
                if each and not {each, _frame(each)} & set(chosen.robot.frames):
                    advice = "floatplan info ROBOT --frames lists them"
                    raise wrong(option, f"the robot has no frame {each!r}", advice)
            if frame and phases and frame not in map(_frame, phases[last]):
                reason = f"{_typed(other, phases)} has {', '.join(phases[last])} next to the flight"
                raise wrong(side, reason, "leave one of the two out")
        if self.duration is not None:
            number("duration")(self.duration, "duration")
            height = standing_height(chosen.robot, chosen.feet[0], chosen.posture) if chosen.feet else math.inf
            rise = GRAVITY * self.duration**2 / 8
            if chosen.feet and not LEAST_RISE * height <= rise <= MOST_RISE * height:
                low, high = (math.sqrt(8 * share * height / GRAVITY) for share in (LEAST_RISE, MOST_RISE))
                reason = (
                    f"it jumps {rise:.2g} m high in {self.duration:g} s, and stands with its mass {height:.2g} m high"
                )
                raise wrong("duration", reason, f"give {low:.2g} to {high:.2g} s")

    def whole_turns(self, chosen: ChosenRobot) -> tuple[int, ...]:
        """Return the whole turns that are tried, those backwards positive.

        Left open, it is one over the side on which it takes off, then none.
        """
        if self.turns is not None or self.backwards:
            count = 1 if self.turns is None else self.turns
            return (count if self.backwards else -count,)
        ends = (chosen.feet[0], chosen.feet[-1])
        rear, front = (place(chosen.robot, foot, chosen.posture).real for foot in ends)
        at = place(chosen.robot, self.foot, chosen.posture).real if self.foot else rear
        return (1 if 2 * at <= rear + front else -1, 0)

    def request(self, chosen: ChosenRobot, foot: str) -> JumpRequest:
        """Return what is asked of the jump that takes off from a foot."""
        fixed: Sequence[Literal["duration"]] = () if self.duration is None else ("duration",)
        feet: Literal["auto", "rolling"] = "rolling" if chosen.on_wheels else "auto"
        own = chosen.stance is not None and chosen.stance.own
        stands: Standing = dict(zip(chosen.robot.joints, chosen.posture.tolist(), strict=True)) if own else "standing"
        level, before = _usual(chosen, foot, "takeoff")
        if level and not set(self.given) - {"turns", "backwards", "duration", "posture"}:
            return JumpRequest(fixed=fixed, feet=feet, takeoff=JumpTakeoff(from_=stands))
        before = self.contacts or before
        meeting = _usual(chosen, self.landing, "landing")[1] if self.landing else _mirrored(chosen, before)
        try:
            takeoff = JumpTakeoff(contacts=before, from_=stands)
        except InputError as error:
            raise error.within(element="jump.takeoff") from None
        try:
            landing = JumpLanding(contacts=self.landing_contacts or meeting)
        except InputError as error:
            raise error.within(element="jump.landing") from None
        return JumpRequest(fixed=fixed, feet=feet, takeoff=takeoff, landing=landing)


def wrong(name: str, reason: str, advice: str | None = None) -> InputError:
    """Return the error of an option."""
    return InputError(reason, element=name.replace("_", "-"), advice=advice)


def _typed(name: str, value: Any) -> str:
    if isinstance(value, Mapping):
        value = '"' + ",".join(f"{joint}={position:.6g}" for joint, position in value.items()) + '"'
    elif not isinstance(value, bool | int | float | str):
        value = '"' + ";".join(map(",".join, value)) + '"'
    return f"--{name.replace('_', '-')}" + ("" if value is True else f" {value}")


def _frame(name: str) -> str:
    """The frame of a contact's name."""
    frame, _, end = name.rpartition(".")
    return frame if end in ("toe", "heel", "tip") else name


def _usual(chosen: ChosenRobot, frame: str, side: Literal["takeoff", "landing"]) -> tuple[bool, Groups]:
    """Phases of a side: all feet, and next to the flight the frame alone, of a sole its toe.

    Before them, whether all feet stand level in the reference posture; others do in one that is looked for.
    """
    robot, turns = chosen.robot, chosen.robot.tree.turns
    outer, inner = usual_groups(robot, frame, side, np.append(upright(robot, frame), chosen.posture))
    level = len(outer) >= len(chosen.feet)
    if not level:
        own = turns[robot.frames[frame].body]
        on_it = [(turns[robot.frames[foot].body] == own).all() for foot in chosen.feet]
        outer = tuple(frame if here else foot for here, foot in zip(on_it, chosen.feet, strict=True))
        inner = [(foot,) for foot in outer]
    alone: list[tuple[str, ...]] = [each for each in inner if _frame(each[0]) == frame]
    return level, [outer, *alone] if side == "takeoff" else [*alone, outer]


def _mirrored(chosen: ChosenRobot, phases: Groups) -> list[tuple[str, ...]]:
    """The phases in reverse order, the rear foot in place of the front one and the other way about."""
    order = sorted(set(map(_frame, phases[0])), key=lambda frame: place(chosen.robot, frame, chosen.posture).real)
    other = dict(zip(order, reversed(order), strict=True))
    return [
        tuple(other.get(_frame(name), _frame(name)) + name[len(_frame(name)) :] for name in group)
        for group in reversed(phases)
    ]
