"""Plans of flights in space: lifted motions, made smaller where nothing else is asked, else followed by the kernel."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from floatplan.errors import InputError
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.spatial.attitude import IntegrationError
from floatplan.motion.spatial.flight import SpatialFlight
from floatplan.planning.lifting import (
    IN_A_VALLEY,
    LIFTING,
    TO_A_MINIMUM,
    LiftedFlight,
    LiftedMotion,
    close,
    descend,
    is_least,
    nearby,
    refined,
    starts,
    steepness,
)
from floatplan.planning.options import SearchOptions
from floatplan.planning.result import AttemptResult, SearchResult, summary
from floatplan.planning.robust import RobustCost, about
from floatplan.planning.search import (
    ANNOUNCED_EVERY,
    MOST_ATTEMPTS,
    RULES,
    Allowance,
    Search,
    expiry,
)
from floatplan.planning.spec import nominal_start
from floatplan.planning.variables import Start
from floatplan.problem.problem import Problem

LOG = logging.getLogger(__name__)
MOST_STARTS = 300  # [-]


@dataclass(frozen=True)
class SpatialRules:
    """What a search in space tries."""

    starts_in_a_row: int = 6  # [-] at one degree, before the next is tried
    few_joints: int = 6  # [-] that need a higher degree
    twist: float = np.pi / 2  # [rad] about the third axis, that needs a higher degree
    degrees: tuple[int, ...] = (9, 11)  # [-] of twists, of robots with few joints, and without momentum
    degrees_without_twist: tuple[int, ...] = (7, 9)  # [-]
    share_of_fixed: float = 0.8  # [-] of budget or work, before another h than the fixed one is tried
    share_of_one: float = 0.5  # [-] of the usual work, for one start; also where a budget of seconds ends the search
    share_of_near: float = 4.0  # [-] of the usual work, for a start near a plan: past edges that takes 80 to 410 steps
    outside: float = 1e-6  # [-] of the box of h, that is rounding
    first_radius_within: float = 0.2  # [rad] of p, root mean square, of a step down that leads out of limits
    last_radius_within: float = 0.01  # [rad] the same, below which a step gains next to nothing
    steps_within: int = 20  # [-] at most; under tight limits the last one still gains two per cent


SPATIAL_RULES = SpatialRules()


def degrees_tried(problem: Problem, flight: SpatialFlight) -> list[tuple[int, ...]]:
    """Degrees of the polynomials that take turns: the one that is given, else what the problem needs.

    Twists, few joints, and turns without momentum need higher ones.
    """
    n = len(problem.robot.joints)
    h = problem.flight.angular_momentum
    if not problem.raises_degree:
        return [problem.degrees]
    demanding = (
        n <= SPATIAL_RULES.few_joints
        or abs(flight.reorientation.change[2]) > SPATIAL_RULES.twist
        or not (isinstance(h, str) or np.any(h))
    )
    degrees = SPATIAL_RULES.degrees if demanding else SPATIAL_RULES.degrees_without_twist
    return [(degree,) * n for degree in degrees]


class SpatialSearch(Search):
    """A search for a flight in space."""

    def run(self, most_starts: int = MOST_ATTEMPTS) -> SearchResult:
        """Search for a motion; where the given h leads to none, with h free too, to say with which there is one.

        Raises
        ------
        InputError
            The robot turns too fast for any motion of it to be integrated.
        """
        if self.spec.momentum.axes.size:
            return self._tried(1.0)
        result = self._tried(SPATIAL_RULES.share_of_fixed)
        if result.holding or result.interrupted or self.impossible:
            return result
        problem = self.spec.problem
        freed = replace(problem, flight=replace(problem.flight, angular_momentum="free"))
        try:
            other = SpatialSearch(freed, replace(self.options, starts=1))._tried(1 - SPATIAL_RULES.share_of_fixed)
        except (InputError, KeyboardInterrupt):
            return result
        x = other.best.x
        return replace(result, other_momentum=other.best.variables.angular_momentum(x) if other.best.holds else None)

    def _tried(self, share: float) -> SearchResult:
        """Try starts until so many of them are solved, or a share of the budget, or of the usual work, is used up."""
        options = self.options
        results: list[AttemptResult] = []
        expired = expiry(options.budget and share * options.budget)
        work_before = self.work.done
        most_work = share * Allowance.of(options).left
        work_of_one = SPATIAL_RULES.share_of_one * share * Allowance.of(SearchOptions()).left
        solved = 0
        announced = time.monotonic()
        interrupted = False

        def stop() -> bool:
            return expired() or self.work.done - work_before > most_work

        try:
            for result in islice(self._in_turns(stop, work_of_one), MOST_STARTS):
                if result:
                    results.append(result)
                    solved += result.holds
                    if LOG.isEnabledFor(logging.INFO):
                        LOG.info("%s", summary(results))
                if solved >= options.starts or stop():
                    break
                if not solved and len(results) >= RULES.starts_of_the_impossible and self.impossible:
                    break
                if options.progress and time.monotonic() - announced > ANNOUNCED_EVERY:
                    announced = time.monotonic()
                    options.progress(f"{len(results)} starts tried, {solved} solved")
        except KeyboardInterrupt:
            interrupted = True
            if not results:
                raise
        if not results:
            reason = "turns the robot too fast: no motion can be integrated"
            raise InputError(reason, element="flight.angular_momentum", advice="give a smaller one, or fewer turns")
        return SearchResult(
            spec=self.spec,
            seed=options.seed,
            results=results,
            impossible=() if solved else self.impossible,
            ran_out_of_time=stop(),
            interrupted=interrupted,
        )

    def _in_turns(self, stop: Callable[[], bool], most_work: float) -> Iterator[AttemptResult | None]:
        """Where the starts end, in their order: those of the first degree, then those of the others, in turns.

        Each may do so much work. None where that cannot be integrated.
        """
        flight = self.spec.flight
        assert isinstance(flight, SpatialFlight), "the robot flies in space"
        seeds = np.random.SeedSequence(self.options.seed)
        lifted: list[Iterator[LiftedMotion | None]] = []
        for degrees in degrees_tried(self.spec.problem, flight):
            of_degree = LiftedFlight(self.spec, nominal_start(self.spec, degrees).variables, self.work)
            lifted.append(starts(of_degree, int(seeds.generate_state(1)[0]) + len(lifted)))
        is_left = True
        while is_left:
            is_left = False
            for motions in lifted:
                for start in islice(motions, SPATIAL_RULES.starts_in_a_row):
                    is_left = True
                    yield self._follow_lifted(start, stop, most_work) if start else None

    def follow_near(self, start: Start, stop: Callable[[], bool]) -> AttemptResult | None:
        """Follow a motion that is nearly one to the goal; None where it cannot be integrated."""
        lifted = LiftedFlight(self.spec, start.variables, self.work)
        most_work = SPATIAL_RULES.share_of_near * Allowance.of(SearchOptions()).left
        try:
            return self._follow_lifted(nearby(lifted, start.x), stop, most_work, is_near=True)
        except IntegrationError:
            return None

    def _follow_lifted(
        self, start: LiftedMotion, stop: Callable[[], bool], most_work: float, is_near: bool = False
    ) -> AttemptResult | None:
        """Where one start ends: closed, then made smaller, or followed with limits and another objective.

        One that is near a plan is not made smaller first: without limits it would leave them.
        None where that cannot be integrated.
        """
        before = self.work.done
        motion = close(start)
        usable = motion.is_closed() and motion.makes_right_turns
        objective = self.spec.problem.motion.objective
        is_norm = objective in ("coefficients", "clip")  # of the variables x
        if usable and objective == "robust":
            result = self._robust(motion, stop, before + most_work)
        elif usable and (self.spec.constraints or not is_norm):
            begin = motion if is_near else descend(motion)
            result = self._within_limits(begin, stop, before + most_work)
        else:
            result = self._smallest(motion) if usable else self._judged(motion, "infeasible")
        result.work = self.work.done - before
        return result if np.isfinite(result.residual).all() else None

    def _smallest(self, motion: LiftedMotion) -> AttemptResult:
        """Where a closed motion ends that is made smaller; where that is steep, in small steps on, if that holds."""
        smaller = descend(motion)
        is_steep = steepness(smaller) > LIFTING.steep
        candidates = [descend(smaller, rules=IN_A_VALLEY), smaller] if is_steep else [smaller]
        for candidate in candidates:
            final = refined(candidate)
            status = "infeasible" if final is None else "optimal" if is_least(final) else "feasible"
            result = self._judged(final or motion, status)
            if result.holds:
                break
        return result

    def _robust(self, motion: LiftedMotion, stop: Callable[[], bool], until: float) -> AttemptResult:
        """Where a closed motion ends for the objective "robust".

        With limits the smallest motion is cheap, and says first whether one from here keeps them at all. Where the
        least one breaks them, the descent goes on within, from the better one of the smallest and that near the least.
        """
        small = descend(motion)
        results = [self._within_limits(small, stop, until)] if self.spec.constraints else []
        if results and not results[0].holds:
            return results[0]
        lower = descend(small, RobustCost.of)
        least = refined(lower)
        of_least = None
        if least is not None:
            of_least = self._judged(about(least), "feasible")
            results.append(of_least)
            if self.spec.constraints and not of_least.holds:
                results.append(self._within_limits(about(least), stop, until))
        holding = [result for result in results if result.holds]
        if not holding:
            return results[-1] if results else self._judged(motion, "infeasible")
        best = min(holding, key=lambda result: result.objective_value)
        if self.spec.constraints and not (of_least is not None and of_least.holds):
            best = self._descend_within(best, stop, until)
        elif best is of_least:
            best = self._at_a_minimum(lower, best)
        best.status = "optimal" if self._is_least_robust(best) else "feasible"
        return best

    def _at_a_minimum(self, lower: LiftedMotion, best: AttemptResult) -> AttemptResult:
        """Go on with the descent of the objective "robust" to a minimum; the result before where limits forbid that."""
        final = refined(descend(lower, RobustCost.of, TO_A_MINIMUM))
        if final is None:
            return best
        result = self._judged(about(final), "feasible")
        return result if result.holds and result.objective_value < best.objective_value else best

    def _is_least_robust(self, result: AttemptResult) -> bool:
        """Whether a motion, which keeps the limits, is a minimum of the objective "robust" even without them."""
        if result.variables.momentum.axes.shape != self.spec.momentum.axes.shape:
            return False  # its h was fixed at the edge of the box
        lifted = LiftedFlight(self.spec, result.variables, self.work)
        try:
            return RobustCost.of(close(nearby(lifted, result.x))).is_least
        except IntegrationError:
            return False

    def _descend_within(self, best: AttemptResult, stop: Callable[[], bool], until: float) -> AttemptResult:
        """Make the objective "robust" smaller within limits.

        The kernel finds the motion within them that is nearest to where a step down leads.
        """
        radius = SPATIAL_RULES.first_radius_within
        cost = None
        for _ in range(SPATIAL_RULES.steps_within):
            if radius < SPATIAL_RULES.last_radius_within or stop() or self.work.done > until:
                break
            try:
                if cost is None:
                    lifted = LiftedFlight(self.spec, best.variables, self.work)
                    cost = RobustCost.of(close(nearby(lifted, best.x)))
                motion = cost.motion
                beyond = close(motion.moved(*motion.step(motion.gaps, cost.downhill(radius))))
                result = self._within_limits(about(beyond), stop, until)
            except IntegrationError:
                break
            if result.holds and result.objective_value < best.objective_value * (1 - LIFTING.least_gain):
                best = result
                cost = None
                radius = 2 * radius
            else:
                radius = LIFTING.shorter * radius
        return best

    def _within_limits(self, motion: LiftedMotion, stop: Callable[[], bool], until: float) -> AttemptResult:
        """Follow a closed motion with limits and objective; where h leaves its box by that, with h at the edge of it.

        That may be done until the work of all starts is so much.
        """
        variables = motion.lifted.variables
        free = variables.coefficients
        result = self.follow(Start(variables, motion.x, at_once=True), stop, until - self.work.done)
        chosen = result.x[free:]
        if not result.holds or np.abs(chosen).max(initial=0.0) <= 1 + SPATIAL_RULES.outside:
            return result
        h = variables.angular_momentum(np.append(motion.x[:free], np.clip(chosen, -1, 1)))
        fixed_variables = replace(variables, momentum=MomentumSet(h, np.empty((len(h), 0))))
        fixed = LiftedFlight(self.spec, fixed_variables, self.work)
        try:
            nearest = close(fixed.fly(motion.cells, motion.x[:free], motion.borders))
        except IntegrationError:
            return replace(result, violation=np.inf)
        if not (nearest.is_closed() and nearest.makes_right_turns):
            return self._judged(nearest, "infeasible")
        return self.follow(Start(fixed_variables, nearest.x, at_once=True), stop, until - self.work.done)

    def _judged(self, motion: LiftedMotion, status: str) -> AttemptResult:
        return self.judge(Start(motion.lifted.variables, motion.x), status)
