"""The numbers that the search chooses, and the motions they stand for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.sine_polynomial import SinePolynomials
from floatplan.planning.transcription.boundary import Boundary

AtEnds: TypeAlias = Literal["momentum", "velocities", "accelerations"]


@dataclass(frozen=True, eq=False)
class DecisionVariables:
    """How the search's variables x make a motion: ``z = offset + scaling @ x[:m]``, ``h`` by the rest.

    Attributes
    ----------
    polynomials : SinePolynomials
    offset : (m,), scaling : (m, m)
        m free coefficients in all, joint by joint.
    momentum : MomentumSet
        Of h, ``centre + axes @ x[m:]``.
    following : Boundary, optional
        The conditions (13) where they change with h; the polynomials' own are those of the middle h.
    """

    polynomials: SinePolynomials
    offset: Array
    scaling: Array
    momentum: MomentumSet
    following: Boundary | None = None

    @cached_property
    def coefficients(self) -> int:
        """Number m of free coefficients."""
        return len(self.offset)

    @cached_property
    def size(self) -> int:
        """Number of variables."""
        return self.coefficients + self.momentum.free

    @cached_property
    def metric(self) -> Array:
        """Matrix (size, size): ``|metric @ step|`` is 1 where p moves by 1 rad root mean square, or h by an axis."""
        metric = np.eye(self.size)
        joints = len(self.polynomials.centre)
        metric[: self.coefficients, : self.coefficients] = self.scaling / np.sqrt(joints)
        return metric

    @cached_property
    def chosen_at_ends(self) -> frozenset[AtEnds]:
        """What the search chooses of the state at takeoff or landing."""
        chosen: set[AtEnds] = {"momentum"} if self.momentum.free else set()
        if self.following:
            chosen.add("velocities")
        if self.polynomials.free_ends:
            chosen.add("accelerations")
        return frozenset(chosen)

    def motion_class(self, angular_momentum: Array) -> SinePolynomials:
        """The class of motions with an angular momentum (e,)."""
        if not self.following:
            return self.polynomials
        return replace(self.polynomials, boundary=self.following(angular_momentum))

    def boundary_by_axes(self, x: Array) -> Array | None:
        """Derivatives (n, g, H) of the given conditions (13) by ``x[m:]``; None where they do not change."""
        if not self.following:
            return None
        by_momentum = self.following.by_momentum(self.angular_momentum(x))[:, list(self.polynomials.form.given)]
        return np.asarray(by_momentum @ self.momentum.axes)

    def free_coefficients(self, x: Array) -> Array:
        """Free coefficients z (n, width); zero where a joint has fewer."""
        free = self.offset + self.scaling @ x[: self.coefficients]
        joints, width = len(self.polynomials.free), self.polynomials.width
        if len(free) < joints * width:
            z = np.zeros(joints * width)
            z[self.polynomials.free_indices] = free
            free = z
        return free.reshape(joints, width)

    def variables(self, z: Array, angular_momentum: npt.ArrayLike) -> Array:
        """Return the x of a motion: the inverse of :meth:`free_coefficients` and :meth:`angular_momentum`."""
        x = np.linalg.solve(self.scaling, z.ravel()[self.polynomials.free_indices] - self.offset)
        if not self.momentum.free:
            return np.asarray(x)
        beside = np.atleast_1d(angular_momentum) - self.momentum.centre
        return np.concatenate((x, np.linalg.lstsq(self.momentum.axes, beside, rcond=None)[0]))

    def angular_momentum(self, x: Array) -> Array:
        """Angular momentum h (e,), kg m^2/s."""
        if not self.momentum.free:
            return self.momentum.centre
        return np.asarray(self.momentum.centre + self.momentum.axes @ x[self.coefficients :])

    def plain_motion(self) -> Array:
        """Return the x of the Hermite motion with no free part, and the h in the middle."""
        return self.variables(self.polynomials.no_free_part, self.momentum.centre)

    def gradient(self, by_z: Array, by_momentum: Array | None, by_axes: Array | None = None) -> Array:
        """Derivatives (..., size) by x, from those by z (..., n, width) and by h (..., e), None for zeros.

        ``by_axes`` (..., H) are added: what h does by way of the boundary.
        """
        *shape, joints, width = by_z.shape
        rows = math.prod(shape)  # one product of matrices is faster than many
        flat = self.flat_gradient(
            by_z.reshape(rows, joints * width),
            None if by_momentum is None else by_momentum.reshape(rows, -1),
            None if by_axes is None else by_axes.reshape(rows, -1),
        )
        return flat.reshape(*shape, self.size)

    def flat_gradient(self, by_z: Array, by_momentum: Array | None, by_axes: Array | None = None) -> Array:
        """Derivatives (r, size) by x, from those by z (r, n width) and by h (r, e), as of :meth:`gradient`."""
        by_x = (by_z if by_z.shape[1] == len(self.offset) else by_z[:, self.polynomials.free_indices]) @ self.scaling
        if not self.momentum.free:
            return by_x
        chosen = np.zeros((len(by_x), self.momentum.free)) if by_axes is None else by_axes
        if by_momentum is not None:
            chosen = chosen + by_momentum @ self.momentum.axes
        return np.concatenate((by_x, chosen), axis=1)
