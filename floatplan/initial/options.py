"""Options of ``floatplan init``, which the first flight satisfies, or which are refused by their names."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Any, Literal

import numpy as np

from floatplan.arguments import number, without
from floatplan.errors import InputError
from floatplan.initial.feet import position, standing_height, upright
from floatplan.initial.robots import ChosenRobot
from floatplan.jumps.setup import usual_groups
from floatplan.problem.jump import Groups, JumpLanding, JumpRequest, JumpTakeoff, Standing
from floatplan.tables import GRAVITY, Unit

OPTIONS = {  # that may be to blame for a key of the problem, the likeliest first
    "jump.takeoff.from": ("posture", "reference"),
    "jump.takeoff": ("contacts", "takeoff", "posture"),
    "jump.landing": ("landing_contacts", "landing", "contacts", "takeoff"),
    "flight.takeoff": ("takeoff", "contacts"),
    "flight.landing": ("landing", "landing_contacts"),
}


@dataclass(frozen=True, kw_only=True)
class InitOptions:
    """Options by their names; None is left open. Turns are forwards unless ``backwards``, which by itself is one.

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
    def typed(self) -> dict[str, str]:
        """The options that are set, as they are typed."""
        options = without(asdict(self), ("angles",))
        if self.posture is not None and self.angles == "deg":
            options["posture"] = {joint: math.degrees(angle) for joint, angle in self.posture.items()}
        typed = {}
        for name, value in options.items():
            if value is not None and value is not False:
                typed[name] = _typed(name, value)
        return typed

    @property
    def foot(self) -> str | None:
        """The frame that is to take off."""
        return self.takeoff or (_frame(self.contacts[-1][0]) if self.contacts else None)

    def refuse_own(self, error: InputError) -> None:
        """Raise an error about a key of the problem as one of the option that sets it, if one does."""
        for key, names in OPTIONS.items():
            if not (error.element or "").startswith(key):
                continue
            for name in names:
                if name in self.typed:
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
        self._check_side(chosen, "takeoff", "contacts", last=-1)
        self._check_side(chosen, "landing", "landing_contacts", last=0)
        if self.duration is not None:
            number("duration")(self.duration, "duration")
            if chosen.feet:
                self._check_duration(chosen, self.duration)

    def _check_side(self, chosen: ChosenRobot, side: str, contacts: str, last: int) -> None:
        """Refuse unknown frames, and a frame of a side that does not stand in the phase next to the flight."""
        frame: str | None = getattr(self, side)
        phases: Groups = getattr(self, contacts) or ()
        names = [(side, frame)] if frame else []
        names += [(contacts, name) for name in chain.from_iterable(phases)]
        for option, name in names:
            if name and not {name, _frame(name)} & set(chosen.robot.frames):
                raise wrong(option, f"the robot has no frame {name!r}", "floatplan info ROBOT --frames lists them")
        if frame and phases and frame not in map(_frame, phases[last]):
            reason = f"{_typed(contacts, phases)} has {', '.join(phases[last])} next to the flight"
            raise wrong(side, reason, "leave one of the two out")

    def _check_duration(self, chosen: ChosenRobot, duration: float) -> None:
        """Refuse durations in which a jump rises by less than a thousandth, or more than ten times its height."""
        height = standing_height(chosen.robot, chosen.feet[0], chosen.posture)
        rise = GRAVITY * duration**2 / 8
        least = 1e-3 * height
        most = 10.0 * height
        if not least <= rise <= most:
            stands = f"stands with its mass {height:.2g} m high"
            reason = f"it jumps {rise:.2g} m high in {duration:g} s, and {stands}"
            shortest = math.sqrt(8 * least / GRAVITY)
            longest = math.sqrt(8 * most / GRAVITY)
            raise wrong("duration", reason, f"give {shortest:.2g} to {longest:.2g} s")

    def whole_turns(self, chosen: ChosenRobot) -> tuple[int, ...]:
        """Return the whole turns that are tried, those backwards positive.

        Left open, it is one over the side on which it takes off, then none.
        """
        if self.turns is not None or self.backwards:
            count = 1 if self.turns is None else self.turns
            return (count if self.backwards else -count,)
        rear = position(chosen.robot, chosen.feet[0], chosen.posture).real
        front = position(chosen.robot, chosen.feet[-1], chosen.posture).real
        takeoff = position(chosen.robot, self.foot, chosen.posture).real if self.foot else rear
        return (1 if 2 * takeoff <= rear + front else -1, 0)

    def request(self, chosen: ChosenRobot, foot: str) -> JumpRequest:
        """Return the request of the jump that takes off from a foot."""
        fixed: Sequence[Literal["duration"]] = () if self.duration is None else ("duration",)
        feet: Literal["auto", "rolling"] = "rolling" if chosen.on_wheels else "auto"
        posture: Standing = "standing"
        if chosen.stance is not None and chosen.stance.own:
            posture = dict(zip(chosen.robot.joints, chosen.posture.tolist(), strict=True))
        level, takeoff_contacts = _usual(chosen, foot, "takeoff")
        if level and not set(self.typed) - {"turns", "backwards", "duration", "posture"}:
            return JumpRequest(fixed=fixed, feet=feet, takeoff=JumpTakeoff(from_=posture))
        takeoff_contacts = self.contacts or takeoff_contacts
        if self.landing:
            _, landing_contacts = _usual(chosen, self.landing, "landing")
        else:
            landing_contacts = _mirrored(chosen, takeoff_contacts)
        try:
            takeoff = JumpTakeoff(contacts=takeoff_contacts, from_=posture)
        except InputError as error:
            raise error.within(element="jump.takeoff") from None
        try:
            landing = JumpLanding(contacts=self.landing_contacts or landing_contacts)
        except InputError as error:
            raise error.within(element="jump.landing") from None
        return JumpRequest(fixed=fixed, feet=feet, takeoff=takeoff, landing=landing)


