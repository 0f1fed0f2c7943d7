"""What a process of the studio is asked, and what it answers: plans with what is shown of them, points of the map."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec

import numpy as np

import floatplan as fp
from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.errors import printable
from floatplan.jumps.jump import Jump
from floatplan.jumps.launch import launches
from floatplan.planning.kernel_input.numbers import is_plain_family
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.plans.measures import PlanWarning, Utilisation, largest_use
from floatplan.plans.presentation import Row
from floatplan.plans.trajectory import Trajectory
from floatplan.studio.curves import Shares, shares
from floatplan.view.outlines import Poses, body_poses, coordinates, postures

POSE_RATE = 60.0  # [Hz]
MOST_POSES = 1200  # [-] of a long flight
TRAIL = 161  # [-] points of a path
NEAR_BUDGET = 0.3  # [s] of search for the flight that is shown where no jump was found
DURATION = "flight.duration"
MOMENTUM = "flight.angular_momentum"
COLUMNS = 9  # [-] values of h, values of T
ROWS = 7
DURATION_STEP = 0.07  # [-] of the duration
MOMENTUM_STEP = 0.12  # [-] of the angular momentum, or of half the interval (9); the larger one counts
TOGETHER = 3  # [-] points that are asked for at a time
POINT_BUDGET = 0.4  # [s] of search at a point


@dataclass(frozen=True)
class Failure:
    """Why there is no answer, for a person."""

    words: str

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """Return what went wrong: floatplan's own errors say it themselves."""
        if isinstance(error, fp.FloatplanError):
            return cls(str(error))
        if isinstance(error, MemoryError):
            return cls("there is not enough memory for this")
        return cls(printable(f"{type(error).__name__}: {error}"))


@dataclass(frozen=True, eq=False)
class ShownPlan:
    """A plan, or a jump, with what the page shows of it, measured where it was planned.

    Attributes
    ----------
    plan : Plan
        With its certificate, where it was proved; where none was found, the nearest motion. Of a jump its flight.
    settled : bool
        Whether ``floatplan plan`` or ``floatplan jump`` would answer so; else a quick search did.
    poses : Poses
    paths : (N,) complex, m; of the centre of mass, and of the frames that take off and land
    utilisation, warnings : of the plan
    clearance : m, or None without obstacles
    shares : of limits, over time
    jump : Jump or None
        What was found, where a jump was asked for; where that is none, the plan is that of the flight alone.
    stances : what was found of stances before takeoff and after landing
    """

    plan: fp.Plan
    settled: bool
    poses: Poses
    paths: tuple[ComplexArray, ComplexArray, ComplexArray]
    utilisation: tuple[Utilisation, ...]
    warnings: tuple[PlanWarning, ...]
    clearance: float | None
    shares: tuple[Shares, ...]
    jump: Jump | None = None
    stances: tuple[Row, ...] = ()

    @classmethod
    def of(cls, plan: fp.Plan, settled: bool, jump: Jump | None = None) -> ShownPlan:
        """Measure a plan, or the jump around it."""
        motion: Trajectory = plan if jump is None or jump.flight is None else jump
        times = pose_times(motion.duration)
        placed = postures(motion, np.linspace(0.0, motion.duration, TRAIL))
        return cls(
            plan=replace(plan, as_recorded=None if plan.certificate is None else plan.record),  # without what it caches
            settled=settled,
            poses=body_poses(plan.robot, *coordinates(motion, times)),
            paths=(placed.com, placed.takeoff, placed.landing),
            utilisation=plan.utilisation,
            warnings=plan.warnings,
            clearance=plan.peaks.clearance,
            shares=shares(motion),
            jump=jump,
        )

    @property
    def found_jump(self) -> Jump | None:
        """The jump; None where none was found."""
        return None if self.jump is None or self.jump.flight is None else self.jump

    @property
    def motion(self) -> Trajectory:
        """What moves: the jump, or the plan."""
        return self.found_jump or self.plan

    @property
    def largest_use(self) -> float | None:
        """Largest share of a limit that a motor uses; None without limits."""
        if self.found_jump is None:
            return largest_use(self.utilisation)
        return max((each.peak for each in self.shares if each.limited), default=None)


@dataclass(frozen=True, eq=False)
class PlanTask:
    """Plan a problem: as ``floatplan plan`` does, with its proof, or within a ``budget``, s, the best motion so far.

    A search with a budget begins from the plan ``near`` it, where there is one, and is for the flight alone. Without, a
    problem with a jump is answered as ``floatplan jump`` does, but that the search begins from the jump that is near.
    """

    problem: fp.Problem
    budget: float | None = None
    near: fp.Plan | Jump | None = None

    def answer(self, say: Callable[[str], None] | None = None) -> ShownPlan:
        """Plan, and say in a few words what is done."""
        if self.budget is not None:
            return ShownPlan.of(self._searched(self.budget), settled=False)
        if self.problem.jump is None:
            return ShownPlan.of(fp.plan(self.problem, progress=say, prove=True), settled=True)
        jump = fp.jump(self.problem, progress=say, near=self.near if isinstance(self.near, Jump) else None)
        if jump.flight is None:
            return ShownPlan.of(self._searched(NEAR_BUDGET), True, jump)
        jump = jump.with_certificate(fp.certify(jump.flight))
        assert jump.flight is not None
        return ShownPlan.of(jump.flight, True, jump)

    def _searched(self, budget: float) -> fp.Plan:
        near = self.near.flight if isinstance(self.near, Jump) else self.near
        return planned(self.problem, SearchOptions(budget=budget), near).plan


