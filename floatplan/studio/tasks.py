"""The tasks of the studio's processes and their results: plans with all that is shown of them, points of the map."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec

import numpy as np

import floatplan as fp
from floatplan.arrays import Array, IntArray
from floatplan.errors import printable
from floatplan.jumps.jump import Jump
from floatplan.jumps.launches.launch import launches
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.planning.kernel_input.numbers import is_unconstrained_family
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.plans.measures import PlanWarning, Utilisation, largest_use
from floatplan.plans.presentation import Row
from floatplan.plans.trajectory import Trajectory
from floatplan.studio.curves import Shares, shares
from floatplan.view.jumps import flies_in_space
from floatplan.view.outlines import Poses, grids, moving_bodies, paths_in_space, postures
from floatplan.view.scene.meshes import bends
from floatplan.view.scene.scene import world_points

COLUMNS = 9  # [-] values of h on the map
ROWS = 7  # [-] values of T on the map


@dataclass(frozen=True)
class Failure:
    """Why there is no result, for a person."""

    words: str

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """Return the message of an error; floatplan's own errors need no name."""
        if isinstance(error, fp.FloatplanError):
            return cls(str(error))
        if isinstance(error, MemoryError):
            return cls("there is not enough memory for this")
        return cls(printable(f"{type(error).__name__}: {error}"))


@dataclass(frozen=True, eq=False)
class ShownPlan:
    """A plan, or a jump, with all that the page shows of it, measured where it was planned.

    Attributes
    ----------
    plan : Plan
        With its certificate, where it was proved; where there is no solution, the nearest motion. Of a jump its flight.
    settled : bool
        Whether it is the result of ``floatplan plan`` or ``floatplan jump``; else that of a quick search.
    poses : Poses
    paths : (N, 3) m, in the world; of the centre of mass, and of the frames that take off and land
    grid : (L, 2, 3) m, lines on the ground and on half-spaces; in space
    utilisation, warnings : of the plan
    clearance : m, or None without obstacles
    shares : of limits, over time
    jump : Jump or None
        The result, where the problem has a jump; where it is not solved, the plan is that of the flight without it.
    stances : rows about the stances before takeoff and after landing
    """

    plan: fp.Plan
    settled: bool
    poses: Poses | BodyPoses
    paths: tuple[Array, ...]
    utilisation: tuple[Utilisation, ...]
    warnings: tuple[PlanWarning, ...]
    clearance: float | None
    shares: tuple[Shares, ...]
    jump: Jump | None = None
    stances: tuple[Row, ...] = ()
    grid: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))

    @classmethod
    def of(cls, plan: fp.Plan, settled: bool, jump: Jump | None = None) -> ShownPlan:
        """Measure a plan, or the jump around it."""
        motion: Trajectory = plan if jump is None or jump.flight is None else jump
        paths: tuple[Array, ...]
        grid = np.zeros((0, 2, 3))
        if flies_in_space(motion):
            paths = paths_in_space(motion, np.linspace(0.0, motion.duration, 361))
            grid = np.reshape(grids(motion), (-1, 2, 3))
        else:
            placed = postures(motion, np.linspace(0.0, motion.duration, 161))
            planar_paths = (placed.com, placed.takeoff, placed.landing)
            # [rad] a polygon of such angles looks smooth
            paths = tuple(world_points(plan.robot.plane, path[bends(path, 0.05)]) for path in planar_paths)
        return cls(
            plan=replace(plan, as_recorded=None if plan.certificate is None else plan.record),  # without what it caches
            settled=settled,
            poses=moving_bodies(motion, pose_times(motion.duration)),
            paths=paths,
            grid=grid,
            utilisation=plan.utilisation,
            warnings=plan.warnings,
            clearance=plan.peaks.clearance,
            shares=shares(motion),
            jump=jump,
        )

    @property
    def solved_jump(self) -> Jump | None:
        """The jump; None where it is not solved."""
        return None if self.jump is None or self.jump.flight is None else self.jump

    @property
    def motion(self) -> Trajectory:
        """The moving robot: the jump, or the plan."""
        return self.solved_jump or self.plan

    @property
    def largest_use(self) -> float | None:
        """Largest share of a limit that a motor uses; None without limits."""
        if self.solved_jump is None:
            return largest_use(self.utilisation)
        return max((shares.peak for shares in self.shares if shares.limited), default=None)


