"""Flights in space: stunts of a quadruped and turns of an arm within their limits, twists of a diver, drawn goals."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from measuring import PROBLEMS, Counts, heading, table
from obstructed_in_space import least_seen, obstructed

import floatplan as fp
from floatplan.arrays import Array
from floatplan.motion.flight import flight_of
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.planning.variables import decision_variables
from floatplan.simulation.reduced_model import reduced_model
from floatplan.simulation.spatial_motion import SpatialPlanMotion, angle_between

URDF = PROBLEMS.parent / "urdf"
GO2 = "example-robot-data:go2_description/urdf/go2.urdf"
STANDING = np.tile([0.0, 0.8, -1.5], 4)
STUNTS = {  # axes, then the angles of the first and the third
    "roll": ("xyz", (2 * math.pi, 0.0)),
    "roll back": ("xyz", (-2 * math.pi, 0.0)),
    "flip": ("yxz", (-2 * math.pi, 0.0)),
    "flip with half a twist": ("yzx", (-2 * math.pi, math.pi)),
    "one and a half with half a twist": ("yzx", (-3 * math.pi, math.pi)),
    "spin": ("zxy", (2 * math.pi, 0.0)),
}
ANY_DEGREE, WITHIN = fp.Motion(degree="auto"), fp.Limits(velocity="urdf", torque="urdf")
LEVEL = fp.Attitude(quaternion_xyzw=(0, 0, 0, 1))
TRACKED = 30.0  # [rad] bandwidth of replays whose joints are tracked, times the duration
DRAWN_LIMIT = 1.3  # [-] of the peaks of a drawn motion, the limits of every third


def turned(axis: Array, angle: float) -> fp.Attitude:
    """The attitude by an angle, rad, about an axis (3,) of any length."""
    vector = math.sin(angle / 2) * axis / np.linalg.norm(axis)
    return fp.Attitude(quaternion_xyzw=(*vector.tolist(), math.cos(angle / 2)))


def stunts(count: int) -> Iterator[fp.Problem]:
    """Of the Go2, from and to postures near standing, within the URDF's limits, h free."""
    robot = fp.Robot.from_urdf(GO2, base="free-flyer")
    for seed in range(count):
        rng = np.random.default_rng(seed)
        axes, (first, third) = list(STUNTS.values())[seed % len(STUNTS)]
        start, goal = (fp.Attitude(angles=(a, 0.0, c), axes=axes) for a, c in ((0.0, 0.0), (first, third)))
        ends = STANDING + rng.uniform(-0.2, 0.2, (2, 12))
        flight = fp.Flight(float(rng.uniform(0.5, 0.8)), "free")
        yield fp.Problem(robot, fp.Posture(start, ends[0]), fp.Posture(goal, ends[1]), flight, ANY_DEGREE, WITHIN)


def arms(count: int) -> Iterator[fp.Problem]:
    """Of a UR5 and a Panda, in turns, on a free base of 50 kg: 45 to 90 degrees about any axis, h = 0."""
    robots = [fp.Robot.from_urdf(URDF / name, base="free-flyer") for name in ("free_ur5.urdf", "free_panda.urdf")]
    for seed in range(count):
        rng, robot = np.random.default_rng(seed), robots[seed % 2]
        axis, angle = rng.normal(size=3), rng.uniform(math.pi / 4, math.pi / 2)
        start, goal = LEVEL, turned(axis, angle)
        low, high = robot.position_limits.T
        ends = low + (high - low) * rng.uniform(0.26, 0.74, (2, len(robot.joints)))
        flight = fp.Flight(float(rng.uniform(15, 30)), 0.0, gravity=0.0)
        yield fp.Problem(robot, fp.Posture(start, ends[0]), fp.Posture(goal, ends[1]), flight, ANY_DEGREE, WITHIN)


