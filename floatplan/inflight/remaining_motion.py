"""The remaining flight: the joints' motion (12) from now to the landing, and how it is written on a shorter time."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from numpy.polynomial.chebyshev import chebval

from floatplan.arrays import Array, read_only
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.sine_polynomial import Form, WrittenMotion, basis
from floatplan.plans.plan import Plan


@dataclass(eq=False)  # not frozen, for its speed: there is one per update
class RemainingMotion:
    """Joints from ``begin`` to ``end``, s since takeoff: ``centre + amplitude sin(p)``, p a polynomial of time.

    Attributes
    ----------
    centre, amplitude : (n,) rad
    begin, end : s
        The landing is at ``end``.
    coefficients : (6+m, n)
        Of p in ``basis``: p and two derivatives by u = (t - begin) / (end - begin) at both ends, then those of the m
        free polynomials.
    table : (3, k+1, 6+m)
        Of their values and two derivatives by u, in Chebyshev polynomials of 2 u - 1.
    """

    centre: Array
    amplitude: Array
    begin: float
    end: float
    coefficients: Array
    table: Array

    @property
    def remaining(self) -> float:
        """Time from ``begin`` to ``end``, s."""
        return self.end - self.begin

    def at(self, times: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, velocities, accelerations (N, n) at times (N,), s since takeoff; constant outside of its time."""
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64))
        inside = np.minimum(np.maximum(instants - self.begin, 0.0), self.remaining)
        positions, velocities, accelerations = self._written.at(inside)
        outside = (instants > self.end) | (instants < self.begin)
        if outside.any():
            velocities[outside] = 0.0
            accelerations[outside] = 0.0
        return positions, velocities, accelerations

    @cached_property
    def _written(self) -> WrittenMotion:
        """The same by time since ``begin``."""
        p, rate, curvature = self.table @ self.coefficients
        chebyshev = (p, rate / self.remaining, curvature / self.remaining**2)
        return WrittenMotion(self.centre, self.amplitude, self.remaining, chebyshev)


class Rewriting:
    """What writes motions on a shorter time: the values at ``points``, Chebyshev's, fix all coefficients.

    Exact while the landing time stays. Where it moves, p, p', p'' at both ends, by time, and free coefficients stay.
    """

    def __init__(self, plan: Plan) -> None:
        least_free = 6  # polynomials of each joint, also where the plan has fewer
        size = max(plan.coefficients.shape[1], CONDITIONS + least_free)
        self.form = Form(size - CONDITIONS)
        functions = basis(self.form)
        self.points = (1 - np.cos(np.pi * (np.arange(size) + 0.5) / size)) / 2
        self.of_values = np.linalg.inv(functions.values(self.points)[0])
        written = WrittenMotion.from_powers(plan.centre, plan.amplitude, plan.coefficients, plan.duration)
        coefficients = self.of_values @ chebval(2 * self.points - 1, written.chebyshev[0]).T
        boundary = np.stack([chebval([-1.0, 1.0], series).T for series in written.chebyshev])
        self.landing = read_only(boundary[:, 1])
        scale = plan.duration ** np.arange(3.0)[:, None]  # from derivatives by time to those by u
        coefficients[:3] = boundary[:, 0] * scale
        coefficients[3:CONDITIONS] = self.landing * scale
        self.first = RemainingMotion(
            np.array(plan.centre),
            np.array(plan.amplitude),
            0.0,
            plan.duration,
            read_only(coefficients),
            functions.series,
        )
