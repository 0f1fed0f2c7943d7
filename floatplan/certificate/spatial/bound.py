"""How far the true attitude is from the approximation, for every instant: the theorem (S3), with enclosed constants.

``docs/theory/space.md`` has the proof. With Q the polynomial quaternion of a cell and ``N = |Q|^2``, the approximation
is ``R^ = R(Q)``, which turns at ``w^ = 2 vec(Q* Q') / N``. Its residual is ``rho = w^ - omega(t, R^)``, so that

    N I rho = I 2 vec(Q* Q') - N R^^T h + N A q',

of which all but N are polynomials of Q and of what :class:`~floatplan.certificate.spatial.bodies.BodyMotion` encloses.
Then ``r`` bounds the sum of all steps between cells, the first one from the attitude at takeoff, and of the integral
of ``|rho|``; ``s`` bounds the transitions of ``zeta' = M^ [h]x zeta``, and c the integral of ``1.003 |h| /
lambda_min(I)``:

    where 2 s r <= 1/2 and q = 4 s^2 r c + 1.006 s r < 1, the true attitude is within (1 + q) s r of the approximation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.certificate.cells import ORDER, TimeCells
from floatplan.certificate.enclosure import ROUND, Balls, up
from floatplan.certificate.spatial.attitude import SIGNS, Approximation, product
from floatplan.certificate.spatial.bodies import BodyMotion
from floatplan.certificate.spatial.models import DEGREES, UNIT, Matrices, cross_matrices, crossed, frobenius, inverted

QUADRATIC = 1.003  # [-] |N| <= 1.003 |h| / lambda_min eps^2 + 0.503 eps |rho| for eps <= 1/2
LINEAR = 1.006  # [-] twice 0.503
LARGEST = 0.5  # [rad] up to which these hold
FINE = 0.05  # [-] growth sought within one step between the instants at which transitions are compared
MOST_STEPS = 400  # [-] of them in a flight sought: pairs of them are compared
MOST_COMPARED = 1000  # [-] whose transitions' spectral norms are looked at
SQUARINGS = 4  # [-] of a matrix, after which its Frobenius norm is the spectral norm but for a factor of 3^(1/32)


@dataclass(frozen=True, eq=False)
class AttitudeBound:
    """What is proved of the attitude.

    Attributes
    ----------
    bound : rad
        The true attitude is within it of the approximation, at all times; infinite where that is not proved.
    residual : rad
        r, the sum of all steps and of the integral of the residual.
    amplification : s, by how much a small turn at one instant grows until another one
    condition : q, which has to be below 1
    attitudes : Matrices
        Rotations (3, 3) of the true motion, from the base's axes to the world's: one item.
    momentum_in_base : Matrices
        ``R^T h`` of the true motion: one vector, kg m^2/s.
    residuals : (cells,) rad/s
        Bounds on ``|rho|``.
    """

    bound: float
    residual: float
    amplification: float
    condition: float
    attitudes: Matrices
    momentum_in_base: Matrices
    residuals: Array


@dataclass(frozen=True, eq=False)
class _Approximated:
    """The approximation as models: its attitudes, the momentum as it sees it, its rates, and bounds on ``|N - 1|``."""

    attitudes: Matrices
    momentum_in_base: Matrices
    rates: Matrices
    off: Array


def attitude_bound(
    motion: BodyMotion, approximation: Approximation, cells: TimeCells, momentum: Array, start: Array
) -> AttitudeBound:
    """Bound how far the attitude is from the approximation, on all cells, which follow each other from t = 0."""
    length = up(2.0 * (cells.half.mid + cells.half.rad))
    size = _up(float(np.linalg.norm(momentum)))
    approximated = _approximated(approximation, cells, momentum)
    residuals = _residuals(motion, approximated)
    steps = _steps(approximation, start)
    r = _up(steps.sum() + residuals @ length)
    mobility = (
        _spectral(motion.inverse.c[:, 0, 0]) + motion.inverse.sizes[:, 0, 1:].sum(axis=1) + motion.inverse.e[:, 0]
    )
    c = _up(QUADRATIC * size * float(up(mobility) @ length))
    s = _amplification(motion, approximated, approximation, cells, size, steps)
    condition = _up(4.0 * s * s * r * c + LINEAR * s * r)
    bound = _up((1.0 + condition) * s * r)
    if not (_up(2.0 * s * r) <= LARGEST and condition < 1.0):
        bound = math.inf
    # |E - 1| <= eps for a rotation E by eps
    widened = np.full(approximated.attitudes.e.shape, bound)
    return AttitudeBound(
        bound=bound,
        residual=r,
        amplification=s,
        condition=condition,
        attitudes=approximated.attitudes.widened(widened, norm=1.0),
        momentum_in_base=approximated.momentum_in_base.widened(up(widened * size)),
        residuals=residuals,
    )


def _approximated(approximation: Approximation, cells: TimeCells, momentum: Array) -> _Approximated:
    """Models of ``R^``, ``R^^T h`` and ``w^``, from ``N R^ = F G^T`` and ``N w^ = 2 G Q'``.

    With Q = (v, w): ``F = [w 1 + [v]x, -v]`` and ``G = [w 1 - [v]x, -v]``, both (3, 4). What is divided by N is off by
    ``|N - 1| / (1 - |N - 1|)`` of itself.
    """
    q = approximation.quaternions
    first, second = _factor(q, 1.0), _factor(q, -1.0)
    column = q[:, None, :, :, None]
    square = Matrices.exact(column.swapaxes(-1, -2)) @ Matrices.exact(column)
    deviation = square.c[:, 0, :, 0, 0].copy()
    deviation[:, 0] -= 1.0
    off = up(np.abs(deviation).sum(axis=1) + square.e[:, 0] + UNIT)
    off = up(np.where(off < 0.5, off / np.where(off < 0.5, 1.0 - off, 1.0), np.inf))[:, None]
    shifted = np.zeros_like(column)
    shifted[:, :, :-1] = column[:, :, 1:] * DEGREES[1:, None, None]
    derivative = _rounded_once(shifted)
    inverse = Balls(2.0 / cells.half.mid, up(8.0 * (ROUND + cells.half.rad / cells.half.mid) / cells.half.mid))
    rates = (second @ derivative).scaled(Balls(inverse.mid[:, None], inverse.rad[:, None]))
    h = Matrices.constant(Balls.exact(momentum[None, :, None]), len(q))
    momentum_in_base = second @ (first.transposed @ h)
    attitudes = first @ second.transposed
    return _Approximated(
        attitudes=attitudes.widened(up(off * attitudes.norm)),
        momentum_in_base=momentum_in_base.widened(up(off * momentum_in_base.norm)),
        rates=rates.widened(up(off * rates.norm)),
        off=off,
    )


def _factor(quaternions: Array, sign: float) -> Matrices:
    """Matrices ``[w 1 +- [v]x, -v]`` (3, 4) of quaternions (cells, K, 4), each entry a part of one or minus that."""
    c = np.empty((len(quaternions), 1, ORDER, 3, 4))
    c[:, 0, :, :, :3] = sign * cross_matrices(quaternions[..., :3]) + quaternions[..., 3, None, None] * np.eye(3)
    c[:, 0, :, :, 3] = -quaternions[..., :3]
    return Matrices.exact(c)


def _rounded_once(c: Array) -> Matrices:
    """Models of polynomials whose coefficients are rounded once."""
    return Matrices.of(c, up(UNIT * np.abs(c).sum(axis=2)))


def _residuals(motion: BodyMotion, approximated: _Approximated) -> Array:
    """Bounds (cells,) on ``|rho|``, rad/s: ``rho = I^-1 (I w^ - R^^T h + A q')``."""
    unbalanced = motion.inertia @ approximated.rates - approximated.momentum_in_base + motion.joint_momentum
    rho = motion.inverse @ unbalanced
    return up(frobenius(rho.magnitude + rho.entries))[:, 0]


def _steps(approximation: Approximation, start: Array) -> Array:
    """Bounds (cells,) on the angles, rad, by which cells begin beside where the one before ended, or beside ``start``.

    With a and b the quaternions there and ``a = b + d``, ``|a| |b| sin(angle / 2) = |vec(a b*)| = |vec(d b*)|``, in
    which nothing cancels. Each sum of coefficients is two doubles: d is off by less than 4 UNIT of what it is a sum of,
    and each entry of ``vec(d b*)``, a sum of four products, by less than 5 UNIT of ``|d| |b|``. With a sine that is
    below 0.1, the angle is below 2.01 times the sine.
    """
    q = approximation.quaternions
    if not np.isfinite(q).all():
        return np.full(len(q), np.inf)
    first, of_first = _sums(q * SIGNS[:, None])
    last, of_last = _sums(q)
    before = np.concatenate([start[None], last[:-1]])
    of_before = np.concatenate([np.zeros((1, 4)), of_last[:-1]])
    sign = np.where(np.einsum("cx,cx->c", first, before) < 0.0, -1.0, 1.0)[:, None]  # Q and -Q are one attitude
    difference = first - sign * before
    step = difference + (of_first - sign * of_before)
    vector = np.linalg.norm(product(step, before * [-1.0, -1.0, -1.0, 1.0])[:, :3], axis=1)
    rounded = 16.0 * UNIT * np.linalg.norm(np.abs(difference) + np.abs(of_first) + np.abs(of_before), axis=1)
    length = np.linalg.norm(first, axis=1)
    sine = up(vector / (length * np.linalg.norm(before, axis=1)) + rounded / length)
    return np.where(sine < 0.1, up(2.01 * sine), np.inf)


def _sums(q: Array) -> tuple[Array, Array]:
    """Sums (cells, 4) over the coefficients (cells, K, 4), rounded once, and what they lack, rounded once."""
    columns = q.swapaxes(1, 2).reshape(-1, q.shape[1]).tolist()
    sums = [math.fsum(column) for column in columns]
    rest = [math.fsum([*column, -total]) for column, total in zip(columns, sums, strict=True)]
    return np.array(sums).reshape(-1, 4), np.array(rest).reshape(-1, 4)


def _amplification(
    motion: BodyMotion,
    approximated: _Approximated,
    approximation: Approximation,
    cells: TimeCells,
    size: float,
    steps: Array,
) -> float:
    """A bound on ``|Phi(t) Phi(tau)^-1|`` over all pairs tau <= t, where ``Phi' = M^ [h]x Phi``.

    In the base's axes the turn ``y = R^^T zeta`` is as long, and ``y' = (I^-1 [R^^T h]x - [w^]x) y``; the length of
    any solution grows at kappa at most, half of h times the spread of the eigenvalues of ``I^-1``. Transitions between
    instants are enclosed, and products of them, not of their radii: with ``T^_k`` a computed transition, off by d_k
    with the rounding of its products, ``C^`` the largest computed product and s the largest true one,

        |C - C^| = |sum_k (T_n .. T_k+1) (T_k - T^_k) (T^_k-1 .. T^_m)| <= s |C^| sum_k d_k,

    so that ``s <= |C^| / (1 - |C^| sum_k d_k)``. Between the instants a solution grows by exp(kappa length) at most.
    """
    spread = _spread(motion.inverse)
    growth = up(0.5 * size * spread * 2.0 * (cells.half.mid + cells.half.rad))
    if not np.isfinite(growth).all() or growth.max() > 100.0:
        return math.inf
    parts = max(1, min(math.ceil(growth.max() / FINE), MOST_STEPS // len(cells)))
    generator = motion.inverse @ crossed(approximated.momentum_in_base) - crossed(approximated.rates)
    half = Balls(cells.half.mid[:, None], cells.half.rad[:, None])
    c = approximation.transitions[:, None]
    transitions = Matrices.exact(c)
    slope = np.zeros_like(c)
    slope[:, :, :-1] = c[:, :, 1:] * DEGREES[1:, None, None]
    derivative = _rounded_once(slope)
    defect = derivative - (generator @ transitions).scaled(half)
    # Of the solution that is the identity in the middle: defects before an instant, carried on to it.
    off = up((defect.size + defect.e)[:, 0] * np.exp(growth / 2) * (1.0 + 1e-12))
    instants = np.linspace(-1.0, 1.0, parts + 1)
    found = [transitions.at(u) for u in instants.tolist()]
    values = np.concatenate([value for value, _ in found], axis=1)
    radii = np.concatenate([radius for _, radius in found], axis=1) + off[:, None]
    back = inverted(values[:, :-1])
    one = frobenius(values[:, :-1] @ back - np.eye(3)) + 4.0 * UNIT * frobenius(values[:, :-1]) * frobenius(back)
    missed = up(one + radii[:, :-1] * frobenius(back))
    missed = np.where(missed < 0.5, missed, np.nan)
    of_back = frobenius(back) * missed / (1.0 - missed)
    ahead = values[:, 1:] @ back
    d = radii[:, 1:] * (frobenius(back) + of_back) + frobenius(values[:, 1:]) * of_back
    d += 4.0 * UNIT * frobenius(values[:, 1:]) * frobenius(back)
    d[:, 0] += steps * frobenius(ahead[:, 0])  # between cells the base's axes are turned by a step
    sequence = ahead.reshape(-1, 3, 3)
    total = _up(d.sum() + 4.0 * UNIT * frobenius(sequence).sum())
    largest, size_of_all = _largest_product(sequence)
    if not size_of_all * total < 0.5:
        return math.inf
    within = _up(np.exp(growth.max() / parts) * (1.0 + 1e-12))
    return _up(max(1.0, largest) / (1.0 - size_of_all * total) * within)


def _up(value: float) -> float:
    """A number rounded up as radii are."""
    return float(up(np.array(float(value))))


def _spread(inverse: Matrices) -> Array:
    """Bounds (cells,) on the differences of the largest and the least eigenvalue of ``I^-1`` at any instant.

    For any number v it is at most ``2 |I^-1 - v 1|``.
    """
    middle = inverse.c[:, 0, 0]
    if not np.isfinite(middle).all():
        return np.full(len(middle), np.inf)
    values = np.linalg.eigvalsh((middle + middle.swapaxes(1, 2)) / 2)
    center = (values[:, 0] + values[:, -1]) / 2
    off = _spectral(middle - center[:, None, None] * np.eye(3)) + 2.0 * UNIT * frobenius(middle)
    return up(2.0 * (off + inverse.sizes[:, 0, 1:].sum(axis=1) + inverse.e[:, 0]))


def _largest_product(sequence: Array) -> tuple[float, float]:
    """Bounds on the spectral and the Frobenius norm of all products of neighbours in a sequence (L, 3, 3).

    The spectral norm is at least the Frobenius norm over sqrt(3), so that products whose Frobenius norm is less than
    0.57 of the largest one have a smaller one. Of very many products the Frobenius norm has to do.
    """
    products = sequence
    largest = 0.0
    candidates = []
    for count in range(1, len(sequence) + 1):
        if count > 1:
            products = sequence[count - 1 :] @ products[:-1]
        sizes = frobenius(products)
        largest = max(largest, float(sizes.max()))
        if len(sequence) <= MOST_COMPARED:
            candidates.append(products[sizes >= 0.57 * largest])
    length = _up(largest)
    if not candidates or not math.isfinite(length):
        return length, length
    found = np.concatenate(candidates)
    return float(_spectral(found[frobenius(found) >= 0.57 * largest]).max()), length


def _spectral(matrices: Array) -> Array:
    """Bounds (...) on the spectral norms of matrices (..., 3, 3): ``|A|^(2 m) = |(A^T A)^m|``, for m a power of two."""
    size = up(frobenius(matrices))
    scaled = matrices / np.where(size > 0, size, 1.0)[..., None, None]
    power = scaled.swapaxes(-1, -2) @ scaled
    for _ in range(SQUARINGS):
        power = power @ power
    # Norms are at most 1: the first product is off by less than 6 UNIT, each squaring doubles that and adds 4 UNIT.
    rounded = frobenius(power) + 12.0 * 2.0**SQUARINGS * UNIT
    return up(size * rounded ** (0.5 / 2.0**SQUARINGS) * (1.0 + 1e-12))
