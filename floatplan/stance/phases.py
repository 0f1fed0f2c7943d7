"""Phases of a jump: which contacts stand when, for how long; and the standing posture at both ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.optimize import minimize

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot import Robot
from floatplan.stance.contacts import Contact, heights_over_com

SHARES = {"takeoff": ((1.7, 1.03), (2.73,)), "flight": (2.57,), "landing": ((0.86, 2.3), (3.16,))}  # [sqrt(H/g)]
INTERVALS = {"takeoff": (14, 14), "flight": 16, "landing": (14, 14)}
SINGLE = 28  # [-] intervals of a stance that has one phase
WIDEST = {
    "takeoff": (0.5, 1.6),
    "flight": (0.8, 1.5),
    "landing": (0.5, 1.6),
}  # [-] of a phase's guessed duration, unless bounds are given
INSIDE = 0.2  # [-] of the support, that the centre of mass keeps from its ends where the robot stands
DENSER = 1.3  # [-] power by which nodes are denser near the flight
STILL = 1e-6  # [m] what counts as level

Side = Literal["takeoff", "flight", "landing"]


@dataclass(frozen=True)
class Phase:
    """A time in which the contacts do not change.

    Attributes
    ----------
    side : "takeoff", "flight" or "landing"
    contacts : those that stand; the anchor, which stands in all phases of its side, first
    duration : guessed, s
    bounds : of the duration, s
    intervals : between the nodes of the program
    """

    side: Side
    contacts: tuple[Contact, ...]
    duration: float
    bounds: tuple[float, float]
    intervals: int

    @property
    def anchor(self) -> Contact:
        """The contact from which places are measured."""
        return self.contacts[0]

    @cached_property
    def shares(self) -> Array:
        """Times (intervals + 1,) of its nodes over its duration: denser near the flight."""
        even = np.arange(self.intervals + 1) / self.intervals
        if self.side == "flight":
            return even
        return 1 - (1 - even) ** DENSER if self.side == "takeoff" else even**DENSER

    @property
    def others(self) -> tuple[Contact, ...]:
        """The contacts beside the anchor."""
        return self.contacts[1:]


def phases_of(
    takeoff: Sequence[tuple[Contact, ...]],
    landing: Sequence[tuple[Contact, ...]],
    height: float,
    gravity: float,
    bounds: Sequence[tuple[float, float] | None],
) -> tuple[Phase, ...]:
    """Return the phases of a jump, with generic durations.

    Parameters
    ----------
    takeoff, landing : contacts of their phases, in order of time
    height : of the centre of mass where the robot stands, m
    gravity : m/s^2
    bounds : of the durations of all phases, s; None for generic ones
    """
    unit = math.sqrt(height / gravity)
    sides: list[tuple[Side, Sequence[tuple[Contact, ...]]]] = [
        ("takeoff", takeoff),
        ("flight", [()]),
        ("landing", landing),
    ]
    phases: list[Phase] = []
    for side, groups in sides:
        anchor = takeoff[-1][0] if side == "takeoff" else landing[0][0]
        shares = _shares(side, len(groups))
        for contacts, (share, intervals) in zip(groups, shares, strict=True):
            ordered = tuple(sorted(contacts, key=lambda each: each != anchor))
            guess, given = share * unit, bounds[len(phases)]
            low, high = given if given is not None else (WIDEST[side][0] * guess, WIDEST[side][1] * guess)
            phases.append(Phase(side, ordered, min(max(guess, low), high), (low, high), intervals))
    return tuple(phases)


def _shares(side: Side, count: int) -> list[tuple[float, int]]:
    """Guessed duration, in sqrt(height/g), and intervals of each of a side's phases."""
    if side == "flight":
        return [(SHARES["flight"][0], int(INTERVALS["flight"]))]  # type: ignore[arg-type, call-overload]
    if count == 1:
        return [(float(SHARES[side][1][0]), SINGLE)]  # type: ignore[index]
    first, last = SHARES[side][0]  # type: ignore[misc]
    many, few = INTERVALS[side]  # type: ignore[misc]
    if count == 2:
        return [(first, many), (last, few)]
    split = np.linspace(first, last, count) * (first + last) / np.linspace(first, last, count).sum()
    return [(float(each), (many + few) // count + 2) for each in split]


def standing_posture(robot: Robot, contacts: Sequence[Contact], wanted: Array, limits: Array) -> Array:
    """Return positions (n,) rad, nearest to the wanted ones, in which the robot stands still with its base level.

    All contacts are on level ground, and the centre of mass is over them: inside their span, or above the one point.

    Parameters
    ----------
    contacts : all on which it stands
    wanted : (n,) rad
    limits : (n, 2) rad

    Raises
    ------
    InputError
        There is none near by.
    """
    spots = [each.spots[0] for each in contacts]
    depths = np.array([each.depth for each in contacts])

    def faults(positions: Array) -> Array:
        places = heights_over_com(robot, spots, 0.0, positions)
        ground = places.imag - depths
        low, high = places.real.min(), places.real.max()
        if high - low < STILL:
            return np.append(ground[1:] - ground[0], low)
        room = INSIDE * (high - low)
        beyond = max(low + room, 0.0) + min(high - room, 0.0)
        return np.append(ground[1:] - ground[0], beyond)

    if np.abs(faults(wanted)).max() < STILL and (limits[:, 0] <= wanted).all() and (wanted <= limits[:, 1]).all():
        return wanted
    found = minimize(
        lambda q: float(((q - wanted) ** 2).sum()),
        np.clip(wanted, limits[:, 0], limits[:, 1]),
        jac=lambda q: 2 * (q - wanted),
        bounds=limits,
        constraints={"type": "eq", "fun": faults},
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 200},
    )
    if np.abs(faults(found.x)).max() > STILL:
        raise InputError(
            "no posture near the reference posture was found in which it stands still",
            element="jump.contacts",
            advice="give one, or other contacts",
        )
    return np.asarray(found.x)
