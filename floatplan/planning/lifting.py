"""Flights in space by lifting: the attitudes at the borders of cells are unknowns too (multiple shooting).

From a path of attitudes that the physics of twisting suggests, a damped Gauss-Newton method closes the gaps between the
cells: each step is the shortest change of the motion that closes them to first order. A second stage descends the size
of the motion's free part along motions without gaps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct, doubles
from floatplan.motion.sine_polynomial import basis
from floatplan.motion.spatial.attitude import (
    LEVELS,
    OUT_OF_MEMORY,
    Cells,
    IntegrationError,
    Turning,
    attitudes_at,
    cells,
    turn,
)
from floatplan.motion.spatial.attitude import wrong_way as wrong_turns
from floatplan.motion.spatial.flight import SpatialFlight
from floatplan.motion.spatial.rotations import exponential, logarithm, of_angles
from floatplan.planning.kernel_input.space import cells_and_stages, spatial_body
from floatplan.planning.kernel_problem import motions_struct
from floatplan.planning.result import AttemptResult, Work
from floatplan.planning.spec import FlightSpec
from floatplan.planning.variables import DecisionVariables

CELLS, STAGES = 16, 5  # of the grid that is searched on
FINE_STAGES, FINER = 8, (16, 32, 64)  # [-] of the cells that a plan is closed in
EXACT = 1e-10  # [rad] by which twice as many cells may change the attitude at landing
ROUNDING = 1e-12  # [-]
CLOSED = 1e-7  # [rad] gaps below which a motion is closed
CLOSED_FINELY = 1e-11  # [rad] the same of a plan
STEPS = 30  # [-] most of them
LONGEST_STEP = 0.7  # [rad] of p, root mean square over all joints together
LARGEST_TURN = 0.6  # [rad] of a border
SHORTEST = 1e-3  # [-] of a step, below which it is given up
SHORTER = 0.4  # [-] a step that does not serve
GAIN = 0.25  # [-] of what a whole step would gain that is asked for
TURNS_WEIGH = 0.09  # [-] mean square turn of the borders beside the square change of the motion
DESCENDED = 1e-3  # [-] of the motion: a projected gradient below it is none
LEAST = 1e-2  # [-] the same, of a motion that is called optimal
DESCENTS = 40  # [-] most steps of the descent
TRUST = 0.5  # [rad] of p, root mean square over all joints together: the first step of the descent
CORRECTIONS = 5  # [-] most steps that close the gaps again after one of the descent
LEAST_GAIN = 1e-3  # [-] of the size of the motion
STEEPEST_START = 0.9  # [-] sine of the tilt of a path
A_SOMERSAULT = np.pi / 2  # [rad] about the first axis: a twist beside less is made without tilt
FINENESS = 401  # [-] instants by which a bump is integrated


@dataclass(frozen=True, eq=False)
class LiftedFlight:
    """What is asked: the joints' motions of a class, in a flight, with the choice of h; and the work done with them."""

    spec: FlightSpec
    variables: DecisionVariables
    work: Work = field(default_factory=Work)
    flight: SpatialFlight = field(init=False)
    _body: Struct = field(init=False)
    _motions: Struct = field(init=False)

    def __post_init__(self) -> None:
        """Fill the structs that all motions share."""
        flight = self.spec.flight
        assert isinstance(flight, SpatialFlight), "the robot flies in space"
        vars(self).update(
            flight=flight,
            _body=spatial_body(flight, self.variables.momentum, needs_rates=True),
            _motions=motions_struct(self.spec.problem, self.variables, of_coefficients=False),
        )

    def fly(self, cells: Cells, x: Array, borders: Array) -> LiftedMotion:
        """Fly the motion x in all cells, each from its border (C, 3, 3); errors as of :func:`turn`."""
        self.work.evaluated(len(cells.s) * self.flight.bodies, entries=3 * cells.count * len(x))
        count, size = cells.count, len(x)
        ends = np.empty((count, 3, 3))
        gaps = np.empty((count, 3))
        carried = np.empty((count, 3, count, 3))
        turns = np.empty((count, 3, size))
        spun = np.empty((2, count, cells.stages, 4))
        lifted = Struct(
            "Lifted",
            x=doubles(x),
            borders=doubles(borders),
            ends=ends,
            gaps=gaps,
            spun=spun,
            carried=carried,
            turns=turns,
        )
        grid, nodes = cells_and_stages(cells, self.variables.polynomials.form)
        compiled = kernel()
        failed = compiled.lift(
            self._body.pointer,
            grid.pointer,
            self._motions.pointer,
            nodes.pointer,
            lifted.pointer,
            compiled.instructions,
        )
        if failed == OUT_OF_MEMORY:
            raise MemoryError
        if failed:
            raise IntegrationError
        return LiftedMotion(
            lifted=self,
            cells=cells,
            x=x,
            borders=borders,
            ends=ends,
            gaps=gaps,
            carried=carried,
            turns=turns,
            spun=spun,
            makes_right_turns=bool(lifted.pointer.is_right_way),
        )

    def flown(self, cells: Cells, x: Array) -> Turning:
        """How the base turns in the motion x, in cells without gaps; errors as of :func:`turn`."""
        self.work.evaluated(len(cells.s) * self.flight.bodies)
        flight, h = self.flight, self.variables.angular_momentum(x)
        polynomials = self.variables.polynomials
        motion = polynomials.motion(self.variables.free_coefficients(x), basis(polynomials.form).values(cells.s))
        inertia, joint_map = flight.dynamics.momentum_maps(motion.positions)
        relative = np.einsum("kan,kn->ka", joint_map, motion.velocities)
        return turn(cells, flight.duration, inertia, relative, h, flight.initial_attitude)