def wrong(name: str, reason: str, advice: str | None = None) -> InputError:
    """Return the error of an option."""
    return InputError(reason, element=name.replace("_", "-"), advice=advice)


def _typed(name: str, value: Any) -> str:
    """An option with its value, as it is typed."""
    option = f"--{name.replace('_', '-')}"
    if value is True:
        return option
    if isinstance(value, Mapping):
        value = '"' + ",".join(f"{joint}={angle:.6g}" for joint, angle in value.items()) + '"'
    elif not isinstance(value, int | float | str):
        value = '"' + ";".join(map(",".join, value)) + '"'
    return f"{option} {value}"


def _frame(name: str) -> str:
    """The frame of a contact's name."""
    frame, _, end = name.rpartition(".")
    return frame if end in ("toe", "heel", "tip") else name


def _usual(chosen: ChosenRobot, frame: str, side: Literal["takeoff", "landing"]) -> tuple[bool, Groups]:
    """Whether all feet stand level in the reference posture; and phases: all feet, and next to the flight the frame.

    Of a sole that is its toe. Feet that are not level stand in a posture that is searched for.
    """
    robot = chosen.robot
    turns = robot.tree.turns
    outer, inner = usual_groups(robot, frame, side, np.append(upright(robot, frame), chosen.posture))
    level = len(outer) >= len(chosen.feet)
    if not level:
        own_leg = turns[robot.frames[frame].body]
        feet = []
        for foot in chosen.feet:
            same_leg = (turns[robot.frames[foot].body] == own_leg).all()
            feet.append(frame if same_leg else foot)
        outer = tuple(feet)
        inner = [(foot,) for foot in outer]
    of_frame: list[tuple[str, ...]] = [group for group in inner if _frame(group[0]) == frame]
    return level, [outer, *of_frame] if side == "takeoff" else [*of_frame, outer]


def _mirrored(chosen: ChosenRobot, phases: Groups) -> list[tuple[str, ...]]:
    """The phases in reverse order, the rear foot exchanged for the front one and the other way about."""
    feet = sorted(set(map(_frame, phases[0])), key=lambda frame: position(chosen.robot, frame, chosen.posture).real)
    opposite = dict(zip(feet, reversed(feet), strict=True))

    def mirrored(names: Sequence[str]) -> Iterator[str]:
        for name in names:
            frame = _frame(name)
            yield opposite.get(frame, frame) + name[len(frame) :]

    return [tuple(mirrored(names)) for names in reversed(phases)]
