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


def forces(robot: SpatialRobot, motion: BodyMotion, seen: Matrices) -> Forces:
    """Enclose rates and torques for the momentum ``R^T h`` as the base sees it, one vector."""
    rate = motion.inverse @ (seen - motion.relative)
    spins = motion.axes @ motion.rates
    bodies = beside([rate, spins]).sums(np.vstack([np.ones(len(robot.carried) + 1), robot.carried]).T)
    pushed = motion.axes @ motion.pushes + crossed(bodies[robot.parent]) @ spins
    turned = crossed(bodies)
    second = crossed(pushed.sums(robot.carried.T)) + turned @ turned
    driven = (second @ motion.rotations).of_blocks(robot.inertia)
    held = axial(motion.rotations @ driven.transposed)
    acceleration = -(motion.inverse @ held.summed())
    on_bodies = held + motion.spreads.transposed @ acceleration
    torques = (motion.axes.transposed @ on_bodies.sums(robot.carried)).scalars()
    torques += motion.pushes.scalars().times(Balls.exact(robot.armature))
    return Forces(rate, torques.linear(Balls.exact(robot.transmission.T)))


def squared(vectors: Matrices) -> Taylor:
    """The squared lengths of vectors."""
    return (vectors.transposed @ vectors).scalars()
