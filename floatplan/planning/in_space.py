"""Plans of flights in space: lifted motions, made smaller where nothing else is asked, else followed by the kernel."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from floatplan.errors import InputError
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.spatial.attitude import LEVELS, IntegrationError, cells
from floatplan.motion.spatial.flight import SpatialFlight
from floatplan.motion.spatial.goal import wrong_way as wrong_turns
from floatplan.planning.attempt import Attempts
from floatplan.planning.lifting import LiftedFlight, LiftedMotion, close, descend, is_least, nearby, refined, starts
from floatplan.planning.search import (
    ANNOUNCED_EVERY,
    ATTEMPTS_FOR_THE_IMPOSSIBLE,
    SearchOptions,
    SearchResult,
    expiry,
    log_attempt,
)
from floatplan.planning.starts import Start
from floatplan.planning.transcription.result import AttemptResult
from floatplan.planning.transcription.variables import decision_variables
from floatplan.problem.problem import Problem

TURNS = 6  # [-] starts at one degree before the next takes its turn
FEW_JOINTS = 6  # [-] that need a higher degree
TWIST = np.pi / 2  # [rad] about the third axis, that needs a higher degree
DEGREES = (9, 11)  # [-] of twists, of robots with few joints, and without momentum
DEGREES_WITHOUT_TWIST = (7, 9)  # [-]
MOST_STARTS = 300  # [-]
WITH_GIVEN = 0.8  # [-] of budget or work, before it is tried whether another h than the given one leads to a plan
OF_ONE = 0.5  # [-] of the usual work, that one start may do; also where a budget of seconds ends the search
OUTSIDE = 1e-6  # [-] of the box of h, that is rounding


def search_in_space(prepared: Attempts, options: SearchOptions) -> SearchResult:
    """Search for a motion; where the given h leads to none, with h free too, to say with which there is one.

    Raises
    ------
    InputError
        The robot turns too fast for any motion of it to be integrated.
    """
    if prepared.momentum.free:
        return _tried(prepared, options, 1.0)
    result = _tried(prepared, options, WITH_GIVEN)
    if result.holding or result.interrupted or prepared.impossible:
        return result
    flight = replace(prepared.problem.flight, angular_momentum="free")
    freed = Attempts(replace(prepared.problem, flight=flight), prepared.seed)
    try:
        other = _tried(freed, replace(options, starts=1), 1 - WITH_GIVEN)
    except (InputError, KeyboardInterrupt):
        return result
    x = other.best.x
    return replace(result, momentum_found=other.best.variables.angular_momentum(x) if other.best.holds else None)


def _tried(prepared: Attempts, options: SearchOptions, share: float) -> SearchResult:
    """Try starts until so many of them are solved, or a share of the budget, or of the usual work, is used up."""
    results: list[AttemptResult] = []
    expired, began = expiry(options.budget and share * options.budget), prepared.model.work
    most_work, of_one = share * options.work, OF_ONE * share * replace(options, budget=None).work
    solved, announced, interrupted = 0, time.monotonic(), False

    def stop() -> bool:
        return expired() or prepared.model.work - began > most_work

    try:
        for result in islice(_results(prepared, options.seed, stop, of_one), MOST_STARTS):
            if result:
                results.append(result)
                solved += result.holds
                log_attempt(prepared, results)
            if solved >= options.starts or stop():
                break
            if not solved and len(results) >= ATTEMPTS_FOR_THE_IMPOSSIBLE and prepared.impossible:
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
    return SearchResult(prepared, results, ran_out_of_time=stop(), interrupted=interrupted)


def _is_followed(prepared: Attempts) -> bool:
    """Whether the kernel follows what lifting finds."""
    return bool(prepared.constraints) or prepared.problem.motion.objective != "coefficients"


def degrees_tried(problem: Problem, flight: SpatialFlight) -> list[tuple[int, ...]]:
    """Degrees of the polynomials that take turns: the one that is given, else what the problem needs.

    Twists, few joints, and turns without momentum need higher ones.
    """
    n, h = len(problem.robot.joints), problem.flight.angular_momentum
    if not problem.raises_degree:
        return [problem.degrees]
    demanding = n <= FEW_JOINTS or abs(flight.change[2]) > TWIST or not (isinstance(h, str) or np.any(h))
    return [(degree,) * n for degree in (DEGREES if demanding else DEGREES_WITHOUT_TWIST)]


def _results(
    prepared: Attempts, seed: int, stop: Callable[[], bool], most_work: float
) -> Iterator[AttemptResult | None]:
    """Where the starts end, in their order: those of the first degree, then those of the others, in turns.

    Each may do so much work. None where that cannot be integrated.
    """
    flight = prepared.model.flight
    assert isinstance(flight, SpatialFlight), "the robot flies in space"
    problem, seeds = prepared.problem, np.random.SeedSequence(seed)
    lifted: list[Iterator[LiftedMotion | None]] = []
    for degrees in degrees_tried(problem, flight):
        branches = np.zeros((2, len(degrees)), np.int64)
        variables = decision_variables(problem, degrees, branches, prepared.momentum)
        of_degree = LiftedFlight(prepared.model, flight, variables)
        lifted.append(starts(of_degree, int(seeds.generate_state(1)[0]) + len(lifted)))
    is_left = True
    while is_left:
        is_left = False
        for drawn in lifted:
            for start in islice(drawn, TURNS):
                is_left = True
                yield _followed(prepared, start, stop, most_work) if start else None


def _followed(
    prepared: Attempts, start: LiftedMotion, stop: Callable[[], bool], most_work: float
) -> AttemptResult | None:
    """Where one start ends: closed, then made smaller, or followed with limits and another objective.

    None where that cannot be integrated.
    """
    model, before = prepared.model, prepared.model.work
    motion = close(start)
    usable = motion.is_closed() and motion.makes_right_turns
    if usable and _is_followed(prepared):
        smaller = descend(motion)
        result = _within_limits(prepared, smaller, stop, before + most_work)
    else:
        final = refined(descend(motion)) if usable else None
        status = "infeasible" if final is None else "optimal" if is_least(final) else "feasible"
        result = _judged(prepared, final or motion, status)
    result.work = model.work - before
    return result if np.isfinite(result.missed).all() else None


def follow_motion(prepared: Attempts, start: Start, stop: Callable[[], bool]) -> AttemptResult | None:
    """Where a motion leads that is nearly one to the goal; None where it cannot be integrated."""
    flight = prepared.model.flight
    assert isinstance(flight, SpatialFlight), "the robot flies in space"
    lifted = LiftedFlight(prepared.model, flight, start.variables)
    try:
        return _followed(prepared, nearby(lifted, start.x), stop, OF_ONE * SearchOptions().work)
    except IntegrationError:
        return None


def _within_limits(prepared: Attempts, motion: LiftedMotion, stop: Callable[[], bool], until: float) -> AttemptResult:
    """Follow a closed motion with limits and objective; where that leads h out of its box, with h at the edge of it.

    That may be done until the work of all starts is so much.
    """
    lifted, model = motion.lifted, prepared.model
    variables, free = lifted.variables, lifted.coefficients
    result = prepared.attempt(Start(variables, motion.x, at_once=True), stop, until - model.work)
    chosen = result.x[free:]
    if not result.holds or np.abs(chosen).max(initial=0.0) <= 1 + OUTSIDE:
        return result
    h = variables.angular_momentum(np.append(motion.x[:free], np.clip(chosen, -1, 1)))
    given = replace(variables, momentum=MomentumSet(h, np.empty((len(h), 0))))
    fixed = LiftedFlight(lifted.model, lifted.flight, given)
    try:
        nearest = close(fixed.fly(motion.cells, motion.x[:free], motion.borders))
    except IntegrationError:
        return replace(result, violation=np.inf)
    usable = nearest.is_closed() and nearest.makes_right_turns
    if not usable:
        return _judged(prepared, nearest, "infeasible")
    return prepared.attempt(Start(given, nearest.x, at_once=True), stop, until - model.work)


def _judged(prepared: Attempts, motion: LiftedMotion, status: str) -> AttemptResult:
    return prepared.judge(Start(motion.lifted.variables, motion.x), status)


def wrong_way(result: AttemptResult) -> str:
    """What is wrong with the way to the goal, its turns or its tilt; empty for nothing."""
    flight, x = result.model.flight, result.x
    assert isinstance(flight, SpatialFlight), "the robot flies in space"
    lifted = LiftedFlight(result.model, flight, result.variables)
    return wrong_turns(flight.start, flight.goal, lifted.flown(cells(*LEVELS[result.level]), x).way)
