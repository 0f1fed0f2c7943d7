"""Flights in space by lifting: the attitudes at the borders of cells are unknowns too (multiple shooting).

From a path of attitudes that the physics of twisting suggests, a damped Gauss-Newton method closes the gaps between the
cells: each step is the shortest change of the motion that closes them to first order. A second stage descends the size
of the motion's free coefficients along motions without gaps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct, doubles
from floatplan.motion.dynamics import MomentumSet
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


@dataclass(frozen=True)
class LiftingSettings:
    """Numbers of lifting, in the order of its steps."""

    cells: int = 16  # [-] of the grid of a search
    stages: int = 5  # [-] of one of them
    fine_stages: int = 8  # [-] of the cells that a plan is closed in
    fine_cells: tuple[int, ...] = (16, 32, 64)  # [-] how many of these
    exact: float = 1e-10  # [rad] by which twice as many cells may change the attitude at landing
    rounding: float = 1e-12  # [-]
    steepest_start: float = 0.9  # [-] sine of the tilt of a path
    somersault: float = np.pi / 2  # [rad] about the first axis: with less a twist is made without tilt
    bump_instants: int = 401  # [-] by which a bump is integrated
    # Closing the gaps.
    closed: float = 1e-7  # [rad] gaps below which a motion is closed
    closed_finely: float = 1e-11  # [rad] the same of a plan
    closing_steps: int = 30  # [-] at most
    longest_step: float = 0.7  # [rad] of p, root mean square over all joints
    largest_rotation: float = 0.6  # [rad] of a border, in a step
    shortest_step: float = 1e-3  # [-] below which closing is given up
    shorter: float = 0.4  # [-] share of a step that does not serve, which is tried next
    required_gain: float = 0.25  # [-] of what a whole step promises
    rotation_weight: float = 0.09  # [-] of the borders' mean square rotation, against the square change of the motion
    # Descending to a smaller motion.
    descent_steps: int = 40  # [-] at most
    first_radius: float = 0.5  # [rad] of p, root mean square over all joints
    closing_steps_again: int = 5  # [-] at most, after a step of the descent
    least_gain: float = 1e-3  # [-] of the size of the motion
    no_gradient: float = 1e-3  # [-] of the size of the motion: a smaller projected gradient ends the descent
    steep: float = 0.09  # [-] the same, above which small gains do not end the descent: of levelling mostly
    optimal_gradient: float = 1e-2  # [-] the same, of a motion that is called optimal
    recorded: float = 1e-3  # [rad] root mean square from a recorded motion: shares of less are no difference


LIFTING = LiftingSettings()
# Of a descent through a curved valley: a Go2 that levels out has a size of 1.44 rad where a step first gains less than
# a thousandth, and of 1.13 at the bottom.
IN_A_VALLEY = replace(LIFTING, descent_steps=200, least_gain=1e-4)
# Of a descent to what may be called optimal: it ends where hardly anything is left to gain.
TO_A_MINIMUM = replace(LIFTING, descent_steps=200, least_gain=1e-5, no_gradient=1e-5, shortest_step=1e-4)


@dataclass(frozen=True, eq=False)
class LiftedFlight:
    """The joints' motions of a class, in a flight, with the choice of h; and the work done with them."""

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

    @cached_property
    def of_any_momentum(self) -> LiftedFlight:
        """The same joints' motions, whose further variables are the three components of h, kg m^2/s."""
        momentum = MomentumSet(np.zeros(3), np.eye(3))
        return LiftedFlight(self.spec, replace(self.variables, momentum=momentum), self.work)

    def fly(self, cells: Cells, x: Array, borders: Array) -> LiftedMotion:
        """Fly the motion x in all cells, from their borders (C, 3, 3); errors as of :func:`turn`."""
        self.work.evaluated(len(cells.s) * self.flight.bodies, entries=3 * cells.count * len(x))
        count = cells.count
        size = len(x)
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

    def turning(self, cells: Cells, x: Array) -> Turning:
        """How the base turns in the motion x, in cells without gaps; errors as of :func:`turn`."""
        self.work.evaluated(len(cells.s) * self.flight.bodies)
        flight = self.flight
        h = self.variables.angular_momentum(x)
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
    makes_right_turns : whether turns and tilt are as requested
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
        """Root mean square of p's free polynomials over time and all joints, rad."""
        return float(np.linalg.norm(self.x[: self.lifted.variables.coefficients]))

    def is_closed(self, gap: float = LIFTING.closed) -> bool:
        """Whether no gap is larger than so much, rad."""
        return float(np.einsum("ca,ca->c", self.gaps, self.gaps).max()) < gap * gap

    def at(self, instants: Array) -> Array:
        """Attitudes (K, 3, 3) at instants (K,) of [0, 1], from the borders before them."""
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
        movable = np.ones(len(self.x), bool)
        free = self.lifted.variables.coefficients
        for _ in range(self.lifted.variables.momentum.axes.shape[1] + 1):
            columns = jacobian[:, movable]
            change = along.copy()
            missing = closing[-1] + jacobian @ along
            change[movable] -= columns.T @ np.linalg.lstsq(columns @ columns.T, missing, rcond=LIFTING.rounding)[0]
            beyond = movable & (np.abs(self.x + change) > 1 + LIFTING.rounding)
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


