"""Flights in space past obstacles and clear of themselves that are known to be possible: a motion is drawn first.

Where it leads is the goal. Obstacles stand where it passes clear by 3 to 10 mm, and where the plan made without them
comes at least 10 mm into them; links keep apart that it keeps apart, and that plan does not.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import coal  # which Pinocchio brings
import numpy as np
import pinocchio as pin
from measuring import PROBLEMS

import floatplan as fp
from floatplan.arrays import Array
from floatplan.motion.flight import flight_of
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.motion.spatial.clearance import SpatialSegments, pair_distances_in_space, shapes_in_space
from floatplan.planning.variables import decision_variables
from floatplan.problem.parts import Obstacle
from floatplan.problem.spatial_obstacles import SpatialObstacle

URDF = PROBLEMS.parent / "urdf"
GO2 = "example-robot-data:go2_description/urdf/go2.urdf"
LEVEL = fp.Attitude(quaternion_xyzw=(0, 0, 0, 1))
DENSE = 161  # [-] instants at which drawn motions are looked at
PASSED = (0.003, 0.010)  # [m] by which the drawn motion is clear of obstacles
DEEP_ENOUGH = 0.01  # [m] by which the plan made without an obstacle is inside it
RADII = (0.03, 0.5)  # [m]
SEED = 1e-6  # [m] size of an obstacle before it is grown
TRIES = 60  # [-] places for an obstacle
NEAR = 0.05  # [m] between balls around shapes, below which these are looked at
ANY_DEGREE = fp.Motion(degree="auto")


@dataclass(frozen=True)
class Flier:
    """A robot whose motions are drawn, from joints about ``middle`` by ``spread``, rad, with free parts so ``wild``."""

    robot: fp.Robot
    middle: Array
    spread: float
    wild: float
    duration: float
    momentum: float
    gravity: float = 9.81


@lru_cache
def fliers() -> tuple[Flier, ...]:
    """A diver, a Go2, a cat, and a UR5 on a free base."""
    made = {
        name: fp.Robot.from_urdf(URDF / name, base="free-flyer") for name in ("diver.urdf", "cat.urdf", "free_ur5.urdf")
    }
    go2 = fp.Robot.from_urdf(GO2, base="free-flyer")
    middles = {name: robot.position_limits.mean(axis=1) for name, robot in made.items()}
    return (
        Flier(made["diver.urdf"], middles["diver.urdf"], 0.5, 0.3, 1.2, 10.0),
        Flier(go2, np.tile([0.0, 0.8, -1.5], 4), 0.3, 0.25, 0.6, 0.6),
        Flier(made["cat.urdf"], middles["cat.urdf"], 0.4, 0.3, 0.6, 0.1),
        Flier(made["free_ur5.urdf"], 0.3 * middles["free_ur5.urdf"], 1.0, 0.3, 20.0, 0.0, 0.0),
    )


@dataclass(frozen=True)
class Drawn:
    """A problem without obstacles, and where the capsules of a motion that solves it are at instants (K,), s."""

    problem: fp.Problem
    times: Array
    segments: SpatialSegments


def draw(rng: np.random.Generator, flier: Flier) -> Drawn:
    """Draw a motion, and ask for where it leads."""
    robot, n = flier.robot, len(flier.robot.joints)
    low, high = robot.position_limits.T
    low = np.where(np.isfinite(low), low, -np.pi)
    high = np.where(np.isfinite(high), high, np.pi)
    ends = np.clip(flier.middle + flier.spread * rng.uniform(-1, 1, (2, n)), low + 0.1, high - 0.1)
    h = flier.momentum * rng.normal(size=3) * [0.4, 1.0, 0.4]
    speed = tuple(rng.uniform(-1, 1, 2).tolist()) if flier.gravity else (0.0, 0.0)
    flight = fp.Flight(flier.duration, tuple(h.tolist()), horizontal_velocity=speed, gravity=flier.gravity)
    asked = fp.Problem(robot, fp.Posture(LEVEL, ends[0]), fp.Posture(LEVEL, ends[1]), flight)
    degrees = (9,) * n
    variables = decision_variables(asked, degrees, np.zeros((2, n), int), flight_of(asked).momentum_set)
    z = variables.free_coefficients(flier.wild * rng.normal(size=variables.size))
    low, high = asked.position_limits.T
    b = variables.polynomials.powers_of_seconds(z)
    written = WrittenMotion.from_powers((low + high) / 2, (high - low) / 2, b, flight.duration)
    first = flight_of(asked)
    landing = first.whole_motion(written, h, first.ballistics).state(np.array([flight.duration])).orientation[0]
    goal = fp.Posture(fp.Attitude(quaternion_xyzw=tuple(landing.tolist())), ends[1])
    problem = replace(asked, goal=goal, motion=ANY_DEGREE)
    flown = flight_of(problem)
    times = np.linspace(0, flight.duration, DENSE)
    segments = flown.whole_motion(written, h, flown.ballistics).segments(times)
    assert isinstance(segments, SpatialSegments), "it flies in space"
    return Drawn(problem, times, segments)


def obstacle_between(rng: np.random.Generator, drawn: Drawn, guess: SpatialSegments) -> SpatialObstacle | None:
    """An obstacle that the drawn motion clears, and the guess comes into, somewhere on the guess's links."""
    times = drawn.times
    for _ in range(TRIES):
        k, capsule = int(rng.integers(8, DENSE - 8)), int(rng.integers(len(guess.radius)))
        share = rng.uniform()
        point = (1 - share) * guess.start[k, capsule] + share * guess.end[k, capsule]
        passed = float(rng.uniform(*PASSED))
        found = _grown(_seed(rng, point, float(times[k]), float(times[-1])), drawn, passed)
        if found is None or _least(guess, found, times) > -DEEP_ENOUGH or _least(drawn.segments, found, times) <= 0:
            continue
        return replace(found, margin=float(rng.uniform(0, 0.5) * passed))
    return None


