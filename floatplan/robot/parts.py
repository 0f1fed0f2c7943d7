"""The small pieces that a :class:`floatplan.robot.Robot` is described with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from floatplan.arguments import FINITE, Check, Checked, text
from floatplan.arrays import Array


@dataclass(frozen=True, eq=False)
class Plane:
    """The plane of the motion, in the root link's axes.

    Attributes
    ----------
    name : str
        Two letters, horizontal then vertical: "xz" has +x and +z.
    horizontal, vertical : (3,)
        Unit vectors along the two letters.
    normal : (3,)
        The axis that the planned joints share (majority sign): a unit vector along plus or minus the third letter.
    turn : float
        +1 where a positive angle about the normal turns the horizontal axis towards the vertical one, else -1.
    """

    name: str
    horizontal: Array
    vertical: Array
    normal: Array
    turn: float


@dataclass(frozen=True)
class Coupling(Checked):
    """A joint that follows a planned one: ``position = ratio * leader's position + offset`` (rad)."""

    leader: str
    ratio: float = 1.0
    offset: float = 0.0
    checks: ClassVar[Mapping[str, Check]] = {"leader": text, "ratio": FINITE, "offset": FINITE}


@dataclass(frozen=True)
class LinkCapsule:
    """A link's shape in the plane: all points within ``radius`` of the segment from ``start`` to ``end``.

    ``body`` indexes :class:`PlanarTree`; ``start`` and ``end`` are complex places in that body's frame, m.
    """

    link: str
    body: int
    start: complex
    end: complex
    radius: float


@dataclass(frozen=True)
class Frame:
    """A named point of the robot: a link's or joint's origin, fixed to a body of the :class:`PlanarTree`, m.

    ``link`` is the link itself, or the joint's child.
    """

    body: int
    local: complex
    link: str
