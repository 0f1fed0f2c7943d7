"""Phases of a jump: which contacts stand when, for how long; and the standing posture at both ends."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, least_squares, minimize

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.contacts import LEVEL, Contact
from floatplan.robot import PlanarTree, Robot
from floatplan.robot.standing import heights_over_com

# Of phases: guessed duration, sqrt(height / g); intervals; least and largest share of that duration, if none is asked
FLIGHT = (2.57, 16, 0.8, 1.5)  # with a turn
HOP = (1.2, 16, 0.3, 1.5)  # without one
STANCES = {  # where there is one phase, and two
    "takeoff": [[(2.73, 28, 0.5, 1.6)], [(1.7, 18, 0.5, 1.6), (1.03, 18, 0.5, 1.6)]],
    "landing": [[(3.16, 28, 0.5, 1.6)], [(0.86, 18, 0.5, 1.6), (2.3, 18, 0.5, 1.6)]],
}
INSIDE = 0.2  # [-] of the support, that the centre of mass keeps from its ends where the robot stands
SLOWEST = 0.1  # [-] of an even step is the step next to the flight; steps grow linearly from there
GENTLE = 0.1  # [-] of a phase's duration, at its end next to the flight, in which forces may vanish gently
ATTEMPTS = 10  # [-] random postures from which a standing one is looked for
UNSTEADY = 1.0  # [-] cost of time on one point, over sqrt(height / g): there errors grow by a factor e in as much
STILL = 1e-6  # [m] what counts as level
EXACT = 1e-14  # [-] of the search for what is as level as numbers are

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
    gentle : whether forces may vanish towards the flight as gently as they like
    """

    side: Side
    contacts: tuple[Contact, ...]
    duration: float
    bounds: tuple[float, float]
    intervals: int
    gentle: bool = False

    @property
    def name(self) -> str:
        """Side and contacts, for a person."""
        return self.side + (" on " if self.contacts else "") + " and ".join(each.name for each in self.contacts)

    @property
    def anchor(self) -> Contact:
        """The contact from which places are measured."""
        return self.contacts[0]

    @cached_property
    def shares(self) -> Array:
        """Times (intervals + 1,) of its nodes over its duration: denser near the flight."""
        even = np.linspace(0.0, 1.0, self.intervals + 1)
        if self.side == "flight":
            return even
        away = 1 - even if self.side == "takeoff" else even
        apart = away * (SLOWEST + (1 - SLOWEST) * away)
        return 1 - apart if self.side == "takeoff" else apart

    @cached_property
    def firm(self) -> Array:
        """Shares (intervals + 1,) of the usual room within their bounds, which forces keep at its nodes."""
        away = 1 - self.shares if self.side == "takeoff" else self.shares
        return np.minimum(away / GENTLE, 1.0) if self.gentle else np.ones_like(away)

    @property
    def others(self) -> tuple[Contact, ...]:
        """The contacts beside the anchor."""
        return self.contacts[1:]

    def gathered(self, forces: Mapping[str, Array]) -> Array:
        """Forces (2 others, N) of the contacts beside the anchor, from those (N, 2) of points by their names."""
        sums = [np.sum([forces[name] for name in each.names], axis=0).T for each in self.others]
        return np.concatenate([np.empty((0, self.intervals + 1)), *sums])

    def own_joints(self, tree: PlanarTree, contact: Contact) -> list[int]:
        """Indices of the joints that keep a contact beside the anchor where it stands: its leg's, from the foot up.

        Raises
        ------
        InputError
            The leg has too few of its own.
        """
        body = contact.spots[0].body
        own: list[int] = []
        count = 1 if contact.vertical else 2
        held = np.zeros(tree.turns.shape[1]) if contact.vertical else tree.turns[self.anchor.spots[0].body]
        while body > 0:
            joints = np.flatnonzero(tree.turns[body] - tree.turns[tree.parent[body]]).tolist()
            own += [joint for joint in joints if not held[joint] and joint not in own]
            body = int(tree.parent[body])
        if len(own) < count:
            reason = f"the leg of {contact.name!r} has too few joints to stand beside {self.anchor.name!r}"
            raise InputError(reason, element=f"jump.{self.side}.contacts", advice="name one foot alone")
        return own[:count]


