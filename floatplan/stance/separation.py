"""What stays apart: capsules of links from the user's obstacles and from one another, by lines that separate them.

Two convex shapes keep a distance between their middle lines if a direction n exists with ``n . (a - b) >= distance``
for all ends a of the one and b of the other. Directions are variables of the program, free to turn: so the condition is
smooth, and shapes that overlap find their way out. One direction holds from a node to the next, at both of which it
separates: nothing passes through an obstacle between nodes. Pairs come by exchange: those that a solution brings too
near, of what moves alike, left and right, the nearest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError
from floatplan.motion.planar.clearance import LinkShapes, Segments, obstacle_distances, pair_distances
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle, SelfClearance
from floatplan.robot import LinkCapsule, Robot
from floatplan.stance.contacts import Contact, from_frame, heights_over_com
from floatplan.stance.model import Spot, casadi
from floatplan.stance.motion import hermite
from floatplan.stance.rows import Rows

if TYPE_CHECKING:
    from floatplan.stance.program import JumpProgram

ROOM = 0.005  # [m] beyond margins, at nodes
NEAR = 0.002  # [m] beyond margins: what is nearer, at nodes or between them, is too near
INSTANTS = 4  # [-] in an interval, where distances are measured
DIRECTIONS = 64  # [-] that are tried for a guess
TURNS = 1.5 * np.pi  # [rad] by which directions may turn from their guess
DETOUR = 2.0  # [-] times longer has to be the way around on the side where a shape is, for the other to come first


@dataclass(frozen=True, eq=False)
class Line:
    """What separates a capsule from another, or from a piece of an obstacle: a direction in each of some intervals.

    Attributes
    ----------
    key : which pair it is
    name : the same for a person
    first : index of the capsule
    other : index of another; or the piece of an obstacle
    reach : distance of their middle lines at least: radii and margin, m
    room : beyond that, m
    intervals : (L,) of the program
    angles : (L,) rad, of directions from the other to the capsule, where the program begins
    rooms : (L,) m, no more than ``room``, nor than there is where the robot stands
    """

    key: tuple[int, ...]
    name: str
    first: int
    other: int | Obstacle
    reach: float
    room: float = 0.0
    intervals: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    angles: Array = field(default_factory=lambda: np.zeros(0))
    rooms: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def normal(self) -> complex | None:
        """The direction, where there is but one: out of a half-plane."""
        if not isinstance(self.other, HalfPlane):
            return None
        return complex(*self.other.normal) / abs(complex(*self.other.normal))

    def exists(self, since: Array) -> Any:
        """When (M,) that is, since takeoff, s."""
        low, high = (None if isinstance(self.other, int) else self.other.window) or (-np.inf, np.inf)
        return (since >= low) & (since <= high)


@dataclass(frozen=True, eq=False)
class Separation:
    """What a program keeps apart.

    Attributes
    ----------
    robot : Robot
    obstacles, pairs : from what it stays away, and which of its links stay apart
    origin : where the frame that takes off is at takeoff, m, horizontal and vertical
    room : beyond margins, at nodes, m
    lines : that the program has
    """

    robot: Robot
    obstacles: tuple[Obstacle, ...] = ()
    pairs: tuple[SelfClearance, ...] = ()
    origin: tuple[float, float] = (0.0, 0.0)
    room: float = ROOM
    lines: tuple[Line, ...] = ()

    @property
    def angles(self) -> Array:
        """Directions (size,) where the program begins, rad."""
        return np.concatenate([np.zeros(0), *(line.angles for line in self.lines)])

    @property
    def box(self) -> Array:
        """Bounds (2, size) of directions, rad."""
        free = np.concatenate([np.zeros(0), *(np.full(line.angles.shape, line.normal is None) for line in self.lines)])
        bounds: Array = self.angles + TURNS * free * np.array([[-1.0], [1.0]])
        return bounds

    @cached_property
    def _candidates(self) -> list[tuple[Line, tuple[Any, ...]]]:
        """All that has to stay apart, and what moves alike there."""
        if not self.obstacles and not self.pairs:
            return []
        shapes = self.robot.shapes
        turns = [tuple(self.robot.tree.turns[shape.body].tolist()) for shape in shapes]
        pairs: list[tuple[Line, tuple[Any, ...]]] = []
        for index, obstacle in enumerate(self.obstacles):
            for number, piece in enumerate(obstacle.pieces):
                for first, shape in enumerate(shapes):
                    reach = shape.radius + getattr(piece, "radius", 0.0) + obstacle.margin
                    name = f"{shape.link} clear of obstacle {index}"
                    line = Line((number, first, index), name, first, piece, reach)
                    pairs.append((line, (index, number, turns[first])))
        for index, asked in enumerate(self.pairs):
            for first, other in itertools.permutations(range(len(shapes)), 2):
                if (shapes[first].link, shapes[other].link) == asked.links:
                    reach = shapes[first].radius + shapes[other].radius + asked.margin
                    line = Line((first, other, index), " clear of ".join(asked.links), first, other, reach)
                    pairs.append((line, (index, turns[first], turns[other])))
        return pairs

    def _placed(self, program: JumpProgram, guess: Array) -> tuple[Array, Segments]:
        """Instants (M,) s since takeoff, and where the capsules are then, in the world of the flight."""
        y, v, a, *_, durations, _ = program.split(guess)
        robot, index, gravity = self.robot, program.flight, program.model.gravity
        tree, nodes = robot.tree, program.times(durations.ravel())
        begin, end = int(program.starts[index]), int(program.starts[index + 1])
        fine = np.interp(np.arange(INSTANTS * (len(nodes) - 1) + 1) / INSTANTS, np.arange(len(nodes)), nodes)
        values, since = hermite(nodes, y, v, a)(fine), fine - nodes[begin]
        angles = tree.absolute_angles(values[:, 0], values[:, 1:])
        anchors = [program.phases[side].anchor for side in (index - 1, index + 1)]
        spots = [each.spots[0] for each in anchors]
        weights = tree.point_weights(np.array([spot[0] for spot in spots]), np.array([spot[1] for spot in spots]))
        rotations = tree.rotations(angles)
        before, after = weights @ rotations.T
        takeoff, landing = INSTANTS * begin, INSTANTS * end
        first = complex(*self.origin) + from_frame(robot, anchors[0], y[:, begin])
        rates = 1j * tree.turn * (v[0, begin] + tree.turns @ v[1:, begin])
        speed = -complex(weights[0] @ (rates * rotations[takeoff]))
        com = first - before[takeoff] + speed * since - 0.5j * gravity * since**2
        second = com[landing] + after[landing]
        com[:takeoff], com[landing:] = first - before[:takeoff], second - after[landing:]
        return since, LinkShapes(tree, robot.shapes).place(com, angles)

    def _distances(self, since: Array, segments: Segments) -> Iterator[tuple[Line, tuple[Any, ...], Array]]:
        """All that has to stay apart, with distances (M,) beyond margins, m."""
        known: dict[tuple[int, ...], Array] = {}
        for line, alike in self._candidates:
            other, radii = line.other, segments.radius[line.first]
            if isinstance(other, int):
                radii = radii + segments.radius[other]
                own = (segments.of(np.array([each])) for each in (line.first, other))
                distances = pair_distances(*own)[:, 0]
            else:
                radii = radii + getattr(other, "radius", 0.0)
                if line.key[::2] not in known:
                    rows = obstacle_distances(segments, other, since)
                    known[line.key[::2]] = rows.reshape(len(since), -1, len(segments.radius)).min(axis=1)
                distances = known[line.key[::2]][:, line.first]
            yield line, alike, np.where(line.exists(since), distances - (line.reach - radii), np.inf)

    def check_standing(self, contact: Contact, y: Array) -> None:
        """Refuse what is too near where the robot stands, before the flight or after it.

        Parameters
        ----------
        contact : on which it stands; its place is known where it is the frame's that takes off
        y : (n+1,) rad

        Raises
        ------
        InputError
            Links are too near to one another, or to an obstacle that is always there.
        """
        robot, home = self.robot, self.robot.frames[contact.frame]
        if not self._candidates:
            return
        place = complex(*self.origin) - heights_over_com(robot, contact.spots[:1], y)[0]
        segments = LinkShapes(robot.tree, robot.shapes).place(
            place[None], robot.tree.absolute_angles(y[0], y[1:])[None]
        )
        for line, _, distances in self._distances(np.zeros(1), segments):
            still = isinstance(line.other, int) or not (line.other.window or any(line.other.velocity))
            known = isinstance(line.other, int) or contact.spots[0] == (home.body, home.local)
            if still and known and distances[0] < 0:
                reason = f"where the robot stands, {line.name} is missed by {-distances[0]:.2g} m"
                table = "self_clearance" if isinstance(line.other, int) else "obstacles"
                raise InputError(
                    reason, element=f"{table}[{line.key[-1]}]", advice="change it, its margin or the posture"
                )

    def wider(self, program: JumpProgram, guess: Array) -> list[Separation]:
        """Return what also holds apart what a solution brings too near, on either way around; else nothing.

        Parameters
        ----------
        program : that is solved
        guess : (size,) its solution
        """
        if not self._candidates:
            return []
        since, segments = self._placed(program, guess)
        chosen = {line.key: line for line in self.lines}
        nearest: dict[tuple[Any, ...], tuple[float, Line]] = {}
        for line, alike, distances in self._distances(since, segments):
            least = float(distances.min())
            if least < nearest.get(alike, (NEAR, line))[0]:
                nearest[alike] = least, line
        for least, line in nearest.values():
            room = chosen[line.key].room + NEAR - least if line.key in chosen else self.room
            chosen[line.key] = replace(line, room=room)
        if not nearest:
            return []
        ways = (self._directed(program, since, segments, chosen.values(), way) for way in (False, True))
        return [replace(self, lines=tuple(way)) for way in ways]

    def at(self, program: JumpProgram, guess: Array) -> Separation:
        """Return the same lines for another program, where its variables (size,) begin."""
        if not self.lines:
            return self
        placed = self._placed(program, guess)
        return replace(self, lines=tuple(self._directed(program, *placed, self.lines, False)))

    def _directed(
        self, program: JumpProgram, since: Array, segments: Segments, lines: Any, swapped: bool
    ) -> Iterator[Line]:
        """Lines with directions that separate as well as they can, or lead around on a side, in each interval."""
        ways = np.exp(2j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)
        first, last = program.starts[program.flight], program.starts[program.flight + 1]
        for line in lines:
            tried = np.array([line.normal]) if line.normal is not None else ways
            ends = [
                np.stack((segments.start[:, each], segments.end[:, each]))
                if isinstance(each, int)
                else np.array([place + complex(*each.velocity) * since for place in middle_line(each)])
                for each in (line.first, line.other)
            ]
            apart = (ends[0][:, None] - ends[1][None]).reshape(-1, len(since), 1)
            gaps = (apart * tried.conj()).real.min(axis=0) - line.reach
            within = np.stack([gaps[k : k + len(gaps) - INSTANTS : INSTANTS] for k in range(INSTANTS + 1)]).min(axis=0)
            angles = np.angle(tried[within.argmax(axis=1)])
            if line.normal is None:
                angles = _around(angles, within.max(axis=1), swapped)
            there = np.stack([line.exists(since[k::INSTANTS][: len(angles)]) for k in range(INSTANTS)]).any(axis=0)
            intervals = np.flatnonzero(there)
            rooms = np.full(len(angles), line.room)
            for stands, end in ((slice(first), 0), (slice(last, None), -1)):
                rooms[stands] = np.clip(0.9 * gaps[end].max(), 0.0, line.room)
            yield replace(line, intervals=intervals, angles=angles[intervals], rooms=rooms[intervals])

    def add(self, program: JumpProgram, rows: Rows, parts: Sequence[Any], durations: Any, angles: Any) -> None:
        """Rows of the lines at both ends of their intervals.

        Parameters
        ----------
        program : whose rows they are
        parts : y, v, a (n+1, K+1)
        durations : (phases, 1)
        angles : (size, 1) the directions
        """
        if not self.lines:
            return
        ca, model = casadi(), program.model
        shapes = self.robot.shapes
        capsules = {each for line in self.lines for each in (line.first, line.other) if isinstance(each, int)}
        spots = [spot for index in sorted(capsules) for spot in capsule_ends(shapes[index])]
        directions = ca.vertsplit(angles, np.cumsum([0, *[len(line.angles) for line in self.lines]]).tolist())
        begins = ca.cumsum(ca.vertcat(0.0, durations))
        bases = self._bases(program, rows, parts, durations[program.flight])
        for number, phase in enumerate(program.phases):
            start, stop = (int(each) for each in program.starts[number : number + 2])
            since = begins[number] - begins[program.flight] + durations[number] * ca.DM(phase.shares).T
            reference = None if phase.side == "flight" else phase.anchor.spots[0]
            places = model.function("ends", model.places(model.weights(spots, reference)))
            own = rows.calls(places, *[part[:, start : stop + 1] for part in parts])
            base = bases(phase.side, since)
            x, z = (each + ca.repmat(shift, len(spots), 1) for each, shift in zip(own, base, strict=True))
            for line, turned in zip(self.lines, directions, strict=True):
                chosen = np.flatnonzero((line.intervals >= start) & (line.intervals < stop))
                angle = turned[chosen.tolist()].T
                for side in (0, 1) if len(chosen) else ():
                    at = (line.intervals[chosen] - start + side).tolist()
                    ends = [
                        [(x[spots.index(spot), at], z[spots.index(spot), at]) for spot in capsule_ends(shapes[each])]
                        if isinstance(each, int)
                        else [
                            (place.real + each.velocity[0] * since[0, at], place.imag + each.velocity[1] * since[0, at])
                            for place in middle_line(each)
                        ]
                        for each in (line.first, line.other)
                    ]
                    for (x0, z0), (x1, z1) in itertools.product(*ends):
                        value = ca.cos(angle) * (x0 - x1) + ca.sin(angle) * (z0 - z1)
                        kept = ca.DM(line.reach + line.rooms[chosen]).T
                        rows.add(value - kept, 0.0, np.inf, f"{line.name} ({phase.side})")

    def _bases(self, program: JumpProgram, rows: Rows, parts: Sequence[Any], duration: Any) -> Callable[..., Any]:
        """Function of a side and times since takeoff: the anchor's place there, in flight the centre of mass's, m."""
        model, index, gravity = program.model, program.flight, program.model.gravity
        anchors = [program.phases[side].anchor for side in (index - 1, index + 1)]
        takeoff, landing = ([part[:, int(program.starts[index + k])] for part in parts] for k in (0, 1))
        spot, home = anchors[0].spots[0], model.robot.frames[anchors[0].frame]
        from_frame = model.places(model.weights([spot], (home.body, home.local)))
        outputs = [*from_frame, *model.com_from(spot), *model.com_from(spot, 1)]
        x, z, over_x, over_z, vx, vz = rows.calls(model.function("takes_off", outputs), *takeoff)
        from_com = rows.calls(model.function("lands", model.com_from(anchors[1].spots[0])), *landing)
        x, z = (each + place for each, place in zip((x, z), self.origin, strict=True))
        lands = x + over_x + vx * duration - from_com[0], z - anchors[0].depth + anchors[1].depth

        def base(side: str, since: Any) -> tuple[Any, Any]:
            if side == "flight":
                return x + over_x + vx * since, z + over_z + vz * since - gravity / 2 * since**2
            return tuple(each + 0 * since for each in ((x, z) if side == "takeoff" else lands))

        return base


def middle_line(piece: Obstacle) -> list[complex]:
    """Ends of the middle line of a piece of an obstacle, as it is at takeoff, m; of a half-plane a point."""
    places = ("start", "end") if isinstance(piece, Bar) else ("center",) if isinstance(piece, Circle) else ("point",)
    return [complex(*getattr(piece, name)) for name in places]


def capsule_ends(shape: LinkCapsule) -> list[Spot]:
    """Ends of a capsule, one of a disc."""
    return [(shape.body, end) for end in dict.fromkeys((shape.start, shape.end))]


def _around(angles: Array, gaps: Array, swapped: bool) -> Array:
    """Angles (K,) rad that lead around on one side where gaps (K,) are negative: the other one where ``swapped``."""
    found, edges = angles.copy(), np.flatnonzero(np.diff(np.concatenate(([0], gaps < 0, [0]))))
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
