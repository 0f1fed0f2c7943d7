"""The motion in Taylor models: joints (12), angular momentum (4), orientation (18) and torques, on cells of time.

All models have the shape (K, cells, items). What follows from the joints' motion uses the constants of
:class:`~floatplan.certificate.planar.inertia.PlanarRobot`. With
``zeta_b = exp(i sum_k turns_bk q_k)`` and ``phi_b' = theta' + sum_k turns_bk q_k'``:

- ``m_j - i n_j = sum_i C_ij conj(zeta_i) zeta_j``; ``D_0 = sum_j m_j`` and ``D_k = sum_j m_j turns_jk`` in (4);
- (4) and its derivative: ``sum_j m_j phi_j' = h`` and ``sum_j (m_j phi_j'' + n_j phi_j'^2) = 0``;
- the torque on body i is ``Q_i = Re(conj(zeta_i) sum_j C_ij zeta_j (phi_j'' + i phi_j'^2))``, and on joint k
  ``tau_k = sum_i turns_ik Q_i``; on motor l, ``sum_i motor_turns_il Q_i``; Q_i has what turns the motors' rotors too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.certificate.cells import FIRST_CELLS, ORDER, TimeCells, Vectors
from floatplan.certificate.enclosure import ROUND, Balls, Taylor, cos_sin, integral, products, reciprocal, up
from floatplan.certificate.joints import joint_motion
from floatplan.certificate.limits import LimitedQuantity
from floatplan.certificate.planar.inertia import PlanarRobot
from floatplan.plans.record import PlanRecord


@dataclass(frozen=True, eq=False)
class Joints:
    """What does not depend on the orientation, (K, cells, n) unless stated otherwise.

    ``motor_torques`` (K, cells, motors) are the motors' own; ``rate`` is theta' and has one item; ``cos`` and ``sin``
    are the parts of zeta, (K, cells, m).
    """

    positions: Taylor
    velocities: Taylor
    accelerations: Taylor
    motor_torques: Taylor
    rate: Taylor
    cos: Taylor
    sin: Taylor

    def limited_rate(self, limit: float) -> LimitedQuantity:
        """The orientation's rate, and its limit, rad/s."""
        return LimitedQuantity("orientation_rate", (), self.rate, limit)

    @classmethod
    def joined(cls, batches: Sequence[Joints]) -> Joints:
        """The models of several batches of cells."""

        def join(name: str) -> Taylor:
            models = [getattr(batch, name) for batch in batches]
            return Taylor(np.concatenate([m.c for m in models], axis=1), np.concatenate([m.e for m in models]))

        return cls(*(join(row.name) for row in fields(cls)))

    def __getitem__(self, cells: IntArray) -> Joints:
        """The models of some cells, or in another order."""
        return Joints(**{row.name: getattr(self, row.name)[cells] for row in fields(self)})


@dataclass(frozen=True, eq=False)
class FlightEnclosure:
    """The flight on all cells in the order of time; ``orientation`` has one item."""

    cells: TimeCells
    joints: Joints
    orientation: Taylor

    @cached_property
    def direction(self) -> Vectors:
        """Cosine and sine of the orientation."""
        return Vectors(*cos_sin(self.orientation))


def joint_models(robot: PlanarRobot, record: PlanRecord, cells: TimeCells) -> Joints:
    """Enclose joints, orientation rate and torques on cells."""
    q, dq, ddq = joint_motion(record, cells)
    cos, sin = cos_sin(q.linear(robot.turns))
    shares, twists = _momentum_shares(robot, cos, sin)
    turned = dq.linear(robot.turns)
    turned_twice = ddq.linear(robot.turns)
    inverse = reciprocal(shares.sum())
    h = Taylor.constant(Balls.exact(np.full((len(cells.low), 1), record.angular_momentum)), ORDER)
    weighted_rate, weighted_acceleration = products([(shares, turned), (shares, turned_twice)])
    rate = (h - weighted_rate.sum()) * inverse
    phi_rate = turned + rate
    squared = phi_rate * phi_rate
    acceleration = -((weighted_acceleration + twists * squared).sum() * inverse)
    body_torques = _body_torques(robot, cos, sin, turned_twice + acceleration, squared)
    if robot.rotors is not None:
        body_torques += ddq.linear(robot.rotors)
    return Joints(q, dq, ddq, body_torques.linear(robot.motor_turns.transposed), rate, cos, sin)


