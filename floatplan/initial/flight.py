"""A first flight of any robot: a flip from a foot at rest to a foot at rest, else the largest turn, else one afloat."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

from floatplan.errors import InputError
from floatplan.initial.candidates import GRAVITY, Candidates, Flights
from floatplan.initial.problems import problem_of, turns_afloat
from floatplan.initial.robots import ChosenRobot
from floatplan.initial.stance import Stance
from floatplan.planning.planned import planned
from floatplan.planning.repair import proved_plan
from floatplan.planning.search import SearchOptions
from floatplan.plans.plan import Plan
from floatplan.problem.problem import Problem

LONG, SHORT, LEAPING = (3.0, 3.8), (2.3, 3.0), (1.2, 2.4)  # [-] durations over sqrt(height / g)
FLIPS_WORK, LEAPS_WORK, ALL_WORK = 2.5e7, 4e7, 5e7  # [instants of one body] up to there, about 1 s each 6e6
PATIENCE = 8e6  # [instants of one body] with one flight, until a motion is found
GOOD = 1.0  # [-] cost of a flight that is tried before others are sought
LEAN = math.radians(35)  # [rad] of the base at both ends of a flip
LEANS_OF_LEAPS = tuple(math.radians(lean) for lean in (45, 25, 12, 4))  # [rad] the same of leaps, which turn by it
SMALLEST_TURN = math.radians(3)  # [rad] that is worth a flight
CORRECTIONS = 2  # [-] with lower accelerations, where a locked joint cannot be held
CALMER = 0.8  # [-] of the acceleration that would just do


@dataclass(frozen=True, eq=False)
class FirstFlight:
    """A problem whose plan was found, proved and has no warnings.

    Attributes
    ----------
    problem : Problem
    plan : Plan
    reasons : why the flight turns no farther; empty where it is a full flip
    """

    problem: Problem
    plan: Plan
    reasons: tuple[str, ...]

    @property
    def turn(self) -> float:
        """Of the base, rad."""
        return self.problem.final.orientation - self.problem.initial.orientation


def first_flight(chosen: ChosenRobot, *, seed: int = 0, progress: Callable[[str], None] | None = None) -> FirstFlight:
    """Search for a flight that can begin and end: on a foot a full flip, else the largest turn; else in free fall.

    The search ends by the work it has done, not by a clock: the answer is the same on every machine.

    Parameters
    ----------
    chosen : ChosenRobot
    seed : int
        Of the postures tried.
    progress : callable, optional
        Told in a few words what is tried.

    Raises
    ------
    InputError
        The robot's geometry is wrong, it does not keep to its plane, or none of the flights tried has a plan that is
        proved and without warnings.
    """
    chosen.robot.check_shapes()
    search = _Search(progress or (lambda _: None))
    reasons: list[str] = []
    for kind, groups, most in (("flip", _flips(chosen), FLIPS_WORK), ("leap", _leaps(chosen), LEAPS_WORK)):
        tried, least = 0, math.inf
        for family, candidate in search.candidates(groups, seed):
            if not candidate.depth and not candidate.unsteady:
                least = min(least, float(candidate.ratios.max()))
            if not candidate.begins_and_ends or abs(candidate.turn) < SMALLEST_TURN or search.work > most:
                continue
            tried += 1
            search.progress(f"{kind} of {math.degrees(candidate.turn):.0f} degrees on {family.stance.frame}")
            answer = search.planned(problem_of(chosen, family.stance.frame, candidate))
            if answer is not None:
                return FirstFlight(*answer, () if kind == "flip" else tuple(reasons))
        reasons.append(_why(kind, tried, least))
    if not chosen.feet:
        reasons = ["No feet were found that it could stand on."]
    elif len(chosen.robot.joints) == 1:
        reasons = ["For a flip one joint is too few: no rates of it and the base stop the foot."]
    farthest = 0.0
    for problem in turns_afloat(chosen):
        turn = abs(problem.final.orientation - problem.initial.orientation)
        farthest = max(farthest, turn)
        if turn < SMALLEST_TURN or search.work > ALL_WORK:
            continue
        search.progress(f"turn of {math.degrees(turn):.0f} degrees afloat")
        answer = search.planned(problem)
        if answer is not None:
            return FirstFlight(*answer, tuple(reasons))
    reasons.append(f"Afloat, its joints would turn the base by at most {math.degrees(farthest):.2g} degrees.")
    raise InputError(
        f"no flight was found that is proved and without warnings. {' '.join(reasons)}".removesuffix("."),
        source=chosen.robot.source,
        advice="write the problem yourself, with joints that move more of the robot; floatplan info lists them",
    )


@dataclass
class _Search:
    """What was done so far, and how to plan: ``work`` counts instants of one body."""

    progress: Callable[[str], None]
    work: float = 0.0

    def candidates(self, groups: Iterable[Sequence[Flights]], seed: int) -> Iterator[tuple[Flights, Candidates]]:
        """Yield the best flight of each family: within a group good ones as they are found, then the better before."""
        for group in groups:
            others = []
            for family in group:
                candidate = family.search(seed)
                self.work += family.work
                if candidate.cost <= GOOD:
                    yield family, candidate
                else:
                    others.append((family, candidate))
            yield from sorted(others, key=lambda pair: pair[1].cost)

    def planned(self, problem: Problem) -> tuple[Problem, Plan] | None:
        """A proved plan without warnings; where only a locked joint cannot be held, one that moves more calmly.

        It is the plan that ``floatplan plan`` finds, given up where that takes long.
        """
        for _ in range(1 + CORRECTIONS):
            try:
                found = planned(problem, SearchOptions(patience=PATIENCE))
            except InputError:
                return None
            self.work += found.work
            plan = proved_plan(found)
            if found.gave_up or not plan.ok or plan.certificate is None or not plan.certificate.proved:
                return None
            if not plan.warnings:
                return problem, plan
            calmer = _calmer(problem, plan)
            if calmer is None:
                return None
            problem = calmer
        return None


def _calmer(problem: Problem, plan: Plan) -> Problem | None:
    """The problem with accelerations low enough for locked joints to hold; None where other warnings remain."""
    shares = [w.limit / w.value for w in plan.warnings if w.kind == "holding_torque" and w.value and w.limit]
    if len(shares) < len(plan.warnings):
        return None
    acceleration = CALMER * min(shares) * float(plan.peaks.joints["acceleration"].max())
    rounded = math.radians(float(f"{math.degrees(acceleration):.2g}"))
    return replace(problem, limits=replace(problem.limits, acceleration=rounded))


def _why(kind: str, tried: int, least: float) -> str:
    if tried:
        return f"Of {tried} {kind}s that could begin and end, no motion was found within the limits."
    if math.isfinite(least):
        return f"For a {kind} the joints would have to turn at {least:.2g} times a velocity limit to take off or land."
    return f"For a {kind} no posture was found to take off from or to land in."


def _flips(chosen: ChosenRobot) -> Iterator[list[Flights]]:
    """Backwards from the hindmost feet, forwards from the foremost, long and short: compared with each other."""
    backwards = int(chosen.robot.plane.turn)
    choices = product(((backwards, chosen.feet[:1]), (-backwards, chosen.feet[-1:])), (LONG, SHORT))
    yield [each for (turns, feet), band in choices for each in _on_feet(chosen, feet, turns, LEAN, band)]


def _leaps(chosen: ChosenRobot) -> Iterator[list[Flights]]:
    """On all feet, those that lean most first."""
    for lean in LEANS_OF_LEAPS:
        yield _on_feet(chosen, chosen.feet, 0, lean, LEAPING)


def _on_feet(
    chosen: ChosenRobot, feet: Sequence[str], turns: int, lean: float, band: tuple[float, float]
) -> list[Flights]:
    if len(chosen.robot.joints) == 1:
        return []
    found = []
    for stance in (Stance(chosen.robot, foot, chosen.feet) for foot in feet):
        unit = math.sqrt(stance.size / GRAVITY)
        found.append(Flights(stance, turns, (band[0] * unit, band[1] * unit), lean))
    return found
