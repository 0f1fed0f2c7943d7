"""Joint motions as sine functions of polynomials, (12), for any joint range, with the conditions (13) built in.

``q_i(t) = centre_i + amplitude_i sin(p_i(s))`` with ``s = t / T``. Once the branch of the arcsine is chosen at each
end, the six conditions (13) fix p, p' and p'' at both ends, and ::

    p_i(s) = quintic Hermite polynomial of these + s^3 (1 - s)^3 sum_k z_ik J_k(s)

carries them for any ``z``. The J_k are Jacobi polynomials that make the free functions orthonormal on [0, 1], so that a
unit change of z is a root-mean-square change of p by one radian. Where the accelerations at an end are free, the
quintic with p'' there is one of the free functions, scaled to the same length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from floatplan.arrays import Array, IntArray, read_only
from floatplan.motion import exact_polynomials as exact
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.quadrature import chebyshev_values
from floatplan.problem.problem import Problem

END_LENGTH = math.sqrt(1 / 9240)  # [-] root mean square of the quintic with p'' = 1 at one end
EDGE = 1e-12  # [-] of the amplitude: nearer to the end of its range than this, a joint stands on the edge


CURVATURES = (2, 5)  # of the conditions (13) p'' at s = 0 and at s = 1


class Form(NamedTuple):
    """Which polynomials make p.

    ``width`` free ones in all; ``free_ends`` are those of ``CURVATURES`` among them, which come first.
    """

    width: int
    free_ends: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Basis:
    """The polynomials of s whose combination is p: the Hermite ones of fixed conditions, then the free ones.

    Attributes
    ----------
    fixed : the conditions (13) that are not free
    bubbles : number of free polynomials that vanish at both ends with two derivatives
    powers : (k+1, 6+m)
        Coefficients in powers of s, column by column.
    series : (3, k+1, 6+m)
        The columns and their first two derivatives by s, in Chebyshev polynomials of 2 s - 1.
    """

    fixed: tuple[int, ...]
    bubbles: int
    powers: Array
    series: Array

    def values(self, s: Array) -> tuple[Array, Array, Array]:
        """The columns and their first two derivatives by s at the instants s: three arrays (len(s), 6+m)."""
        value, first, second = self.series
        polynomials = chebyshev_values(2 * s - 1, len(value) - 1)
        return polynomials @ value, polynomials[:, :-1] @ first[:-1], polynomials[:, :-2] @ second[:-2]


@lru_cache(maxsize=32)
def basis(form: Form) -> Basis:
    """Return the basis of a form: p has degree ``5 + bubbles``."""
    bubbles = form.width - len(form.free_ends)
    fixed = tuple(condition for condition in range(CONDITIONS) if condition not in form.free_ends)
    columns = exact.basis_columns(bubbles)
    if form.free_ends:
        ends = columns[:, form.free_ends] / Fraction(END_LENGTH)
        columns = np.concatenate((columns[:, fixed], ends, columns[:, CONDITIONS:]), axis=1)
    value = np.asarray(exact.chebyshev_map(len(columns)) @ columns, dtype=np.float64)  # numbers rounded once
    series = np.zeros((3, *value.shape))
    series[0] = value
    series[1, :-1] = chebyshev.chebder(value, 1, scl=2)
    series[2, :-2] = chebyshev.chebder(value, 2, scl=2)
    return Basis(fixed, bubbles, read_only(columns), read_only(series))


@dataclass(eq=False)  # not frozen, for its speed: there is one per evaluation
class JointMotion:
    """Joint motion at N instants; the accelerations are computed on first use.

    ``positions, velocities, accelerations`` are (N, n) in rad and s; ``p_rate, p_curvature`` are the derivatives of p
    by s, from ``coefficients`` (6+width, n) of the basis and its ``second`` derivatives (N, 6+width); ``sine, cosine``
    are ``amplitude sin p, amplitude cos p``.
    """

    positions: Array
    velocities: Array
    sine: Array
    cosine: Array
    p_rate: Array
    second: Array
    coefficients: Array
    per_second: float

    @cached_property
    def p_curvature(self) -> Array:
        """Second derivative (N, n) of p by s."""
        return np.asarray(self.second @ self.coefficients)

    @cached_property
    def accelerations(self) -> Array:
        """Joint accelerations (N, n) rad/s^2."""
        sine_rate = self.sine * self.p_rate
        return np.asarray(self.per_second**2 * (self.cosine * self.p_curvature - sine_rate * self.p_rate))

    @property
    def slopes(self) -> Array:
        """Derivatives (3, 3, N, n) of positions, velocities and accelerations by p, ``p_rate`` and ``p_curvature``."""
        per_second = self.per_second
        slopes = np.zeros((3, 3, *self.positions.shape))
        slopes[0, 0] = self.cosine
        slopes[1, 0] = -per_second * self.sine * self.p_rate
        slopes[1, 1] = per_second * self.cosine
        slopes[2, 0] = -(per_second**2) * (self.sine * self.p_curvature + self.cosine * self.p_rate**2)
        slopes[2, 1] = 2 * per_second * slopes[1, 0]
        slopes[2, 2] = per_second**2 * self.cosine
        return slopes


@dataclass(frozen=True, eq=False)
class SinePolynomials:
    """The class of motions (12) that satisfies (13) for one choice of arcsine branches.

    Attributes
    ----------
    centre, amplitude : (n,) rad
    duration : s
    boundary : (n, 6)
        p, dp/ds, d2p/ds2 at s = 0, then at s = 1; of ``free_ends`` they mean nothing.
    free : (n,) int
        Free polynomials of each joint: degree - 5, and one for each free end.
    free_ends : which of ``CURVATURES`` are free
    form : Form
        Which polynomials make p.
    width : int
        Free polynomials of the joint that has most.
    free_indices : int array
        Which entries of a flattened z (n, width) the joints have; the others stay zero.
    fixed_boundary : (n, g)
        The conditions (13) that are not free.
    nominal_coefficients : (n, width)
        Free coefficients of the nominal, Hermite motion: zeros.
    """

    centre: Array
    amplitude: Array
    duration: float
    boundary: Array
    free: tuple[int, ...]
    free_ends: tuple[int, ...] = ()
    form: Form = field(init=False)
    width: int = field(init=False)
    free_indices: IntArray = field(init=False)
    fixed_boundary: Array = field(init=False)
    nominal_coefficients: Array = field(init=False)

    def __post_init__(self) -> None:
        """Derive what every motion of the class needs."""
        width = max(self.free)
        form = Form(width, self.free_ends)
        vars(self).update(
            form=form,
            width=width,
            free_indices=np.flatnonzero(np.arange(width) < np.array(self.free)[:, None]),
            fixed_boundary=self.boundary[:, basis(form).fixed] if self.free_ends else self.boundary,
            nominal_coefficients=read_only(np.zeros((len(self.free), width))),
        )

    @classmethod
    def between_ends(cls, problem: Problem, free: Sequence[int], branch: IntArray) -> SinePolynomials:
        """Return the motions between a problem's start and goal, (13), that land on branches (n,) of the arcsine.

        Joints have ``free`` (n,) polynomials each. An acceleration that the search chooses is taken as zero.
        """
        low, high = problem.position_limits.T
        centre = (low + high) / 2
        amplitude = (high - low) / 2
        duration = problem.flight.duration
        conditions: list[Array] = []
        for state, on_branch in ((problem.initial, np.zeros_like(branch)), (problem.final, branch)):
            accelerations = np.nan_to_num(state.accelerations)
            p, rate, curvature = boundary_arguments(
                state.positions, state.velocities, accelerations, centre, amplitude, on_branch
            )
            conditions += [p, duration * rate, duration**2 * curvature]
        return cls(centre, amplitude, duration, np.array(conditions).T, tuple(free))

    def motion(self, z: Array, values: tuple[Array, Array, Array]) -> JointMotion:
        """Joint motion from free coefficients z (n, width) at the instants of the basis values."""
        value, first, second = values
        coefficients = np.concatenate((self.fixed_boundary, z), axis=1).T
        p = value @ coefficients
        p_rate = first @ coefficients
        sine = self.amplitude * np.sin(p)
        cosine = self.amplitude * np.cos(p)
        per_second = 1 / self.duration
        return JointMotion(
            positions=self.centre + sine,
            velocities=per_second * cosine * p_rate,
            sine=sine,
            cosine=cosine,
            p_rate=p_rate,
            second=second,
            coefficients=coefficients,
            per_second=per_second,
        )

    def powers_of_seconds(self, z: Array) -> Array:
        """The paper's coefficients b (n, width+6), powers of t in seconds, of (12), rounded with care."""
        conditions = self.boundary
        if self.free_ends:
            conditions = conditions.copy()
            conditions[:, self.free_ends] = z[:, : len(self.free_ends)] / END_LENGTH
        combinations = np.concatenate((conditions, z[:, len(self.free_ends) :]), axis=1).tolist()
        return np.array([exact.powers_of_seconds(combination, self.duration) for combination in combinations])


