"""Spectral quadrature and extrema, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import legendre

from floatplan.motion.quadrature import (
    NODE_COUNTS,
    chebyshev_nodes,
    extremes,
    gauss_legendre,
    largest_magnitudes,
    least_by_grids,
    local_minima,
    resolution,
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

    def test_integrals_up_to_any_instant(self):
        quadrature = gauss_legendre(24)
        integrals = quadrature.integrals(INSTANTS) @ np.exp(3 * quadrature.nodes)
        assert integrals == pytest.approx((np.exp(3 * INSTANTS) - 1) / 3, abs=1e-13)

    def test_last_integral_is_the_whole(self):
        quadrature = gauss_legendre(16)
        assert quadrature.integrals(np.array([1.0]))[0] == pytest.approx(quadrature.weights, abs=1e-15)

    def test_transform_gives_legendre_coefficients(self):
        quadrature = gauss_legendre(16)
        coefficients = np.arange(1.0, 17.0)
        values = np.polynomial.legendre.legval(2 * quadrature.nodes - 1, coefficients)
        assert quadrature.transform @ values == pytest.approx(coefficients, abs=1e-12)

    def test_tail_falls_as_fast_as_the_function_is_smooth(self):
        """Geometrically, by the pole at i/5 (Trefethen, theorem 8.2)."""

        def tail(count):
            quadrature = gauss_legendre(count)
            return quadrature.tail(1 / (1 + 25 * (2 * quadrature.nodes - 1) ** 2))

        rate = np.log(tail(128) / tail(96)) / 32
        assert rate == pytest.approx(-np.arcsinh(1 / 5), rel=0.05)
        assert gauss_legendre(16).tail(np.exp(gauss_legendre(16).nodes)) < 1e-14


class TestExtrema:
    def test_nodes_rise_from_0_to_1(self):
        nodes = chebyshev_nodes(9)
        assert (nodes[0], nodes[4], nodes[-1]) == (0.0, pytest.approx(0.5), 1.0)
        assert (np.diff(nodes) > 0).all()

    def test_minima_inside_and_at_both_ends(self):
        """cos(14 s + 0.4): minima at odd multiples of pi inside, and at s = 1 where it still falls."""
        s = chebyshev_nodes(65)
        column, where, value = local_minima(np.cos(14 * s + 0.4)[:, None])
        inside = (np.array([1, 3]) * np.pi - 0.4) / 14
        assert column.tolist() == [0, 0, 0]
        assert np.sort(where) == pytest.approx([*inside, 1.0], abs=1e-8)
        assert np.sort(value) == pytest.approx([-1, -1, np.cos(14.4)], abs=1e-13)

    def test_minima_of_several_functions_are_told_apart(self):
        s = chebyshev_nodes(33)
        column, where, value = local_minima(np.stack(((s - 0.3) ** 2, s, 2 - s, (s - 0.71) ** 2 - 4), axis=1))
        order = np.argsort(column)
        assert column[order].tolist() == [0, 1, 2, 3]
        assert where[order] == pytest.approx([0.3, 0.0, 1.0, 0.71], abs=1e-7)
        assert value[order] == pytest.approx([0.0, 0.0, 1.0, -4.0], abs=1e-13)

    def test_minimum_between_points_of_the_search_grid(self):
        for place in np.random.default_rng(1).uniform(0.01, 0.99, 20):
            s = chebyshev_nodes(65)
            _, where, value = local_minima(-np.exp(-80 * (s[:, None] - place) ** 2))
            best = np.argmin(value)
            assert where[best] == pytest.approx(place, abs=1e-7)
            assert value[best] == pytest.approx(-1, abs=1e-12)

    def test_largest_magnitudes_have_no_sign(self):
        s = chebyshev_nodes(65)
        values = np.stack((3 * np.sin(9 * s), -5 * s, 2 * s * (1 - s), np.full(65, -0.7)), axis=1)
        largest, where = largest_magnitudes(values)
        assert largest == pytest.approx([3.0, 5.0, 0.5, 0.7], abs=1e-12)
        assert np.abs(np.sin(9 * where[0])) == pytest.approx(1.0, abs=1e-12)
        assert where[1:3] == pytest.approx([1.0, 0.5], abs=1e-7)

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

    def test_resolution_tells_whether_the_nodes_are_enough(self):
        def of(count):
            return resolution(np.sin(40 * chebyshev_nodes(count))[:, None])

        assert of(17) > 0.05
        assert of(65) < 1e-13
        assert resolution(np.zeros((17, 2))) == 0
