"""Spectral quadrature and extrema, against closed forms."""

import numpy as np
import pytest
from numpy.polynomial import legendre

from floatplan.motion.quadrature import (
    NODE_COUNTS,
    chebyshev_nodes,
    extremes,
    gauss_legendre,
    least_by_grids,
    local_minima,
)

INSTANTS = np.linspace(0, 1, 33)


class TestGaussLegendre:
    @pytest.mark.parametrize("count", NODE_COUNTS)
    def test_integrates_polynomials_up_to_twice_its_nodes(self, count):
        quadrature = gauss_legendre(count)
        for degree in (0, 1, count, 2 * count - 1):
            assert quadrature.weights @ quadrature.nodes**degree == pytest.approx(1 / (degree + 1), rel=1e-13)
        vanishing = legendre.legval(2 * quadrature.nodes - 1, [0.0] * count + [1.0])
        assert quadrature.weights @ vanishing**2 == pytest.approx(0.0, abs=1e-20)  # its integral is 1 / (2 count + 1)

    @pytest.mark.parametrize("count", NODE_COUNTS)
    def test_tabulated_nodes_are_those_that_numpy_computes(self, count):
        nodes, weights = legendre.leggauss(count)
        quadrature = gauss_legendre(count)
        assert 2 * quadrature.nodes - 1 == pytest.approx(nodes, abs=4e-16)
        assert 2 * quadrature.weights == pytest.approx(weights, rel=1e-12)

    def test_integrals_up_to_any_instant(self):
        quadrature = gauss_legendre(24)
        integrals = quadrature.integrals(INSTANTS) @ np.exp(3 * quadrature.nodes)
        assert integrals == pytest.approx((np.exp(3 * INSTANTS) - 1) / 3, abs=1e-13)


class TestExtrema:
    def test_minima_inside_and_at_both_ends(self):
        """cos(14 s + 0.4): minima at odd multiples of pi inside, and at s = 1 where it still falls."""
        s = chebyshev_nodes(65)
        column, where, value = local_minima(np.cos(14 * s + 0.4)[:, None])
        inside = (np.array([1, 3]) * np.pi - 0.4) / 14
        assert column.tolist() == [0, 0, 0]
        assert np.sort(where) == pytest.approx([*inside, 1.0], abs=1e-8)
        assert np.sort(value) == pytest.approx([-1, -1, np.cos(14.4)], abs=1e-13)

    def test_extremes_have_a_sign_and_a_place(self):
        s = chebyshev_nodes(65)
        least, at_least, largest, at_largest = extremes(np.stack((np.cos(np.pi * s), s - 2), axis=1))
        assert least == pytest.approx([-1.0, -2.0], abs=1e-12)
        assert largest == pytest.approx([1.0, -1.0], abs=1e-12)
        assert at_least == pytest.approx([1.0, 0.0], abs=1e-7)
        assert at_largest == pytest.approx([0.0, 1.0], abs=1e-7)

    def test_least_value_of_a_function_with_kinks_and_jumps(self):
        def values(times):
            return np.where(times < 0.7371, np.abs(times - 0.3123), np.abs(times - 0.7371) - 0.5)

        least, where = least_by_grids(values, 1.3, [0.7371])
        assert (least, where) == (-0.5, 0.7371)
        least, where = least_by_grids(lambda times: np.abs(times - 0.3123), 1.3, ())
        assert least == pytest.approx(0.0, abs=1e-6)
        assert where == pytest.approx(0.3123, abs=1e-6)
        assert least_by_grids(lambda times: np.full(times.shape, np.inf), 1.3, ())[0] == np.inf