@dataclass(frozen=True, eq=False)
class LiftedMotion:
    """A motion in C cells that begin at ``borders`` (C, 3, 3).

    Attributes
    ----------
    ends : (C, 3, 3)
        Attitudes at the cells' ends.
    gaps : (C, 3) rad
        From there to the next borders, at last to the goal.
    carried : (C, 3, C, 3)
        Small turns of the ends that small turns at the cells' ends make.
    turns : (C, 3, size)
        Small turns of the ends by x, where no gap changes.
    spun : (2, C, S, 4), see :class:`~floatplan.motion.spatial.attitude.Turning`
    makes_right_turns : whether turns and tilt are those that are asked for
    """

    lifted: LiftedFlight
    cells: Cells
    x: Array
    borders: Array
    ends: Array
    gaps: Array
    carried: Array
    turns: Array
    spun: Array
    makes_right_turns: bool

    @property
    def size(self) -> float:
        """Root mean square of p's free part, over time, joints together, rad."""
        return float(np.linalg.norm(self.x[: self.lifted.variables.coefficients]))

    def is_closed(self, gap: float = CLOSED) -> bool:
        """Whether no gap is larger than so much, rad."""
        return float(np.einsum("ca,ca->c", self.gaps, self.gaps).max()) < gap * gap

    def at(self, instants: Array) -> Array:
        """Attitudes (K, 3, 3) at instants (K,) of [0, 1], each from the border before it."""
        spun = self.spun if self.lifted.variables.angular_momentum(self.x).any() else self.spun[1:]
        return attitudes_at(self.cells, self.lifted.flight.duration, self.borders, spun, instants)

    def step(self, gaps: Array, along: Array | float = 0.0) -> tuple[Array, Array]:
        """Shortest change of x (size,), from ``along``, with which the borders' turns (C, 3) close gaps (C, 3).

        Numbers of h that would leave [-1, 1] go to its edge.
        """
        count = len(gaps)
        closing = -(self.carried.reshape(3 * count, 3 * count) @ gaps.ravel()).reshape(count, 3)
        jacobian = self.turns[-1]
        along = np.full_like(self.x, along) if isinstance(along, float) else along.copy()
        movable, free = np.ones(len(self.x), bool), self.lifted.variables.coefficients
        for _ in range(self.lifted.variables.momentum.axes.shape[1] + 1):
            columns, change = jacobian[:, movable], along.copy()
            missing = closing[-1] + jacobian @ along
            change[movable] -= columns.T @ np.linalg.lstsq(columns @ columns.T, missing, rcond=ROUNDING)[0]
            beyond = movable & (np.abs(self.x + change) > 1 + ROUNDING)
            beyond[:free] = False
            if not beyond.any():
                break
            along[beyond] = np.sign(self.x + change)[beyond] - self.x[beyond]
            movable &= ~beyond
        turns = np.zeros_like(closing)  # none at takeoff
        turns[1:] = closing[:-1] + self.turns[:-1] @ change
        return change, turns

    def moved(self, change: Array, turns: Array) -> LiftedMotion:
        """Fly the motion that is changed by so much."""
        return self.lifted.fly(self.cells, self.x + change, np.asarray(exponential(turns) @ self.borders))