@dataclass(frozen=True, eq=False)
class PlanTask:
    """Plan a problem: as ``floatplan plan`` does, with its proof, or within a ``budget``, s, the best motion so far.

    A search with a budget begins from the plan ``near`` it, where there is one, and is for the flight without its jump.
    Without, a problem with a jump is planned as by ``floatplan jump``, but that the search begins from the near jump.
    """

    problem: fp.Problem
    budget: float | None = None
    near: fp.Plan | Jump | None = None

    def run(self, say: Callable[[str], None] | None = None) -> ShownPlan:
        """Plan, with a few words about the progress."""
        if self.budget is not None:
            return ShownPlan.of(self._searched(self.budget), settled=False)
        if self.problem.jump is None:
            return ShownPlan.of(fp.plan(self.problem, progress=say, prove=True), settled=True)
        jump = self._jump(say)
        if jump.flight is None:
            return ShownPlan.of(self._searched(0.3), True, jump)  # [s] for a flight to look at instead
        jump = jump.with_certificate(*map(fp.certify, jump.flights))
        assert jump.flight is not None
        return ShownPlan.of(jump.flight, True, jump)

    def _jump(self, say: Callable[[str], None] | None) -> Jump:
        """The jump, searched for near the one at hand; from the usual starts where that has other phases."""
        if not isinstance(self.near, Jump):
            return fp.jump(self.problem, progress=say)
        try:
            return fp.jump(self.problem, progress=say, near=self.near)
        except fp.InputError as error:
            if error.element != "near":
                raise
            return fp.jump(self.problem, progress=say)

    def _searched(self, budget: float) -> fp.Plan:
        near = self.near.flight if isinstance(self.near, Jump) else self.near
        return planned(self.problem, SearchOptions(budget=budget), near).plan


def pose_times(duration: float) -> Array:
    """Instants (K,) of the poses of a motion, s."""
    # at 60 Hz, as screens show; of a long flight fewer, which a page can still hold
    return np.linspace(0.0, duration, min(int(np.ceil(duration * 60.0)) + 1, 1200))


@dataclass(frozen=True, eq=False)
class LaunchTask:
    """Look for stances within the limits on torque and rate: from standing to a plan's takeoff, from its landing."""

    present: ShownPlan

    def run(self) -> ShownPlan:
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

    def run(self) -> list[MapPoint]:
        """Plan them."""
        family = fp.Family(self.problem, self.varied)
        if not is_unconstrained_family(family):
            return [self._searched(family, row) for row in range(len(family))]
        plans = fp.plan_many(family)
        points = []
        for row, (status, ok) in enumerate(zip(plans.status.tolist(), plans.ok.tolist(), strict=True)):
            points.append(MapPoint.of(status, plans[row]) if ok else MapPoint(status, None))
        return points

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
    points : (row, column) -> MapPoint, so far
    """

    momenta: Array
    durations: Array
    relative: bool
    points: Mapping[tuple[int, int], MapPoint] = field(default_factory=dict)

    @classmethod
    def centred_at(cls, present: ShownPlan) -> Map:
        """Return the empty map with a plan in its middle.

        Neighbours differ by 7 % of the duration, and by 12 % of h or of half the interval (9), whichever is larger.
        """
        duration = present.plan.duration
        momentum = present.plan.angular_momentum
        low, high = present.plan.angular_momentum_bounds or (0.0, 0.0)
        step = 0.12 * max(abs(momentum), abs(high - low) / 2, 1e-3)
        return cls(
            momenta=np.asarray(momentum + step * (np.arange(COLUMNS) - COLUMNS // 2), dtype=np.float64),
            durations=np.asarray(duration * (1 + 0.07 * (np.arange(ROWS) - ROWS // 2)), dtype=np.float64),
            relative=present.largest_use is not None,
        )

    def tasks(self, problem: fp.Problem) -> Iterator[tuple[list[tuple[int, int]], MapTask]]:
        """Rows and columns of points and the task of planning them, from the middle outwards."""
        rows, columns = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
        distance = ((rows - ROWS // 2) / ROWS) ** 2 + ((columns - COLUMNS // 2) / COLUMNS) ** 2
        order: IntArray = np.argsort(distance, kind="stable")
        for first in range(0, len(order), 3):  # three at a time: a new problem need not wait for many
            points = order[first : first + 3]
            row = rows[points]
            column = columns[points]
            varied = {"flight.duration": self.durations[row], "flight.angular_momentum": self.momenta[column]}
            yield list(zip(row.tolist(), column.tolist(), strict=True)), MapTask(problem, varied, budget=0.4)

    def values(self, row: int, column: int) -> dict[str, float]:
        """The numbers of a point, by their paths."""
        return {
            "flight.duration": float(self.durations[row]),
            "flight.angular_momentum": float(self.momenta[column]),
        }
