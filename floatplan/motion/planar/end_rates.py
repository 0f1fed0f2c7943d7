"""The rates at both ends of a flight: with a frame at rest on request, and not into the ground."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError, refuse
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.planar.closed_form import tree_dynamics
from floatplan.motion.planar.contact_rates import End, contact_rates, has_contact
from floatplan.problem.parts import JointState
from floatplan.problem.problem import Problem
from floatplan.problem.resolution import end_errors
from floatplan.tables import CLEARANCE, FLIGHT_EVENTS, ROUNDED_FRAME_SPEED


@dataclass(frozen=True, eq=False)
class RateCurve:
    """The rates (K, n) rad/s that belong to rising angular momenta (K,) kg m^2/s, straight between them.

    The least largest share of limits makes them piecewise linear. Between two h the frame is at rest too, because the
    equations of :class:`~floatplan.motion.planar.contact_rates.ContactEquations` are linear.
    """

    momenta: Array
    rates: Array

    def __call__(self, momentum: float) -> Array:
        """Rates (n,) at h."""
        piece = int(np.clip(np.searchsorted(self.momenta, momentum) - 1, 0, len(self.momenta) - 2))
        width = self.momenta[piece + 1] - self.momenta[piece]
        slope = (self.rates[piece + 1] - self.rates[piece]) / width
        return np.asarray(self.rates[piece] + slope * (momentum - self.momenta[piece]))


@dataclass(frozen=True, eq=False)
class EndRates:
    """The ``fixed`` rates (2, n) rad/s at both ends; at some ends (0, 1) they follow ``curves`` instead."""

    fixed: Array
    curves: Mapping[int, RateCurve]

    def __call__(self, angular_momentum: Array) -> Array:
        """Rates (2, n) for h (1,)."""
        rates = self.fixed.copy()
        for number, curve in self.curves.items():
            rates[number] = curve(float(angular_momentum[0]))
        return rates


@lru_cache(maxsize=8)
def end_rates(problem: Problem, momentum: MomentumSet) -> EndRates:
    """Return the rates at both ends.

    Raises
    ------
    InputError
        A frame is to be at rest that no rates bring to rest, or the base, which nothing holds; or for that a joint
        would rotate that stands on the edge of its range.
    """
    states = (problem.initial, problem.final)
    fixed = np.array([state.velocities for state in states])
    curves: dict[int, RateCurve] = {}
    for number, (element, end) in enumerate(FLIGHT_EVENTS.items()):
        if states[number].frame_rests:
            middle = float(momentum.centre[0])
            if momentum.axes.size:
                # The rates are computed so far from the middle of a free h; beyond, they go on straight.
                reach = 4.0 * float(np.abs(momentum.axes[0]).max())
                curves[number] = _curve(problem, element, end, middle, reach)
            else:
                fixed[number] = _rates(problem, element, end, middle)
                settled = replace(states[number], velocities=fixed[number])
                ranges = problem.position_limits
                refuse(
                    list(end_errors(problem.robot, ranges, problem.flight, settled, element))
                )  # of joints on an edge
    return EndRates(fixed, curves)


def _curve(problem: Problem, element: str, end: End, middle: float, reach: float) -> RateCurve:
    """Halve the range of h until the rates are straight."""

    def rates(momentum: float) -> Array:
        return _rates(problem, element, end, momentum)

    sampled = {momentum: rates(momentum) for momentum in (middle - reach, middle, middle + reach)}
    open_ = [(middle - reach, middle), (middle, middle + reach)]
    smallest = reach / 2**10  # on the way to a bend of the rates
    rounding = 1e-9  # [-] relative to the rates: a smaller bend
    while open_:
        low, high = open_.pop()
        between = (low + high) / 2
        sampled[between] = rates(between)
        size = rounding * (np.abs(sampled[low]).max() + np.abs(sampled[high]).max())
        bent = np.abs(sampled[between] - (sampled[low] + sampled[high]) / 2).max() > size
        if bent and high - low > smallest:
            open_ += [(low, between), (between, high)]
    momenta = np.array(sorted(sampled))
    return RateCurve(momenta, np.array([sampled[momentum] for momentum in momenta.tolist()]))


def _rates(problem: Problem, element: str, end: End, momentum: float) -> Array:
    frame = problem.takeoff.frame if end == "takeoff" else problem.landing.frame
    if not has_contact(problem, end):
        raise InputError(
            f"{end!r} needs a frame on the ground, and {frame!r} is the base itself",
            element=f"{element}.velocities",
            advice=f"name a frame as flight.{end}, or give the rates",
        )
    solution = contact_rates(problem, end, momentum)
    if not solution.exist:
        raise InputError(
            f"no rates of the joints let frame {frame!r} be at rest at {end}, with {momentum:.4g} kg m^2/s",
            element=f"{element}.velocities",
            advice="plan more joints, give another posture, angular momentum or frame, or give the rates",
        )
    return solution.rates


def motion_into_ground(problem: Problem, angular_momentum: Array) -> list[InputError]:
    """Return what moves into the ground at takeoff or landing, with this angular momentum (1,), kg m^2/s.

    Rates that were rounded to six digits pass: where they lead into the ground, the search finds it.
    """
    if not problem.ground:
        return []
    rates = end_rates(problem, MomentumSet(angular_momentum, np.empty((1, 0))))(angular_momentum)
    start = replace(problem.initial, velocities=rates[0])
    goal = replace(problem.final, velocities=rates[1])
    errors = []
    for name, state, instant, sign, direction in (
        ("start", start, 0.0, 1.0, "down into the ground at takeoff"),
        ("goal", goal, problem.flight.duration, -1.0, "up out of the ground at landing"),
    ):
        link, velocity = _slowest_contact(problem, state, instant, sign, float(angular_momentum[0]))
        if velocity < -ROUNDED_FRAME_SPEED:
            errors.append(
                InputError(
                    f"{link} moves {direction}, at {-velocity:.4g} m/s",
                    element=f"{name}.velocities",
                    advice="give other rates there, another angular momentum, posture or duration",
                )
            )
    return errors


def _slowest_contact(
    problem: Problem, state: JointState, instant: float, sign: float, angular_momentum: float
) -> tuple[str, float]:
    """Of the points on the ground the one that is slowest upwards, or downwards for sign -1: its link, m/s."""
    robot = problem.robot
    path = problem.path
    tree = robot.tree
    shapes = problem.ground_shapes
    rate = tree_dynamics(tree).base_rate(state.positions[None], state.velocities[None], angular_momentum)[0]
    rotations = tree.rotations(tree.absolute_angles(np.array(state.orientation), state.positions))
    swings = 1j * tree.turn * (rate + tree.turns @ state.velocities) * rotations
    bodies = np.array([shape.body for shape in shapes])
    com_height = path.positions(np.array([instant]))[0, 1]
    com_velocity = path.velocities(np.array([instant]))[0, 1]
    slowest = ("", np.inf)
    radius = np.array([shape.radius for shape in shapes])
    for end in ("start", "end"):
        weights = tree.point_weights(bodies, np.array([getattr(shape, end) for shape in shapes]))
        height = com_height + (weights @ rotations).imag - radius - problem.ground_plane.point[1]
        velocity = sign * (com_velocity + (weights @ swings).imag)
        for index in np.flatnonzero(np.abs(height) < CLEARANCE):
            slowest = min(slowest, (shapes[index].link, float(velocity[index])), key=lambda contact: contact[1])
    return slowest
