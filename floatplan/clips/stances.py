"""The stances beside repaired flights: they meet these with their speeds, and feet stay where the clip has them.

The clip runs on in its own time around a flight. Where the flight's velocities differ from it the base and the joints
take them over, and lose them within a part of the stance; then the legs are bent so that feet near the ground are where
the clip has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array
from floatplan.clips.clip import Clip
from floatplan.clips.curve import body_poses
from floatplan.motion.spatial.dynamics import BASE
from floatplan.motion.spatial.rotations import logarithm

HELD = 0.02  # [m] over the ground, up to which feet are held to the clip
LOOSE = 0.05  # [m] over the ground, from where on they are not
ROUNDS = 6  # [-] of Gauss and Newton at most
CLOSE = 1e-7  # [m, rad] by which a foot may miss
DAMPING = 1e-6  # [-] of the squared change of joints


@dataclass(frozen=True, eq=False)
class Seam:
    """Where a stance meets a flight: by how much velocities differ, and how long the stance has to lose that.

    Attributes
    ----------
    instant : s, of the repaired clip
    sign : 1 where the stance follows, -1 where it is before
    room : s
    change : (6 + J,) of the base in the world, m/s and rad/s, and of the joints: the flight's less the clip's
    """

    instant: float
    sign: float
    room: float
    change: Array

    def moved(self, times: Array) -> Array:
        """By how much (K, 6 + J) base and joints are moved at times (K,), s: ``u (1 - u/room)^3`` times the change."""
        passed = self.sign * (times - self.instant)
        inside = (passed > 0) & (passed < self.room)
        shape = np.where(inside, passed * (1.0 - passed / max(self.room, 1e-9)) ** 3, 0.0)
        return self.sign * shape[:, None] * self.change


def stance_configurations(clip: Clip, clip_times: Array, times: Array, seams: Sequence[Seam]) -> Array:
    """Configurations (K, 7 + J) of the stances of a repaired clip.

    Parameters
    ----------
    clip_times : (K,) s, of the clip
    times : (K,) s, the same instants in the repaired clip
    seams : sequence of Seam
    """
    curve = clip.curve
    bases = curve.base_positions(clip_times)
    attitudes = curve.attitudes(clip_times)
    positions = curve.positions(clip_times)
    moved = np.zeros((len(times), BASE + positions.shape[1]))
    for seam in seams:
        moved += seam.moved(times)
    is_moved = np.flatnonzero(np.abs(moved).max(axis=1) > 0)
    turned = Rotation.from_rotvec(moved[:, 3:BASE]) * Rotation.from_matrix(attitudes)
    found = np.concatenate((bases + moved[:, :3], turned.as_quat(), positions + moved[:, BASE:]), axis=1)
    if len(is_moved):
        targets = body_poses(clip.robot.model, bases[is_moved], attitudes[is_moved], positions[is_moved])
        heights = _heights(clip, clip_times[is_moved])
        for row, number in enumerate(is_moved):
            feet = [
                (body, pin.SE3(targets.rotations[row, body], targets.places[row, body]), share)
                for body, share in zip(clip.scene.foot_bodies, _shares(heights[row]), strict=True)
                if share > 0
            ]
            if feet:
                found[number] = _with_feet_held(clip, found[number], feet)
    return found


def _heights(clip: Clip, clip_times: Array) -> Array:
    """Heights (K, F) of the feet over the ground at times of the clip, m."""
    scene = clip.scene
    over_ground = scene.foot_heights - scene.ground.heights[:, None]
    columns = [np.interp(clip_times, scene.times, column) for column in over_ground.T]
    return np.stack(columns, axis=1)


def _shares(heights: Array) -> Array:
    """How much feet at heights (F,) are held, from 1 on the ground to 0 in the air."""
    return np.clip((LOOSE - heights) / (LOOSE - HELD), 0.0, 1.0)


def _with_feet_held(clip: Clip, configuration: Array, feet: Sequence[tuple[int, pin.SE3, float]]) -> Array:
    """The configuration with the legs bent so that feet are where they are to be, each by its share."""
    model = clip.robot.model
    data = model.createData()
    legs = sorted({column for body, _, _ in feet for column in _leg(model, body)})
    now = configuration
    for _ in range(ROUNDS):
        pin.computeJointJacobians(model, data, now)
        misses, rows = [], []
        for body, target, _ in feet:
            place = data.oMi[body]
            misses += [target.translation - place.translation, pin.log3(target.rotation @ place.rotation.T)]
            rows.append(pin.getJointJacobian(model, data, body, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:, legs])
        miss = np.concatenate(misses)
        if np.abs(miss).max() < CLOSE:
            break
        jacobian = np.concatenate(rows)
        normal = jacobian @ jacobian.T + DAMPING * np.eye(len(miss))
        change = np.zeros(model.nv)
        change[legs] = jacobian.T @ np.linalg.solve(normal, miss)
        now = pin.integrate(model, now, change)
    held = configuration.copy()
    for body, _, share in feet:
        own = [column + 1 for column in _leg(model, body)]  # a configuration has one number more, of the quaternion
        held[own] = configuration[own] + share * (now[own] - configuration[own])
    return held


def _leg(model: pin.Model, body: int) -> list[int]:
    """Velocities of the model that move a foot but not the base, up to where limbs part."""
    columns: list[int] = []
    joint = body
    while joint > 1:
        columns.append(model.joints[joint].idx_v)
        joint = model.parents[joint]
    return columns


def foot_misses(clip: Clip, clip_times: Array, configurations: Array) -> Array:
    """By how much (K, F), m, feet that are held are off the clip's, at times of the clip; 0 of others."""
    curve = clip.curve
    model = clip.robot.model
    own = curve.poses(clip_times)
    attitudes = Rotation.from_quat(configurations[:, 3:7]).as_matrix()
    new = body_poses(model, configurations[:, :3], attitudes, configurations[:, 7:])
    held = _heights(clip, clip_times) < HELD
    bodies = list(clip.scene.foot_bodies)
    return np.where(held, np.linalg.norm(new.places[:, bodies] - own.places[:, bodies], axis=2), 0.0)


def velocity_difference(
    flight: Array, clip_velocities: tuple[Array, Array, Array], pace: float, attitude: Array
) -> Array:
    """The change (6 + J,) of a seam: a flight's velocity (6 + J,), its base's part in the base's axes, less the clip's.

    The clip's are of its own time; a second of the clip is ``pace`` seconds of the repaired one.
    """
    linear, angular, joints = clip_velocities
    own = np.concatenate((attitude @ flight[:3], attitude @ flight[3:BASE], flight[BASE:]))
    return own - np.concatenate((linear, angular, joints)) / pace


def turn_between(first: Array, second: Array) -> float:
    """Angle, rad, between two attitudes (3, 3)."""
    return float(np.linalg.norm(logarithm((first @ second.T)[None])))