def _seed(rng: np.random.Generator, point: Array, time: float, duration: float) -> SpatialObstacle:
    """An obstacle of next to no size, at a point at a time; some move, some are there for a while alone."""
    velocity = rng.normal(size=3) * 0.2 / duration if rng.random() < 0.3 else np.zeros(3)
    window = None
    if rng.random() < 0.2:
        window = (max(0.0, time - 0.2 * duration), min(duration, time + 0.2 * duration))
    shared: dict[str, Any] = {"velocity": tuple(velocity.tolist()), "window": window}
    middle = point - velocity * time
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    kind = rng.choice(["sphere", "capsule", "half-space", "box"], p=[0.4, 0.3, 0.15, 0.15])
    if kind == "half-space":
        return fp.HalfSpace(point=tuple(middle.tolist()), normal=tuple(direction.tolist()), **shared)
    if kind == "box":
        return fp.Box(center=tuple(middle.tolist()), size=(SEED,) * 3, **shared)
    if kind == "sphere":
        return fp.Sphere(center=tuple(middle.tolist()), radius=SEED, **shared)
    half = float(rng.uniform(0.1, 0.5)) * direction
    start, end = middle - half, middle + half
    return fp.Capsule(start=tuple(start.tolist()), end=tuple(end.tolist()), radius=SEED, **shared)


def _grown(seed: SpatialObstacle, drawn: Drawn, passed: float) -> SpatialObstacle | None:
    """The same as large as the drawn motion lets it be, which passes it by so much; None where that is not large."""
    more = _least(drawn.segments, seed, drawn.times) - passed
    if isinstance(seed, fp.HalfSpace):
        moved = np.array(seed.point) + more * np.array(seed.unit_normal)
        return replace(seed, point=tuple(moved.tolist()))
    if more < RADII[0]:
        return None
    if isinstance(seed, fp.Box):
        return replace(seed, size=(SEED + 2 * more,) * 3)
    assert isinstance(seed, fp.Sphere | fp.Capsule), "there are no others"
    return replace(seed, radius=SEED + min(more, RADII[1]))


def _least(segments: SpatialSegments, obstacle: Obstacle, times: Array) -> float:
    low, high = obstacle.window or (-np.inf, np.inf)
    there = (times >= low) & (times <= high)
    return float(segments.distances(obstacle, times)[there].min(initial=np.inf))


def links_to_keep_apart(drawn: Drawn, guess: SpatialSegments) -> fp.SelfClearance | None:
    """Two links that the guess brings nearer than the drawn motion ever does, or into one another."""
    shapes = shapes_in_space(drawn.problem.robot)
    names, found = sorted(set(shapes.links)), list[tuple[float, fp.SelfClearance]]()
    of = {name: np.array([i for i, link in enumerate(shapes.links) if link == name]) for name in names}
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            kept, come = (
                float(pair_distances_in_space(each.of(of[one]), each.of(of[other])).min())
                for each in (drawn.segments, guess)
            )
            if kept > PASSED[1] and kept - come > 2 * DEEP_ENOUGH:
                found.append(
                    (kept - come, fp.SelfClearance((one, other), max(0.0, min(kept - PASSED[0], come + 0.05))))
                )
    return max(found, key=lambda each: each[0])[1] if found else None


def obstructed(count: int) -> Iterator[fp.Problem]:
    """Problems of all fliers in turns, past one to three obstacles, or about links that keep apart; h is that drawn."""
    numbered = (obstructed_problem(seed) for seed in itertools.count())
    return itertools.islice((problem for problem in numbered if problem is not None), count)


def obstructed_problem(seed: int) -> fp.Problem | None:
    """One of these; None where the motion that is drawn by its seed makes none."""
    rng = np.random.default_rng([17, seed])
    try:
        drawn = draw(rng, fliers()[seed % len(fliers())])
    except fp.InputError:  # it leads half a turn away, by which way is then left open
        return None
    guess = fp.plan(drawn.problem)
    if not guess.ok:
        return None
    segments = guess.whole.segments(drawn.times)
    assert isinstance(segments, SpatialSegments), "it flies in space"
    name = f"obstructed_{seed}"
    count = seed // len(fliers()) % 4
    if count == 0:
        pair = links_to_keep_apart(drawn, segments)
        return None if pair is None else replace(drawn.problem, self_clearances=(pair,), name=name)
    obstacles = []
    for _ in range(count):
        obstacle = obstacle_between(rng, drawn, segments)
        if obstacle is not None:
            obstacles.append(obstacle)
    return None if len(obstacles) < count else replace(drawn.problem, obstacles=tuple(obstacles), name=name)


