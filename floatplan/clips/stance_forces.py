"""Forces of the stances before and after a repaired flight: they are bent, not planned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.clips.clip import Clip
from floatplan.clips.flights import FOOT_CLEARANCE
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.kinematics import body_poses, centre_of_mass
from floatplan.motion.spatial.rotations import of_quaternions

STEPS = 2  # [-] instants to either side, of differences: nearer ones tell of the frames' noise
LOADED = 0.1  # [-] of the weight: where the ground carries less, where it presses tells nothing
# unit vectors at 24 equal steps of the full circle: the feet's edge is 1 % off at most
DIRECTIONS = np.stack([np.cos(2.0 * np.pi * np.arange(24) / 24), np.sin(2.0 * np.pi * np.arange(24) / 24)], axis=1)


@dataclass(frozen=True, eq=False)
class StanceFigures:
    """Forces of the stances before and after a repaired flight.

    Attributes
    ----------
    vertical_least : least vertical force of the ground, in shares of the weight; negative where it would be adhesive
    friction : the largest share of horizontal in vertical force; infinite where the ground would have to be adhesive
    pressure_outside : m, by which the centre of pressure is outside of the feet that stand, at most
    """

    vertical_least: float
    friction: float
    pressure_outside: float


def stance_figures(clip: Clip, configurations: Array, clip_times: Array, step: float, gravity: float) -> StanceFigures:
    """Return what K instants, ``step`` seconds apart, of a stance would take; those at its ends serve for differences.

    Parameters
    ----------
    clip : Clip
        Whose feet stand where they do, over its ground.
    configurations : (K, 7 + J), with K above twice STEPS
    clip_times : (K,) s, of the clip
    step : s
    gravity : m/s^2
    """
    robot = clip.robot
    poses = body_poses(robot, configurations[:, :3], of_quaternions(configurations[:, 3:7]), configurations[:, 7:])
    com = centre_of_mass(robot, poses)
    inner = slice(STEPS, -STEPS)
    span = STEPS * step
    acceleration = (com[2 * STEPS :] - 2.0 * com[inner] + com[: -2 * STEPS]) / span**2
    up = np.array([0.0, 0.0, 1.0])
    force = acceleration / gravity + up  # in shares of the weight
    across = np.linalg.norm(force[:, :2], axis=1)
    friction = np.where(force[:, 2] > 0, across / np.maximum(force[:, 2], 1e-9), np.inf)
    momentum = _angular_momentum(clip, configurations, step)
    moment = (momentum[2 * STEPS :] - momentum[: -2 * STEPS]) / (2.0 * span * robot.mass * gravity)
    standing = BodyPoses(poses.places[inner], poses.rotations[inner])
    reach, ground = _reach(clip, standing, clip_times[inner])
    pressure = _centre_of_pressure(com[inner], force, moment, ground)
    outside = (pressure @ DIRECTIONS.T - reach).max(axis=1)
    loaded = (force[:, 2] > LOADED) & np.isfinite(outside)
    return StanceFigures(
        vertical_least=float(force[:, 2].min()),
        friction=float(friction.max()),
        pressure_outside=float(outside[loaded].max(initial=0.0)),
    )


def _angular_momentum(clip: Clip, configurations: Array, step: float) -> Array:
    """Angular momentum (K, 3) about the centre of mass, kg m^2/s."""
    model = clip.robot.model
    data = model.createData()
    momenta = np.empty((len(configurations), 3))
    for k, now in enumerate(configurations):
        first = max(k - 1, 0)
        last = min(k + 1, len(configurations) - 1)
        velocity = pin.difference(model, configurations[first], configurations[last]) / ((last - first) * step)
        momenta[k] = pin.computeCentroidalMomentum(model, data, now, velocity).angular
    return momenta


def _reach(clip: Clip, poses: BodyPoses, clip_times: Array) -> tuple[Array, Array]:
    """How far (K, D) feet on the ground reach in each direction from the world's origin, and how low (K,) they are, m.

    Minus infinity where none is on the ground.
    """
    scene = clip.scene
    lowest = scene.foot_solids.lowest(poses)[..., 2]
    # points up to 0.01 m over a foot's lowest point are on the ground
    stands = scene.foot_clearances(clip_times) < FOOT_CLEARANCE
    levels = np.where(stands, lowest + 0.01, -np.inf)
    return scene.foot_solids.reach(poses, levels, DIRECTIONS), lowest.min(axis=1)


def _centre_of_pressure(com: Array, force: Array, moment: Array, ground: Array) -> Array:
    """Where on the ground (K, 2), m, the forces act: through there they have the moments about the centre of mass.

    Parameters
    ----------
    com : (K, 3) m
    force : (K, 3), in shares of the weight
    moment : (K, 3) m, of the moment in shares of the weight
    ground : (K,) m
    """
    height = com[:, 2] - ground
    x = -(moment[:, 1] + height * force[:, 0])
    y = moment[:, 0] - height * force[:, 1]
    vertical = np.where(np.abs(force[:, 2]) > LOADED, force[:, 2], np.nan)
    return com[:, :2] + np.stack([x, y], axis=1) / vertical[:, None]
