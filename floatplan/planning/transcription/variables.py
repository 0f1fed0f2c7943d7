"""The numbers that the search chooses, and the motions they stand for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.sine_polynomial import SinePolynomials


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
    """

    polynomials: SinePolynomials
    offset: Array
    scaling: Array
    momentum: MomentumSet

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

    def gradient(self, by_z: Array, by_momentum: Array | None) -> Array:
        """Derivatives (..., size) by x, from those by z (..., n, width) and by h (..., e), None for zeros."""
        *shape, joints, width = by_z.shape
        rows = math.prod(shape)  # one product of matrices is faster than many
        flat = self.flat_gradient(
            by_z.reshape(rows, joints * width), None if by_momentum is None else by_momentum.reshape(rows, -1)
        )
        return flat.reshape(*shape, self.size)

    def flat_gradient(self, by_z: Array, by_momentum: Array | None) -> Array:
        """Derivatives (r, size) by x, from those by z (r, n width) and by h (r, e), None for zeros."""
        by_x = (by_z if by_z.shape[1] == len(self.offset) else by_z[:, self.polynomials.free_indices]) @ self.scaling
        if not self.momentum.free:
            return by_x
        zeros = np.zeros((len(by_x), self.momentum.free))
        return np.concatenate((by_x, zeros if by_momentum is None else by_momentum @ self.momentum.axes), axis=1)