def levellings(count: int) -> Iterator[fp.Problem]:
    """Of the Go2 in 0.7 s, h = 0: from 20 to 60 degrees off, about any level axis."""
    robot = fp.Robot.from_urdf(GO2, base="free-flyer")
    for seed in range(count):
        rng = np.random.default_rng(seed)
        way, angle = rng.uniform(0, 2 * math.pi), rng.uniform(math.pi / 9, math.pi / 3)
        start = turned(np.array([math.cos(way), math.sin(way), 0.0]), angle)
        flight = fp.Flight(0.7, 0.0)
        yield fp.Problem(robot, fp.Posture(start, STANDING), fp.Posture(LEVEL, STANDING), flight, ANY_DEGREE)


def twists(count: int) -> Iterator[fp.Problem]:
    """Of the diver: one or two somersaults with half a twist to two, either way; h suggested, or free, in turns."""
    robot = fp.Robot.from_urdf(URDF / "diver.urdf", base="free-flyer")
    low, high = robot.position_limits.T
    for seed in range(count):
        rng = np.random.default_rng(seed)
        somersaults, twist = float(rng.choice([1, 2])), float(rng.choice([0.5, 1, 1.5, 2]))
        forwards, left = rng.choice([-1.0, 1.0], 2).tolist()
        first = low + (high - low) * rng.uniform(0.25, 0.75, 7)
        first[2:4], first[5:] = first[:2], 0.0
        last = np.clip(first + 0.3 * rng.normal(size=7), low + 0.1 * (high - low), high - 0.1 * (high - low))
        start = fp.Attitude(angles=(0, 0, 0), axes="yxz")
        goal = fp.Attitude(angles=(2 * math.pi * forwards * somersaults, 0, 2 * math.pi * left * twist), axes="yxz")
        flight = fp.Flight(float(rng.uniform(1.1, 1.7)), "free" if seed % 2 else "suggested")
        yield fp.Problem(robot, fp.Posture(start, first), fp.Posture(goal, last), flight, ANY_DEGREE)


def drawn_goals(count: int) -> Iterator[fp.Problem]:
    """The attitudes to which drawn motions of the Go2 lead, a third within limits of 1.3 times their peaks."""
    robot = fp.Robot.from_urdf(GO2, base="free-flyer")
    for seed in range(count):
        rng = np.random.default_rng(seed)
        ends = STANDING + rng.uniform(-0.3, 0.3, (2, 12))
        problem, state = drawn_goal(robot, ends, rng.normal(size=3) * [0.3, 1.0, 0.3], 0.6, rng)
        if seed % 3 == 0:
            peaks = (np.abs(values).max(axis=0) for values in (state.velocities, state.torques))
            rates, torques = (tuple((DRAWN_LIMIT * np.maximum(peak, 0.1)).tolist()) for peak in peaks)
            problem = replace(problem, limits=fp.Limits(velocity=rates, torque=torques))
        yield problem


def drawn_goal(
    robot: fp.Robot, ends: Array, h: Array, duration: float, rng: np.random.Generator
) -> tuple[fp.Problem, fp.FlightState]:
    """The attitude to which a drawn motion leads between two postures (2, n), as a problem; and that motion."""
    n = len(robot.joints)
    flight = fp.Flight(duration, tuple(h))
    level = fp.Problem(robot, fp.Posture(LEVEL, ends[0]), fp.Posture(LEVEL, ends[1]), flight)
    dynamics = flight_of(level)
    variables = decision_variables(level, (7,) * n, np.zeros((2, n), int), dynamics.momentum_set)
    z = variables.free_coefficients(0.25 * rng.normal(size=variables.size))
    low, high = level.position_limits.T
    b = variables.polynomials.powers_of_seconds(z)
    written = WrittenMotion.from_powers((low + high) / 2, (high - low) / 2, b, duration)
    motion = dynamics.whole_motion(written, h, dynamics.ballistics)
    state = motion.state(np.linspace(0, duration, 60))
    goal = fp.Posture(fp.Attitude(quaternion_xyzw=tuple(state.orientation[-1])), ends[1])
    return replace(level, goal=goal, motion=ANY_DEGREE), state