@dataclass(frozen=True, eq=False)
class Meeting:
    """What is known of one end of the flight.

    Attributes
    ----------
    node : 0, its first, or -1, its last
    y : (n+1,) rad
    v, a : (n+1,) rad/s, rad/s^2; None where nothing is asked of them
    com : horizontal and vertical velocity of the centre of mass, m/s; None where that follows
    """

    node: int
    y: Array
    v: Array | None = None
    a: Array | None = None
    com: tuple[float, float] | None = None


def side_phases(
    side: Side,
    groups: Sequence[tuple[Contact, ...]],
    unit: float,
    bounds: Sequence[tuple[float, float] | None],
    turns: int = 0,
) -> list[Phase]:
    """Return the phases of a side of the flight, or the flight, with generic durations.

    Parameters
    ----------
    side : "takeoff", "flight" or "landing"
    groups : contacts of its one or two phases, in order of time
    unit : sqrt(height / g) of the centre of mass where the robot stands, s
    bounds : of their durations, s; None for generic ones
    turns : of the base in flight
    """
    usual = [FLIGHT if turns else HOP] if side == "flight" else STANCES[side][len(groups) - 1]
    anchor = groups[-1 if side == "takeoff" else 0][:1]
    phases: list[Phase] = []
    for contacts, (share, intervals, least, most), given in zip(groups, usual, bounds, strict=True):
        guess = share * unit
        low, high = given or (least * share * unit, most * share * unit)
        ordered = tuple(sorted(contacts, key=lambda each: (each,) != anchor))
        phases.append(Phase(side, ordered, min(max(guess, low), high), (low, high), intervals))
    return phases


def instants(phases: Sequence[Phase], durations: Array) -> Array:
    """Times (K+1,) of the nodes of phases that last so long, s."""
    times = np.zeros(1)
    for phase, lasts in zip(phases, durations, strict=True):
        times = np.append(times, times[-1] + lasts * phase.shares[1:])
    return times


def unsteady(phases: Sequence[Phase]) -> list[float]:
    """Costs of the phases' durations: of those on one point, where more stand on the same side of the flight."""
    sides = {phase.side for phase in phases if phase.others}
    return [UNSTEADY if not phase.others and phase.side in sides else 0.0 for phase in phases]


def standing_posture(robot: Robot, contacts: Sequence[Contact], wanted: Array, limits: Array) -> Array | None:
    """Return orientation and joints (n+1,) rad, nearest to the wanted ones, in which the robot stands still.

    All contacts are on level ground, and the centre of mass is over them: inside their span, or above the one point.
    None where no such posture is found.

    Parameters
    ----------
    contacts : all on which it stands
    wanted : (n+1,) rad
    limits : (n+1, 2) rad
    """
    spots = [each.spots[0] for each in contacts]
    depths = np.array([each.depth for each in contacts])

    one = np.ptp(heights_over_com(robot, spots, wanted).real) < STILL

    def levels(positions: Array) -> Array:
        """Heights of the contacts relative to the first; and where the one is, from under the centre of mass."""
        places = heights_over_com(robot, spots, positions)
        ground = places.imag - depths
        return np.append(ground[1:] - ground[0], places.real[:1] if one else [])

    def span(positions: Array) -> Array:
        """Ends of the support, less room, from under the centre of mass."""
        along = heights_over_com(robot, spots, positions).real
        room = INSIDE * np.ptp(along)
        return np.array([-(along.min() + room), along.max() - room])

    def stands(positions: Array) -> bool:
        inside = one or bool(span(positions).min() >= -STILL)
        return inside and bool(np.abs(levels(positions)).max(initial=0.0) < STILL)

    if stands(wanted) and (limits[:, 0] <= wanted).all() and (wanted <= limits[:, 1]).all():
        return _polished(levels, wanted) if one else wanted
    constraints = [NonlinearConstraint(levels, 0.0, 0.0)]
    if not one:
        constraints.append(NonlinearConstraint(span, 0.0, np.inf))
    low, high = limits.T
    drawn = np.random.default_rng(0).uniform(low[1:], high[1:], (ATTEMPTS, len(low) - 1))
    for start in (np.clip(wanted, low, high), *np.insert(drawn, 0, wanted[0], axis=1)):
        found = minimize(  # type: ignore[call-overload]
            lambda q: float(((q - wanted) ** 2).sum()),
            start,
            jac=lambda q: 2 * (q - wanted),
            bounds=Bounds(low, high),
            constraints=constraints,
            method="SLSQP",
            options={"ftol": 1e-12, "maxiter": 200},
        )
        if stands(found.x):
            return _polished(levels, found.x) if one else np.asarray(found.x)
    return None


