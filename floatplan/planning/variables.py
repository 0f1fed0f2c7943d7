"""The numbers that the search chooses, the motions they stand for, and the conditions (13) at both ends of these."""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import accumulate, compress
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, BoolArray, IntArray, identity
from floatplan.motion.dynamics import MomentumSet, RatesAtEnds
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import flight_of
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.sine_polynomial import CURVATURES, Form, SinePolynomials, basis, boundary_arguments, powers_map
from floatplan.problem.problem import Problem
from floatplan.problem.reference import REFERENCE_NODES, reference_at

AtEnds: TypeAlias = Literal["momentum", "velocities", "accelerations"]


@dataclass(frozen=True, eq=False)
class Boundary:
    """The conditions (13) of a problem, for arcsine branches (2, n) at takeoff and at landing.

    ``positions, accelerations`` (2, n) rad and rad/s^2, zeros where they are ``free`` (2, 1); ``centre, amplitude``
    (n,) rad; ``duration`` s.
    """

    positions: Array
    accelerations: Array
    free: BoolArray
    rates: RatesAtEnds
    centre: Array
    amplitude: Array
    duration: float
    branches: IntArray

    def __call__(self, angular_momentum: Array) -> Array:
        """p, dp/ds, d2p/ds2 (n, 6) at s = 0, then at s = 1, for h (e,) kg m^2/s; zero for p'' that is free."""
        rates = self.rates(angular_momentum)
        p, rate, curvature = boundary_arguments(
            self.positions, rates, self.accelerations, self.centre, self.amplitude, self.branches
        )
        curvature = np.where(self.free, 0.0, self.duration**2 * curvature)
        ends = np.array([p, self.duration * rate, curvature])
        return ends.transpose(2, 1, 0).reshape(-1, CONDITIONS)


@dataclass(frozen=True, eq=False)
class DecisionVariables:
    """How the search's variables x make a motion: ``z = offset + scaling @ x[:m]``, ``h`` by the others.

    Attributes
    ----------
    polynomials : SinePolynomials
    offset : (m,), scaling : (m, m)
        m free coefficients in all, joint by joint.
    momentum : MomentumSet
        Of h, ``centre + axes @ x[m:]``.
    following : Boundary, optional
        The conditions (13) where they change with h; the polynomials' own are those of the middle h.
    offset_map : (m, g), optional
        By which the offset follows a joint's fixed conditions (13), where it does.
    has_reference : whether x = 0 is the motion nearest to a recorded one, or the one to be near to
    coefficients : number m of free coefficients
    size : number of variables
    chosen_at_ends : what the search chooses of the state at takeoff or landing
    """

    polynomials: SinePolynomials
    offset: Array
    scaling: Array
    momentum: MomentumSet
    following: Boundary | None = None
    offset_map: Array | None = None
    has_reference: bool = False
    coefficients: int = field(init=False)
    size: int = field(init=False)
    chosen_at_ends: frozenset[AtEnds] = field(init=False)

    def __post_init__(self) -> None:
        """Count the variables, and say what is chosen at both ends."""
        chosen: set[AtEnds] = {"momentum"} if self.momentum.axes.size else set()
        if self.following:
            chosen.add("velocities")
        if self.polynomials.free_ends:
            chosen.add("accelerations")
        vars(self).update(
            coefficients=len(self.offset),
            size=len(self.offset) + self.momentum.axes.shape[1],
            chosen_at_ends=frozenset(chosen),
        )

    @property
    def degrees(self) -> tuple[int, ...]:
        """Degree of p of every joint."""
        fixed = CONDITIONS - len(self.polynomials.free_ends)
        return tuple(free + fixed - 1 for free in self.polynomials.free)

    @cached_property
    def metric(self) -> Array:
        """Matrix (size, size): ``|metric @ step|`` is 1 where p moves by 1 rad root mean square, or h by an axis."""
        metric = np.eye(self.size)
        joints = len(self.polynomials.centre)
        metric[: self.coefficients, : self.coefficients] = self.scaling / np.sqrt(joints)
        return metric

    def motion_class(self, angular_momentum: Array) -> SinePolynomials:
        """The class of motions with an angular momentum (e,)."""
        if not self.following:
            return self.polynomials
        return replace(self.polynomials, boundary=self.following(angular_momentum))

    def free_coefficients(self, x: Array) -> Array:
        """Free coefficients z (n, width); zero where a joint has fewer."""
        free = self.offset + self.scaling @ x[: self.coefficients]
        joints = len(self.polynomials.free)
        width = self.polynomials.width
        if len(free) < joints * width:
            z = np.zeros(joints * width)
            z[self.polynomials.free_indices] = free
            free = z
        return free.reshape(joints, width)

    def variables(self, z: Array, angular_momentum: npt.ArrayLike) -> Array:
        """Return the x of a motion: the inverse of :meth:`free_coefficients` and :meth:`angular_momentum`."""
        beyond = z.ravel()[self.polynomials.free_indices] - self.offset
        is_scaled = self.offset_map is not None or self.has_reference
        x = np.asarray(np.linalg.solve(self.scaling, beyond) if is_scaled else beyond, np.float64)
        if not self.momentum.axes.size:
            return x
        difference = np.atleast_1d(angular_momentum) - self.momentum.centre
        if not difference.any():
            return np.concatenate((x, np.zeros(self.momentum.axes.shape[1])))
        return np.concatenate((x, np.linalg.lstsq(self.momentum.axes, difference, rcond=None)[0]))

    def angular_momentum(self, x: Array) -> Array:
        """Angular momentum h (e,), kg m^2/s."""
        if not self.momentum.axes.size:
            return self.momentum.centre
        return np.asarray(self.momentum.centre + self.momentum.axes @ x[self.coefficients :])

    @cached_property
    def nominal_motion(self) -> Array:
        """The x of the motion without free coefficients, or of that to be near to; h is in the middle."""
        x = np.zeros(self.size)
        if self.has_reference:
            return x
        is_scaled = self.offset_map is not None
        x[: self.coefficients] = np.linalg.solve(self.scaling, -self.offset) if is_scaled else 0.0 - self.offset
        return x