CLASSES: dict[str, Callable[[int], Iterator[fp.Problem]]] = {
    "Go2: rolls, flips, spins; h free, limits": stunts,
    "Panda and UR5 on 50 kg: 45 to 90 degrees; limits": arms,
    "diver: 1 or 2 somersaults, 1/2 to 2 twists": twists,
    "Go2: where drawn motions lead": drawn_goals,
    "Go2 levels out, h = 0": levellings,
}


def space(counts: Counts) -> None:
    """How many are planned, and how soon."""
    heading(f"space: {counts.in_space} of each, seeds 0 to {counts.in_space - 1}")
    rows = []
    for name, draw in CLASSES.items():
        solved, seconds, missed = 0, [], []
        for seed, problem in enumerate(draw(counts.in_space)):
            began = time.process_time()
            plan = fp.plan(problem)
            seconds.append(time.process_time() - began)
            solved += plan.ok
            if not plan.ok:
                missed.append(seed)
        print(f"  {name}: not found, seeds {missed}" if missed else f"  {name}: all found")
        rows.append([name, solved, len(seconds), *np.quantile(seconds, (0.5, 0.9, 1.0)).tolist()])
    table(["class", "found", "of", "s of the processor, median", "p90", "at most"], rows)
    _past_obstacles(counts)
    _within_limits(counts.in_space)
    _exactness(counts.in_space)
    if counts.peers_in_space:
        _beside_ipopt(counts.peers_in_space)


def _past_obstacles(counts: Counts) -> None:
    """Where drawn motions are clear of obstacles and of themselves: how many are planned, proved, and how clear."""
    problems = list(obstructed(counts.in_space))
    seconds, of_proofs, least, missed, unproved = [], [], [], [], []
    for problem in problems:
        began = time.process_time()
        plan = fp.plan(problem)
        seconds.append(time.process_time() - began)
        if not plan.ok:
            missed.append(problem.name)
            continue
        began = time.process_time()
        certificate = fp.certify(plan)
        of_proofs.append(time.process_time() - began)
        least.append(least_seen(plan, counts.instants))
        if not certificate.proved:
            labels = ", ".join(finding.label for finding in certificate.unproved)
            unproved.append(f"{problem.name} ({certificate.verdict}: {labels})")
    found = len(problems) - len(missed)
    worst = min(least, default=np.inf)
    row = ["past obstacles", found, len(problems), *np.quantile(seconds, (0.5, 0.9, 1.0)).tolist(), worst]
    head = ["", "found", "of", "s, median", "p90", "at most", f"least distance of {counts.instants} instants, m"]
    table(head, [row])
    table(
        ["", "proved", "of", "s, median", "p90", "at most"],
        [["proofs", found - len(unproved), found, *np.quantile(of_proofs or [np.nan], (0.5, 0.9, 1.0)).tolist()]],
    )
    if missed:
        print(f"  not found: {', '.join(missed)}")
    if unproved:
        print(f"  not proved: {'; '.join(unproved)}")


def _within_limits(count: int) -> None:
    """What takes long: a Go2 levels out within its limits, and a Talos turns; no search is to take 10 s."""
    rows = []
    talos = fp.Robot.from_urdf("example-robot-data:talos_data/robots/talos_reduced.urdf", base="free-flyer")
    low, high = talos.position_limits.T
    posture = np.clip(0, low + 0.05 * (high - low), high - 0.05 * (high - low))
    start = fp.Posture(fp.Attitude(angles=(0, 0, 0), axes="yxz"), posture)
    turns = [
        fp.Problem(
            talos, start, replace(start, orientation=fp.Attitude(angles=angles, axes="yxz")), flight, ANY_DEGREE, WITHIN
        )
        for angles, flight in (
            ((-2 * math.pi, 0, math.pi), fp.Flight(0.8, "free")),
            ((-4 * math.pi, 0, 2 * math.pi), fp.Flight(0.8, "free")),
            ((0, 0, math.pi / 4), fp.Flight(0.8, 0.0)),
            ((0.5, 0, 0.8), fp.Flight(0.5, 0.0)),
        )
    ]
    levelled = [replace(problem, limits=WITHIN) for problem in levellings(min(count, 40))]
    for name, problems in (
        ("Go2 levels out, h = 0, limits", levelled),
        ("Talos: turns, h free and 0, limits", turns[:count]),
    ):
        solved, seconds = [], []
        for problem in problems:
            began = time.process_time()
            solved.append(fp.plan(problem).ok)
            seconds.append(time.process_time() - began)
        soon = sum(ok and each < 2 for ok, each in zip(solved, seconds, strict=True))
        rows.append([name, sum(solved), soon, len(solved), *np.quantile(seconds, (0.5, 0.9, 1.0)).tolist()])
    table(["within the URDF's limits", "found", "in 2 s", "of", "s, median", "p90", "at most"], rows)


