"""Stances around repaired flights, bent to meet the flights' velocities, with feet where the clip has them.

The clip runs on in its own time around a flight. Where the velocities of flight and clip differ, base and joints begin
with those of the flight and come back to the clip before the stance is over; then the legs are bent so that feet near
the ground are where the clip has them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array, BoolArray
from floatplan.clips.clip import Clip
from floatplan.clips.flights import BASE_BODY
from floatplan.clips.timing import smoothstep
from floatplan.motion.spatial.kinematics import Limb, body_poses, in_body, on_body
from floatplan.motion.spatial.rotations import logarithm, of_quaternions
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.base import FREE_FLYER as BASE

FIXED = 0.02  # [m] over the ground, up to which feet stay where the clip has them
LOOSE = 0.05  # [m] over the ground, from which on feet are free; less where a flight begins or ends lower
LEAST_FADE = 1e-3  # [m] from FIXED to LOOSE, over which feet become free


@dataclass(frozen=True, eq=False)
class Seam:
    """Where a stance meets a flight: by how much velocities differ, and how long the stance has to lose the difference.

    Attributes
    ----------
    instant : s, of the repaired clip
    sign : 1 where the stance follows, -1 where it is before
    span : s
    clearances : (F,) m, of the clip's feet there
    change : (6 + J,) of the base in the world, m/s and rad/s, and of the joints: the flight's less the clip's
    offset : (6 + J,) by how much positions differ, m and rad; optional
        Next to a planned stance, whose feet are not quite where the clip has them.
    """

    instant: float
    sign: float
    span: float
    clearances: Array
    change: Array
    offset: Array | None = None

    def moved(self, times: Array) -> Array:
        """By how much (K, 6 + J) base and joints are moved at times (K,), s: ``u (1 - u/span)^3`` times the change.

        An offset vanishes by the smoothstep of the fifth order.
        """
        passed = self.sign * (times - self.instant)
        inside = (passed > 0) & (passed < self.span)
        shape = np.where(inside, passed * (1.0 - passed / max(self.span, 1e-9)) ** 3, 0.0)
        moved = self.sign * shape[:, None] * self.change
        if self.offset is not None:
            remaining = np.where(inside, 1.0 - passed / max(self.span, 1e-9), 0.0)
            moved = moved + smoothstep(remaining)[:, None] * self.offset
        return moved

    def frees_feet(self, times: Array) -> BoolArray:
        """Whether feet are not where the clip has them at times (K,), s: they are on the way to other places."""
        passed = self.sign * (times - self.instant)
        return np.asarray((passed > 0) & (passed < self.span) & (self.offset is not None))

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
    is_bent = np.abs(moved).max(axis=1) > 0
    for seam in seams:
        is_bent &= ~seam.frees_feet(times)
    is_moved = np.flatnonzero(is_bent)
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
    targets = clip.curve.poses(clip_times)
    points = scene.foot_solids.lowest(targets)
    attitudes = of_quaternions(configurations[:, 3:7])
    for foot, (body, leg) in enumerate(zip(scene.foot_bodies, _legs(clip.robot, scene.foot_bodies), strict=True)):
        near = np.flatnonzero(shares[:, foot] > 0)
        if not (leg.moved and len(near)):
            continue
        angles = leg.bent(
            base_positions=configurations[near, :3],
            attitudes=attitudes[near],
            positions=configurations[near, 7:],
            local=in_body(targets, body, points[:, foot])[near],
            target=points[near, foot],
            attitude=targets.rotations[near, body],
        )
        columns = np.array([clip.robot.model.idx_qs[joint] for joint in leg.moved])
        change = shares[near, foot, None] * (angles - configurations[near[:, None], columns])
        bent[near[:, None], columns] += change
    return bent


def _legs(robot: Robot, feet: Sequence[int]) -> Iterator[Limb]:
    """The leg of each foot, with those of its joints that move no other foot."""
    chains = [_chain(robot, foot) for foot in feet]
    for number, chain in enumerate(chains):
        others = set[int]().union(*chains[:number], *chains[number + 1 :])
        yield Limb(robot, chain, tuple(joint for joint in chain if joint not in others))


def _chain(robot: Robot, body: int) -> tuple[int, ...]:
    """Joints from the base, which is not among them, to a body."""
    joints: list[int] = []
    while body > BASE_BODY:
        joints.insert(0, body)
        body = robot.model.parents[body]
    return tuple(joints)


def foot_misses(clip: Clip, clip_times: Array, configurations: Array) -> Array:
    """By how much (K, F), m, feet that should stay are off the clip's, at times of the clip; 0 of others."""
    scene = clip.scene
    own = clip.curve.poses(clip_times)
    new = body_poses(clip.robot, configurations[:, :3], of_quaternions(configurations[:, 3:7]), configurations[:, 7:])
    misses = np.zeros((len(clip_times), len(scene.foot_bodies)))
    points = scene.foot_solids.lowest(own)
    for foot, body in enumerate(scene.foot_bodies):
        target = points[:, foot]
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
