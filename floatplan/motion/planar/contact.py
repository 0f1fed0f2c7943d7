"""Whether a flight can begin and end: the rates with which its frames leave and meet the ground at rest."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import compress
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np

from floatplan.arguments import Outlined, number, optional
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.files import json_value
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
from floatplan.problem.file import as_problem
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Frame
from floatplan.robot.standing import FLAT
from floatplan.tables import RELATIVE

VERBS: dict[End, str] = {"takeoff": "leave", "landing": "meet"}
FAST = 40.0  # [rad/s] that no joint of a legged robot turns at

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
        As requested, see :class:`~floatplan.Flight`; where it is free, the one that suits both ends best.
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
        """As requested, or the one that suits both ends best where it is free; about the centre of mass, kg m^2/s."""
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

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict, for a person."""
        return (self.verdict,)

    @cached_property
    def verdict(self) -> str:
        """Whether the frame can be at rest, at what share of which limit, for a person."""
        solution = self.found
        verb = VERBS[self.end]
        if solution is None:
            return (
                f"No frame stands on the ground at {self.end}: {self.frame} is the base link, which flies freely;"
                f" flight.{self.end} can name another frame."
            )
        if not solution.exist:
            return f"{self.frame} cannot {verb} the ground at rest at {self.end}: {_why_none(self.problem, solution)}."
        if solution.joint is None:
            return f"{self.frame} {verb}s the ground at rest at {self.end}, with every limited joint at rest."
        if solution.ratio is None:
            return (
                f"{self.frame} {verb}s the ground at rest at {self.end} with joints that turn at up to"
                f" {self._in_words}, {solution.joint} before all; no motor has a velocity limit."
            )
        rates = f"{solution.joint} at {self.rate:.4g} rad/s where {self.limit:.4g} rad/s are allowed"
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
        content: dict[str, Any] = json_value(
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
    """Return h as requested, and in kg m^2/s; where it is free, the one that suits both ends best."""
    requested = problem.flight.momentum_in_plane if angular_momentum is None else angular_momentum
    if requested == "free":
        shared = shared_momentum(problem)
        requested = "midpoint" if shared is None else shared
    return requested, sum(problem.momentum_interval) / 2 if isinstance(requested, str) else float(requested)


def reachable_sets(problem: Problem) -> dict[str, Reachable]:
    """Return what joint rates reach at the ends where a frame stands on the ground, about what the problem asks.

    Where h is free it is the one that lets the joints be slowest at both.
    """
    _, momentum = momentum_of_ends(problem)
    return {end: reachable(problem, end, momentum) for end in get_args(End) if has_contact(problem, end)}


def no_common_momentum(problem: Problem) -> str | None:
    """Tell where h is free and both ends have one of their own that the limits allow, but none suits both."""
    if problem.angular_momentum is not None:
        return None
    ends: tuple[End, ...] = ("takeoff", "landing")
    best = [contact_rates(problem, end, None) for end in ends if has_contact(problem, end)]
    if len(best) < 2 or not all(solution.ratio is not None and solution.ratio <= 1 + RELATIVE for solution in best):
        return None
    first = reachable(problem, ends[0], best[0].angular_momentum).angular_momentum
    last = reachable(problem, ends[1], best[1].angular_momentum).angular_momentum
    if first is None or last is None or max(first[0], last[0]) <= min(first[1], last[1]):
        return None
    return (
        "No angular momentum suits both ends: within the velocity limits takeoff takes"
        f" {first[0]:.4g} to {first[1]:.4g} kg m^2/s, landing {last[0]:.4g} to {last[1]:.4g} kg m^2/s."
    )


def _contact(source: Problem | str | Path, end: End, angular_momentum: float | None) -> Contact:
    problem = as_problem(source)
    requested, momentum = momentum_of_ends(
        problem, optional(number("angular_momentum"))(angular_momentum, "angular_momentum")
    )
    if not has_contact(problem, end):
        return Contact(problem, end, requested, None)
    rates, point = min(_rates_of_points(problem, end, momentum), key=lambda solution: solution[0].size)
    return Contact(problem, end, requested, rates, point)


def _rates_of_points(problem: Problem, end: End, momentum: float) -> list[tuple[ContactRates, Frame]]:
    """Rates with which a point is at rest that the foot may stand on at an end, of all of these, the frame first."""
    robot = problem.robot
    limits = rate_limits(problem)
    frame, orientation, positions, com_velocity = at_end(problem, end)
    points = [frame] if problem.jump is None else [frame, *lowest_points(problem, end)]
    equations = [equations_at(robot, point, orientation, positions, com_velocity) for point in points]
    rates = [rates_at(robot, equation, limits, momentum) for equation in equations]
    return list(zip(rates, points, strict=True))


def lowest_points(problem: Problem, end: End) -> list[Frame]:
    """The points of the foot's true shape that are lowest at an end: its toe, its tip, or where it is round its bottom.

    A stance stands on one of them, or on the frame: which of them rests is its own business.
    """
    robot = problem.robot
    tree = problem.robot.tree
    frame, orientation, positions, _ = at_end(problem, end)
    try:
        link = robot.contact_link(frame.link)
        shapes = robot.link_hulls[link] if link is not None else ()
    except InputError:  # shapes cannot be read, such as a mesh
        return []
    rotations = tree.rotations(tree.absolute_angles(np.array(orientation), positions))
    points: list[Frame] = []
    heights: list[float] = []
    for shape in shapes:
        down = -1j * np.conj(rotations[shape.body])  # in the body's axes
        for corner in (shape.start, shape.end):
            point_on_body = complex(corner + shape.radius * down)
            weights = tree.point_weights(np.array([shape.body]), np.array([point_on_body]))[0]
            points.append(Frame(shape.body, point_on_body, frame.link, weights))
            heights.append(float((weights @ rotations).imag))
    lowest = min(heights, default=0.0)
    return list(compress(points, np.array(heights) < lowest + FLAT))


def _why_none(problem: Problem, solution: ContactRates) -> str:
    joints = len(problem.robot.joints)
    if joints == 1:
        return "the base and one joint have two rates for three conditions, no velocity and the angular momentum"
    return (
        f"in this posture no joint rates stop it at an angular momentum of {solution.angular_momentum:.4g} kg m^2/s;"
        " joints that are stretched out cannot, bend them"
    )


def in_words(solution: ContactRates) -> str:
    """Return that share, or without limits the rate, in words."""
    number = solution.size
    if not math.isfinite(number):
        return "joint rates that do not exist"
    if solution.ratio is None:
        return f"{number:.3g} rad/s"
    return f"{100 * number:.0f} % of a velocity limit" if number <= 1 else f"{number:.3g} times a velocity limit"
