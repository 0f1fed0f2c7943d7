"""How fast the base turns, and the joints' torques, on cells of time, in the base's axes.

With ``omega_b`` and ``alpha_b`` of all bodies, ``R_b'' = ([alpha_b]x + [omega_b]x^2) R_b``, and the moment on body b,
by which a virtual turn of it alone would do work, is

    Q_b = sum_k r_k x v_k  over its columns r of R_b and v of ``(R'' C)_b``.

The base's own acceleration alpha turns all bodies alike and adds ``L_b^T alpha``; in free flight all moments together
are zero, so that ``I alpha = -sum_b Q_b`` of the rest. The torque of a joint is the moment on what it carries about
its axis, and what turns its rotor. Gravity has no part in it: C is about the centre of mass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.certificate.enclosure import Balls, Taylor
from floatplan.certificate.spatial.bodies import BodyMotion
from floatplan.certificate.spatial.models import Matrices, axial, beside, crossed
from floatplan.certificate.spatial.robot import SpatialRobot


@dataclass(frozen=True, eq=False)
class Forces:
    """The base's rate, one vector, rad/s, and the motors' own torques (K, cells, motors), N m."""

    rate: Matrices
    motor_torques: Taylor


def forces(robot: SpatialRobot, motion: BodyMotion, momentum_in_base: Matrices) -> Forces:
    """Enclose rates and torques for the angular momentum in the base's axes, one vector."""
    base_rate = motion.inverse @ (momentum_in_base - motion.joint_momentum)
    spins = motion.joint_axes @ motion.joint_rates
    on_path = np.vstack(
        [np.ones(len(robot.carried) + 1), robot.carried]
    )  # the base's rate, and of joints before a body
    rates = beside([base_rate, spins]).sums(on_path.T)
    spin_changes = motion.joint_axes @ motion.joint_accelerations + crossed(rates[robot.parent]) @ spins
    crossed_rates = crossed(rates)
    # Everything but the base's own acceleration: R_b'' R_b^T, then the moments Q_b.
    second = crossed(spin_changes.sums(robot.carried.T)) + crossed_rates @ crossed_rates
    driven = (second @ motion.rotations).of_blocks(robot.inertia)
    moments_without_base = axial(motion.rotations @ driven.transposed)
    base_acceleration = -(motion.inverse @ moments_without_base.summed())
    moments = moments_without_base + motion.body_inertias.transposed @ base_acceleration
    torques = (motion.joint_axes.transposed @ moments.sums(robot.carried)).scalars()
    torques += motion.joint_accelerations.scalars().times(Balls.exact(robot.armature))
    return Forces(base_rate, torques.linear(Balls.exact(robot.transmission.T)))


def squared(vectors: Matrices) -> Taylor:
    """The squared lengths of vectors."""
    return (vectors.transposed @ vectors).scalars()