def least_seen(plan: fp.Plan, instants: int) -> float:
    """Least distance, m, beyond what is asked, of a plan to obstacles and between its links, at so many instants.

    Pinocchio says where the links are, and reads their shapes from the robot's own file; Coal says how far these are
    from obstacles, or from one another. Shapes around which balls are more than ``NEAR`` apart are not looked at.
    """
    robot, problem, model = plan.robot, plan.problem, plan.robot.free_flyer()
    folders = [str(folder) for folder in robot.path.parents]
    geometry = pin.buildGeomFromUrdf(model, str(robot.path), pin.GeometryType.COLLISION, package_dirs=folders)
    shapes = geometry.geometryObjects
    links = [model.frames[shape.parentFrame].name for shape in shapes]
    times = np.unique(np.concatenate((np.linspace(0, plan.duration, instants), *_windows(problem))))
    data = model.createData()
    carriers = sorted({int(shape.parentJoint) for shape in shapes})
    joint_places, joint_rotations = (
        np.empty((len(carriers), len(times), 3)),
        np.empty((len(carriers), len(times), 3, 3)),
    )
    for k, q in enumerate(plan.q(times)):
        pin.forwardKinematics(model, data, q)
        for place, rotation, joint in zip(joint_places, joint_rotations, carriers, strict=True):
            where = data.oMi[joint]
            place[k], rotation[k] = where.translation, where.rotation
    centers, rotations = [], []
    for shape in shapes:
        carrier, own = carriers.index(int(shape.parentJoint)), shape.placement
        centers.append(joint_places[carrier] + joint_rotations[carrier] @ own.translation)
        rotations.append(joint_rotations[carrier] @ own.rotation)
    balls = []
    for shape in shapes:
        shape.geometry.computeLocalAABB()
        balls.append((np.array(shape.geometry.aabb_center), float(shape.geometry.aabb_radius)))
    middles = [center + rotation @ ball[0] for center, rotation, ball in zip(centers, rotations, balls, strict=True)]
    radii = np.array([ball[1] for ball in balls])
    least = np.inf

    def look(k: int, first: int, other: object, where: coal.Transform3s) -> float:
        own = coal.Transform3s(rotations[first][k], centers[first][k])
        return float(
            coal.distance(shapes[first].geometry, own, other, where, coal.DistanceRequest(), coal.DistanceResult())
        )

    for obstacle in problem.obstacles:
        low, high = obstacle.window or (-np.inf, np.inf)
        there = (times >= low) & (times <= high)
        shift = times[:, None] * np.array(obstacle.velocity)
        as_coal, ends, around = _as_coal(obstacle)
        for i in range(len(shapes)):
            from_middle = SpatialSegments(middles[i][:, None], middles[i][:, None], radii[[i]])
            bound = from_middle.distances(obstacle, times).min(axis=1)
            for k in np.flatnonzero(there & (bound < NEAR)).tolist():
                where = coal.Transform3s(around, ends + shift[k])
                least = min(least, look(k, i, as_coal, where) - obstacle.margin)
    for pair in problem.self_clearances:
        first, second = ([i for i, link in enumerate(links) if link == name] for name in pair.links)
        for i, j in itertools.product(first, second):
            bound = np.linalg.norm(middles[i] - middles[j], axis=1) - radii[i] - radii[j]
            for k in np.flatnonzero(bound < NEAR).tolist():
                where = coal.Transform3s(rotations[j][k], centers[j][k])
                least = min(least, look(k, i, shapes[j].geometry, where) - pair.margin)
    return least


def _windows(problem: fp.Problem) -> list[Array]:
    """Ends of the obstacles' windows within the flight, s."""
    return [np.clip(each.window, 0, problem.flight.duration) for each in problem.obstacles if each.window]


def _as_coal(obstacle: Obstacle) -> tuple[object, Array, Array]:
    """An obstacle as Coal knows it, and where it is at takeoff: place (3,) m, and rotation (3, 3)."""
    still = np.eye(3)
    if isinstance(obstacle, fp.Sphere):
        return coal.Sphere(obstacle.radius), np.array(obstacle.center), still
    if isinstance(obstacle, fp.Box):
        return coal.Box(*obstacle.size), np.array(obstacle.center), still
    if isinstance(obstacle, fp.HalfSpace):
        normal = np.array(obstacle.unit_normal)
        return coal.Halfspace(normal, 0.0), np.array(obstacle.point), still
    assert isinstance(obstacle, fp.Capsule), "there are no others"
    start, end = np.array(obstacle.start), np.array(obstacle.end)
    turned = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end - start).matrix()
    return coal.Capsule(obstacle.radius, float(np.linalg.norm(end - start))), (start + end) / 2, turned