def close(motion: LiftedMotion, gap: float = CLOSED, most_steps: int = STEPS) -> LiftedMotion:
    """Close the gaps of a motion; return where that ends, closed or not."""
    length = 1.0
    for _ in range(most_steps):
        if motion.is_closed(gap):
            break
        change, turns = motion.step(motion.gaps)
        before = _size(change, turns)
        farthest = max(float(np.linalg.norm(turns, axis=1).max()), ROUNDING)
        length = min(
            1.0, 2 * length, LONGEST_STEP / max(float(np.linalg.norm(change)), ROUNDING), LARGEST_TURN / farthest
        )
        other = None
        while length >= SHORTEST:
            try:
                other = motion.moved(length * change, length * turns)
            except IntegrationError:
                other = None
            if other is not None and _size(*motion.step(other.gaps)) <= (1 - GAIN * length) ** 2 * before:
                break
            other, length = None, SHORTER * length
        if other is None:
            break
        motion = other
    return motion


def _size(change: Array, turns: Array) -> float:
    return float(change @ change + TURNS_WEIGH * (turns * turns).sum() / len(turns))


def descend(motion: LiftedMotion) -> LiftedMotion:
    """Make a closed motion's free part smaller, along closed motions with the same turns."""
    radius = TRUST
    free = motion.lifted.variables.coefficients
    for _ in range(DESCENTS):
        downhill = np.zeros_like(motion.x)
        downhill[:free] = -motion.x[:free]
        change, turns = motion.step(np.zeros_like(motion.gaps), downhill)
        length = float(np.linalg.norm(change))
        if length <= DESCENDED * motion.size:
            break
        farthest = max(float(np.linalg.norm(turns, axis=1).max()), ROUNDING)
        share = min(1.0, radius / length, LARGEST_TURN / farthest)
        try:
            other = close(motion.moved(*motion.step(motion.gaps, share * downhill)), most_steps=CORRECTIONS)
        except IntegrationError:
            other = motion
        if other.is_closed() and other.size < motion.size * (1 - LEAST_GAIN) and other.makes_right_turns:
            motion, radius = other, 2 * min(radius, share * length)
        else:
            radius = SHORTER * min(radius, share * length)
            if radius < SHORTEST:
                break
    return motion


def is_least(motion: LiftedMotion) -> bool:
    """Whether no closed motion beside a closed one has a smaller free part, to first order."""
    free = motion.lifted.variables.coefficients
    downhill = np.zeros_like(motion.x)
    downhill[:free] = -motion.x[:free]
    change, _ = motion.step(np.zeros_like(motion.gaps), downhill)
    return float(np.linalg.norm(change)) <= LEAST * max(motion.size, ROUNDING)


def refined(motion: LiftedMotion) -> LiftedMotion | None:
    """Close a motion in as many cells as its attitude at landing needs; None where none are enough."""
    for count in FINER:
        fine = cells(count, FINE_STAGES)
        borders = motion.at(np.arange(count) / count)
        try:
            motion = close(motion.lifted.fly(fine, motion.x, borders), CLOSED_FINELY)
            if not motion.is_closed(CLOSED_FINELY):
                return None
            finer = motion.lifted.flown(cells(2 * count, FINE_STAGES), motion.x).ends[-1]
        except IntegrationError:
            return None
        if np.linalg.norm(logarithm((finer @ motion.ends[-1].T)[None])) < EXACT:
            return motion
    return None


@dataclass(frozen=True)
class Bump:
    """When a path tilts: from ``begin`` to ``end``, shares of the flight, over ramps of a share of that."""

    begin: float = 0.05
    end: float = 0.95
    ramp: float = 0.4

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Bump:
        """Draw one."""
        return cls(rng.uniform(0, 0.35), rng.uniform(0.65, 1), rng.uniform(0.2, 0.5))

    def at(self, s: Array) -> Array:
        """Its height (K,), from 0 to 1."""
        ramp = self.ramp * (self.end - self.begin)
        return _smoothstep((s - self.begin) / ramp) * _smoothstep((self.end - s) / ramp)


def _smoothstep(x: Array) -> Array:
    x = np.clip(x, 0, 1)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x * x))