def pose_times(duration: float) -> Array:
    """Instants (K,) of the poses of a motion, s."""
    return np.linspace(0.0, duration, min(int(np.ceil(duration * POSE_RATE)) + 1, MOST_POSES))


@dataclass(frozen=True, eq=False)
class LaunchTask:
    """Look for stances within the limits on torque and rate, from rest to a plan's takeoff, and from its landing."""

    present: ShownPlan

    def answer(self) -> ShownPlan:
        """Look for them; the same plan where nothing is limited, or CasADi is not installed."""
        plan = self.present.plan
        limits = np.concatenate((plan.problem.motor_torque_limits, plan.problem.velocity_limits))
        if not plan.ok or np.isinf(limits).all() or find_spec("casadi") is None:
            return self.present
        return replace(self.present, stances=tuple(launches(plan, starts=1)[0]))


@dataclass(frozen=True)
class MapPoint:
    """One point of the map.

    Attributes
    ----------
    status : as of :func:`floatplan.plan_many`
    use : share of the limits that the plan uses; where there are none, its largest torque, N m; None without a plan
    """

    status: str
    use: float | None

    @classmethod
    def of(cls, status: str, plan: fp.Plan) -> MapPoint:
        """Measure the plan of a point."""
        use = largest_use(plan.utilisation)
        return cls(status, float(np.max(plan.peaks.motor_torque)) if use is None else use)


@dataclass(frozen=True, eq=False)
class MapTask:
    """Plan some points of the map: arrays by their paths; each within a budget, s, where they are no batch."""

    problem: fp.Problem
    varied: Mapping[str, Array]
    budget: float

    def answer(self) -> list[MapPoint]:
        """Plan them."""
        family = fp.Family(self.problem, self.varied)
        if not is_plain_family(family):
            return [self._searched(family, row) for row in range(len(family))]
        plans = fp.plan_many(family)
        answers = enumerate(zip(plans.status.tolist(), plans.ok.tolist(), strict=True))
        return [MapPoint.of(status, plans[row]) if ok else MapPoint(status, None) for row, (status, ok) in answers]

    def _searched(self, family: fp.Family, row: int) -> MapPoint:
        try:
            plan = fp.plan(family[row], budget=self.budget)
        except fp.InputError:
            return MapPoint("error", None)
        return MapPoint.of(plan.status, plan) if plan.ok else MapPoint("not_found", None)


@dataclass(frozen=True, eq=False)
class Map:
    """Plans around one: columns of angular momentum, rows of duration.

    Attributes
    ----------
    momenta : (COLUMNS,) kg m^2/s
    durations : (ROWS,) s
    relative : whether what points use is a share of limits; else torques, N m
    points : (row, column) -> MapPoint, as far as they were planned
    """

    momenta: Array
    durations: Array
    relative: bool
    points: Mapping[tuple[int, int], MapPoint] = field(default_factory=dict)

    @classmethod
    def centred_at(cls, present: ShownPlan) -> Map:
        """Return the empty map with a plan in its middle."""
        duration = present.plan.duration
        momentum = present.plan.angular_momentum
        low, high = present.plan.angular_momentum_bounds or (0.0, 0.0)
        step = MOMENTUM_STEP * max(abs(momentum), abs(high - low) / 2, 1e-3)
        return cls(
            momenta=np.asarray(momentum + step * (np.arange(COLUMNS) - COLUMNS // 2), dtype=np.float64),
            durations=np.asarray(duration * (1 + DURATION_STEP * (np.arange(ROWS) - ROWS // 2)), dtype=np.float64),
            relative=present.largest_use is not None,
        )

    def questions(self, problem: fp.Problem) -> Iterator[tuple[list[tuple[int, int]], MapTask]]:
        """Rows and columns of points and the question about them, from the middle outwards."""
        rows, columns = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
        distance = ((rows - ROWS // 2) / ROWS) ** 2 + ((columns - COLUMNS // 2) / COLUMNS) ** 2
        order: IntArray = np.argsort(distance, kind="stable")
        for first in range(0, len(order), TOGETHER):
            row, column = (each[order[first : first + TOGETHER]] for each in (rows, columns))
            varied = {DURATION: self.durations[row], MOMENTUM: self.momenta[column]}
            yield list(zip(row.tolist(), column.tolist(), strict=True)), MapTask(problem, varied, POINT_BUDGET)

    def values(self, row: int, column: int) -> dict[str, float]:
        """The numbers of a point, by their paths."""
        return {DURATION: float(self.durations[row]), MOMENTUM: float(self.momenta[column])}