def close(motion: LiftedMotion, gap: float = LIFTING.closed, most_steps: int = LIFTING.closing_steps) -> LiftedMotion:
    """Close the gaps of a motion; return where that ends, closed or not."""
    length = 1.0
    for _ in range(most_steps):
        if motion.is_closed(gap):
            break
        change, turns = motion.step(motion.gaps)
        before = _size(change, turns)
        farthest = max(float(np.linalg.norm(turns, axis=1).max()), LIFTING.rounding)
        length = min(
            1.0,
            2 * length,
            LIFTING.longest_step / max(float(np.linalg.norm(change)), LIFTING.rounding),
            LIFTING.largest_rotation / farthest,
        )
        other = None
        while length >= LIFTING.shortest_step:
            try:
                other = motion.moved(length * change, length * turns)
            except IntegrationError:
                other = None
            if (
                other is not None
                and _size(*motion.step(other.gaps)) <= (1 - LIFTING.required_gain * length) ** 2 * before
            ):
                break
            other = None
            length = LIFTING.shorter * length
        if other is None:
            break
        motion = other
    return motion


def _size(change: Array, turns: Array) -> float:
    return float(change @ change + LIFTING.rotation_weight * (turns * turns).sum() / len(turns))


class Cost(Protocol):
    """What is least of closed motions, at one of them."""

    @property
    def value(self) -> float:
        """The cost, rad."""

    def downhill(self, radius: float) -> Array:
        """Change of x (size,) that promises most, where no step is longer than a radius."""


@dataclass(frozen=True, eq=False)
class SizeCost:
    """The size of the free coefficients of a motion."""

    motion: LiftedMotion

    @property
    def value(self) -> float:
        """The size, rad."""
        return self.motion.size

    def downhill(self, radius: float) -> Array:
        """Towards no free coefficients, in whatever radius."""
        free = self.motion.lifted.variables.coefficients
        downhill = np.zeros_like(self.motion.x)
        downhill[:free] = -self.motion.x[:free]
        return downhill


def descend(
    motion: LiftedMotion, cost_of: Callable[[LiftedMotion], Cost] = SizeCost, rules: LiftingSettings = LIFTING
) -> LiftedMotion:
    """Make the cost of a closed motion smaller, along closed motions with the same turns; ``rules`` say how far."""
    radius = rules.first_radius
    cost = cost_of(motion)
    least = LIFTING.recorded if motion.lifted.variables.has_reference else 0.0
    for _ in range(rules.descent_steps):
        downhill = cost.downhill(radius)
        change, turns = motion.step(np.zeros_like(motion.gaps), downhill)
        length = float(np.linalg.norm(change))
        if length <= rules.no_gradient * max(motion.size, least):
            break
        farthest = max(float(np.linalg.norm(turns, axis=1).max()), LIFTING.rounding)
        share = min(1.0, radius / length, LIFTING.largest_rotation / farthest)
        try:
            other = close(
                motion.moved(*motion.step(motion.gaps, share * downhill)), most_steps=LIFTING.closing_steps_again
            )
            other_cost = cost_of(other)
        except IntegrationError:
            other = motion
            other_cost = cost
        is_less = other_cost.value < cost.value * (1 - rules.least_gain)
        if other.is_closed() and is_less and other.makes_right_turns:
            motion = other
            cost = other_cost
            radius = 2 * min(radius, share * length)
        else:
            radius = LIFTING.shorter * min(radius, share * length)
            if radius < rules.shortest_step:
                break
    return motion


def steepness(motion: LiftedMotion) -> float:
    """The shortest way to smaller free coefficients of closed motions, to first order, relative to their size."""
    least = LIFTING.recorded if motion.lifted.variables.has_reference else LIFTING.rounding
    change, _ = motion.step(np.zeros_like(motion.gaps), SizeCost(motion).downhill(np.inf))
    return float(np.linalg.norm(change)) / max(motion.size, least)


def is_least(motion: LiftedMotion) -> bool:
    """Whether no closed motion near a closed one has smaller free coefficients, to first order."""
    return steepness(motion) <= LIFTING.optimal_gradient


def refined(motion: LiftedMotion) -> LiftedMotion | None:
    """Close a motion in as many cells as its attitude at landing needs; None where none are enough."""
    for count in LIFTING.fine_cells:
        fine = cells(count, LIFTING.fine_stages)
        borders = motion.at(np.arange(count) / count)
        try:
            motion = close(motion.lifted.fly(fine, motion.x, borders), LIFTING.closed_finely)
            if not motion.is_closed(LIFTING.closed_finely):
                return None
            finer = motion.lifted.turning(cells(2 * count, LIFTING.fine_stages), motion.x).ends[-1]
        except IntegrationError:
            return None
        if np.linalg.norm(logarithm((finer @ motion.ends[-1].T)[None])) < LIFTING.exact:
            return motion
    return None


