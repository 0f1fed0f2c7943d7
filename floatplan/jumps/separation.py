"""Distances that a jump respects: of links from the user's obstacles and from one another, by separating lines.

Two convex shapes are at a distance if a direction n exists with ``n . (a - b) >= distance`` for all ends a of the one's
middle line and b of the other's. Directions are variables of the program: so the condition is smooth, and shapes that
overlap find their way out. One direction counts from a node to the next, at both of which it separates: nothing passes
through an obstacle between nodes. Pairs are added where a solution brings them too near, of those that move alike, left
and right, the nearest. One more variable is the shortfall of all distances; it has a cost, a higher one where it did
not vanish: so a program may begin with distances too small, and ends so where not all can be.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array, BoolArray, ComplexArray, IntArray
from floatplan.errors import InputError
from floatplan.jumps.contacts import displacement, is_ground
from floatplan.jumps.model import casadi
from floatplan.jumps.motion import quintic_spline, refined, values
from floatplan.jumps.phases import instants
from floatplan.jumps.rows import NodeRows, Rows
from floatplan.motion.planar.clearance import Segments, obstacle_distances, pair_distances
from floatplan.problem.ground_step import GroundEdge
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle, SelfClearance
from floatplan.robot import LinkCapsule, Robot
from floatplan.robot.standing import ROLLED, Spot

RESERVE = 0.005  # [m] beyond margins, at nodes
TOO_NEAR = 0.002  # [m] beyond margins: what is nearer, at nodes or between them, gets rows
TOLERATED_SHORTFALL = RESERVE - TOO_NEAR  # [m] of distances at nodes
INSTANTS = 4  # [-] in an interval, at which distances are measured


@dataclass(frozen=True, eq=False)
class SeparatingLine:
    """What separates a capsule from another, or from a piece of an obstacle: a direction in each of some intervals.

    Attributes
    ----------
    name, element : which pair, for a person; and what requires it, as obstacles[0]
    first, other : indices of the capsule, and of another or, after all of them, of a piece of an obstacle
    radii, margin : distances of their middle lines, and of their surfaces beyond, m, at least
    alike : the same for pairs that move alike
    reserve : beyond that, m
    intervals : (L,) of the program
    angles : (L,) rad, of directions from the other to the capsule, where the program begins
    reach : (L,) m, least distances of middle lines: the reserve is no more than there is where the robot stands
    """

    name: str
    element: str
    first: int
    other: int
    radii: float
    margin: float
    alike: tuple[Any, ...]
    reserve: float = 0.0
    intervals: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    angles: Array = field(default_factory=lambda: np.zeros(0))
    reach: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, eq=False)
class Separation:
    """Distances that a program requires.

    Attributes
    ----------
    robot : Robot
    obstacles, pairs : from which it stays away, and which of its links stay away from each other
    origin : where the frame that takes off is at takeoff, m, horizontal and vertical
    ground : height of the ground there, m: half-planes that are the ground, or below it, are no obstacles
    reserve : beyond margins, at nodes, m
    lines : that the program has
    weight : of the shortfall of their distances, relative to the squared torques, 1/m
    """

    robot: Robot
    obstacles: tuple[Obstacle, ...] = ()
    pairs: tuple[SelfClearance, ...] = ()
    origin: tuple[float, float] = (0.0, 0.0)
    ground: float = -np.inf
    reserve: float = RESERVE
    lines: tuple[SeparatingLine, ...] = ()
    weight: float = 40.0

    @property
    def start(self) -> Array:
        """Where the program begins (size,): directions, rad, and the shortfall, m; nothing without lines."""
        if not self.lines:
            return np.zeros(0)
        return np.concatenate([*(line.angles for line in self.lines), np.zeros(1)])

    @property
    def box(self) -> Array:
        """Bounds (2, size) of these: directions of half-planes are their normals."""
        if not self.lines:
            return np.zeros((2, 0))
        ranges = []
        for line in self.lines:
            most = 0.0 if isinstance(self._shapes[line.other], HalfPlane) else 1.5 * np.pi  # rad, either way
            ranges.append(np.full(len(line.angles), most))
        bounds: Array = self.start + np.append(np.concatenate(ranges), np.inf) * np.array([[-1.0], [1.0]])
        bounds[0, -1] = 0.0
        return bounds

    @cached_property
    def _shapes(self) -> list[LinkCapsule | Obstacle]:
        """The robot's capsules, then the obstacles' pieces."""
        shapes: list[LinkCapsule | Obstacle] = list(self.robot.shapes)
        for obstacle in self.obstacles:
            shapes += obstacle.pieces
        return shapes

    @cached_property
    def _candidates(self) -> list[SeparatingLine]:
        """All pairs at whose distances limits are set."""
        if not self.obstacles and not self.pairs:
            return []
        capsules = self.robot.shapes
        candidates: list[SeparatingLine] = []
        moves = [tuple(self.robot.tree.turns[shape.body].tolist()) for shape in capsules]
        pieces = iter(range(len(capsules), len(self._shapes)))
        for index, obstacle in enumerate(self.obstacles):
            is_edge = isinstance(obstacle, GroundEdge)
            element = "jump.edge" if is_edge else f"obstacles[{index}]"
            obstacle_name = "the edge of the ground" if is_edge else f"obstacle {index}"
            own_pieces = list(itertools.islice(pieces, len(obstacle.pieces)))
            if is_ground(obstacle, self.ground):
                continue
            for other, (first, shape) in itertools.product(own_pieces, enumerate(capsules)):
                radii = shape.radius + getattr(self._shapes[other], "radius", 0.0)
                name = f"{shape.link} clear of {obstacle_name}"
                alike: tuple[Any, ...] = (element, other, moves[first])
                candidates.append(SeparatingLine(name, element, first, other, radii, obstacle.margin, alike))
        for index, pair in enumerate(self.pairs):
            element = f"self_clearance[{index}]"
            name = " clear of ".join(pair.links)
            for first, other in itertools.permutations(range(len(capsules)), 2):
                if (capsules[first].link, capsules[other].link) == pair.links:
                    radii = capsules[first].radius + capsules[other].radius
                    alike = (element, moves[first], moves[other])
                    candidates.append(SeparatingLine(name, element, first, other, radii, pair.margin, alike))
        return candidates

    def _ends(
        self, node_rows: NodeRows, call: Callable[..., Any], motion: Sequence[Any], chosen: Sequence[int], steps: int
    ) -> Iterator[tuple[Any, Any, Any]]:
        """For each phase times since takeoff (1, N), and x, z (2 C, N) of both ends of C shapes, in the flight's world.

        Parameters
        ----------
        call : evaluates a function of y, v, a
        motion : y, v, a (n+1, N) and durations (phases, 1): expressions or numbers
        chosen : C indices of shapes, those of the robot first
        steps : in an interval
        """
        ca = casadi()
        model = node_rows.model
        index = node_rows.flights[0]
        *state, durations = motion
        capsule_ends: list[Spot] = []
        piece_ends: list[tuple[complex, tuple[float, float]]] = []  # at takeoff, and their velocity
        for shape in (self._shapes[k] for k in chosen):
            for end in _middle_line(shape):
                if isinstance(shape, LinkCapsule):
                    capsule_ends.append(Spot(shape.body, end))
                else:
                    piece_ends.append((end, shape.velocity))
        before = node_rows.phases[index - 1].anchor
        home = self.robot.frames[before.frame]
        from_frame = model.positions(model.weights([before.spots[0]], Spot(home.body, home.local)))
        takeoff = [array[:, steps * int(node_rows.first_nodes[index])] for array in state]
        x, z = call(model.function("from_frame", from_frame), *takeoff)
        x = x + self.origin[0]  # where the anchor stands
        z = z + self.origin[1]
        begins = ca.cumsum(ca.vertcat(0.0, durations))
        for number, phase in enumerate(node_rows.phases):
            start = steps * int(node_rows.first_nodes[number])
            stop = steps * int(node_rows.first_nodes[number + 1])
            in_phase = durations[number] * ca.DM(refined(phase.progress, steps)).T
            since = begins[number] - begins[index] + in_phase
            previous = node_rows.phases[number - 1] if number else phase
            if phase.side == "flight":
                after = node_rows.phases[number + 1]
                spot = previous.anchor.spots[0]
                takeoff = [array[:, start] for array in state]
                landing = [array[:, stop] for array in state]
                leaves = model.function("leaves", [*model.com_from(spot), *model.com_from(spot, 1)])
                com_x, com_z, vx, vz = call(leaves, *takeoff)
                landing_com_x, _ = call(model.function("lands", model.com_from(after.anchor.spots[0])), *landing)
                reference = x + com_x + vx * in_phase, z + com_z + vz * in_phase - model.gravity / 2 * in_phase**2
                x = x + com_x + vx * durations[number] - landing_com_x
                z = z - previous.anchor.depth - previous.rise + after.anchor.depth + after.rise
            else:
                if phase.flight_number > previous.flight_number:  # between two flights
                    spots = (previous.anchor.spots[0], phase.anchor.spots[0])
                    beyond = displacement(self.robot, *spots, node_rows.standing(phase))
                    x = x + beyond[0]
                    z = z + beyond[1]
                reference = (x, z)
            positions = model.positions(model.weights(capsule_ends, phase.anchor.spots[0] if phase.contacts else None))
            of_phase = [array[:, start : stop + 1] for array in state]
            ends = []
            for axis, own in enumerate(call(model.function("ends", positions), *of_phase)):
                rows = [ca.repmat(reference[axis] + 0 * since, len(capsule_ends), 1) + own]
                for end, velocity in piece_ends:
                    rows.append((end.real, end.imag)[axis] + velocity[axis] * since)
                ends.append(ca.vertcat(*rows))
            yield since, ends[0], ends[1]

    def _measured(self, node_rows: NodeRows, motion: Sequence[Any]) -> tuple[Array, Segments]:
        """Instants (M,) s since takeoff, ``INSTANTS`` in each interval, and where all shapes are then."""
        y, v, a, durations = motion
        times = instants(node_rows.phases, durations.ravel())
        fine = [*values(quintic_spline(times, np.stack((y, v, a))), refined(times, INSTANTS)), durations]
        since: list[Array] = []
        positions: list[ComplexArray] = []
        every = range(len(self._shapes))
        for at, x, z in self._ends(node_rows, lambda function, *state: function(*state), fine, every, INSTANTS):
            first = 1 if since else 0  # the first instant of a phase is the last of the one before
            since.append(np.asarray(at)[0, first:])
            positions.append((np.asarray(x) + 1j * np.asarray(z))[:, first:])
        ends = np.concatenate(positions, axis=1).T
        radii = [getattr(shape, "radius", 0.0) for shape in self._shapes]
        return np.concatenate(since), Segments(ends[:, ::2], ends[:, 1::2], np.array(radii))

    def _distances(self, since: Array, segments: Segments) -> Iterator[tuple[SeparatingLine, Array]]:
        """All candidates, with distances (M,) beyond margins, m; infinite while one of them does not exist."""
        for line in self._candidates:
            own = segments.of(np.array([line.first]))
            other = self._shapes[line.other]
            if isinstance(other, HalfPlane):
                distances = obstacle_distances(own, other, since).min(axis=1)
            else:
                distances = pair_distances(own, segments.of(np.array([line.other])))[:, 0]
            yield line, np.where(_exists(other, since), distances - line.margin, np.inf)

    def check_standing(self, node_rows: NodeRows, motion: Sequence[Any]) -> None:
        """Refuse what is too near where the robot stands, before the flight or after it.

        Raises
        ------
        InputError
            Links are too near to one another, or to an obstacle that always exists.
        """
        if not self._candidates:
            return
        anchor = node_rows.phases[node_rows.flights[0] - 1].anchor
        home = self.robot.frames[anchor.frame]
        spot = anchor.spots[0]
        # Else where it stands depends on how the foot rotates until it takes off.
        stands_on_frame = spot._replace(radius=0.0) == Spot(home.body, home.local)
        rolled = spot.radius * ROLLED  # [m] along the ground, by which a foot may roll until it takes off
        for line, distances in self._distances(*self._measured(node_rows, motion)):
            other = self._shapes[line.other]
            least = distances[0]
            allowed = 0.0
            if isinstance(other, LinkCapsule):
                least = min(least, distances[-1])
            elif other.window or any(other.velocity) or not stands_on_frame:
                continue
            elif not isinstance(other, HalfPlane) or other.normal[0]:
                allowed = -rolled
            if least < allowed:
                reason = f"where the robot stands, {line.name} is missed by {-least:.2g} m"
                raise InputError(reason, element=line.element, advice="change it, its margin or the posture")

    def wider(self, node_rows: NodeRows, motion: Sequence[Any], shortfall: float) -> list[Separation]:
        """Return separations that add what a solution brings too near, one for either way around; else nothing.

        Parameters
        ----------
        node_rows : of the program
        motion : y, v, a (n+1, K+1) and durations (phases, 1) of its solution
        shortfall : of its distances, m
        """
        if not self._candidates:
            return []
        since, segments = self._measured(node_rows, motion)
        nearest: dict[tuple[Any, ...], tuple[float, SeparatingLine]] = {}
        for line, distances in self._distances(since, segments):
            least = float(distances.min())
            if least < nearest.get(line.alike, (TOO_NEAR, line))[0]:
                nearest[line.alike] = least, line
        if not nearest:
            return []
        chosen = {(line.first, line.other): line for line in self.lines}
        for least, line in nearest.values():
            key = line.first, line.other
            reserve = self.reserve
            if key in chosen:
                reserve = chosen[key].reserve + max(self.reserve - least - shortfall, 0.0)
            chosen[key] = replace(line, reserve=reserve)
        lines = list(chosen.values())
        over = self._directed(node_rows, since, segments, lines, swapped=False)
        under = self._directed(node_rows, since, segments, lines, swapped=True)
        same = all(np.array_equal(one.angles, two.angles) for one, two in zip(over, under, strict=True))
        steeper = 10.0  # [-] times the weight, where distances still fell short
        weight = self.weight * (steeper if shortfall > TOLERATED_SHORTFALL else 1.0)
        return [replace(self, lines=directed, weight=weight) for directed in ([over] if same else [over, under])]

    def at(self, node_rows: NodeRows, motion: Sequence[Any]) -> Separation:
        """Return the same lines for another program, where its motion begins."""
        if not self.lines:
            return self
        since, segments = self._measured(node_rows, motion)
        return replace(self, lines=self._directed(node_rows, since, segments, self.lines, swapped=False))

    def _directed(
        self, node_rows: NodeRows, since: Array, segments: Segments, lines: Sequence[SeparatingLine], swapped: bool
    ) -> tuple[SeparatingLine, ...]:
        """Lines with directions that separate as well as they can, or lead around on a side, in each interval."""
        takeoff = node_rows.first_nodes[node_rows.flights[0]]
        landing = node_rows.first_nodes[node_rows.flights[-1] + 1]
        directed = []
        for line in lines:
            other = self._shapes[line.other]
            if isinstance(other, HalfPlane):
                normal = complex(*other.normal)
                directions = np.array([normal / abs(normal)])
            else:
                count = 64
                directions = np.exp(2j * np.pi * np.arange(count) / count)
            own_ends = np.stack((segments.start[:, line.first], segments.end[:, line.first]))
            other_ends = np.stack((segments.start[:, line.other], segments.end[:, line.other]))
            vectors = (own_ends[:, None] - other_ends[None]).reshape(4, len(since), 1)
            gaps = (vectors * directions.conj()).real.min(axis=0) - line.radii - line.margin
            # Of each interval, the least of its instants and of the first of the next one.
            shifted = [gaps[k : k + len(gaps) - INSTANTS : INSTANTS] for k in range(INSTANTS + 1)]
            of_intervals = np.stack(shifted).min(axis=0)
            angles = np.angle(directions[of_intervals.argmax(axis=1)])
            if len(directions) > 1:
                angles = _around(angles, of_intervals.max(axis=1), swapped)
            intervals = np.flatnonzero(_exists(other, since)[:-1].reshape(-1, INSTANTS).any(axis=1))
            reach = np.full(len(angles), line.radii + line.margin + line.reserve)
            for stance, end in ((slice(takeoff), 0), (slice(landing, None), -1)):
                reach[stance] -= line.reserve - np.clip(0.9 * gaps[end].max(), 0.0, line.reserve)
            directed.append(replace(line, intervals=intervals, angles=angles[intervals], reach=reach[intervals]))
        return tuple(directed)

    def add(self, node_rows: NodeRows, rows: Rows, motion: Sequence[Any], own: Any) -> Any:
        """Add rows of the lines at both ends of their intervals; return the cost of the shortfall.

        Parameters
        ----------
        node_rows : of the program
        motion : y, v, a (n+1, K+1) and durations (phases, 1)
        own : (size, 1) the directions, and the shortfall
        """
        if not self.lines:
            return 0.0
        ca = casadi()
        chosen = sorted({line.first for line in self.lines} | {line.other for line in self.lines})
        sizes = [len(line.angles) for line in self.lines]
        *directions, shortfall = ca.vertsplit(own, np.cumsum([0, *sizes, 1]).tolist())

        def ends_of(shape: int) -> range:
            """Rows of a shape's ends; of points one."""
            first = 2 * chosen.index(shape)
            return range(first, first + len(set(_middle_line(self._shapes[shape]))))

        of_phases = self._ends(node_rows, rows.at_nodes, motion, chosen, 1)
        for phase, start, (_, x, z) in zip(node_rows.phases, node_rows.first_nodes, of_phases, strict=False):
            for line, angles in zip(self.lines, directions, strict=True):
                in_phase = np.flatnonzero((line.intervals >= start) & (line.intervals < start + phase.intervals))
                if not len(in_phase):
                    continue
                angle = angles[in_phase.tolist()].T
                reach = ca.DM(line.reach[in_phase]).T
                for side, one, two in itertools.product((0, 1), ends_of(line.first), ends_of(line.other)):
                    at = (line.intervals[in_phase] - start + side).tolist()
                    value = ca.cos(angle) * (x[one, at] - x[two, at]) + ca.sin(angle) * (z[one, at] - z[two, at])
                    rows.add(value - reach + shortfall, 0.0, np.inf, f"{line.name} ({phase.side})")
        return self.weight * shortfall


