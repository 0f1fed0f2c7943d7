"""Looks at a plan at many instants by code that is not the planner's, and says by how much anything is violated.

From a plan it takes the problem, the robot's URDF text, the coefficients of (12) and h: nothing computed from them, but
for the capsules around collision geometry. Dynamics and places are those of :mod:`independent_robot`, the orientation
is the integral of (4) at numpy's Chebyshev points, joint motions are its polynomials, distances are the formulas below.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from independent_robot import Flyer, Skeleton, joint_map
from numpy.polynomial import Chebyshev, polynomial

import floatplan as fp
from floatplan.problem.parts import JointState

INSTANTS = 20_000
DEGREES = (64, 128, 256, 512, 1024, 2048)  # of what is integrated
TAIL, TOLERANCE = 6, 1e-10  # the last coefficients, beside the largest, of a degree that is enough


@dataclass(frozen=True)
class Worst:
    """By how much one requirement is violated at worst, in its unit, and when, s; negative where it holds."""

    label: str
    amount: float
    unit: str
    time: float

    def __str__(self) -> str:
        return f"{self.label}: {self.amount:.2e} {self.unit} at {self.time:.4f} s"


@dataclass(frozen=True, eq=False)
class Placed:
    """The S capsules of a link: ``start, end`` (S, K, 2) m, ``radius`` (S,) m."""

    start: np.ndarray
    end: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True, eq=False)
class Look:
    """A plan at times (K,)."""

    plan: fp.Plan
    times: np.ndarray

    @cached_property
    def flyer(self) -> Flyer:
        """The robot."""
        return Flyer(self.plan.robot)

    @cached_property
    def derivatives(self) -> list[np.ndarray]:
        """Coefficients of p(t) of (12) and of its first two derivatives; terms of 1e5 rad may cancel in their sums."""
        return [polynomial.polyder(self.plan.coefficients.T.astype(np.longdouble), order) for order in range(3)]

    def joints_at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions, velocities, accelerations (K, n) by (12)."""
        plan = self.plan
        exact = times.astype(np.longdouble)
        p, rate, curvature = (np.float64(polynomial.polyval(exact, each)).T for each in self.derivatives)
        sine, cosine = np.sin(p), np.cos(p)
        return (
            plan.centre + plan.amplitude * sine,
            plan.amplitude * cosine * rate,
            plan.amplitude * (cosine * curvature - sine * rate**2),
        )

    @cached_property
    def joints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The joints' motion at the times."""
        return self.joints_at(self.times)

    @cached_property
    def orientation(self) -> np.ndarray:
        """Orientation (K,) at the times: the integral of (4), from its values at Chebyshev points that are enough."""
        for degree in DEGREES:
            rate = Chebyshev.interpolate(self.rates_at, degree, domain=[0.0, self.plan.duration])
            if np.abs(rate.coef[-TAIL:]).max() <= TOLERANCE * np.abs(rate.coef).max():
                return np.asarray(self.plan.problem.initial.orientation + rate.integ(lbnd=0.0)(self.times))
        raise ValueError("the base turns at a rate that no polynomial of a sensible degree is")

    def rates_at(self, times: np.ndarray) -> np.ndarray:
        """theta0' (K,) at times (K,), by (4)."""
        positions, velocities, _ = self.joints_at(times)
        momentum, flyer = self.plan.angular_momentum, self.flyer
        return np.array([flyer.base_rate(q, v, momentum) for q, v in zip(positions, velocities, strict=True)])

    @cached_property
    def rates(self) -> np.ndarray:
        """theta0' (K,) at the times."""
        return self.rates_at(self.times)

    @cached_property
    def joint_torques(self) -> np.ndarray:
        """Torques (K, m) of all joints, each its own."""
        return np.array([self.flyer.torques(*state) for state in zip(*self.joints, self.rates, strict=True)])

    @property
    def torques(self) -> np.ndarray:
        """Torques (K, n) of the planned coordinates."""
        return self.joint_torques @ self.flyer.by_planned

    @property
    def motor_torques(self) -> np.ndarray:
        """Torques (K, motors) of ``robot.motors``."""
        return self.joint_torques @ self.flyer.by_motor.T

    @cached_property
    def com(self) -> np.ndarray:
        """Path (K, 2) of the centre of mass, by (2), (3) and (6)."""
        problem = self.plan.problem
        gravity, duration = problem.flight.gravity, problem.flight.duration

        def from_com(frame: str, state: JointState) -> np.ndarray:
            one = Skeleton(self.plan.robot, np.array([state.orientation]), state.positions[None, :])
            return one.from_com(frame)[0]

        begin = np.array(problem.takeoff.position) - from_com(problem.takeoff.frame, problem.initial)
        end_height = problem.landing_height - from_com(problem.landing.frame, problem.final)[1]
        climb = (end_height - begin[1]) / duration + gravity * duration / 2
        path = begin + self.times[:, None] * np.array([problem.flight.horizontal_velocity, climb])
        path[:, 1] -= gravity * self.times**2 / 2
        return path

    @cached_property
    def links(self) -> dict[str, Placed]:
        """Capsules of each link, placed."""
        shapes: dict[str, list[tuple[np.ndarray, np.ndarray, float]]] = {}
        for link, start, end, radius in Skeleton(self.plan.robot, self.orientation, self.joints[0]).capsules():
            shapes.setdefault(link, []).append((self.com + start, self.com + end, radius))
        return {link: Placed(*map(np.stack, zip(*each, strict=True))) for link, each in shapes.items()}


