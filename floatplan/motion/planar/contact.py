"""Whether a flight can begin and end: the rates with which its frames leave and meet the ground at rest.

Where they do not exist, or are too fast, other h, durations and postures are tried, and told if they would help.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np

from floatplan.arguments import Outlined, number, optional
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.files import plain
from floatplan.motion.planar.bounds import momentum_asked, momentum_intervals
from floatplan.motion.planar.closed_form import ballistics, frame_weights
from floatplan.motion.planar.contact_rates import (
    ContactRates,
    End,
    Reachable,
    at_end,
    contact_rates,
    equations_at,
    has_contact,
    rate_limits,
    rates_at,
    reachable,
    shared_momentum,
)
from floatplan.pool import one_thread
from floatplan.problem.file import given_problem
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Frame
from floatplan.tables import RELATIVE

VERBS: dict[End, str] = {"takeoff": "leave", "landing": "meet"}
GOLDEN = (math.sqrt(5) - 1) / 2
LEVEL = 5e-3  # [m] within which points of a foot's shape are as low as its lowest: a stance takes a sole for flat so
FAST = 40.0  # [rad/s] that no joint of a legged robot turns at
DURATIONS = np.geomspace(0.5, 2.0, 33)  # [-] of the asked one
REFINEMENTS = 20  # [-] golden sections of the best of these
TRIALS = 300  # [-] postures
STEPS = (0.5, 0.02)  # [rad] of the first and the last trials
INSIDE = 0.02  # [-] of a joint's range, kept free at its ends: a joint on the edge can only be at rest
SINKING = 1e-3  # [m] by which a posture may bring a frame below the lowest of the asked one's
WORTH_TELLING = 0.95  # [-] of what it is now
ENOUGH = 0.8  # [-] of a limit, or of FAST: slower need not be
CHANGE = 0.1  # [-] of a limit, that is as bad as a change by one rad, or of the duration by a factor of e

Momentum: TypeAlias = float | Literal["midpoint"]


@dataclass(frozen=True, eq=False, repr=False)
class Contact(Outlined):
    """The frame at one end of a flight, and the joint rates with which it is at rest there.

    They are those with the least largest ``|rate| / limit``, for the posture, angular momentum and velocity of the
    centre of mass there. Limits are the URDF's and the problem's, whichever is stricter.

    Attributes
    ----------
    problem : Problem
    end : "takeoff" or "landing"
    momentum : float or "midpoint"
        As asked for, see :class:`~floatplan.Flight`; where it is free, the one that suits both ends best.
    found : ContactRates, optional
        None where no frame stands on the ground: the base link's own flies freely.
    point : Frame, optional
        Where the foot is at rest: of the flight of a jump, that point on which it stands with which the joints are
        slowest, such as its toe; else the frame itself.
    """

    problem: Problem
    end: End
    momentum: Momentum
    found: ContactRates | None
    point: Frame | None = None
    shown: ClassVar[Sequence[str]] = ("frame", "end", "ok", "ratio", "joint", "rates", "angular_momentum", "verdict")

    @property
    def frame(self) -> str:
        """The frame that leaves or meets the ground."""
        return self.problem.takeoff.frame if self.end == "takeoff" else self.problem.landing.frame

    @property
    def ratio(self) -> float | None:
        """Largest ``|rate| / limit``; None without limits or without contact, infinite where no rates exist."""
        return None if self.found is None else self.found.ratio

    @property
    def joint(self) -> str | None:
        """The motor whose limit holds back most; without limits, the one that weighs most in the largest rate."""
        return None if self.found is None else self.found.joint

    @property
    def rate(self) -> float | None:
        """Magnitude of that motor's rate, rad/s."""
        if self.found is None or self.joint is None:
            return None
        return abs(float(self.found.motor_rates[self.problem.robot.motors.index(self.joint)]))

    @property
    def limit(self) -> float | None:
        """That motor's limit, rad/s; None without."""
        return None if self.rate is None or self.ratio is None else self.rate / self.ratio

    @property
    def rates(self) -> Array:
        """Rates (n,) of the planned joints, rad/s; NaN where there are none."""
        return np.full(len(self.problem.robot.joints), np.nan) if self.found is None else self.found.rates

    @property
    def limits(self) -> Array:
        """Velocity limits (n,) of the planned joints and what follows them, rad/s; infinite where there is none."""
        return np.full(len(self.problem.robot.joints), np.inf) if self.found is None else self.found.limits

    @property
    def orientation_rate(self) -> float:
        """Rate of the base, rad/s; NaN where there is none."""
        return math.nan if self.found is None else self.found.orientation_rate

    @property
    def angular_momentum(self) -> float | None:
        """As asked, or the one that suits both ends best where it is free; about the centre of mass, kg m^2/s."""
        return None if self.found is None else self.found.angular_momentum

    @property
    def ok(self) -> bool:
        """Whether the limits allow the rates, or nothing stands on the ground."""
        return self.found is None or (self.found.exist and (self.ratio is None or self.ratio <= 1 + RELATIVE))

    def speed(self, orientation_rate: float, rates: Array) -> float:
        """Of its point, m/s, by direction at most, with such rates of base and joints (n,), rad/s."""
        frame, orientation, positions, com_velocity = at_end(self.problem, self.end)
        point = self.point or frame
        equations = equations_at(self.problem.robot, point, orientation, positions, com_velocity)
        return float(np.abs(equations.matrix[1:] @ np.append(orientation_rate, rates) + equations.com_velocity).max())

    @cached_property
    def sentences(self) -> tuple[str, ...]:
        """The verdict for a person; where it is bad, also what was tried and would help."""
        if self.found is None:
            return (self.verdict,)
        bad = self.found.size > (1 if self.ratio is not None else FAST)
        return (self.verdict, *(advice(self.problem, self.end, self.momentum) if bad else ()))

    @cached_property
    def verdict(self) -> str:
        """The first sentence, of the posture as it is."""
        found, verb = self.found, VERBS[self.end]
        if found is None:
            return (
                f"No frame stands on the ground at {self.end}: {self.frame} is the base link, which flies freely;"
                f" flight.{self.end} can name another frame."
            )
        if not found.exist:
            return f"{self.frame} cannot {verb} the ground at rest at {self.end}: {_why_none(self.problem, found)}."
        if found.joint is None:
            return f"{self.frame} {verb}s the ground at rest at {self.end}, with every limited joint at rest."
        if found.ratio is None:
            return (
                f"{self.frame} {verb}s the ground at rest at {self.end} with joints that turn at up to"
                f" {self._in_words}, {found.joint} before all; no motor has a velocity limit."
            )
        rates = f"{found.joint} at {self.rate:.4g} rad/s where {self.limit:.4g} rad/s are allowed"
        if self.ok:
            return f"{self.frame} {verb}s the ground at rest at {self.end}, with {self._in_words}: {rates}."
        return f"{self.frame} cannot {verb} the ground at rest at {self.end}: that takes {self._in_words}, {rates}."

    @property
    def unlimited(self) -> tuple[str, float] | None:
        """The fastest of the motors that the URDF sets no velocity limit, and its rate, rad/s; None without."""
        if self.found is None or not self.found.exist:
            return None
        robot = self.problem.robot
        rates = np.where(np.isfinite(robot.motor_velocity_limits), 0.0, np.abs(self.found.motor_rates))
        fastest = int(rates.argmax())
        return (robot.motors[fastest], float(rates[fastest])) if rates[fastest] else None

    @property
    def _in_words(self) -> str:
        """Share and angular momentum in words: one says nothing without the other."""
        return "" if self.found is None else f"{in_words(self.found)} at {self.found.angular_momentum:.5g} kg m^2/s"

    @property
    def brief(self) -> str:
        """The verdict in a few words."""
        if self.found is None:
            return "flies"
        if not self.found.exist:
            return f"{self.frame} cannot {VERBS[self.end]} the ground at rest: no joint rates stop it"
        return f"{self.frame} {VERBS[self.end]}s the ground at rest with {self._in_words}"

    def to_dict(self) -> dict[str, Any]:
        """Return what ``--json`` prints of it; None for what is not finite."""
        content: dict[str, Any] = plain(
            {
                "frame": self.frame,
                "contact": self.found is not None,
                "ok": self.ok,
                "ratio": self.ratio,
                "joint": self.joint,
                "rates": None if self.found is None or not self.found.exist else self.rates,
                "limits": self.limits,
                "orientation_rate": self.orientation_rate,
                "angular_momentum": self.angular_momentum,
                "sentences": self.sentences,
            }
        )
        return content