def _middle_line(shape: LinkCapsule | Obstacle) -> list[complex]:
    """Both ends of the middle line of a capsule, m, or of a piece of an obstacle at takeoff: points have one twice."""
    if isinstance(shape, LinkCapsule):
        return [shape.start, shape.end]
    if isinstance(shape, Bar):
        return [complex(*shape.start), complex(*shape.end)]
    point = shape.center if isinstance(shape, Circle) else shape.point  # type: ignore[attr-defined]
    return [complex(*point)] * 2


def _exists(shape: LinkCapsule | Obstacle, since: Array) -> BoolArray:
    """When (M,) a shape exists, since takeoff, s."""
    low, high = (shape.window if isinstance(shape, Obstacle) else None) or (-np.inf, np.inf)
    return np.asarray((since >= low) & (since <= high))


def _around(angles: Array, gaps: Array, swapped: bool) -> Array:
    """Angles (K,) rad that lead around on one side where gaps (K,) are negative: the other one where ``swapped``."""
    led = angles.copy()
    edges = np.flatnonzero(np.diff(np.concatenate(([0], gaps < 0, [0]))))
    for begin, end in edges.reshape(-1, 2).tolist():
        if begin == 0 or end == len(angles):  # no way around: the direction before or after
            if begin:
                led[begin:end] = angles[begin - 1]
            elif end < len(angles):
                led[begin:end] = angles[end]
            continue
        deepest = begin + int(gaps[begin:end].argmin())
        routes = []
        lengths = []
        for middle in (angles[deepest], angles[deepest] + np.pi):
            over = angles[begin - 1] + math.remainder(middle - angles[begin - 1], 2 * np.pi)
            route = (angles[begin - 1], over, over + math.remainder(angles[end] - over, 2 * np.pi))
            routes.append(route)
            lengths.append(float(np.abs(np.diff(route)).sum()))
        detour = 2.0  # [-] times longer has to be the way on the side where the shape is, for the other to come first
        other_side = (lengths[0] > detour * lengths[1]) != swapped
        led[begin:end] = np.interp(np.arange(begin, end), [begin - 1, deepest, end], routes[other_side])
    return led


def add_distance(rows: Rows, node_rows: NodeRows, index: int, motion: Sequence[Any], along: Any, beyond: float) -> None:
    """Add a row: what lands is beyond an edge of the ground.

    Parameters
    ----------
    index : of the flight among the phases
    motion : y, v, a (n+1, nodes) of the flight
    along : how far it goes, m
    beyond : least horizontal position of the foot that lands from the one that takes off, m; its sign is the direction
    """
    model = node_rows.model
    # Where circles are, not where they would be without their rotation.
    before, after = (node_rows.phases[index + side].anchor.spots[0]._replace(radius=0.0) for side in (-1, 1))
    (x0,) = rows.at_nodes(model.function("before", [model.com_from(before)[0]]), *(m[:, 0] for m in motion))
    (x1,) = rows.at_nodes(model.function("after", [model.com_from(after)[0]]), *(m[:, -1] for m in motion))
    value = np.sign(beyond) * (x0 + along - x1 - beyond)
    rows.add(value / node_rows.height, 0.0, np.inf, "landing beyond the edge")
