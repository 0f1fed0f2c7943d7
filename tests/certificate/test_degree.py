"""What a plan file's doubles hold of (13): boundary values and interior of polynomials of every degree allowed."""

import flint
import numpy as np
import pytest
from flint import arb, arb_poly

from floatplan.motion.sine_polynomial import SinePolynomials
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
