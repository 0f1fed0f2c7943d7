"""Obstacles of flights in space: balls, bars, half-spaces and boxes, in the world's axes, z up."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar

from floatplan.arguments import shortened
from floatplan.problem.attitude import Triple
from floatplan.problem.parts import Obstacle, RoundBar, RoundObstacle, Wall
from floatplan.tables import Key

NO_VOLUME = "is 0, and what has no volume keeps nothing away"


@dataclass(frozen=True, kw_only=True)
class SpatialObstacle(Obstacle):
    """What all obstacles in space share.

    Parameters
    ----------
    margin, window : as of :class:`Obstacle`
    velocity : (float, float, float), m/s
        Of one that moves: x, y, z; it is where it is written at takeoff.
    """

    velocity: Annotated[Triple, Key(unit="m/s")] = (0.0, 0.0, 0.0)  # type: ignore[assignment]  # not two

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Those of every obstacle, and a ball that is a point, or a bar that is a line."""
        yield from super().contradictions()
        if getattr(self, "radius", None) == 0:
            yield "radius", NO_VOLUME


@dataclass(frozen=True, kw_only=True)
class Sphere(SpatialObstacle, RoundObstacle):
    """A ball: centre (x, y, z) and radius, m."""

    kind: ClassVar[str] = "sphere"
    about: ClassVar[str] = "A ball, in space"
    center: Annotated[Triple, Key("Its middle: x, y, z", "m")]
    radius: Annotated[float, Key("Of the ball", "m")]


@dataclass(frozen=True, kw_only=True)
class Capsule(SpatialObstacle, RoundBar):
    """A bar with round ends: all points within ``radius`` of the segment from ``start`` to ``end``, m."""

    kind: ClassVar[str] = "capsule"
    about: ClassVar[str] = "A bar with round ends, in space"
    start: Annotated[Triple, Key("One end of its middle line: x, y, z", "m")]
    end: Annotated[Triple, Key("The other end", "m")]
    radius: Annotated[float, Key("Of the bar", "m")]


@dataclass(frozen=True, kw_only=True)
class HalfSpace(SpatialObstacle, Wall):
    """Ground or a wall: solid where ``normal . (x - point) < 0``; the normal is made a unit vector."""

    kind: ClassVar[str] = "half-space"
    about: ClassVar[str] = "Ground or a wall in space, solid on one side of a plane"
    point: Annotated[Triple, Key("A point on the plane: x, y, z", "m")] = (0.0, 0.0, 0.0)
    normal: Annotated[Triple, Key("Direction away from what is solid: x, y, z; of any length")] = (0.0, 0.0, 1.0)

    @property
    def unit_normal(self) -> Triple:
        """The normal as a unit vector."""
        length = math.hypot(*self.normal)
        x, y, z = self.normal
        return x / length, y / length, z / length


@dataclass(frozen=True, kw_only=True)
class LevelGround(HalfSpace):
    """The ground, on which links stand: heights over it are those of their solids, not of the capsules around them."""


@dataclass(frozen=True, kw_only=True)
class Box(SpatialObstacle):
    """A box whose edges are along the world's axes: middle and edges, m.

    A link is clear of it where one of its six faces is between them: at its edges and corners that is more than need
    be.
    """

    kind: ClassVar[str] = "box"
    about: ClassVar[str] = "A box in space with edges along x, y and z, to be passed on one of its faces"
    center: Annotated[Triple, Key("Its middle: x, y, z", "m")]
    size: Annotated[Triple, Key("Its edges along x, y and z", "m", "radius")]
    bounded = True

    @property
    def thickness(self) -> float:
        """Its shortest edge, m."""
        return min(self.size)

    @property
    def where(self) -> str:
        """Middle and edges."""
        edges = [f"{edge:g}" for edge in self.size]
        return f"at ({shortened(self.center, 6)}) m, {' x '.join(edges)} m"

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Those of every obstacle, and a box that is flat."""
        yield from super().contradictions()
        if min(self.size) == 0:
            yield "size", f"has an edge that {NO_VOLUME}"


SPATIAL_OBSTACLE_KINDS: dict[str, type[SpatialObstacle]] = {
    kind.kind: kind for kind in (Sphere, Capsule, HalfSpace, Box)
}
SpatialObstacle.kinds = SPATIAL_OBSTACLE_KINDS
