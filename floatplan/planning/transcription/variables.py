"""The numbers that the search chooses, and the motions they stand for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.sine_polynomial import SinePolynomials


@dataclass(frozen=True, eq=False)
class DecisionVariables:
    """How the search's variables x make a motion: ``z = offset + scaling @ x[:m]``, ``h = middle + reach x[m]``.

    Attributes
    ----------
    polynomials : SinePolynomials
    offset : (m,), scaling : (m, m)
        m free coefficients in all, joint by joint.
    middle, reach : kg m^2/s
        ``reach`` is 0 where h is given, and x then has no entry for it.
    """

    polynomials: SinePolynomials
    offset: Array
    scaling: Array
    middle: float
    reach: float

    @property
    def coefficients(self) -> int:
        """Number m of free coefficients."""
        return len(self.offset)

    @property
    def size(self) -> int:
        """Number of variables."""
        return self.coefficients + (1 if self.reach else 0)

    @cached_property
    def metric(self) -> Array:
        """Matrix (size, size): ``|metric @ step|`` is 1 where p moves by 1 rad root mean square, or h by its reach."""
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

    def variables(self, z: Array, angular_momentum: float) -> Array:
        """Return the x of a motion: the inverse of :meth:`free_coefficients` and :meth:`angular_momentum`."""
        x = np.linalg.solve(self.scaling, z.ravel()[self.polynomials.free_indices] - self.offset)
        return np.asarray(np.append(x, (angular_momentum - self.middle) / self.reach) if self.reach else x)

    def angular_momentum(self, x: Array) -> float:
        """Angular momentum h, kg m^2/s."""
        return float(self.middle + self.reach * x[-1]) if self.reach else self.middle

    def plain_motion(self) -> Array:
        """Return the x of the Hermite motion with no free part, and the middle h."""
        return self.variables(self.polynomials.no_free_part, self.middle)

    def gradient(self, by_z: Array, by_momentum: Array) -> Array:
        """Derivatives (..., size) by x, from those by z (..., n, width) and by h (...)."""
        flat = by_z.reshape(*by_z.shape[:-2], -1)
        by_x = (flat if flat.shape[-1] == len(self.offset) else flat[..., self.polynomials.free_indices]) @ self.scaling
        if not self.reach:
            return np.asarray(by_x)
        return np.concatenate((by_x, self.reach * by_momentum[..., None]), axis=-1)
