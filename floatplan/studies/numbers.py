"""The numbers of a problem file that a study can vary, by their paths: unit and range of each."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from floatplan.errors import InputError
from floatplan.problem.parts import OBSTACLE_KINDS
from floatplan.tables import LIMIT_TABLE, RANGES, Range

_JOINT, _INDEX, _AXIS = r"\.[^.]+", r"\.\d+", r"\.[01]"
_LIMIT_WORDS = "|".join(row.key for row in LIMIT_TABLE.values() if row.of != "base")
_PLACES = (place for kind in OBSTACLE_KINDS.values() for place in kind.places())
_OBSTACLE_WORDS = "|".join(dict.fromkeys((*_PLACES, "normal", "velocity", "window")))
_PATHS = {  # path -> key of RANGES; None for the number that the path names
    rf"(?:start|goal)\.(?P<key>orientation|(?:positions|velocities|accelerations)(?:{_JOINT})?)": None,
    r"flight\.(?P<key>duration|angular_momentum|horizontal_velocity|gravity)": None,
    rf"flight\.(?P<key>takeoff\.position{_AXIS}|landing\.height)": "place",
    rf"motion\.(?P<key>degree)(?:{_JOINT})?": "degree",
    rf"limits\.(?P<key>position{_JOINT}{_AXIS})": "positions",
    rf"limits\.(?P<key>{_LIMIT_WORDS})(?:{_JOINT})?": "limit",
    r"limits\.(?P<key>orientation_rate)": "limit",
    rf"limits\.(?P<key>motor{_JOINT}\.stall)": "limit",
    rf"limits\.(?P<key>motor{_JOINT}\.slope)": "slope",
    rf"obstacles{_INDEX}\.(?P<key>radius|margin)": None,
    rf"obstacles{_INDEX}\.(?P<key>(?:{_OBSTACLE_WORDS}){_AXIS})": None,
    rf"self_clearance{_INDEX}\.(?P<key>margin)": None,
}
DEGREE = Range(0, 100, "")  # the problem itself refuses what it cannot have


@dataclass(frozen=True)
class Quantity:
    """A number of a problem file.

    Attributes
    ----------
    unit : in the file
    factor : from the file's unit to SI and radians
    whole : whether it is an integer
    """

    unit: str
    factor: float
    whole: bool
    allowed: Range

    def check(self, value: float, element: str) -> None:
        """Refuse a number, in the file's unit, out of its range, or not whole where it must be."""
        if self.whole and value != math.floor(value):
            raise InputError(f"{value:g} is not a whole number", element=element)
        low, high = self.allowed.low / self.factor, self.allowed.high / self.factor
        if not low <= value <= high:
            raise InputError(f"{value:g} is outside {Range(low, high, self.unit)}", element=element)


def quantity(path: str, degrees: bool) -> Quantity:
    """Return what a path of a problem file names; ``degrees`` is the file's unit of angles.

    Raises
    ------
    InputError
        It is no number that can be varied.
    """
    for pattern, given in _PATHS.items():
        found = re.fullmatch(pattern, path, flags=re.ASCII)
        if found:
            key = found["key"].split(".")[0]
            return _quantity(given or key, _unit(key, given), degrees)
    raise InputError(
        "is no number of a problem file that can be varied",
        element=path,
        advice='give a path such as "flight.duration", "goal.positions.q1" or "obstacles.0.center.0"',
    )


def patterns() -> list[str]:
    """Regular expressions of all paths, as JSON Schema writes them."""
    return [pattern.replace("?P<key>", "?:") for pattern in _PATHS]


def _unit(key: str, given: str | None) -> str:
    """Unit of a key: a limit's is of what it limits."""
    if given == "limit":
        return next((row.unit for row in LIMIT_TABLE.values() if row.key == key), "N m")
    return "" if given == "degree" else RANGES.get(given or key, RANGES["place"]).unit


def _quantity(key: str, unit: str, degrees: bool) -> Quantity:
    turns = degrees and unit.startswith("rad")
    allowed = DEGREE if key == "degree" else RANGES.get(key, RANGES["place"])
    shown = unit.replace("rad", "deg", 1) if turns else unit
    return Quantity(shown, math.radians(1.0) if turns else 1.0, key == "degree", allowed)
