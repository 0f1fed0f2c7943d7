"""Flights with half and full twists about the vertical, drawn by seed and planned, and played too slowly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from drawn_hops import HOPPERS, Hop, body_of, clip_of
from numpy.typing import NDArray

import floatplan as fp
from floatplan.clips.clip import Clip
from floatplan.problem.attitude import Attitude

Array = NDArray[np.float64]
BELOW = -10.0  # [m] of the ground: no stance is in these clips
DURATION = (0.4, 0.8)  # [s]


def draw_twist(seed: int) -> fp.Plan:
    """Plan a flight of one of the robots that begins and ends near its usual posture, turned by half a turn or one."""
    rng = np.random.default_rng(seed)
    body = body_of(tuple(HOPPERS)[seed % len(HOPPERS)])
    robot = body.robot
    turn = (np.pi, 2 * np.pi)[seed // len(HOPPERS) % 2] * rng.choice([-1.0, 1.0])
    usual = body.standing[7:][[robot.model_joints.index(joint) for joint in robot.joints]]
    height = float(body.standing[2])
    start, goal = (_posture(robot, usual, angle, rng) for angle in (0.0, turn))
    flight = fp.Flight(
        duration=float(rng.uniform(*DURATION)),
        angular_momentum="free",
        takeoff=fp.Takeoff(frame=robot.joint_tree.root, position=(0.0, 0.0, height)),
        landing=fp.Landing(frame=robot.joint_tree.root, height=height),
        horizontal_velocity=tuple((0.3 * rng.normal(size=2)).tolist()),
    )
    return fp.plan(fp.Problem(robot, start=start, goal=goal, flight=flight))


def _posture(robot: fp.Robot, usual: Array, turn: float, rng: np.random.Generator) -> fp.Posture:
    low, high = robot.position_limits.T
    tilt = np.deg2rad(3.0) * rng.normal(size=2)
    return fp.Posture(
        orientation=Attitude(angles=(turn, *tilt.tolist()), axes="zyx"),
        positions=tuple(np.clip(usual + 0.1 * rng.normal(size=len(usual)), low + 0.05, high - 0.05).tolist()),
        velocities=tuple((0.5 * rng.normal(size=len(usual))).tolist()),
        accelerations="free",
    )


def slowly(plan: fp.Plan, factor: float, fps: float) -> Clip:
    """The flight alone, slower by a factor in time, as a clip."""
    times = np.arange(int(plan.duration * factor * fps) + 1) / fps
    motion = plan.full_motion(np.minimum(times / factor, plan.duration))
    q = np.concatenate((motion.base_position, motion.base_quaternion, motion.positions), axis=1)
    hop = Hop(plan.robot, takeoff=0.0, landing=plan.duration, duration=plan.duration, parts=())
    return replace(clip_of(hop, fps, q), ground_height=BELOW)