@one_thread
def takeoff(problem: Problem | str | Path, angular_momentum: float | None = None) -> Contact:
    """Tell whether the takeoff frame can be at rest at takeoff within the joints' velocity limits.

    Joint rates at that one instant are looked at; neither how the robot gets there from rest, nor forces and balance.

    Parameters
    ----------
    problem : Problem, or path of a problem file
    angular_momentum : float, optional
        kg m^2/s; left out, the problem's; where it is free, that with the least larger ratio of takeoff and landing.

    Raises
    ------
    InputError
        The problem is none, or its file is wrong; or the angular momentum is no number in its range.
    """
    return _contact(problem, "takeoff", angular_momentum)


@one_thread
def landing(problem: Problem | str | Path, angular_momentum: float | None = None) -> Contact:
    """Tell whether the landing frame can be at rest at landing; see :func:`takeoff`."""
    return _contact(problem, "landing", angular_momentum)


def momentum_of_ends(problem: Problem, angular_momentum: float | None = None) -> tuple[Momentum, float]:
    """Return h as given, or asked for, and in kg m^2/s; where it is free, the one that suits both ends best."""
    asked = problem.flight.momentum_in_plane if angular_momentum is None else angular_momentum
    if asked == "free":
        shared = shared_momentum(problem)
        asked = "midpoint" if shared is None else shared
    return asked, momentum_asked(problem, asked)