@dataclass(frozen=True)
class Bump:
    """When a path tilts: from ``begin`` to ``end``, shares of the flight, over ramps of a share of that."""

    begin: float = 0.05
    end: float = 0.95
    ramp: float = 0.4

    @classmethod
    def sampled(cls, rng: np.random.Generator) -> Bump:
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
    ``h sin(beta) (1/I_3 - 1/I_t)``, so that a bump of tilt makes the requested twist.
    """
    flight = lifted.flight
    angular_momentum = lifted.variables.angular_momentum(x)
    steady = s if angular_momentum.any() else _smoothstep(s)
    axes = flight.reorientation.goal.axes
    if axes is None:
        before = flight.initial_attitude[None]
        last = flight.initial_attitude
        if angular_momentum.any():
            turning = lifted.turning(cells(LIFTING.cells, LIFTING.stages), x)
            before = turning.at(s)
            last = turning.ends[-1]
        residual = logarithm((flight.final_attitude @ last.T)[None])
        return np.asarray(exponential(steady[:, None] * residual) @ before)
    first, second, third = np.eye(3)[list(map("xyz".index, axes))]
    polynomials = lifted.variables.polynomials
    start = polynomials.motion(polynomials.nominal_coefficients, basis(polynomials.form).values(np.zeros(1)))
    inertia = flight.dynamics.momentum_maps(start.positions)[0][0]
    across = (first @ inertia @ first + second @ inertia @ second) / 2
    along = third @ inertia @ third
    fine = np.linspace(0, 1, LIFTING.bump_instants)
    height = bump.at(fine)
    area = np.concatenate(([0.0], np.cumsum(height[1:] + height[:-1]) / 2 / (LIFTING.bump_instants - 1)))
    twisting = float(angular_momentum @ first) * flight.duration * (1 / along - 1 / across) * area[-1]
    handed = float(first @ np.cross(second, third))
    change = flight.reorientation.change
    tilts = twisting and abs(change[0]) > LIFTING.somersault
    sine = np.clip(handed * change[2] / twisting, -LIFTING.steepest_start, LIFTING.steepest_start) if tilts else 0.0
    angles = np.empty((len(s), 3))
    angles[:, 0] = change[0] * steady
    angles[:, 1] = change[1] * steady + np.arcsin(sine * np.interp(s, fine, height))
    angles[:, 2] = change[2] * (np.interp(s, fine, area / area[-1]) if sine else steady)
    return of_angles(axes, angles + flight.reorientation.start_angles)


def nearby(lifted: LiftedFlight, x: Array) -> LiftedMotion:
    """Lift the motion x, whose error at landing is taken away evenly; errors as of :func:`turn`."""
    grid = cells(LIFTING.cells, LIFTING.stages)
    s = np.arange(LIFTING.cells) / LIFTING.cells
    turning = lifted.turning(grid, x)
    residual = logarithm((lifted.flight.final_attitude @ turning.ends[-1].T)[None])
    return lifted.fly(grid, x, np.asarray(exponential(s[:, None] * residual) @ turning.borders))


def starts(lifted: LiftedFlight, seed: int) -> Iterator[LiftedMotion | None]:
    """Yield motions to close: the one without free coefficients, then random ones without end.

    None for one that cannot be integrated; where nothing is free, there is but one.
    """
    rng = np.random.default_rng(seed)
    grid = cells(LIFTING.cells, LIFTING.stages)
    borders = np.arange(LIFTING.cells) / LIFTING.cells
    polynomials = lifted.variables.polynomials
    joints = len(polynomials.free)
    width = polynomials.width
    axes = int(lifted.variables.momentum.axes.shape[1])
    bump = Bump()
    z = np.zeros((joints, width))
    y = np.zeros(axes)
    while True:
        x = np.concatenate((z.ravel()[polynomials.free_indices], y))
        try:
            yield lifted.fly(grid, x, path(lifted, x, borders, bump))
        except IntegrationError:
            yield None
        if not x.size:
            return
        bump = Bump.sampled(rng)
        z = 0.4 * rng.uniform(0.2, 1.5) * rng.normal(size=(joints, width))
        z[:, 2:] *= 0.15
        y = rng.uniform(-0.5, 0.5, axes)


def wrong_way(result: AttemptResult) -> str:
    """What is wrong with the way to the goal, its turns or its tilt; empty for nothing."""
    lifted = LiftedFlight(result.spec, result.variables)
    way = lifted.turning(cells(*LEVELS[result.level]), result.x).way
    return wrong_turns(lifted.flight.reorientation, way)
