"""What a first flight is asked to be: options of ``floatplan init``, which are kept or refused by their names."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NoReturn

import numpy as np

from floatplan.arguments import number
from floatplan.errors import InputError
from floatplan.initial.feet import place, standing_height, upright
from floatplan.initial.robots import ChosenRobot
from floatplan.problem.jump import Groups, JumpLanding, JumpRequest, JumpTakeoff
from floatplan.robot.robot import Robot
from floatplan.stance.setup import usual_groups

GRAVITY = 9.81  # [m/s^2]
LOWEST, HIGHEST = 1e-3, 10.0  # [-] times the height of the centre of mass, standing, is how high a jump may rise
OPTIONS = {  # which may be wrong where a key of the problem is, the likeliest first
    "jump.takeoff": ("contacts", "takeoff"),
    "jump.landing": ("landing_contacts", "landing", "contacts", "takeoff"),
    "flight.takeoff": ("takeoff", "contacts"),
    "flight.landing": ("landing", "landing_contacts"),
    "flight.duration": ("duration",),
}


@dataclass(frozen=True, kw_only=True)
class Asked:
    """Options by their names; what is None is left open.

    Attributes
    ----------
    takeoff, landing : frames that leave the ground last, and meet it first
    turns : whole turns of the base, forwards unless ``backwards``; 0 for a jump without
    backwards : one turn where their number is left open
    duration : of the flight, s
    contacts : phases until takeoff, frames each; where ``landing_contacts`` are left open, it lands on the same feet in
        reverse order, front and rear exchanged
    landing_contacts : phases from the landing on
    """

    takeoff: str | None = None
    landing: str | None = None
    turns: int | None = None
    backwards: bool = False
    duration: float | None = None
    contacts: Groups | None = None
    landing_contacts: Groups | None = None

    @property
    def given(self) -> dict[str, str]:
        """What is asked, as it is typed."""
        return {name: _typed(name, value) for name, value in asdict(self).items() if value not in (None, False)}

    @property
    def of_jump(self) -> list[str]:
        """Names of options that only a jump can keep."""
        return [name for name in self.given if name != "duration"]

    @property
    def foot(self) -> str | None:
        """The frame that is asked to take off."""
        return self.takeoff or (_frame(self.contacts[-1][0]) if self.contacts else None)

    def without(self, name: str) -> "Asked":
        """Return the same, with an option left open."""
        return replace(self, **{name: Asked.__dataclass_fields__[name].default})

    def refuse(self, name: str, reason: str, advice: str | None = None) -> NoReturn:
        """Raise what is wrong with an option."""
        raise InputError(reason, element=name.replace("_", "-"), advice=advice)

    def refuse_own(self, error: InputError) -> None:
        """Raise an error as one of an option, where it is about a key that stands for one that is given."""
        for key, names in OPTIONS.items():
            for name in names if (error.element or "").startswith(key) else ():
                if name in self.given:
                    self.refuse(name, error.reason, error.advice)

    def check(self, chosen: ChosenRobot) -> None:
        """Refuse what contradicts itself, or what the robot cannot do for want of a frame.

        Raises
        ------
        InputError
            It names the option.
        """
        if self.turns == 0 and self.backwards:
            self.refuse("backwards", "no turn is neither forwards nor backwards", "leave it out, or give --turns 1")
        self._check_frames(chosen.robot)
        if self.duration is not None:
            number("duration")(self.duration, "duration")
        if self.duration is not None and chosen.feet:
            height = standing_height(chosen.robot, chosen.feet[0])
            rise = GRAVITY * self.duration**2 / 8
            if not LOWEST * height <= rise <= HIGHEST * height:
                low, high = (math.sqrt(8 * share * height / GRAVITY) for share in (LOWEST, HIGHEST))
                reason = (
                    f"a jump of {self.duration:g} s rises by {rise:.2g} m, of a mass that stands {height:.2g} m high"
                )
                self.refuse("duration", reason, f"give {low:.2g} to {high:.2g} s")

    def _check_frames(self, robot: Robot) -> None:
        for name, other, next_to_flight in (("takeoff", "contacts", -1), ("landing", "landing_contacts", 0)):
            frame, phases = getattr(self, name), getattr(self, other) or ()
            named = [(name, frame)] * (frame is not None) + [(other, each) for group in phases for each in group]
            for option, each in named:
                if _frame(each) not in robot.frames and each not in robot.frames:
                    advice = "floatplan info ROBOT --frames lists them"
                    self.refuse(option, f"the robot has no frame {each!r}", advice)
            last = phases[next_to_flight] if phases else ()
            if frame and last and frame not in map(_frame, last):
                reason = f"{', '.join(last)} is next to the flight in --{other.replace('_', '-')}"
                self.refuse(name, reason, "leave one of the two out")

    def whole_turns(self, chosen: ChosenRobot) -> tuple[int, ...]:
        """Return which whole turns are tried, those backwards positive.

        Left open, it is one over the side on which it takes off, then none.
        """
        if self.turns is not None or self.backwards:
            count = 1 if self.turns is None else self.turns
            return (count if self.backwards else -count,)
        ends = [place(chosen.robot, foot).real for foot in (chosen.feet[0], chosen.feet[-1])]
        rear = self.foot is None or 2 * place(chosen.robot, self.foot).real <= sum(ends)
        return (1 if rear else -1, 0)

    def request(self, robot: Robot, foot: str) -> JumpRequest:
        """Return what is asked of the jump that takes off from a foot: phases on both sides, where one is asked."""
        fixed = {"fixed": ("duration",) if self.duration is not None else ()}
        if not set(self.given) - {"turns", "backwards", "duration"}:
            return JumpRequest(**fixed)
        before = self.contacts or _usual(robot, foot, "takeoff")
        meeting = _usual(robot, self.landing, "landing") if self.landing else _mirrored(robot, before)
        after = self.landing_contacts or meeting
        sides: dict[str, Any] = {}
        for name, side, phases in (("takeoff", JumpTakeoff, before), ("landing", JumpLanding, after)):
            try:
                sides[name] = side(contacts=phases)
            except InputError as error:
                raise error.within(element=f"jump.{name}") from None
        return JumpRequest(**fixed, **sides)


def _typed(name: str, value: Any) -> str:
    """An option as it is typed."""
    if not isinstance(value, bool | int | float | str):
        value = '"' + ";".join(map(",".join, value)) + '"'
    return f"--{name.replace('_', '-')}" + ("" if value is True else f" {value}")


def _frame(name: str) -> str:
    """The frame of a contact's name."""
    frame, _, end = name.rpartition(".")
    return frame if end in ("toe", "heel", "tip") else name


def _usual(robot: Robot, frame: str, side: Any) -> list[tuple[str, ...]]:
    """Phases of a side: all feet, and next to the flight the frame alone, of a sole its toe."""
    outer, inner = usual_groups(robot, frame, side, np.append(upright(robot, frame), robot.resting))
    own = [each for each in inner if _frame(each[0]) == frame]
    return [outer, *own] if side == "takeoff" else [*own, outer]


def _mirrored(robot: Robot, phases: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """The phases in reverse order, the rear foot in place of the front one and the other way about."""
    order = sorted(set(map(_frame, phases[0])), key=lambda frame: place(robot, frame).real)
    other = dict(zip(order, reversed(order), strict=True))
    return [
        tuple(other.get(_frame(name), _frame(name)) + name[len(_frame(name)) :] for name in group)
        for group in reversed(phases)
    ]