def reachable_sets(problem: Problem) -> dict[str, Reachable]:
    """Return what joint rates reach at the ends where a frame stands on the ground, about what the problem asks.

    Where h is free it is the one that lets the joints be slowest at both together.
    """
    _, momentum = momentum_of_ends(problem)
    return {end: reachable(problem, end, momentum) for end in get_args(End) if has_contact(problem, end)}


def no_common_momentum(problem: Problem) -> str | None:
    """Tell where h is free and each end has its own that the limits allow, but none that suits both."""
    if problem.flight.momentum_in_plane != "free":
        return None
    ends: tuple[End, ...] = ("takeoff", "landing")
    best = [contact_rates(problem, end, None) for end in ends if has_contact(problem, end)]
    if len(best) < 2 or not all(found.ratio is not None and found.ratio <= 1 + RELATIVE for found in best):
        return None
    pairs = zip(ends, best, strict=True)
    first, last = (reachable(problem, end, found.angular_momentum).angular_momentum for end, found in pairs)
    if first is None or last is None or max(first[0], last[0]) <= min(first[1], last[1]):
        return None
    return (
        "No angular momentum suits both ends: within the velocity limits takeoff takes"
        f" {first[0]:.4g} to {first[1]:.4g} kg m^2/s, landing {last[0]:.4g} to {last[1]:.4g} kg m^2/s."
    )


def _contact(given: Problem | str | Path, end: End, angular_momentum: float | None) -> Contact:
    problem = given_problem(given)
    asked, momentum = momentum_of_ends(
        problem, optional(number("angular_momentum"))(angular_momentum, "angular_momentum")
    )
    if not has_contact(problem, end):
        return Contact(problem, end, asked, None)
    rates, point = min(_rates_of_points(problem, end, momentum), key=lambda found: found[0].size)
    return Contact(problem, end, asked, rates, point)


def _rates_of_points(problem: Problem, end: End, momentum: float) -> list[tuple[ContactRates, Frame]]:
    """Rates with which each point is at rest that the foot may stand on at an end, the frame first."""
    robot, limits = problem.robot, rate_limits(problem)
    frame, orientation, positions, com_velocity = at_end(problem, end)
    points = [frame] if problem.jump is None else [frame, *lowest_points(problem, end)]
    equations = [equations_at(robot, point, orientation, positions, com_velocity) for point in points]
    rates = [rates_at(robot, each, limits, momentum) for each in equations]
    return list(zip(rates, points, strict=True))


