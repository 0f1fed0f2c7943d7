"""What a plan file's doubles hold of (13): boundary values and interior of polynomials of every degree allowed."""

from fractions import Fraction

import flint
import numpy as np
import pytest
from flint import arb, arb_poly

from floatplan.motion.exact_polynomials import basis_columns, chebyshev_of_seconds
from floatplan.motion.sine_polynomial import Form, SinePolynomials, WrittenMotion, basis
from floatplan.problem.parts import HIGHEST_DEGREE, LOWEST_DEGREE

DEGREES = range(LOWEST_DEGREE, HIGHEST_DEGREE + 1)


def drawn(rng, degree, joints=3):
    """Polynomials p with values and rates as flights have them, and free parts of a radian each."""
    ends = rng.uniform(-1.5, 1.5, (joints, 6)) * [1, 3, 9, 1, 3, 9]
    polynomials = SinePolynomials(
        np.zeros(joints), np.ones(joints), rng.uniform(0.4, 1.6), ends, (degree - 5,) * joints
    )
    return polynomials, rng.normal(size=(joints, degree - 5))


@pytest.mark.parametrize("degree", DEGREES)
def test_written_doubles_hold_the_boundary_conditions(degree):
    """p to 1e-9, p' to 1e-8 and p'' to 1e-6 of radians and seconds: a tenth of what the certificate allows."""
    rng = np.random.default_rng(degree)
    for _ in range(5):
        polynomials, z = drawn(rng, degree)
        duration = polynomials.duration
        with flint.ctx.workprec(200):
            for row, ends in zip(polynomials.powers_of_seconds(z), polynomials.boundary, strict=True):
                found = []
                for t in (arb(0), arb(duration)):
                    p = arb_poly(row.tolist())
                    found += [p(t), p.derivative()(t), p.derivative().derivative()(t)]
                wanted = [arb(end) / arb(duration) ** (k % 3) for k, end in enumerate(ends)]
                off = [abs(float(a - b)) for a, b in zip(found, wanted, strict=True)]
            assert (np.array(off) <= [1e-15, 1e-14, 1e-13, 1e-9, 1e-8, 1e-6]).all()


@pytest.mark.parametrize("degree", DEGREES)
def test_written_doubles_say_what_the_search_found(degree):
    polynomials, z = drawn(np.random.default_rng(degree), degree)
    times = np.linspace(0.0, polynomials.duration, 41)
    written = WrittenMotion.from_powers(
        polynomials.centre, polynomials.amplitude, polynomials.powers_of_seconds(z), polynomials.duration
    )
    searched = polynomials.motion(z, basis(Form(degree - 5)).values(times / polynomials.duration))
    for found, wanted, tolerance in zip(
        written.at(times),
        (searched.positions, searched.velocities, searched.accelerations),
        (1e-8, 1e-6, 1e-4),
        strict=True,
    ):
        assert np.abs(found - wanted).max() < tolerance


def test_written_coefficients_are_read_to_a_double_s_precision():
    polynomials, z = drawn(np.random.default_rng(1), HIGHEST_DEGREE)
    b = polynomials.powers_of_seconds(z)
    times = np.linspace(0.0, polynomials.duration, 33)
    written = WrittenMotion.from_powers(polynomials.centre, polynomials.amplitude, b, polynomials.duration)
    with flint.ctx.workprec(200):
        exact = [[float(arb_poly(row.tolist())(arb(t)).sin()) for row in b] for t in times]
    assert np.abs(written.at(times)[0] - exact).max() < 1e-13
    assert chebyshev_of_seconds(b, polynomials.duration).shape == (HIGHEST_DEGREE + 1, 3)


def test_the_free_polynomials_are_orthonormal_and_vanish_at_both_ends():
    columns = basis_columns(HIGHEST_DEGREE - 5)[:, 6:]
    powers = range(len(columns))
    moments = np.array([[Fraction(1, i + j + 1) for j in powers] for i in powers], dtype=object)
    inner = (columns.T @ moments @ columns).astype(float)
    assert np.abs(inner - np.eye(len(inner))).max() < 1e-14
    for column in columns.T:
        assert sum(column) == 0
        assert sum(k * c for k, c in enumerate(column)) == 0
        assert sum(k * (k - 1) * c for k, c in enumerate(column)) == 0
        assert not any(column[:3])
