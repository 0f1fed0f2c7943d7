"""Plan records made without the planner: a motion is drawn, and its boundary states and ends become the problem."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import proof_reference as reference
from places import URDF

from floatplan.arrays import read_only
from floatplan.plans.reading import robot_record
from floatplan.plans.record import PlanRecord
from floatplan.robot.robot import Robot


def draw_coefficients(rng, joints, duration, size=0.4, degree=7):
    """Polynomials (joints, degree + 1) in t whose values stay of the order of ``size``."""
    s = np.linspace(0.0, 1.0, degree + 1)
    envelope = np.sin(np.pi * (0.1 + 0.8 * s))
    rows = [
        np.polynomial.Polynomial.fit(s, size * rng.uniform(-1, 1, s.size) * envelope, degree) for _ in range(joints)
    ]
    return np.stack([row.convert().coef / duration ** np.arange(degree + 1) for row in rows])


def resting(start, goal, duration, free, amplitude=math.pi):
    """Polynomial of a joint that rests at both ends: a quintic step and ``s^3 (1 - s)^3`` times that of ``free``."""
    p0, p1 = math.asin(start / amplitude), math.asin(goal / amplitude)
    s = np.polynomial.Polynomial([0.0, 1.0])
    p = p0 + (p1 - p0) * (10 * s**3 - 15 * s**4 + 6 * s**5) + s**3 * (1 - s) ** 3 * np.polynomial.Polynomial(free)
    return np.pad(p.coef, (0, 6 + len(free) - len(p.coef))) / duration ** np.arange(6 + len(free))


def example_a(**changes) -> PlanRecord:
    """Example A of the paper: no limits but the full joint ranges, no obstacle unless asked for."""
    start, goal = np.radians([-108.97, 90.0]), np.radians([70.0, 56.73])
    free = [[0.2921251, -0.38431191], [-12.44290253, -6.92081978]]
    rows = [resting(begin, end, 1.1, z) for begin, end, z in zip(start, goal, free, strict=True)]
    return make_plan(
        Robot.from_urdf(URDF / "gymnast.urdf"),
        np.array(rows),
        **{"orientation": math.radians(108.97), "frames": ("foot", "hand"), "velocity": (1.0, 5.0)} | changes,
    )


def example_b(**changes) -> PlanRecord:
    """Example B of the paper: a circle of 20 cm to be passed at 2 cm."""
    start, goal = np.radians([18.0, -45.0]), [0.0, 0.0]
    free = [[44.18450995, 20.92510309], [-36.25068977, -17.36466123]]
    rows = [resting(begin, end, 1.4, z) for begin, end, z in zip(start, goal, free, strict=True)]
    circle = {"kind": "circle", "center": [1.485, 3.342], "radius": 0.2, "margin": 0.02}
    settings = {"duration": 1.4, "angular_momentum": -1.1778, "orientation": math.radians(72.0), "velocity": (2.0, 6.8)}
    settings |= {"frames": ("foot", "hand"), "obstacles": [circle]}
    return make_plan(Robot.from_urdf(URDF / "gymnast.urdf"), np.array(rows), **settings | changes)


def unlimited(record: PlanRecord) -> PlanRecord:
    """The same plan without limits of velocity, torque and orientation rate."""
    n = len(record.robot.joints)
    limits = {**record.problem["limits"], "velocity": [None] * n, "torque": [None] * n, "orientation_rate": None}
    return replace(record, problem={**record.problem, "limits": limits})


def blank_record(robot: Robot, duration: float, coefficients: np.ndarray, **motion: Any) -> PlanRecord:
    """The record of a motion of which nothing is known yet but the motion."""
    none = read_only(np.zeros(len(robot.joints)))
    return PlanRecord(
        status="feasible",
        ok=True,
        explanation="",
        problem={"flight": {"duration": duration}},
        robot=replace(robot_record(robot), resting=()),
        coefficients=read_only(coefficients),
        objective={"name": "coefficients", "value": 0.0},
        torque_peak=none,
        velocity_peak=none,
        clearance_min=None,
        solver={},
        **motion,
    )


def make_plan(
    robot: Robot,
    coefficients,
    *,
    duration=1.1,
    angular_momentum=0.13,
    orientation=1.9,
    velocity=(1.0, 5.0),
    frames=None,
    obstacles=(),
    self_clearance=(),
    centre=None,
    amplitude=None,
    slack=1.05,
    instants=2001,
    grounded=False,
) -> PlanRecord:
    """A plan that is true: limits are ``slack`` times the peaks, margins of obstacles are the caller's business.

    ``grounded``: choose the vertical velocity so that the landing frame ends at height 0.
    """
    n = len(robot.joints)
    takeoff, landing = frames or (robot.tree.names[0], robot.tree.names[0])
    centre = np.zeros(n) if centre is None else np.asarray(centre)
    amplitude = np.full(n, np.pi) if amplitude is None else np.asarray(amplitude)
    blank = blank_record(
        robot,
        duration,
        coefficients,
        angular_momentum=angular_momentum,
        angular_momentum_bounds=(angular_momentum - 1.0, angular_momentum + 1.0),
        centre=read_only(centre),
        amplitude=read_only(amplitude),
        orientation={"start": orientation, "end": 0.0, "goal": 0.0},
        com={"position0": [0.0, 0.0], "velocity0": list(velocity), "gravity": 9.81},
    )
    dense = reference.evaluate(robot, blank, np.linspace(0.0, duration, instants))
    foot = reference.frame_place(robot, blank, dense, takeoff, 0)
    moved = replace(blank, com={**blank.com, "position0": [float(-foot.real), float(-foot.imag)]})
    end = float(dense.orientation[-1])
    hand = reference.frame_place(robot, moved, dense, landing, -1)
    if grounded:
        moved = replace(moved, com={**moved.com, "velocity0": [velocity[0], float(velocity[1] - hand.imag / duration)]})
        hand = 0j
    torque, speed = np.abs(dense.torques).max(0), np.abs(dense.velocities).max(0)
    problem = {
        "name": "drawn",
        "start": _posture(dense, orientation, 0),
        "goal": _posture(dense, end, -1),
        "flight": {
            "duration": duration,
            "angular_momentum": angular_momentum,
            "takeoff": {"frame": takeoff, "position": [0.0, 0.0]},
            "landing": {"frame": landing, "height": float(hand.imag)},
            "horizontal_velocity": velocity[0],
            "gravity": 9.81,
        },
        "motion": {"degree": [coefficients.shape[1] - 1] * n, "objective": "coefficients"},
        "limits": {
            "position": [[float(c - a), float(c + a)] for c, a in zip(centre, amplitude, strict=True)],
            "velocity": (slack * speed).tolist(),
            "torque": (slack * torque).tolist(),
            "motor": {},
            "orientation_rate": slack * float(np.abs(dense.rate).max()),
        },
        "obstacles": [dict(obstacle) for obstacle in obstacles],
        "self_clearance": [dict(pair) for pair in self_clearance],
    }
    clear = [reference.clearance(robot, moved, dense, obstacle).min() for obstacle in obstacles]
    return replace(
        moved,
        problem=problem,
        orientation={"start": orientation, "end": end, "goal": end},
        torque_peak=read_only(torque),
        velocity_peak=read_only(speed),
        clearance_min=float(min(clear)) if clear else None,
    )


def _posture(dense, orientation, index):
    return {
        "orientation": orientation,
        "positions": dense.positions[index].tolist(),
        "velocities": dense.velocities[index].tolist(),
        "accelerations": dense.accelerations[index].tolist(),
    }