def _exactness(count: int) -> None:
    """Plans against forward dynamics, against the attitude's own equation, and against what is conserved and asked."""
    problems = {path.stem: fp.load_problem(path) for path in sorted((PROBLEMS / "space").glob("*.toml"))[:count]}
    problems |= {f"arm {seed}": problem for seed, problem in enumerate(arms(min(count, 16)))}
    rows: list[list[Any]] = []
    for name, problem in problems.items():
        plan = fp.plan(problem)
        if not plan.ok:
            continue
        state, ends = plan.at(np.linspace(0, plan.duration, 50)), plan.at([0.0, plan.duration])
        wanted = (problem.initial, problem.final)
        off = [
            float(np.abs(getattr(ends, key)[index] - getattr(end, key)).max())
            for index, end in enumerate(wanted)
            for key in ("velocities", "accelerations")
        ]
        flown, tracked = fp.replay(plan), fp.replay(plan, feedback=TRACKED / plan.duration)
        by_equation = SpatialPlanMotion(
            plan.record, reduced_model(plan.robot, float(plan.record.com["gravity"]))
        ).attitude
        turned = max(
            angle_between(by_equation(time), own) for time, own in zip(state.times, state.orientation, strict=True)
        )
        rows.append([name, turned, flown.orientation_error, tracked.orientation_error, _drift(plan, state), max(off)])
    head = ["", "DOP853, rad", "ABA, rad", "ABA, joints tracked", "momentum, relative", "ends' rates"]
    table(head, [*rows, ["largest", *np.max([row[1:] for row in rows], axis=0).tolist()]])


def _drift(plan: fp.Plan, state: fp.FlightState) -> float:
    """Largest error of the angular momentum, over its length or the most that the joints alone have, by Pinocchio."""
    model, data = plan.robot.model, plan.robot.model.createData()
    whole, of_joints = [], []
    for instant in state.times.tolist():
        q, v = plan.q(instant), plan.v(instant)
        whole.append(pin.computeCentroidalMomentum(model, data, q, v).angular.copy())
        v[:6] = 0
        of_joints.append(pin.computeCentroidalMomentum(model, data, q, v).angular.copy())
    size = max(np.linalg.norm(of_joints, axis=1).max(), np.linalg.norm(plan.angular_momentum))
    return float(np.linalg.norm(whole - plan.angular_momentum, axis=1).max() / size)


def _beside_ipopt(count: int) -> None:
    """The same task, without limits, by CasADi and IPOPT."""
    import peers_space  # here, since CasADi is an extra

    rows = []
    for name, draw in (("diver", twists), ("Go2 levels out", levellings)):
        for seed, problem in enumerate(draw(count)):
            began = time.process_time()
            plan = fp.plan(problem)
            seconds = time.process_time() - began
            given = replace(problem, flight=replace(problem.flight, angular_momentum=tuple(plan.angular_momentum)))
            solved, of_ipopt = peers_space.solve(given)
            ended = "solved" if solved else f"not in {peers_space.MOST_SECONDS:.0f} s"
            rows.append([f"{name}, seed {seed}", seconds, of_ipopt, ended, of_ipopt / seconds])
    table(["", "s of the processor", "IPOPT", "", "times"], rows)