def lowest_points(problem: Problem, end: End) -> list[Frame]:
    """The points of the foot's true shape that are lowest at an end: its toe, its tip, or where it is round its bottom.

    A stance stands on one of them, or on the frame: which of them rests is its own business.
    """
    robot, tree = problem.robot, problem.robot.tree
    frame, orientation, positions, _ = at_end(problem, end)
    try:
        link = robot.contact_link(frame.link)
        shapes = robot.link_hulls[link] if link is not None else ()
    except InputError:  # what is to be known of shapes is not to be had, such as a mesh
        return []
    rotations = tree.rotations(tree.absolute_angles(np.array(orientation), positions))
    points: list[Frame] = []
    heights: list[float] = []
    for shape in shapes:
        down = -1j * np.conj(rotations[shape.body])  # in the body's axes
        for corner in (shape.start, shape.end):
            point = Frame(shape.body, complex(corner + shape.radius * down), frame.link)
            points.append(point)
            heights.append(float((frame_weights(robot, point) @ rotations).imag))
    lowest = min(heights, default=0.0)
    return [point for point, height in zip(points, heights, strict=True) if height < lowest + LEVEL]


def _why_none(problem: Problem, found: ContactRates) -> str:
    joints = len(problem.robot.joints)
    if joints == 1:
        return "the base and one joint have two rates for three conditions, no velocity and the angular momentum"
    return (
        f"in this posture no joint rates stop it at an angular momentum of {found.angular_momentum:.4g} kg m^2/s;"
        " joints that are stretched out cannot, bend them"
    )


def _share(found: ContactRates) -> float:
    """Of a velocity limit; without limits, of what is fast."""
    return found.size / (FAST if found.ratio is None else 1.0)


def in_words(found: ContactRates) -> str:
    """Return that share, or without limits the rate, in words."""
    number = found.size
    if not math.isfinite(number):
        return "joint rates that do not exist"
    if found.ratio is None:
        return f"{number:.3g} rad/s"
    return f"{100 * number:.0f} % of a velocity limit" if number <= 1 else f"{number:.3g} times a velocity limit"


@dataclass(frozen=True, eq=False)
class _Trial:
    """One end of a flight with another duration, s, posture (n,), rad, or the best momentum instead of the asked."""

    duration: float
    positions: Array
    free: bool


