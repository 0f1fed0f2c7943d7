"""A judge of plans that shares nothing with the proof: dense evaluation, and 50 digits where doubles cannot tell.

A plan is judged at 20 001 instants and the ends of windows. A violation beyond the stated tolerance by more than 1e-9
of its unit (rad, m, or the limit itself; more where stated) is decided by the evaluation in doubles, whose error is far
below that; wherever a value lies nearer than that to what is allowed, 50 digits decide, instant by instant.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import flint
import numpy as np
import proof_reference as reference
from flint import arb
from proof_sharp import BITS, Sharp

from floatplan.plans.record import PlanRecord
from floatplan.robot.robot import Robot

INSTANTS = 20_001
COARSE = 20  # first look at every 20th instant: what is violated there needs no second
CLOSE = 1e-9


@dataclass(frozen=True)
class Question:
    """One constraint.

    ``excess`` (N,) is the violation beyond the tolerance at ``times`` (N,), in doubles, off by less than ``noise``;
    ``sharp`` gives it with 50 digits at an instant; ``room`` is what a plan that is clearly valid has left.
    ``needs_all``: it compares with an extreme, which a few instants do not show.
    """

    excess: np.ndarray
    times: np.ndarray
    sharp: Callable[[float], arb] | None
    room: float
    noise: float = CLOSE
    needs_all: bool = False


@dataclass
class Judge:
    """Judges plans, and counts the values that took 50 digits."""

    instants: int = INSTANTS
    sharp_values: int = 0

    def __call__(self, robot: Robot, record: PlanRecord) -> str:
        """Say "invalid" where a violation beyond the tolerance is seen, "valid" where there is room, else "unclear"."""
        coarse = self._verdict(robot, record, (self.instants - 1) // COARSE + 1)
        return coarse if coarse == "invalid" else self._verdict(robot, record, self.instants)

    def _verdict(self, robot: Robot, record: PlanRecord, instants: int) -> str:
        verdict = "valid"
        for question in questions(robot, record, instants):
            if question.needs_all and instants < self.instants:
                continue
            if self._violated(question):
                return "invalid"
            if not question.excess.max() < -question.room:
                verdict = "unclear"
        return verdict

    def _violated(self, question: Question) -> bool:
        if question.excess.max() > question.noise:
            return True
        if question.sharp is None:
            return False
        near = np.flatnonzero(question.excess >= -question.noise)
        self.sharp_values += len(near)
        with flint.ctx.workprec(BITS):
            return any(question.sharp(t) > 0 for t in question.times[near].tolist())


def questions(robot: Robot, record: PlanRecord, instants: int) -> Iterator[Question]:
    """All that the certificate states of plans made by :mod:`proof_mutations`."""
    dense = evaluated(_motion_key(record), record, robot, instants, _inside_ends(record))
    sharp = Sharp(robot, record)
    yield from _ends(robot, record, dense, sharp)
    yield from _same(record)
    yield from _limits(record, dense, sharp)
    yield from _clearances(robot, record, dense, sharp)


class _Key:
    """A record that is equal to another where their motions about the centre of mass are."""

    def __init__(self, key, value):
        self.key, self.value = key, value

    def __eq__(self, other):
        return self.key == other.key

    def __hash__(self):
        return hash(self.key)


def _motion_key(record):
    return (
        record.coefficients.tobytes(),
        record.angular_momentum,
        record.duration,
        record.orientation["start"],
        record.robot.sha256,
    )


def evaluated(key, record, robot, instants, ends):
    """The dense evaluation, remembered for the latest motions."""
    return _evaluated(_Key((key, instants, ends), (record, robot)))


@lru_cache(maxsize=16)
def _evaluated(case):
    (_, instants, ends), (record, robot) = case.key, case.value
    times = np.unique([*np.linspace(0.0, record.duration, instants), *ends])
    return reference.evaluate(robot, record, times, gauss=2 if instants > 10_000 else 4)


def _clear(robot, record, dense, obstacle):
    com = tuple(np.ravel([record.com[key] for key in ("position0", "velocity0")]).tolist())
    table = tuple(sorted((key, str(value)) for key, value in obstacle.items() if key != "margin"))
    return _distances(_Key((_motion_key(record), len(dense.times), com, table), (robot, record, dense, obstacle)))


@lru_cache(maxsize=64)
def _distances(case):
    return reference.clearance(*case.value)


def _inside_ends(record):
    ends = [end for obstacle in record.problem["obstacles"] for end in obstacle.get("window") or ()]
    return tuple(end for end in ends if 0.0 < end < record.duration)


def _at(instant, excess, sharp, room, noise=CLOSE, needs_all=False):
    return Question(np.array([excess]), np.array([instant]), sharp, room, noise, needs_all)


def _ends(robot, record, dense, sharp):
    """Orientation, joints and frames at takeoff and landing."""
    problem, flight, duration = record.problem, record.problem["flight"], record.duration
    for number in (problem["goal"]["orientation"], record.orientation["end"]):
        yield _at(
            duration,
            abs(dense.orientation[-1] - number) - 1e-8,
            lambda t, number=number: abs(sharp.orientation(t) - arb(number)) - arb(1e-8),
            1e-10,
        )
    kinds = (("positions", 1e-8, CLOSE), ("velocities", 1e-7, CLOSE), ("accelerations", 1e-5, 1e-7))
    for which, instant, index in (("start", 0.0, 0), ("goal", duration, -1)):
        for order, (kind, tolerance, noise) in enumerate(kinds):
            wanted = problem[which][kind]
            off = np.abs(getattr(dense, kind)[index] - wanted).max() - tolerance

            def exactly(t, order=order, wanted=wanted, tolerance=tolerance):
                states = sharp.joints(arb(t))[order]
                return max(abs(a - arb(b)) for a, b in zip(states, wanted, strict=True)) - arb(tolerance)

            yield _at(instant, off, exactly, 1e-3 * tolerance, noise)
    asked, height = flight["takeoff"]["position"], flight["landing"]["height"]
    foot = reference.frame_place(robot, record, dense, flight["takeoff"]["frame"], 0)
    hand = reference.frame_place(robot, record, dense, flight["landing"]["frame"], -1)

    def place(name, t):
        frame = robot.frames[name]
        return sharp.points(t, [frame.body], [frame.local])[0]

    def foot_off(t):
        seen = place(flight["takeoff"]["frame"], t)
        return max(abs(seen.real - arb(asked[0])), abs(seen.imag - arb(asked[1]))) - arb(1e-8)

    yield _at(0.0, max(abs(foot.real - asked[0]), abs(foot.imag - asked[1])) - 1e-8, foot_off, 1e-10)
    yield _at(
        duration,
        abs(hand.imag - height) - 1e-8,
        lambda t: abs(place(flight["landing"]["frame"], t).imag - arb(height)) - arb(1e-8),
        1e-10,
    )


def _same(record):
    """Numbers that the file holds twice, compared as fractions."""
    problem = record.problem
    pairs = [
        (record.orientation["start"], problem["start"]["orientation"]),
        (record.orientation["goal"], problem["goal"]["orientation"]),
        (record.com["velocity0"][0], problem["flight"]["horizontal_velocity"]),
        (record.com["gravity"], problem["flight"]["gravity"]),
    ]
    if not isinstance(problem["flight"]["angular_momentum"], str):
        pairs.append((record.angular_momentum, problem["flight"]["angular_momentum"]))
    for number, other in pairs:
        off = abs(Fraction(number) - Fraction(other)) - Fraction(1e-12) * max(Fraction(1), abs(Fraction(number)))
        yield _at(0.0, float(off), None, 1e-14, noise=1e-15)


def _limits(record, dense, sharp):
    """Velocities, torques, the orientation rate, and the peaks that the file claims."""
    limits, n = record.problem["limits"], len(record.robot.joints)

    def relative(values, limit, exactly):
        return Question(
            np.abs(values) / limit - 1.0 - 1e-9,
            dense.times,
            lambda t: abs(exactly(t)) - arb(limit) * (1 + arb(1e-9)),
            1e-6,
        )

    for i in range(n):
        yield relative(dense.velocities[:, i], limits["velocity"][i], lambda t, i=i: sharp.joints(arb(t))[1][i])
        yield relative(dense.torques[:, i], limits["torque"][i], lambda t, i=i: sharp.torques(arb(t))[i])
    yield relative(dense.rate, limits["orientation_rate"], lambda t: sharp.rate(arb(t)))
    for recorded, values in ((record.torque_peak, dense.torques), (record.velocity_peak, dense.velocities)):
        off = np.abs(recorded / np.abs(values).max(0) - 1.0).max() - 2e-3
        yield _at(0.0, off, None, 2e-4, noise=2e-5, needs_all=True)


def _clearances(robot, record, dense, sharp):
    """Distances to obstacles, and the least one that the file claims."""
    least = np.inf
    for obstacle in record.problem["obstacles"]:
        distance = _clear(robot, record, dense, obstacle)
        least = min(least, distance.min())

        def violation(t, obstacle=obstacle):
            return arb(obstacle["margin"]) - arb(1e-8) - sharp.clearance(t, obstacle)

        yield Question(
            obstacle["margin"] - 1e-8 - distance,
            dense.times,
            violation,
            5e-9 if obstacle["kind"] == "half-plane" else 1e-6,
        )
    yield _at(0.0, abs(record.clearance_min - least) - 2e-4, None, 1e-6, noise=1e-6, needs_all=True)