def _momentum_shares(robot: PlanarRobot, cos: Taylor, sin: Taylor) -> tuple[Taylor, Taylor]:
    """``m_j = sum_i c_ij cos(x_ij)`` and ``n_j = sum_i c_ij sin(x_ij)``, where ``x_ij = phi_i - phi_j - a_ij``."""
    conjugate = robot.inertia.adjoint.times(cos, sin)  # of sum_i C_ij conj(zeta_i)
    re = conjugate.x
    im = -conjugate.y
    re_cos, im_sin, re_sin, im_cos = products([(re, cos), (im, sin), (re, sin), (im, cos)])
    return re_cos - im_sin, -(re_sin + im_cos)


def _body_torques(robot: PlanarRobot, cos: Taylor, sin: Taylor, acceleration: Taylor, squared: Taylor) -> Taylor:
    along, inwards, outwards, across = products(
        [(cos, acceleration), (sin, squared), (cos, squared), (sin, acceleration)]
    )
    driven = robot.inertia.times(along - inwards, outwards + across)
    of_cos, of_sin = products([(cos, driven.x), (sin, driven.y)])
    return of_cos + of_sin


def assemble(record: PlanRecord, cells: TimeCells, joints: Joints) -> FlightEnclosure:
    """Integrate the orientation over the cells, which follow each other without gaps from t = 0."""
    increments = integral(joints.rate).times(cells.half[:, None])
    steps = increments.at_end(1.0)
    ends = record.orientation["start"] + np.concatenate([[0.0], np.cumsum(steps.mid[:, 0])])
    rounding = 2.0 * ROUND * np.arange(1, len(ends)) * np.abs(ends).max()
    radii = up(np.concatenate([[0.0], np.cumsum(steps.rad[:, 0])])[:-1] + rounding)
    starts = Taylor.constant(Balls(ends[:-1, None], radii[:, None]), ORDER)
    return FlightEnclosure(cells, joints, increments + starts)


def fly(robot: PlanarRobot, record: PlanRecord, windows: Sequence[tuple[float, float]], budget: int) -> FlightEnclosure:
    """Enclose the whole flight on cells that end where the windows, which lie within it, do.

    Cells are halved until their share of the orientation's radius and their torques' radii are as small as sought, or
    the ``budget`` of cells is spent.
    """
    duration = record.duration
    grid = np.arange(FIRST_CELLS + 1) * (duration / FIRST_CELLS)
    grid[-1] = duration
    edges = set(grid.tolist())
    instants = set()  # each is a cell
    for first, last in windows:
        edges |= {first, last}
        if first == last:
            instants.add(first)
    ends = np.array(sorted([*edges, *instants]))
    low = ends[:-1]
    high = ends[1:]
    done_low: list[Array] = []
    done_high: list[Array] = []
    done_joints: list[Joints] = []
    count = 0
    while True:
        cells = TimeCells.between(low, high)
        joints = joint_models(robot, record, cells)
        middle = 0.5 * (low + high)
        coarse = _coarse(joints, duration) & (low < middle) & (middle < high)
        if count + len(low) + coarse.sum() > budget:
            coarse[:] = False
        if not done_joints and not coarse.any():  # not copied: arrays in another order have sums of other last bits
            return assemble(record, cells, joints)
        fine = np.flatnonzero(~coarse)
        done_low.append(low[fine])
        done_high.append(high[fine])
        done_joints.append(joints[fine])
        count += len(fine)
        if not coarse.any():
            break
        low = low[coarse]
        middle = middle[coarse]
        high = high[coarse]
        low = np.concatenate([low, middle])
        high = np.concatenate([middle, high])
    low = np.concatenate(done_low)
    high = np.concatenate(done_high)
    order = np.lexsort((high, low))  # a cell of one instant comes before the one that begins there
    joints = Joints.joined(done_joints)[order]
    return assemble(record, TimeCells.between(low[order], high[order]), joints)


def _coarse(joints: Joints, duration: float) -> BoolArray:
    torque = np.fmax.reduce(joints.motor_torques.size, axis=None, initial=1e-12)
    rate_sharp = joints.rate.e[:, 0] * duration <= 1e-10  # [rad] at the end
    torque_sharp = (joints.motor_torques.e <= 1e-9 * torque).all(axis=-1)  # 1e-9 of the largest torque
    return np.asarray(~(rate_sharp & torque_sharp))