def powers_map(form: Form, duration: float | Array) -> Array:
    """Matrices (.., k+1, g+width) from a joint's fixed conditions and free coefficients to its b, powers of seconds."""
    powers = basis(form).powers
    return np.asarray(powers / (np.array(duration)[..., None] ** np.arange(len(powers)))[..., None])


def boundary_arguments(
    positions: Array, velocities: Array, accelerations: Array, centre: Array, amplitude: Array, branch: IntArray
) -> tuple[Array, Array, Array]:
    """p, dp/dt, d2p/dt2 (..., n) at an end, from (13).

    The branch is that of the arcsine: p is pi branch + asin for even ones, pi branch - asin for odd ones. On the edge
    of a range (cos p = 0) the rate is zero and the acceleration ``-amplitude sin(p) p'^2``: p' follows from the
    acceleration (which must point inwards), and p'' is free; it is taken as zero.
    """
    sine = (positions - centre) / amplitude
    on_edge = 1 - np.abs(sine) < EDGE
    has_edges = on_edge.any()
    if has_edges:
        sine = np.where(on_edge, np.sign(sine), sine)
    sign = 1 - 2 * (branch % 2)
    p = np.asarray(np.pi * branch + sign * np.arcsin(np.minimum(np.maximum(sine, -1), 1)))
    cosine = np.sqrt((1 - sine) * (1 + sine)) * sign
    if not has_edges:
        rate = velocities / (amplitude * cosine)
        return p, rate, (accelerations / amplitude + sine * rate**2) / cosine
    safe = np.where(on_edge, 1.0, cosine)
    inward = np.clip(-accelerations / (amplitude * np.where(on_edge, sine, 1.0)), 0, None)
    rate = np.where(on_edge, np.sqrt(np.where(on_edge, inward, 0.0)), velocities / (amplitude * safe))
    curvature = np.where(on_edge, 0.0, (accelerations / amplitude + sine * rate**2) / safe)
    return p, rate, curvature