def violations(plan: fp.Plan, instants: int = INSTANTS) -> list[Worst]:
    """By how much a plan violates each thing that its problem asks for, at ``instants`` times and at both ends."""
    return violations_seen(Look(plan, np.linspace(0.0, plan.duration, instants)))


def violations_seen(look: Look) -> list[Worst]:
    """Return the same for a look that is there already; its first and last times are those of the flight."""
    return [*_at_the_ends(look), *_joint_limits(look), *_clearances(look)]


def clearance(look: Look) -> np.ndarray:
    """Least distance (K,) of any link to any obstacle that exists then; infinite where none does."""
    least = np.full(len(look.times), np.inf)
    for distance in (distance for _, _, distance in _obstacle_distances(look)):
        least = np.minimum(least, distance.min(axis=1))
    return least


def worst_violation(plan: fp.Plan, instants: int = INSTANTS) -> Worst:
    """Return the largest of the violations."""
    return max(violations(plan, instants), key=lambda worst: worst.amount)


def _at_the_ends(look: Look) -> Iterator[Worst]:
    problem = look.plan.problem
    positions, velocities, accelerations = look.joints
    for index, state in ((0, problem.initial), (-1, problem.final)):
        time = float(look.times[index])
        for name, given, asked, unit in (
            ("position", positions, state.positions, "rad"),
            ("velocity", velocities, state.velocities, "rad/s"),
            ("acceleration", accelerations, state.accelerations, "rad/s^2"),
        ):
            yield Worst(f"boundary {name}", float(np.abs(given[index] - asked).max()), unit, time)
    yield Worst("orientation", abs(float(look.orientation[-1]) - problem.final.orientation), "rad", time)


def _joint_limits(look: Look) -> Iterator[Worst]:
    problem = look.plan.problem
    positions, velocities, _ = look.joints
    outside = np.maximum(problem.position_limits[:, 0] - positions, positions - problem.position_limits[:, 1])
    yield _largest(look, "joint range", outside, "rad")
    if np.isfinite(problem.velocity_limits).any():
        yield _largest(look, "velocity", np.abs(velocities) - problem.velocity_limits, "rad/s")
    if np.isfinite(problem.torque_limits).any():
        yield _largest(look, "torque", np.abs(look.torques) - problem.torque_limits, "N m")
    if np.isfinite(problem.motor_torque_limits).any():
        yield _largest(look, "motor torque", np.abs(look.motor_torques) - problem.motor_torque_limits, "N m")
    if np.isfinite(problem.motor_stall).any():
        _, ratios = joint_map(look.plan.robot, list(look.plan.robot.motors))
        used = np.abs(look.motor_torques) + problem.motor_slope * np.abs(velocities @ ratios.T)
        yield _largest(look, "speed-dependent torque", used - problem.motor_stall, "N m")
    if problem.limits.orientation_rate is not None:
        excess = np.abs(look.rates)[:, None] - problem.limits.orientation_rate
        yield _largest(look, "orientation rate", excess, "rad/s")


