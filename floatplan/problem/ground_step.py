"""Grounds of different heights: the step between takeoff and landing, and the obstacles that stand for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from floatplan.arrays import Array
from floatplan.problem.attitude import Triple
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Bar, Obstacle
from floatplan.problem.spatial_obstacles import Box, Capsule


@dataclass(frozen=True)
class GroundStep:
    """A step of the ground between takeoff and landing, whose edge is straight and level.

    Attributes
    ----------
    edge : horizontal position of it, m, in the flight's world: in space along one axis, at right angles to the other
    low, high : heights of both grounds, m
    inwards : 1 or -1, the direction from the edge in which the higher ground is
    axis : in space 0 where the edge crosses x, 1 where it crosses y; 0 in a plane
    across : in space the position along the other horizontal axis at which the edge has its middle, m; None in a plane
    depth : of obstacles below the ground on which feet stand, farther than capsules around these reach into it, m
    margin : that links keep from the edge, m
    """

    depth: ClassVar[float] = 2e-2
    margin: ClassVar[float] = 0.01

    edge: float
    low: float
    high: float
    inwards: int
    axis: int = 0
    across: float | None = None

    @classmethod
    def of(cls, request: JumpRequest, takeoff: Sequence[float], ground: float) -> Self | None:
        """The step of a request; None where both grounds are equally high.

        Parameters
        ----------
        request : JumpRequest
        takeoff : (2,) in a plane, (3,) in space: where the frame that takes off stands, m
        ground : height of the ground that it leaves, m
        """
        if request.edge is None or not request.rise:
            return None
        is_spatial = len(takeoff) == 3
        axis = request.edge_axis if is_spatial else 0
        ahead = 1 if request.edge > 0 else -1  # from the feet that take off
        return cls(
            edge=takeoff[axis] + request.edge,
            low=ground + min(0.0, request.rise),
            high=ground + max(0.0, request.rise),
            inwards=-ahead if request.rise < 0 else ahead,
            axis=axis,
            across=takeoff[1 - axis] if is_spatial else None,
        )

    def above_low(self, along: Array) -> Array:
        """Heights (..) m of the ground over the lower one at positions (..) along the axis, m."""
        return np.where(self.inwards * (along - self.edge) > 0, self.high - self.low, 0.0)

    def along(self, inside: float) -> float:
        """Position so far inside the edge, m: in a plane horizontally, in space along the axis."""
        return self.edge + self.inwards * inside

    def point(self, inside: float, across: float, height: float) -> Triple:
        """A point in space, m: so far inside the edge and from its middle, at a height."""
        along = self.along(inside)
        aside = (self.across or 0.0) + across
        return (along, aside, height) if self.axis == 0 else (aside, along, height)

    def size(self, along: float, across: float, height: float) -> Triple:
        """The edges of a box in space, m along x, y and z, from what they are along and across the axis."""
        return (along, across, height) if self.axis == 0 else (across, along, height)


class OfHigherGround:
    """What obstacles have in common that stand for higher ground, and are no obstacles of a problem."""


@dataclass(frozen=True, kw_only=True)
class GroundEdge(Bar, OfHigherGround):
    """A bar that stands for the edge of higher ground."""


@dataclass(frozen=True, kw_only=True)
class SpatialGroundEdge(Capsule, OfHigherGround):
    """A bar along the edge of higher ground, in space."""


@dataclass(frozen=True, kw_only=True)
class HigherGround(Box, OfHigherGround):
    """A box that stands for higher ground, in space."""


def edge_obstacles(step: GroundStep | None) -> tuple[Obstacle, ...]:
    """The higher ground as obstacles; none where the grounds are equally high.

    In a plane a bar down its side and one below its top; in space a bar along its edge, and a box whose side is that of
    the ground and whose top is below it.
    """
    if step is None:
        return ()
    far = 3.0  # [m] inside, and to either side: farther than any robot stands from the edge
    radius = 0.01  # [m] of the bar at an edge: where side and top of the ground meet is a round edge inside it
    if step.across is None:
        x = step.along(radius)
        side = GroundEdge(start=(x, step.low - radius), end=(x, step.high - radius), radius=radius, margin=step.margin)
        beyond = x + step.inwards * far
        top = GroundEdge(start=(x, step.high - step.depth), end=(beyond, step.high - step.depth), radius=0.0)
        return side, top
    edge = SpatialGroundEdge(
        start=step.point(radius, -far, step.high - radius),
        end=step.point(radius, far, step.high - radius),
        radius=radius,
        margin=step.margin,
    )
    top_of_box = step.high - step.depth - step.margin
    bottom = step.low - 1.0  # [m] so far below that nothing is nearer to the box's lower face
    box = HigherGround(
        center=step.point(far / 2, 0.0, (bottom + top_of_box) / 2),
        size=step.size(far, 2 * far, top_of_box - bottom),
        margin=step.margin,
    )
    return edge, box