def _polished(levels: Callable[[Array], Array], y: Array) -> Array:
    """Return the posture (n+1,) next to one whose ``levels`` nearly vanish, in which they do; the base stays.

    At rest on one point nothing but the posture puts the centre of mass over it: what it is off by is a moment that no
    force takes up.
    """

    def of_joints(joints: Array) -> Array:
        return levels(np.append(y[0], joints))

    found = least_squares(of_joints, y[1:], ftol=EXACT, xtol=EXACT, gtol=EXACT)
    return np.append(y[0], found.x)


def not_static(robot: Robot, contacts: Sequence[Contact], positions: Array) -> str:
    """Why a robot does not stand still on contacts in a posture (n+1,), for a person."""
    places = heights_over_com(robot, [each.spots[0] for each in contacts], positions)
    undersides = places.imag - [each.depth for each in contacts]
    step = float(np.ptp(undersides))
    if step > LEVEL:
        highest = contacts[int(undersides.argmax())].name
        return f"its feet are {1e3 * step:.0f} mm apart in height, {highest!r} is the highest"
    inside = min(-places.real.min(), places.real.max())
    front = contacts[int(places.real.argmax())].name
    rear = contacts[int(places.real.argmin())].name
    ahead = places.real.max() < -places.real.min()  # of the middle of the feet is the centre of mass
    end = f"ahead of {front!r}" if ahead else f"behind {rear!r}"
    if inside < -STILL:
        return f"its centre of mass is {-1e3 * inside:.0f} mm outside its feet, {end}"
    room = INSIDE * np.ptp(places.real)
    if inside < room:
        return (
            f"its centre of mass is {1e3 * inside:.0f} mm from the end of its feet, {front if ahead else rear!r},"
            f" {1e3 * room:.0f} mm at least"
        )
    return "a joint is too near the end of its range"


def static_beyond_ranges(robot: Robot, contacts: Sequence[Contact], wanted: Array, limits: Array) -> str:
    """Say which joints leave their ranges where a robot would stand still on contacts; empty where it never does.

    Parameters
    ----------
    contacts, wanted, limits : as of :func:`standing_posture`, which finds no posture
    """
    wide = np.column_stack((np.minimum(limits[:, 0], wanted - np.pi), np.maximum(limits[:, 1], wanted + np.pi)))
    wide[0] = limits[0]
    static = standing_posture(robot, contacts, wanted, wide)
    if static is None:
        return ""
    beyond = [
        f"{joint} at {at:.3g} rad, where {low:.3g} to {high:.3g} rad are left of its range"
        for joint, at, (low, high) in zip(robot.joints, static[1:], limits[1:], strict=True)
        if not low - STILL <= at <= high + STILL
    ]
    return f"static would be {' and '.join(beyond)}" if beyond else ""
