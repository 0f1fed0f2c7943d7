"""Frames of a motion for programs that learn from it, and files that are made of nothing else.

A plan, a jump and a recorded motion are sampled once, as :class:`Frames`; each function here is the format of one
program. Joints and bodies are in the order of the frames, which is that of the program's model.
"""

import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array


@dataclass(frozen=True, eq=False)
class Frames:
    """N frames of a motion at a constant rate, in a world whose z axis is up.

    Attributes
    ----------
    rate : Hz
    joints : (J,) names
    positions, velocities : (N, J) rad, rad/s; m, m/s where a joint slides
    base_position : (N, 3) m
    base_quaternion : (N, 4) x, y, z, w, of unit length, nowhere of opposite sign to the frame before
    bodies : (B,) names
    body_motions : of these bodies
        ``body_positions``, ``body_linear_velocities``, ``body_angular_velocities`` (N, B, 3) and ``body_rotations``
        (N, B, 4) w, x, y, z, of the links' frames in the world.
    contacts : none, or
        ``contact_names`` (C,), ``contacts`` (N, C), whether each stands, and of a plan or a jump ``contact_forces``
        (N, C, 3), N, on the robot, in the world.
    """

    rate: float
    joints: tuple[str, ...]
    positions: Array
    velocities: Array
    base_position: Array
    base_quaternion: Array
    bodies: tuple[str, ...] = ()
    body_motions: Mapping[str, Array] = field(default_factory=dict)
    contacts: Mapping[str, Any] = field(default_factory=dict)


def mjlab_arrays(frames: Frames) -> dict[str, Any]:
    """Return the arrays of a motion of mjlab, whose loader finds bodies by their number in its model.

    ``fps`` (1,), ``joint_pos``, ``joint_vel`` (N, J), ``body_pos_w``, ``body_lin_vel_w``, ``body_ang_vel_w``
    (N, B, 3), ``body_quat_w`` (N, B, 4) w, x, y, z, as its ``csv_to_npz`` writes them; the loader takes no notice of
    other names: ``joint_names``, ``body_names``, and the contacts.
    """
    of_bodies = frames.body_motions
    return {
        "fps": np.array([frames.rate]),
        "joint_pos": frames.positions,
        "joint_vel": frames.velocities,
        "body_pos_w": of_bodies["body_positions"],
        "body_quat_w": of_bodies["body_rotations"],
        "body_lin_vel_w": of_bodies["body_linear_velocities"],
        "body_ang_vel_w": of_bodies["body_angular_velocities"],
        "joint_names": np.array(frames.joints),
        "body_names": np.array(frames.bodies),
        **frames.contacts,
    }


def gmr_pickle(frames: Frames, others: Mapping[str, Any]) -> bytes:
    """Return a pickle of GMR, of numbers, lists and arrays, with ``others`` that do not change with the motion.

    ``fps``, ``root_pos`` (N, 3), ``root_rot`` (N, 4) x, y, z, w, ``dof_pos`` (N, J); and of the bodies, where there
    are any, ``link_body_list`` (B,) and ``local_body_pos`` (N, B, 3), m, from the base in its axes.
    """
    data = {
        **others,
        "fps": frames.rate,
        "root_pos": np.array(frames.base_position),
        "root_rot": np.array(frames.base_quaternion),
        "dof_pos": np.array(frames.positions),
        **_lists(frames.contacts),
    }
    if frames.bodies:
        in_world = frames.body_motions["body_positions"] - frames.base_position[:, None]
        axes = Rotation.from_quat(np.array(frames.base_quaternion)).as_matrix()
        data |= {"link_body_list": list(frames.bodies), "local_body_pos": np.einsum("nji,nbj->nbi", axes, in_world)}
    return _pickled(data)


def mimickit_pickle(frames: Frames, others: Mapping[str, Any]) -> bytes:
    """Return a pickle of MimicKit, of numbers and lists, with ``others`` that do not change with the motion.

    ``fps``, and ``frames``: rows of base position, rotation vector and joints.
    """
    vectors = continuous_vectors(Rotation.from_quat(np.array(frames.base_quaternion)).as_rotvec())
    rows = np.concatenate((frames.base_position, vectors, frames.positions), axis=1)
    data = {**others, "fps": frames.rate, "frames": rows.tolist(), **_lists(frames.contacts)}
    return _pickled(data)


def continuous_vectors(vectors: Array) -> Array:
    """Rotation vectors (N, 3), rad, of the same rotations, each as near to the one before as there is."""
    continuous = vectors.copy()
    for before, vector in pairwise(continuous):
        angle = float(np.linalg.norm(vector))
        along = vector if angle > 0 else before
        length = float(np.linalg.norm(along))
        if length > 0:
            axis = along / length
            turns = round((float(before @ axis) - angle) / (2.0 * np.pi))
            if turns:
                vector += 2.0 * np.pi * turns * axis
    return continuous


def _lists(arrays: Mapping[str, Any]) -> dict[str, Any]:
    return {name: np.asarray(values).tolist() for name, values in arrays.items()}


def _pickled(data: Mapping[str, Any]) -> bytes:
    return pickle.dumps(data, protocol=4)  # which Python reads since 3.4
