"""Rotations in space: vectors of rotation, and three angles about axes, by :class:`scipy.spatial.transform.Rotation`.

A rotation matrix R (..., 3, 3) takes vectors of the body to the world. A small turn zeta of the world's axes makes it
``exp([zeta]x) R``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from floatplan.arrays import Array


def _rotation() -> Any:
    from scipy.spatial.transform import Rotation  # here, since plans in a plane do without

    return Rotation


def cross_matrix(vectors: Array) -> Array:
    """Matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    result = np.zeros((*vectors.shape, 3))
    result[..., 2, 1], result[..., 0, 2], result[..., 1, 0] = x, y, z = np.moveaxis(vectors, -1, 0)
    result[..., 1, 2] = -x
    result[..., 2, 0] = -y
    result[..., 0, 1] = -z
    return result


def exponential(turns: Array) -> Array:
    """Rotations (K, 3, 3) by vectors of rotation (K, 3), rad."""
    return np.asarray(_rotation().from_rotvec(turns).as_matrix())


def of_quaternions(quaternions: Array) -> Array:
    """Rotations (K, 3, 3) of quaternions (K, 4), x, y, z, w, of any length."""
    return np.asarray(_rotation().from_quat(quaternions).as_matrix())


def quaternions_of(rotations: Array) -> Array:
    """Quaternions (K, 4) of rotations (K, 3, 3), x, y, z, w, with w not negative."""
    return np.asarray(_rotation().from_matrix(rotations).as_quat(canonical=True))


def logarithm(rotations: Array) -> Array:
    """The shortest vectors of rotation (K, 3), rad, of rotations (K, 3, 3)."""
    return np.asarray(_rotation().from_matrix(rotations).as_rotvec())


def of_angles(axes: str, angles: Array) -> Array:
    """Rotations (K, 3, 3) ``R_a(first) R_b(second) R_c(third)`` about axes such as "yxz", of angles (K, 3), rad."""
    return np.asarray(_rotation().from_euler(axes.upper(), angles).as_matrix())


def unwrapped_angles(axes: str, rotations: Array) -> Array:
    """Angles (K, 3), rad, of a motion (K, 3, 3), see :func:`of_angles`: first and third go on from instant to instant.

    The second is between -90 and 90 degrees where the three axes differ (Yeadon's somersault, tilt and twist), between
    0 and 180 where the third is the first again.
    """
    sequence: Any = axes.upper()
    angles: Array = _rotation().from_matrix(rotations).as_euler(sequence, suppress_warnings=True)
    angles[:, [0, 2]] = np.unwrap(angles[:, [0, 2]], axis=0)
    return angles


def left_jacobian_inverse(turn: Array) -> Array:
    """Derivative (3, 3) of the vector of rotation (3,), rad, by a small turn that is done after it."""
    angle = float(np.linalg.norm(turn))
    across = cross_matrix(turn)
    half = angle / 2
    factor = 1 / 12 if angle < 1e-3 else (1 - half / math.tan(half)) / angle**2
    return np.asarray(np.eye(3) - across / 2 + factor * across @ across)
