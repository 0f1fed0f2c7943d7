"""What stays apart: capsules of links from the user's obstacles and from one another, by lines that separate them.

Two convex shapes keep a distance between their middle lines if a direction n exists with ``n . (a - b) >= distance``
for all ends a of the one and b of the other. Directions are variables of the program, free to turn: so the condition is
smooth, and shapes that overlap find their way out. One direction holds from a node to the next, at both of which it
separates: nothing passes through an obstacle between nodes. Pairs come by exchange: those that a solution brings too
near, of what moves alike, left and right, the nearest. One more variable is what is missing of all distances; it costs,
and more where it does not vanish: so a program begins where nothing is apart yet, and ends where not all can be.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.errors import InputError
from floatplan.jumps.contacts import is_ground
from floatplan.jumps.model import casadi
from floatplan.jumps.motion import hermite, refined, values
from floatplan.jumps.phases import instants
from floatplan.jumps.rows import NodeRows, Rows
from floatplan.motion.planar.clearance import Segments, obstacle_distances, pair_distances
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle, SelfClearance
from floatplan.robot import LinkCapsule, Robot
from floatplan.robot.standing import ROLLED, Spot

ROOM = 0.005  # [m] beyond margins, at nodes
NEAR = 0.002  # [m] beyond margins: what is nearer, at nodes or between them, is too near
SLIGHT = ROOM - NEAR  # [m] that may be missing of distances at nodes
INSTANTS = 4  # [-] in an interval, where distances are measured
DIRECTIONS = 64  # [-] that are tried for a guess
TURNS = 1.5 * np.pi  # [rad] by which directions may turn from their guess
WEIGHT = 40.0  # [1/m] of what is missing, beside the squared torques
STEEPER = 10.0  # [-] times that where something was still missing
DETOUR = 2.0  # [-] times longer has to be the way around on the side where a shape is, for the other to come first


@dataclass(frozen=True, eq=False)
class Line:
    """What separates a capsule from another, or from a piece of an obstacle: a direction in each of some intervals.

    Attributes
    ----------
    name, asked : which pair, for a person; and what asks for it, as obstacles[0]
    first, other : indices of the capsule, and of another or, after all of them, of a piece of an obstacle
    radii, margin : distances of their middle lines, and of their surfaces beyond, m, at least
    alike : the same for pairs that move alike
    room : beyond that, m
    intervals : (L,) of the program
    angles : (L,) rad, of directions from the other to the capsule, where the program begins
    reach : (L,) m, that middle lines keep: room no more than there is where the robot stands
    """

    name: str
    asked: str
    first: int
    other: int
    radii: float
    margin: float
    alike: tuple[Any, ...]
    room: float = 0.0
    intervals: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    angles: Array = field(default_factory=lambda: np.zeros(0))
    reach: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, eq=False)
class Separation:
    """What a program keeps apart.

    Attributes
    ----------
    robot : Robot
    obstacles, pairs : from what it stays away, and which of its links stay apart
    origin : where the frame that takes off is at takeoff, m, horizontal and vertical
    ground : height of the ground there, m: half-planes that are the ground, or below it, are no obstacles
    room : beyond margins, at nodes, m
    lines : that the program has
    weight : of what is missing of their distances, 1/m
    """

    robot: Robot
    obstacles: tuple[Obstacle, ...] = ()
    pairs: tuple[SelfClearance, ...] = ()
    origin: tuple[float, float] = (0.0, 0.0)
    ground: float = -np.inf
    room: float = ROOM
    lines: tuple[Line, ...] = ()
    weight: float = WEIGHT

    @property
    def start(self) -> Array:
        """Where the program begins (size,): directions, rad, and what is missing, m; nothing without lines."""
        return np.concatenate([*(line.angles for line in self.lines), np.zeros(min(len(self.lines), 1))])

    @property
    def box(self) -> Array:
        """Bounds (2, size) of these: directions of half-planes are their normals."""
        turns = [0.0 if isinstance(self._parts[line.other], HalfPlane) else TURNS for line in self.lines]
        free = np.append(np.repeat(turns, [len(line.angles) for line in self.lines]), np.inf)[: len(self.start)]
        bounds: Array = self.start + free * np.array([[-1.0], [1.0]])
        bounds[0, -1:] = 0.0
        return bounds

    @cached_property
    def _parts(self) -> list[LinkCapsule | Obstacle]:
        """The robot's capsules, then the obstacles' pieces."""
        return [*self.robot.shapes, *(piece for obstacle in self.obstacles for piece in obstacle.pieces)]

    @cached_property
    def _candidates(self) -> list[Line]:
        """All that has to stay apart."""
        if not self.obstacles and not self.pairs:
            return []
        shapes = self.robot.shapes
        found: list[Line] = []
        turns = [tuple(self.robot.tree.turns[shape.body].tolist()) for shape in shapes]
        pieces = iter(range(len(shapes), len(self._parts)))
        for index, obstacle in enumerate(self.obstacles):
            asked = f"obstacles[{index}]"
            own = [next(pieces) for _ in obstacle.pieces]
            if is_ground(obstacle, self.ground):
                continue
            for other, (first, shape) in itertools.product(own, enumerate(shapes)):
                radii = shape.radius + getattr(self._parts[other], "radius", 0.0)
                name = f"{shape.link} clear of obstacle {index}"
                found.append(Line(name, asked, first, other, radii, obstacle.margin, (asked, other, turns[first])))
        for index, pair in enumerate(self.pairs):
            asked = f"self_clearance[{index}]"
            name = " clear of ".join(pair.links)
            for first, other in itertools.permutations(range(len(shapes)), 2):
                if (shapes[first].link, shapes[other].link) == pair.links:
                    radii = shapes[first].radius + shapes[other].radius
                    alike = (asked, turns[first], turns[other])
                    found.append(Line(name, asked, first, other, radii, pair.margin, alike))
        return found

    def _placed(
        self, node: NodeRows, call: Callable[..., Any], motion: Sequence[Any], chosen: Sequence[int], steps: int
    ) -> Iterator[tuple[Any, Any, Any]]:
        """For each phase times since takeoff (1, N), and x, z (2 C, N) of both ends of C parts, in the flight's world.

        Parameters
        ----------
        call : evaluates a function of y, v, a
        motion : y, v, a (n+1, N) and durations (phases, 1): expressions or numbers
        chosen : C indices of parts, those of the robot first
        steps : in an interval
        """
        ca = casadi()
        model = node.model
        index = node.flies
        *state, durations = motion
        bodies = [part for part in (self._parts[k] for k in chosen) if isinstance(part, LinkCapsule)]
        pieces = [part for part in (self._parts[k] for k in chosen) if isinstance(part, Obstacle)]
        spots = [Spot(part.body, end) for part in bodies for end in _middle_line(part)]
        anchors = [node.phases[side].anchor for side in (index - 1, index + 1)]
        takeoff, landing = ([part[:, steps * int(node.starts[index + k])] for part in state] for k in (0, 1))
        spot = anchors[0].spots[0]
        home = self.robot.frames[anchors[0].frame]
        from_frame = model.places(model.weights([spot], Spot(home.body, home.local)))
        outputs = [*from_frame, *model.com_from(spot), *model.com_from(spot, 1)]
        x, z, com_x, com_z, vx, vz = call(model.function("takes_off", outputs), *takeoff)
        over, _ = call(model.function("lands", model.com_from(anchors[1].spots[0])), *landing)
        x = x + self.origin[0]
        z = z + self.origin[1]
        begins = ca.cumsum(ca.vertcat(0.0, durations))
        for number, phase in enumerate(node.phases):
            start, stop = (steps * int(each) for each in node.starts[number : number + 2])
            since = begins[number] - begins[index] + durations[number] * ca.DM(refined(phase.shares, steps)).T
            base = x, z
            if number == index:
                base = x + com_x + vx * since, z + com_z + vz * since - model.gravity / 2 * since**2
            elif number > index:
                base = x + com_x + vx * durations[index] - over, z - anchors[0].depth + anchors[1].depth
            places = model.places(model.weights(spots, phase.anchor.spots[0] if phase.contacts else None))
            own = call(model.function("ends", places), *[part[:, start : stop + 1] for part in state])
            moved = [ca.repmat(at + 0 * since, len(spots), 1) + each for at, each in zip(base, own, strict=True)]
            for axis, part in enumerate(moved):
                ends = [
                    (end.real, end.imag)[axis] + piece.velocity[axis] * since
                    for piece in pieces
                    for end in _middle_line(piece)
                ]
                moved[axis] = ca.vertcat(part, *ends)
            yield since, *moved

    def _measured(self, node: NodeRows, motion: Sequence[Any]) -> tuple[Array, Segments]:
        """Instants (M,) s since takeoff, ``INSTANTS`` in each interval, and where all parts are then."""
        y, v, a, durations = motion
        times = instants(node.phases, durations.ravel())
        motion = [*values(hermite(times, np.stack((y, v, a))), refined(times, INSTANTS)), durations]
        parts = range(len(self._parts))
        phases = self._placed(node, lambda function, *given: function(*given), motion, parts, INSTANTS)
        since, x, z = (
            np.concatenate([np.asarray(each)[:, number > 0 :] for number, each in enumerate(values)], axis=1)
            for values in zip(*phases, strict=True)
        )
        places = (x + 1j * z).T
        radii = [getattr(part, "radius", 0.0) for part in self._parts]
        return since[0], Segments(places[:, ::2], places[:, 1::2], np.array(radii))

    def _distances(self, since: Array, segments: Segments) -> Iterator[tuple[Line, Array]]:
        """All that has to stay apart, with distances (M,) beyond margins, m; infinite while one is not there."""
        for line in self._candidates:
            own = segments.of(np.array([line.first]))
            part = self._parts[line.other]
            if isinstance(part, HalfPlane):
                distances = obstacle_distances(own, part, since).min(axis=1)
            else:
                distances = pair_distances(own, segments.of(np.array([line.other])))[:, 0]
            yield line, np.where(_exists(part, since), distances - line.margin, np.inf)

    def check_standing(self, node: NodeRows, motion: Sequence[Any]) -> None:
        """Refuse what is too near where the robot stands, before the flight or after it.

        Raises
        ------
        InputError
            Links are too near to one another, or to an obstacle that is always there.
        """
        anchor = node.phases[node.flies - 1].anchor
        home = self.robot.frames[anchor.frame]
        lines = self._candidates
        spot = anchor.spots[0]
        known = spot._replace(radius=0.0) == Spot(home.body, home.local)  # else it depends on how the foot has turned
        rolled = spot.radius * ROLLED  # [m] along the ground, by which a foot may have rolled until it takes off
        for line, distances in self._distances(*self._measured(node, motion)) if lines else ():
            part = self._parts[line.other]
            least = distances[0]
            if isinstance(part, LinkCapsule):
                least = min(least, distances[-1])
            elif part.window or any(part.velocity) or not known:
                continue
            level = isinstance(part, HalfPlane) and not part.normal[0]
            if least < (-rolled if isinstance(part, Obstacle) and not level else 0.0):
                reason = f"where the robot stands, {line.name} is missed by {-least:.2g} m"
                raise InputError(reason, element=line.asked, advice="change it, its margin or the posture")

    def wider(self, node: NodeRows, motion: Sequence[Any], missing: float) -> list[Separation]:
        """Return what also holds apart what a solution brings too near, on either way around; else nothing.

        Parameters
        ----------
        node : rows of the program
        motion : y, v, a (n+1, K+1) and durations (phases, 1) of its solution
        missing : of its distances, m
        """
        if not self._candidates:
            return []
        placed = self._measured(node, motion)
        chosen = {(line.first, line.other): line for line in self.lines}
        nearest: dict[tuple[Any, ...], tuple[float, Line]] = {}
        for line, distances in self._distances(*placed):
            least = float(distances.min())
            if least < nearest.get(line.alike, (NEAR, line))[0]:
                nearest[line.alike] = least, line
        for least, line in nearest.values():
            key = line.first, line.other
            room = chosen[key].room + max(self.room - least - missing, 0.0) if key in chosen else self.room
            chosen[key] = replace(line, room=room)
        if not nearest:
            return []
        over, under = (self._directed(node, *placed, list(chosen.values()), swapped) for swapped in (False, True))
        same = all(np.array_equal(one.angles, two.angles) for one, two in zip(over, under, strict=True))
        weight = self.weight * (STEEPER if missing > SLIGHT else 1.0)
        return [replace(self, lines=lines, weight=weight) for lines in ([over] if same else [over, under])]

    def at(self, node: NodeRows, motion: Sequence[Any]) -> Separation:
        """Return the same lines for another program, where its motion begins."""
        if not self.lines:
            return self
        return replace(self, lines=self._directed(node, *self._measured(node, motion), self.lines, False))

    def _directed(
        self, node: NodeRows, since: Array, segments: Segments, lines: Sequence[Line], swapped: bool
    ) -> tuple[Line, ...]:
        """Lines with directions that separate as well as they can, or lead around on a side, in each interval."""
        first = node.starts[node.flies]
        last = node.starts[node.flies + 1]
        found = []
        for line in lines:
            part = self._parts[line.other]
            ways = np.exp(2j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)
            if isinstance(part, HalfPlane):
                ways = np.array([complex(*part.normal) / abs(complex(*part.normal))])
            own, other = (np.stack((segments.start[:, k], segments.end[:, k])) for k in (line.first, line.other))
            apart = (own[:, None] - other[None]).reshape(4, len(since), 1)
            gaps = (apart * ways.conj()).real.min(axis=0) - line.radii - line.margin
            within = np.stack([gaps[k : k + len(gaps) - INSTANTS : INSTANTS] for k in range(INSTANTS + 1)]).min(axis=0)
            angles = np.angle(ways[within.argmax(axis=1)])
            if len(ways) > 1:
                angles = _around(angles, within.max(axis=1), swapped)
            there = np.flatnonzero(_exists(part, since)[:-1].reshape(-1, INSTANTS).any(axis=1))
            reach = np.full(len(angles), line.radii + line.margin + line.room)
            for stands, end in ((slice(first), 0), (slice(last, None), -1)):
                reach[stands] -= line.room - np.clip(0.9 * gaps[end].max(), 0.0, line.room)
            found.append(replace(line, intervals=there, angles=angles[there], reach=reach[there]))
        return tuple(found)

    def add(self, node: NodeRows, rows: Rows, motion: Sequence[Any], own: Any) -> Any:
        """Add rows of the lines at both ends of their intervals; return the cost of what is missing.

        Parameters
        ----------
        node : rows of the program
        motion : y, v, a (n+1, K+1) and durations (phases, 1)
        own : (size, 1) the directions, and what is missing
        """
        if not self.lines:
            return 0.0
        ca = casadi()
        chosen = sorted({each for line in self.lines for each in (line.first, line.other)})
        *directions, missing = ca.vertsplit(own, np.cumsum([0, *[len(line.angles) for line in self.lines], 1]).tolist())
        placed = self._placed(node, rows.calls, motion, chosen, 1)
        for phase, start, (_, x, z) in zip(node.phases, node.starts, placed, strict=False):
            for line, turned in zip(self.lines, directions, strict=True):
                among = np.flatnonzero((line.intervals >= start) & (line.intervals < start + phase.intervals))
                angle = turned[among.tolist()].T
                reach = ca.DM(line.reach[among]).T
                ends = [
                    range(2 * chosen.index(k), 2 * chosen.index(k) + len(set(_middle_line(self._parts[k]))))
                    for k in (line.first, line.other)
                ]
                for side, one, two in itertools.product((0, 1) if len(among) else (), *ends):
                    at = (line.intervals[among] - start + side).tolist()
                    value = ca.cos(angle) * (x[one, at] - x[two, at]) + ca.sin(angle) * (z[one, at] - z[two, at])
                    rows.add(value - reach + missing, 0.0, np.inf, f"{line.name} ({phase.side})")
        return self.weight * missing


def _middle_line(part: LinkCapsule | Obstacle) -> list[complex]:
    """Both ends of the middle line of a capsule, m, or of a piece of an obstacle at takeoff: points have one twice."""
    if isinstance(part, LinkCapsule):
        return [part.start, part.end]
    if isinstance(part, Bar):
        return [complex(*part.start), complex(*part.end)]
    return [complex(*(part.center if isinstance(part, Circle) else part.point))] * 2  # type: ignore[attr-defined]


def _exists(part: LinkCapsule | Obstacle, since: Array) -> BoolArray:
    """When (M,) a part is there, since takeoff, s."""
    low, high = (part.window if isinstance(part, Obstacle) else None) or (-np.inf, np.inf)
    return np.asarray((since >= low) & (since <= high))


def _around(angles: Array, gaps: Array, swapped: bool) -> Array:
    """Angles (K,) rad that lead around on one side where gaps (K,) are negative: the other one where ``swapped``."""
    found = angles.copy()
    edges = np.flatnonzero(np.diff(np.concatenate(([0], gaps < 0, [0]))))
    for begin, end in edges.reshape(-1, 2).tolist():
        if begin == 0 or end == len(angles):
            found[begin:end] = angles[begin - 1] if begin else angles[end] if end < len(angles) else angles[begin:end]
            continue
        deepest = begin + int(gaps[begin:end].argmin())
        routes = []
        for middle in (angles[deepest], angles[deepest] + np.pi):
            over = angles[begin - 1] + math.remainder(middle - angles[begin - 1], 2 * np.pi)
            routes.append((angles[begin - 1], over, over + math.remainder(angles[end] - over, 2 * np.pi)))
        lengths = [float(np.abs(np.diff(route)).sum()) for route in routes]
        other = (lengths[0] > DETOUR * lengths[1]) != swapped
        found[begin:end] = np.interp(np.arange(begin, end), [begin - 1, deepest, end], routes[other])
    return found