def free_part(coefficients: Array, duration: float) -> float:
    """Root mean square of p's free polynomials, rad, over time and all joints, from b (n, k+1), powers of seconds."""
    powers = coefficients * duration ** np.arange(coefficients.shape[1])
    form = Form(coefficients.shape[1] - CONDITIONS)
    free = np.linalg.solve(basis(form).powers, powers.T)[CONDITIONS:]
    return float(np.linalg.norm(free))


@dataclass(frozen=True, eq=False)
class WrittenMotion:
    """The joint motion (12) of written coefficients.

    Attributes
    ----------
    centre, amplitude : (n,) rad
    duration : s
    chebyshev : three arrays (k+1, n)
        p and its first two derivatives by time, in Chebyshev polynomials of 2 t/T - 1.
    """

    centre: Array
    amplitude: Array
    duration: float
    chebyshev: tuple[Array, Array, Array]

    @classmethod
    def from_powers(cls, centre: Array, amplitude: Array, coefficients: Array, duration: float) -> WrittenMotion:
        """From the coefficients b (n, k+1), powers of t in seconds."""
        p = exact.chebyshev_of_seconds(coefficients, duration)
        rate = np.asarray(2 / duration * chebyshev.chebder(p), dtype=np.float64)
        curvature = np.asarray(2 / duration * chebyshev.chebder(rate), dtype=np.float64)
        return cls(centre, amplitude, duration, (p, rate, curvature))

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities, accelerations (N, n) at times (N,)."""
        polynomials = chebyshev.chebvander(2 * times / self.duration - 1, len(self.chebyshev[0]) - 1)
        p, rate, curvature = (polynomials[:, : len(series)] @ series for series in self.chebyshev)
        sine = self.amplitude * np.sin(p)
        cosine = self.amplitude * np.cos(p)
        return self.centre + sine, cosine * rate, cosine * curvature - sine * rate**2