def _clearances(look: Look) -> Iterator[Worst]:
    problem = look.plan.problem
    for label, margin, distance in _obstacle_distances(look):
        yield _largest(look, label, margin - distance, "m")
    for pair in problem.self_clearances:
        first, second = (look.links[link] for link in pair.links)
        for i, j in product(range(len(first.radius)), range(len(second.radius))):
            distance = _between(first.start[i], first.end[i], second.start[j], second.end[j])
            lacking = pair.margin - distance + first.radius[i] + second.radius[j]
            yield _largest(look, f"clearance of {pair.links[0]} to {pair.links[1]}", lacking[:, None], "m")


def _obstacle_distances(look: Look) -> Iterator[tuple[str, float, np.ndarray]]:
    """A label, the margin and the distances (K, S), of every link to every obstacle; infinite where that is not."""
    for index, obstacle in enumerate(look.plan.problem.obstacles):
        shift = look.times[:, None] * np.array(obstacle.velocity)
        low, high = obstacle.window or (0.0, look.plan.duration)
        exists = (look.times >= low) & (look.times <= high)
        for link, placed in look.links.items():
            apart = _distance(placed.start - shift, placed.end - shift, obstacle).T - placed.radius
            distance = np.where(exists[:, None], apart, np.inf)
            yield f"clearance of {link} to obstacle {index}", obstacle.margin, distance


def _largest(look: Look, label: str, excess: np.ndarray, unit: str) -> Worst:
    at, column = np.unravel_index(np.argmax(excess), excess.shape)
    return Worst(label, float(excess[at, column]), unit, float(look.times[at]))


def _distance(start: np.ndarray, end: np.ndarray, obstacle: object) -> np.ndarray:
    """Distance (S, K) from segments to an obstacle's surface."""
    if isinstance(obstacle, fp.Circle):
        return _to_point(start, end, np.array(obstacle.center)) - obstacle.radius
    if isinstance(obstacle, fp.HalfPlane):
        normal = np.array(obstacle.normal) / np.hypot(*obstacle.normal)
        return np.minimum((start - obstacle.point) @ normal, (end - obstacle.point) @ normal)
    if isinstance(obstacle, fp.Bar):
        ends = (np.broadcast_to(np.array(point), start.shape) for point in (obstacle.start, obstacle.end))
        return _between(start, end, *ends) - obstacle.radius
    raise TypeError(f"no distance to {type(obstacle).__name__}")


def _to_point(start: np.ndarray, end: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Distance by the two ends, and by the height over the segment where the foot of it lies within."""
    along, to_start, to_end = end - start, point - start, point - end
    nearest = np.minimum(np.linalg.norm(to_start, axis=-1), np.linalg.norm(to_end, axis=-1))
    within = ((along * to_start).sum(axis=-1) > 0) & ((along * to_end).sum(axis=-1) < 0)
    height = np.abs(_cross(along, to_start)) / np.maximum(np.linalg.norm(along, axis=-1), 1e-300)
    return np.where(within, height, nearest)


def _between(start: np.ndarray, end: np.ndarray, other_start: np.ndarray, other_end: np.ndarray) -> np.ndarray:
    """Distance between segments; 0 where they cross."""
    by_ends = [_to_point(start, end, point) for point in (other_start, other_end)]
    by_ends += [_to_point(other_start, other_end, point) for point in (start, end)]
    along, other_along = end - start, other_end - other_start
    sides = _cross(along, other_start - start) * _cross(along, other_end - start)
    other_sides = _cross(other_along, start - other_start) * _cross(other_along, end - other_start)
    return np.where((sides < 0) & (other_sides < 0), 0.0, np.minimum.reduce(by_ends))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
