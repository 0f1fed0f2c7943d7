"""The model after Pinocchio has built it: does every planned motion move mass?"""

from __future__ import annotations

from random import Random  # NumPy's takes longer to import than all postures to draw
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.planar.model import BASE_COORDINATES

POSTURES = 4  # [-] a singular mass matrix is singular at almost all of them, or at the first, the reference
LEAST_EIGENVALUE = 1e-10  # [-] of the mass matrix scaled to a unit diagonal; below it, accelerations lose all digits


def check_model(model: Any, reference: Array, selection: Array, joints: tuple[str, ...], limits: Array) -> None:
    """Check that the mass matrix of base and planned joints is positive definite.

    Parameters
    ----------
    model : pinocchio.Model
    reference, selection : (nv,), (nv, n)
    joints : (n) names
    limits : (n, 2) rad, infinite where not given

    Raises
    ------
    InputError
        If the robot has no mass, or a planned joint moves none.
    """
    moving = np.zeros((model.nv, BASE_COORDINATES + len(joints)))
    moving[:BASE_COORDINATES, :BASE_COORDINATES] = np.eye(BASE_COORDINATES)
    moving[:, BASE_COORDINATES:] = selection
    data = model.createData()
    for positions in sample_postures(limits, POSTURES, Random(0)):
        upper = np.triu(pin.crba(model, data, reference + selection @ positions))
        mass_matrix = moving.T @ (upper + np.triu(upper, 1).T) @ moving
        _check_mass_matrix(mass_matrix, joints)


def sample_postures(limits: Array, count: int, generator: Random) -> Array:
    """Return postures (count, n) within ``limits`` (n, 2); joints without limits turn within [-pi, pi].

    The first is the one nearest to zero.
    """
    lower, upper = np.clip(limits[:, 0], -np.pi, None), np.clip(limits[:, 1], None, np.pi)
    beyond = lower > upper  # limits that leave [-pi, pi] out altogether
    lower[beyond], upper[beyond] = limits[beyond, 0], limits[beyond, 1]
    fractions = [[generator.random() for _ in limits] for _ in range(count)]
    postures: Array = lower + (upper - lower) * np.array(fractions).reshape(count, len(limits))
    postures[0] = np.clip(0.0, lower, upper)
    return postures


def _check_mass_matrix(mass_matrix: Array, joints: tuple[str, ...]) -> None:
    if not np.isfinite(mass_matrix).all():
        raise InputError("its mass matrix is not finite", advice="check that masses are in kg and lengths in m")
    diagonal = mass_matrix.diagonal()
    if not diagonal[0] > 0.0:
        raise InputError("has no mass", advice="give its links an <inertial> element")
    if diagonal.min() > 0.0:
        scale = 1.0 / np.sqrt(diagonal)
        values, vectors = np.linalg.eigh(scale[:, None] * mass_matrix * scale)
        if values[0] > LEAST_EIGENVALUE:
            return
        culprit = int(np.argmax(abs(vectors[BASE_COORDINATES:, 0])))
    else:
        culprit = int(np.argmin(diagonal[BASE_COORDINATES:]))
    reason = "moves no inertia of its own: the mass matrix is singular"
    raise InputError(reason, element=f'joint "{joints[culprit]}"', advice="give the links beyond it mass, or lock it")