class _Trials:
    """Rates of trials at one end of a problem's flight; the frame stays where it is, at the base's orientation."""

    def __init__(self, problem: Problem, end: End, momentum: Momentum) -> None:
        self._problem, self._end, self._momentum = problem, end, momentum
        self._frame, self._orientation, positions, _ = at_end(problem, end)
        self._limits = rate_limits(problem)
        self._weights = np.array([frame_weights(problem.robot, frame) for frame in problem.robot.frames.values()])
        self.asked = _Trial(problem.flight.duration, positions, False)
        self._own_height, lowest = self._heights(positions)
        self._floor = lowest - self._own_height - SINKING

    def rates(self, trial: _Trial) -> ContactRates:
        """Return the least rates of a trial."""
        velocity = self._com_velocity(trial)
        equations = equations_at(self._problem.robot, self._frame, self._orientation, trial.positions, velocity)
        return rates_at(self._problem.robot, equations, self._limits, self._angular_momentum(trial))

    def _angular_momentum(self, trial: _Trial) -> float | None:
        problem = self._problem
        if trial.free:
            return None
        if self._momentum != "midpoint":
            return self._momentum
        start, goal = problem.initial, problem.final
        ends = (trial.positions, goal.positions) if self._end == "takeoff" else (start.positions, trial.positions)
        changes = np.array([goal.orientation - start.orientation, *(ends[1] - ends[0])])
        low, high = momentum_intervals(problem, changes, np.array(trial.duration))
        return float(low + high) / 2

    def _com_velocity(self, trial: _Trial) -> Array:
        """As of the problem, for another duration, or another height of the centre of mass over the frame."""
        path, duration = ballistics(self._problem), self._problem.flight.duration
        rise = path.velocity0[1] * duration - path.gravity * duration**2 / 2
        sign = 1 if self._end == "takeoff" else -1
        rise += sign * (self._heights(trial.positions)[0] - self._own_height)
        return np.array([path.velocity0[0], rise / trial.duration + sign * path.gravity * trial.duration / 2])

    def _heights(self, positions: Array) -> tuple[float, float]:
        """Heights of the contact frame and of the lowest frame over the centre of mass, m."""
        tree = self._problem.robot.tree
        rotations = tree.rotations(tree.absolute_angles(np.array(self._orientation), positions))
        own = float((frame_weights(self._problem.robot, self._frame) @ rotations).imag)
        return own, float((self._weights @ rotations).imag.min())

    def cost(self, trial: _Trial) -> float:
        """Least for the trial nearest to the asked one among those that are slow enough."""
        change = float(np.linalg.norm(trial.positions - self.asked.positions))
        change += abs(math.log(trial.duration / self.asked.duration))
        return max(_share(self.rates(trial)), ENOUGH) + CHANGE * change

    def longer_or_shorter(self) -> _Trial:
        """Return the asked flight with the best duration: a scan, then golden sections about its best."""

        def cost(duration: float) -> float:
            return self.cost(replace(self.asked, duration=duration))

        durations = (self.asked.duration * DURATIONS).tolist()
        index = int(np.argmin([cost(duration) for duration in durations]))
        low, high = durations[max(index - 1, 0)], durations[min(index + 1, len(durations) - 1)]
        for _ in range(REFINEMENTS):
            inner, outer = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
            low, high = (low, outer) if cost(inner) <= cost(outer) else (inner, high)
        return replace(self.asked, duration=min((durations[index], (low + high) / 2), key=cost))

    def changes(self, trial: _Trial, rates: ContactRates) -> Iterator[str]:
        """What is other than asked, in words."""
        problem = self._problem
        if trial.duration != self.asked.duration:
            yield f"a duration of {trial.duration:.3g} s"
        if trial.positions is not self.asked.positions:
            degrees = np.rad2deg(trial.positions).tolist()
            joints = (f"{joint} at {angle:.4g}" for joint, angle in zip(problem.robot.joints, degrees, strict=True))
            yield f"{', '.join(joints)} degrees"
        if trial.free or problem.flight.momentum_in_plane == "free":
            yield f"an angular momentum of {rates.angular_momentum:.5g} kg m^2/s"

    def postures(self, begin: _Trial, *, durations: bool) -> _Trial:
        """Return the best of seeded steps from a trial: of the joints, and of the duration where asked for."""
        low, high = self._problem.position_limits.T
        edge = INSIDE * (high - low)
        rng = np.random.default_rng(0)
        best, least = begin, self.cost(begin)
        for step in np.geomspace(*STEPS, TRIALS):
            turned = best.positions + step * rng.standard_normal(len(low))
            duration = best.duration * math.exp(step * rng.standard_normal()) if durations else best.duration
            trial = replace(
                best,
                positions=np.clip(turned, low + edge, high - edge),
                duration=float(np.clip(duration, *(self.asked.duration * DURATIONS[[0, -1]]))),
            )
            own, lowest = self._heights(trial.positions)
            if lowest - own >= self._floor and (cost := self.cost(trial)) < least:
                best, least = trial, cost
        return best


def advice(problem: Problem, end: End, momentum: Momentum) -> Iterator[str]:
    """Tell what the best angular momentum, duration and posture would make of the rates; bounded work.

    Parameters
    ----------
    momentum : kg m^2/s, or "midpoint"
    """
    trials = _Trials(problem, end, momentum)
    asked = trials.asked
    least = _share(trials.rates(asked))
    longer = trials.longer_or_shorter()
    tried = [replace(asked, free=True), longer, trials.postures(asked, durations=False)]
    shares = [_share(trials.rates(trial)) for trial in tried]
    if min(shares) > 1:
        tried.append(trials.postures(replace(longer, free=True), durations=True))
    for trial in tried:
        rates = trials.rates(trial)
        if _share(rates) < WORTH_TELLING * least:
            yield f"With {', '.join(trials.changes(trial, rates))} it takes {in_words(rates)}."
