"""What the joints alone make of the robot: rotations, inertia and momentum in the base's axes, on cells of time.

With ``U = R C`` of :mod:`~floatplan.certificate.spatial.robot` and ``W_b = U_b R_b^T``, the second moment about the
centre of mass is ``S = sum_b W_b``, and the angular momentum of bodies that turn at ``omega_b`` in the base's axes is
``sum_k u_k x (omega_b x r_k) = L_b omega_b`` over all columns u of U and r of R, with

    L_b = tr(W_b) 1 - W_b^T,    I = sum_b L_b,    A q' = sum_b L_b omega_b.

Rotations are products along the tree, from the base to the leaves. In the Euclidean norm their radii add up, so that a
chain of twelve joints costs nothing that would make up for it to begin at the leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from floatplan.arrays import IntArray
from floatplan.certificate.cells import ORDER, TimeCells
from floatplan.certificate.enclosure import Balls, Taylor, cos_sin, up
from floatplan.certificate.joints import joint_motion
from floatplan.certificate.spatial.models import (
    UNIT,
    Matrices,
    beside,
    frobenius,
    inverted,
    moments,
    one_after_another,
)
from floatplan.certificate.spatial.robot import SpatialRobot
from floatplan.plans.record import PlanRecord


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """The motion of the bodies relative to the base, all in the base's axes; cells first, then items.

    Attributes
    ----------
    positions, velocities, accelerations : (K, cells, n)
        Of the planned joints.
    rotations : B rotations (3, 3) from the bodies' axes to the base's
    joint_axes : J unit vectors
    joint_rates, joint_accelerations : J, derivatives of the positions of the joints that are moved
    body_inertias : B matrices ``L_b`` (3, 3), kg m^2
    inertia, inverse : one matrix (3, 3), I and its inverse
    joint_momentum : one vector, ``A q'``, kg m^2/s
    """

    positions: Taylor
    velocities: Taylor
    accelerations: Taylor
    rotations: Matrices
    joint_axes: Matrices
    joint_rates: Matrices
    joint_accelerations: Matrices
    body_inertias: Matrices
    inertia: Matrices
    inverse: Matrices
    joint_momentum: Matrices

    @classmethod
    def joined(cls, parts: Sequence[BodyMotion]) -> BodyMotion:
        """The models of several batches of cells."""
        models = {}
        for name in cls.__dataclass_fields__:
            models[name] = [getattr(part, name) for part in parts]
        return cls(**{name: _one_after_another(of_parts) for name, of_parts in models.items()})

    def on_cells(self, cells: IntArray) -> BodyMotion:
        """The models of some cells, or in another order."""
        chosen: dict[str, Any] = {}
        for name in self.__dataclass_fields__:
            model = getattr(self, name)
            chosen[name] = model.on_cells(cells) if isinstance(model, Matrices) else model[cells]
        return BodyMotion(**chosen)


def _one_after_another(models: Sequence[Any]) -> Any:
    """The cells of all, of matrices or of scalars."""
    if isinstance(models[0], Matrices):
        return one_after_another(models)
    return Taylor(np.concatenate([model.c for model in models], axis=1), np.concatenate([model.e for model in models]))


def body_motion(robot: SpatialRobot, record: PlanRecord, cells: TimeCells) -> BodyMotion:
    """Enclose the motion relative to the base on cells."""
    q, dq, ddq = joint_motion(record, cells)
    angles = _of_moved_joints(robot, q)
    if robot.offset.any():
        angles += Taylor.constant(Balls.exact(robot.offset).broadcast(angles.e.shape), ORDER)
    cosine, sine = cos_sin(angles)
    rotations = _rotations(robot, cosine, sine)
    axes = rotations[1:].times(Balls(robot.axes.mid[..., None], robot.axes.rad[..., None]))
    axes = Matrices.of(axes.c, axes.entries, axes.e, np.ones_like(axes.e))
    rates = Matrices.of_scalars(_of_moved_joints(robot, dq))
    second_moments = rotations.of_blocks(robot.inertia) @ rotations.transposed
    body_inertias = moments(second_moments)
    inertia = body_inertias.summed()
    rates_of_bodies = (axes @ rates).sums(robot.carried.T)
    return BodyMotion(
        positions=q,
        velocities=dq,
        accelerations=ddq,
        rotations=rotations,
        joint_axes=axes,
        joint_rates=rates,
        joint_accelerations=Matrices.of_scalars(_of_moved_joints(robot, ddq)),
        body_inertias=body_inertias,
        inertia=inertia,
        inverse=_inverse(inertia),
        joint_momentum=(body_inertias @ rates_of_bodies).summed(),
    )


def _of_moved_joints(robot: SpatialRobot, models: Taylor) -> Taylor:
    """Models (K, cells, J) by ratio of those of the planned joints; nothing is rounded where all ratios are 1."""
    of_leaders = models[:, robot.leader]
    return of_leaders if (robot.ratio == 1.0).all() else of_leaders.times(Balls.exact(robot.ratio))


def _rotations(robot: SpatialRobot, cosine: Taylor, sine: Taylor) -> Matrices:
    """Rotations of all bodies relative to the base, by products along the tree, a generation at a time.

    ``still + sine sin q + cosine cos q``: an error of (cos q, sin q) as a complex number, which :func:`cos_sin` bounds,
    turns the plane across the axis by as much, so that it is one of the same spectral norm.
    """
    parts = (robot.still, robot.sine, robot.cosine)
    c = robot.still.mid + np.zeros((*cosine.c.shape, 3, 3))
    c[1:] = 0.0
    c += cosine.c[..., None, None] * robot.cosine.mid + sine.c[..., None, None] * robot.sine.mid
    still, by_sine, by_cosine = (np.abs(part.mid) for part in parts)
    of_still, of_sine, of_cosine = (part.rad for part in parts)
    sines, cosines, radius = (each[..., None, None] for each in (sine.size, cosine.size, cosine.e))
    rounded = 4.0 * UNIT * (still + by_sine * sines + by_cosine * cosines)
    rounded = rounded + of_still + of_sine * (sines + radius) + of_cosine * (cosines + radius)
    entries = up(radius * (by_sine + by_cosine) + rounded)
    e = up(cosine.e + frobenius(rounded))
    turns = Matrices.of(np.ascontiguousarray(c.transpose(1, 2, 0, 3, 4)), entries, e, np.ones_like(e))
    count = len(robot.parent)
    cells = len(e)
    base = Matrices.constant(Balls.exact(np.eye(3)[None]), cells)
    found = [Matrices.of(base.c, base.entries, base.e, np.ones((cells, 1)))]
    bodies = [0]
    generation = [0]
    while len(bodies) <= count:
        children = [b for b in range(1, count + 1) if robot.parent[b - 1] in generation]
        parents = [bodies.index(robot.parent[b - 1]) for b in children]
        found = [beside(found)]
        found.append(found[0][parents] @ turns[[b - 1 for b in children]])
        bodies += children
        generation = children
    return beside(found)[np.argsort(bodies)]


def _inverse(inertia: Matrices) -> Matrices:
    """The inverse of the inertia; an infinite radius where it is not shown to have one.

    For the computed polynomial V and ``D = 1 - I V`` with ``|D| <= r < 1``, ``I^-1 - V = V (D + D^2 + ..)`` has a norm
    of at most ``|V| r / (1 - r)``, and entries within ``|V| (|D| + r^2 / (1 - r))``.
    """
    c = inertia.c[:, 0]
    v = np.zeros_like(c)
    first = inverted(c[:, 0])
    v[:, 0] = first
    for k in range(1, ORDER):
        v[:, k] = -first @ np.einsum("ciab,cibd->cad", c[:, 1 : k + 1], v[:, k - 1 :: -1])
    inverse = Matrices.exact(v[:, None])
    product = inertia @ inverse
    off = product.c.copy()
    off[:, :, 0] -= np.eye(3)
    off = up(np.abs(off).sum(axis=2) + product.entries + 2.0 * UNIT)
    r = up(frobenius(off))
    small = r < 0.5
    more = up(np.where(small, 1.0 / np.where(small, 1.0 - r, 1.0), np.inf))
    e = up(inverse.size * r * more)
    entries = up(inverse.magnitude @ (off + (r * r * more)[..., None, None]))
    return Matrices.of(inverse.c, np.where(small[..., None, None], entries, np.inf), e)
