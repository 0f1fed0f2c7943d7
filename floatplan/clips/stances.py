"""The stances around repaired flights: they meet these with their speeds, and feet stay where the clip has them.

The clip runs on in its own time around a flight. Where the flight's velocities differ from it the base and the joints
take them over, and lose them before the stance is over; then the legs are bent so that feet near the ground are where
the clip has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array
from floatplan.clips.clip import Clip
from floatplan.clips.curve import body_poses, joint_axes
from floatplan.clips.flights import in_body, lowest_point, on_body
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.rotations import logarithm, of_quaternions
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid
from floatplan.robot.urdf.base import FREE_FLYER as BASE

FIXED = 0.02  # [m] over the ground, up to which feet stay where the clip has them
LOOSE = 0.05  # [m] over the ground, from where on they are not; less where a flight begins or ends lower
LEAST_FADE = 1e-3  # [m] from the one to the other
SOLE = 0.01  # [m/rad] that an attitude counts relative to a position: with fewer than six joints the position wins


@dataclass(frozen=True, eq=False)
class Seam:
    """Where a stance meets a flight: by how much velocities differ, and how long the stance has to lose that.

    Attributes
    ----------
    instant : s, of the repaired clip
    sign : 1 where the stance follows, -1 where it is before
    span : s
    clearances : (F,) m, of the clip's feet there
    change : (6 + J,) of the base in the world, m/s and rad/s, and of the joints: the flight's less the clip's
    """

    instant: float
    sign: float
    span: float
    clearances: Array
    change: Array

    def moved(self, times: Array) -> Array:
        """By how much (K, 6 + J) base and joints are moved at times (K,), s: ``u (1 - u/span)^3`` times the change."""
        passed = self.sign * (times - self.instant)
        inside = (passed > 0) & (passed < self.span)
        shape = np.where(inside, passed * (1.0 - passed / max(self.span, 1e-9)) ** 3, 0.0)
        return self.sign * shape[:, None] * self.change

    def loose(self, times: Array) -> Array:
        """Heights (K, F), m, from which on feet are free at times (K,), s; at the flight all are: no speed jumps."""
        passed = self.sign * (times - self.instant)
        own = np.clip(self.clearances, FIXED + LEAST_FADE, LOOSE)
        return np.where(((passed >= 0) & (passed < self.span))[:, None], own, LOOSE)


def stance_configurations(clip: Clip, clip_times: Array, times: Array, seams: Sequence[Seam]) -> Array:
    """Configurations (K, 7 + J) of the stances of a repaired clip.

    Parameters
    ----------
    clip_times : (K,) s, of the clip
    times : (K,) s, the same instants in the repaired clip
    seams : sequence of Seam
    """
    curve = clip.curve
    positions = curve.positions(clip_times)
    moved = np.zeros((len(times), BASE + positions.shape[1]))
    for seam in seams:
        moved += seam.moved(times)
    turned = Rotation.from_rotvec(moved[:, 3:BASE]) * Rotation.from_matrix(curve.attitudes(clip_times))
    bases = curve.base_positions(clip_times) + moved[:, :3]
    configurations = np.concatenate((bases, turned.as_quat(), positions + moved[:, BASE:]), axis=1)
    loose = np.full((len(times), len(clip.scene.foot_bodies)), LOOSE)
    for seam in seams:
        loose = np.minimum(loose, seam.loose(times))
    is_moved = np.flatnonzero(np.abs(moved).max(axis=1) > 0)
    if len(is_moved):
        configurations[is_moved] = _with_feet_fixed(
            clip, configurations[is_moved], clip_times[is_moved], loose[is_moved]
        )
    return configurations


def _with_feet_fixed(clip: Clip, configurations: Array, clip_times: Array, loose: Array) -> Array:
    """Configurations (K, 7 + J) with the legs bent so that feet near the ground are where the clip has them.

    Parameters
    ----------
    loose : (K, F) m over the ground, from where on feet are free
    """
    scene = clip.scene
    bent = configurations.copy()
    fade = np.clip((loose - scene.foot_clearances(clip_times)) / (loose - FIXED), 0.0, 1.0)
    shares = fade**2 * (3.0 - 2.0 * fade)  # with no rate at either end
    chains = [_chain(clip.robot, body) for body in scene.foot_bodies]
    for foot, chain in enumerate(chains):
        others = set[int]().union(*chains[:foot], *chains[foot + 1 :])
        leg = [joint for joint in chain if joint not in others]
        near = np.flatnonzero(shares[:, foot] > 0)
        if not (leg and len(near)):
            continue
        targets = clip.curve.poses(clip_times[near])
        angles = _bent(clip.robot, configurations[near], chain, leg, targets, scene.foot_solids[foot])
        # a joint's column in a configuration, whose base has 7 numbers, is 5 more than its number in the model
        columns = 5 + np.array(leg)
        change = shares[near, foot, None] * (angles - configurations[near][:, columns])
        bent[near[:, None], columns] += change
    return bent


def _chain(robot: Robot, body: int) -> list[int]:
    """Joints from the base, which is not among them, to a body."""
    joints: list[int] = []
    while body > 1:
        joints.insert(0, body)
        body = robot.model.parents[body]
    return joints


def _bent(
    robot: Robot,
    configurations: Array,
    chain: Sequence[int],
    leg: Sequence[int],
    targets: BodyPoses,
    solids: Sequence[LinkSolid],
) -> Array:
    """Positions (K, m) of the m joints of a leg that bring its foot to where it is to be.

    Steps of Gauss and Newton, damped, of all K instants at once. The target is of the point of the foot that is lowest,
    and its attitude as far as the leg has joints for that.

    Parameters
    ----------
    configurations : (K, 7 + J)
    chain : joints from the base to the foot
    leg : those of them that move this foot only
    targets : K poses of all bodies
    solids : the foot's shapes
    """
    body = chain[-1]
    target = lowest_point(targets, solids)
    local = in_body(targets, body, target)
    attitudes = of_quaternions(configurations[:, 3:7])
    positions = configurations[:, 7:].copy()
    columns = np.array(leg) - 2
    axes = joint_axes(robot)[leg]
    for _ in range(8):  # Gauss and Newton converge in fewer
        poses = body_poses(robot, configurations[:, :3], attitudes, positions, chain)
        point = on_body(poses, body, local)
        rotation = logarithm(targets.rotations[:, body] @ np.swapaxes(poses.rotations[:, body], 1, 2))
        miss = np.concatenate((target - point, SOLE * rotation), axis=1)
        sliding = np.einsum("kmab,mb->kma", poses.rotations[:, leg], axes[:, :3])
        turning = np.einsum("kmab,mb->kma", poses.rotations[:, leg], axes[:, 3:])
        arms = point[:, None] - poses.places[:, leg]
        rates = np.concatenate((sliding + np.cross(turning, arms), SOLE * turning), axis=2)
        # 1e-7 m^2 of the squared change of joints damp the step
        normal = np.swapaxes(rates, 1, 2) @ rates + 1e-7 * np.eye(6)
        step = np.einsum("kma,ka->km", rates, np.linalg.solve(normal, miss[..., None])[..., 0])
        positions[:, columns] += step
        if np.abs(step).max() < 1e-8:  # [rad] the next one changes nothing
            break
    return np.asarray(positions[:, columns])


def foot_misses(clip: Clip, clip_times: Array, configurations: Array) -> Array:
    """By how much (K, F), m, feet that should stay are off the clip's, at times of the clip; 0 of others."""
    scene = clip.scene
    own = clip.curve.poses(clip_times)
    new = body_poses(clip.robot, configurations[:, :3], of_quaternions(configurations[:, 3:7]), configurations[:, 7:])
    misses = np.zeros((len(clip_times), len(scene.foot_bodies)))
    for foot, (body, solids) in enumerate(zip(scene.foot_bodies, scene.foot_solids, strict=True)):
        target = lowest_point(own, solids)
        misses[:, foot] = np.linalg.norm(on_body(new, body, in_body(own, body, target)) - target, axis=1)
    return np.where(scene.foot_clearances(clip_times) < FIXED, misses, 0.0)


def velocity_difference(
    flight: Array, clip_velocities: tuple[Array, Array, Array], pace: float, attitude: Array
) -> Array:
    """The change (6 + J,) of a seam: a flight's velocity (6 + J,), the base's components in its axes, less the clip's.

    The clip's are of its own time; a second of the clip is ``pace`` seconds of the repaired one.
    """
    linear, angular, joints = clip_velocities
    own = np.concatenate((attitude @ flight[:3], attitude @ flight[3:BASE], flight[BASE:]))
    return own - np.concatenate((linear, angular, joints)) / pace


def angle_between(first: Array, second: Array) -> float:
    """Angle, rad, between two attitudes (3, 3)."""
    return float(np.linalg.norm(logarithm((first @ second.T)[None])))