@dataclass(frozen=True, eq=False)
class Start:
    """A class of motions (with its arcsine branches) and a point x in it, from which the kernel follows the motion.

    ``at_once`` says that the objective counts from the first step; only where that fails is the motion made feasible
    first. That promises most for nominal motions and for solutions.
    """

    variables: DecisionVariables
    x: Array
    at_once: bool = False


def decision_variables(
    problem: Problem, degrees: tuple[int, ...], branches: IntArray | None, momentum: MomentumSet
) -> DecisionVariables:
    """Variables of a problem's motions, for arcsine branches (2, n) at takeoff and at landing: None for the first ones.

    They are of some degrees, with an angular momentum of a set.
    """
    states = (problem.initial, problem.final)
    rests = problem.initial.frame_rests or problem.final.frame_rests
    rates = np.array([problem.initial.velocities, problem.final.velocities])
    low, high = problem.position_limits.T
    free = np.array([[state.free_accelerations] for state in states])
    conditions = Boundary(
        positions=np.array([state.positions for state in states]),
        accelerations=np.where(free, 0.0, np.array([state.accelerations for state in states])),
        free=free,
        rates=flight_of(problem).end_rates(momentum) if rests else lambda h: rates,
        centre=(low + high) / 2,
        amplitude=(high - low) / 2,
        duration=problem.flight.duration,
        branches=np.zeros((2, len(degrees)), np.int64) if branches is None else branches,
    )
    free_ends = tuple(compress(CURVATURES, conditions.free[:, 0].tolist()))
    polynomials = SinePolynomials(
        conditions.centre,
        conditions.amplitude,
        conditions.duration,
        conditions(momentum.centre),
        tuple(degree - CONDITIONS + 1 + len(free_ends) for degree in degrees),
        free_ends,
    )
    return scaled_variables(problem, polynomials, momentum, conditions if momentum.axes.size and rests else None)


def scaled_variables(
    problem: Problem, polynomials: SinePolynomials, momentum: MomentumSet, following: Boundary | None
) -> DecisionVariables:
    """Variables scaled for the objective: whitened for (17), about a recorded motion to be near it, else z itself."""
    size = sum(polynomials.free)
    if problem.reference is not None:
        offset, scaling = near_reference(problem.reference, polynomials)
        return DecisionVariables(polynomials, offset, scaling, momentum, following, has_reference=True)
    if not (problem.minimises_b and size):
        return DecisionVariables(polynomials, np.zeros(size), identity(size), momentum, following)
    boundary = polynomials.fixed_boundary[None]
    offset, scaling, offset_map = whitened(polynomials.form, polynomials.free, (polynomials.duration,), boundary)
    return DecisionVariables(polynomials, offset[0], scaling[0], momentum, following, offset_map[0])