def path(lifted: LiftedFlight, x: Array, s: Array, bump: Bump) -> Array:
    """Attitudes (K, 3, 3) at instants (K,) of [0, 1] of a path to the goal.

    A goal that is a rotation is reached by the shortest one, from rest to rest, where there is no h; else from the way
    that the motion x turns the base, whose error at landing is taken away evenly. For angles the body of the start
    posture is taken for a symmetric top: with the momentum h along the first axis, a tilt by beta makes it twist at
    ``h sin(beta) (1/I_3 - 1/I_t)``, so that a bump of tilt makes the twist that is asked.
    """
    flight, angular_momentum = lifted.flight, lifted.variables.angular_momentum(x)
    steady = s if angular_momentum.any() else _smoothstep(s)
    axes = flight.reorientation.goal.axes
    if axes is None:
        before, last = flight.initial_attitude[None], flight.initial_attitude
        if angular_momentum.any():
            flown = lifted.flown(cells(CELLS, STAGES), x)
            before, last = flown.at(s), flown.ends[-1]
        missed = logarithm((flight.final_attitude @ last.T)[None])
        return np.asarray(exponential(steady[:, None] * missed) @ before)
    first, second, third = np.eye(3)[["xyz".index(letter) for letter in axes]]
    polynomials = lifted.variables.polynomials
    start = polynomials.motion(polynomials.no_free_part, basis(polynomials.form).values(np.zeros(1)))
    inertia = flight.dynamics.momentum_maps(start.positions)[0][0]
    across, along = (first @ inertia @ first + second @ inertia @ second) / 2, third @ inertia @ third
    fine = np.linspace(0, 1, FINENESS)
    height = bump.at(fine)
    area = np.concatenate(([0.0], np.cumsum(height[1:] + height[:-1]) / 2 / (FINENESS - 1)))
    twisting = float(angular_momentum @ first) * flight.duration * (1 / along - 1 / across) * area[-1]
    handed = float(first @ np.cross(second, third))
    change = flight.reorientation.change
    tilts = twisting and abs(change[0]) > A_SOMERSAULT
    sine = np.clip(handed * change[2] / twisting, -STEEPEST_START, STEEPEST_START) if tilts else 0.0
    angles = np.empty((len(s), 3))
    angles[:, 0] = change[0] * steady
    angles[:, 1] = change[1] * steady + np.arcsin(sine * np.interp(s, fine, height))
    angles[:, 2] = change[2] * (np.interp(s, fine, area / area[-1]) if sine else steady)
    return of_angles(axes, angles + flight.reorientation.start_angles)


def nearby(lifted: LiftedFlight, x: Array) -> LiftedMotion:
    """Lift the motion x, whose error at landing is taken away evenly; errors as of :func:`turn`."""
    grid, s = cells(CELLS, STAGES), np.arange(CELLS) / CELLS
    flown = lifted.flown(grid, x)
    missed = logarithm((lifted.flight.final_attitude @ flown.ends[-1].T)[None])
    return lifted.fly(grid, x, np.asarray(exponential(s[:, None] * missed) @ flown.borders))


def starts(lifted: LiftedFlight, seed: int) -> Iterator[LiftedMotion | None]:
    """Yield motions to close: the one with no free part, then random ones without end.

    None for one that cannot be integrated; where nothing is free, there is but one.
    """
    rng, grid, momentum = np.random.default_rng(seed), cells(CELLS, STAGES), lifted.variables.momentum
    polynomials = lifted.variables.polynomials
    joints, width = len(polynomials.free), polynomials.width
    borders = np.arange(CELLS) / CELLS
    bump, z, y = Bump(), np.zeros((joints, width)), np.zeros(momentum.axes.shape[1])
    while True:
        x = np.concatenate((z.ravel()[polynomials.free_indices], y))
        try:
            yield lifted.fly(grid, x, path(lifted, x, borders, bump))
        except IntegrationError:
            yield None
        if not x.size:
            return
        bump, z = Bump.drawn(rng), 0.4 * rng.uniform(0.2, 1.5) * rng.normal(size=(joints, width))
        z[:, 2:] *= 0.15
        y = rng.uniform(-0.5, 0.5, size=(momentum.axes.shape[1],))


def wrong_way(result: AttemptResult) -> str:
    """What is wrong with the way to the goal, its turns or its tilt; empty for nothing."""
    lifted = LiftedFlight(result.spec, result.variables)
    way = lifted.flown(cells(*LEVELS[result.level]), result.x).way
    return wrong_turns(lifted.flight.reorientation, way)