def near_reference(reference: Array, polynomials: SinePolynomials) -> tuple[Array, Array]:
    """Offset (m,) and scaling (m, m) about the motion that is nearest to a recorded one (K, n), rad.

    With p_ref the arguments of the recorded positions and weights ``w = amplitude cos(p_ref)``, the mean square over
    time of the joints' differences is ``|W (B z + p_0 - p_ref)|^2`` to first order: with ``W B = Q R`` that is
    ``|x|^2`` and a constant, for ``z = R^-1 (x + Q^T W (p_ref - p_0))``. So the norm of x is the objective.
    """
    grid = gauss_legendre(REFERENCE_NODES)
    s = grid.nodes
    recorded = reference_at(reference, s)
    columns = basis(polynomials.form).values(s)[0]
    free = columns[:, columns.shape[1] - polynomials.width :]
    nominal = columns[:, : columns.shape[1] - polynomials.width] @ polynomials.fixed_boundary.T
    sine = np.clip((recorded - polynomials.centre) / polynomials.amplitude, -1.0, 1.0)
    arguments = np.arcsin(sine)
    weights = np.sqrt(grid.weights / len(polynomials.free))[:, None] * polynomials.amplitude
    # At the edge of its range a joint hardly moves with p; it counts by a tenth at least.
    weights = weights * np.maximum(np.cos(arguments), 0.1)
    offset = np.zeros(sum(polynomials.free))
    scaling = np.zeros((len(offset), len(offset)))
    for joint, (width, end) in enumerate(zip(polynomials.free, accumulate(polynomials.free), strict=True)):
        own = slice(end - width, end)
        orthogonal, triangular = np.linalg.qr(weights[:, joint, None] * free[:, :width])
        inverse = np.linalg.inv(triangular)
        difference = weights[:, joint] * (arguments[:, joint] - nominal[:, joint])
        offset[own] = inverse @ (orthogonal.T @ difference)
        scaling[own, own] = inverse
    return offset, scaling


def whitened(
    form: Form, free: tuple[int, ...], durations: tuple[float, ...], boundary: Array
) -> tuple[Array, Array, Array]:
    """Offsets (N, m), scaling (N, m, m), the offsets' maps (N, m, g) for which (17) is ``constant + unit^2 |x|^2``.

    A joint's b is affine in its z, ``b = b_0 + C z``; with ``C = Q R``, ``x = (R z + Q^T b_0) / unit``. The unit makes
    the most sensitive direction of x move p by one radian (root mean square). ``boundary`` (N, n, g): fixed conditions.
    """
    compute = scale if len(durations) == 1 else scale.__wrapped__  # what many need is large, and not needed again
    scaling, offset_map, _ = compute(form, free, durations)
    offset = (offset_map * boundary.repeat(free, axis=1)).sum(axis=2)
    if len(durations) < len(boundary):
        scaling = np.broadcast_to(scaling, (len(boundary), *scaling.shape[1:]))
        offset_map = np.broadcast_to(offset_map, (len(boundary), *offset_map.shape[1:]))
    return offset, scaling, offset_map


@lru_cache(maxsize=64)
def scale(form: Form, free: tuple[int, ...], durations: tuple[float, ...]) -> tuple[Array, Array, Array]:
    """The scaling (N, m, m), the offsets' maps (N, m, g) and the unit (N,) of every duration, s."""
    powers = powers_map(form, np.array(durations))
    fixed = len(basis(form).fixed)
    by_boundary = powers[..., :fixed]
    orthogonal, triangular = np.linalg.qr(powers[..., fixed:])  # of a joint with all of the form's coefficients
    inverse = np.linalg.inv(triangular)
    longest = np.linalg.svd(inverse, compute_uv=False)[:, 0] if form.width else np.ones(len(durations))
    unit = np.asarray(1 / longest)

    # With fewer coefficients Q and R^-1 are their first columns, and rows.
    maps = {}
    for width in set(free):
        maps[width] = -inverse[:, :width, :width] @ (orthogonal[..., :width].swapaxes(1, 2) @ by_boundary)
    scaled = unit[:, None, None] * inverse
    scaling = np.zeros((len(durations), sum(free), sum(free)))
    for width, end in zip(free, accumulate(free), strict=True):
        own = slice(end - width, end)
        scaling[:, own, own] = scaled[:, :width, :width]
    return scaling, np.concatenate([maps[width] for width in free], axis=1), unit
