"""Sine polynomials (12) and the conditions (13) that are built into them."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from sampled_flight import JointSlopes

from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.sine_polynomial import (
    Form,
    SinePolynomials,
    WrittenMotion,
    basis,
    boundary_arguments,
)

DEGREES = (5, 6, 7, 8, 9, 11, 13)
ENDS = np.array([0.0, 1.0])


def draw(seed, n=3, degree=8, branches=(-1, 0, 1, 2, 3)):
    """Random ranges, duration, branches and boundary states: the polynomials, and the states at both ends (2, 3, n)."""
    rng = np.random.default_rng(seed)
    centre, amplitude = rng.uniform(-2, 2, n), rng.uniform(0.2, 3.5, n)
    duration = rng.uniform(0.4, 2.0)
    branch = rng.choice(branches, (2, n))
    positions = centre + amplitude * rng.uniform(-0.95, 0.95, (2, n))
    velocities, accelerations = rng.normal(size=(2, 2, n))
    states = np.stack((positions, velocities, accelerations), axis=1)
    return polynomials(centre, amplitude, duration, states, branch, (degree - 5,) * n), states


def polynomials(centre, amplitude, duration, states, branch, free):
    scales = duration ** np.arange(3)
    boundary = []
    for state, chosen in zip(states, branch, strict=True):
        arguments = boundary_arguments(*state, centre, amplitude, chosen)
        boundary += [scale * values for scale, values in zip(scales, arguments, strict=True)]
    return SinePolynomials(centre, amplitude, duration, np.stack(boundary, axis=1), free)


def random_z(seed, motion, size=1.0):
    return np.random.default_rng(seed).normal(scale=size, size=(len(motion.free), motion.width))


def state_of(motion):
    return np.stack((motion.positions, motion.velocities, motion.accelerations), axis=1)


def written(motion, coefficients):
    return WrittenMotion.from_powers(motion.centre, motion.amplitude, coefficients, motion.duration)


class TestBoundaryConditions:
    @pytest.mark.parametrize("degree", DEGREES)
    def test_hold_whatever_the_free_part(self, degree):
        for seed in range(20):
            motion, states = draw([degree, seed], degree=degree)
            found = state_of(motion.motion(random_z(seed, motion), basis(Form(degree - 5)).values(ENDS)))
            assert np.abs(found - states).max() < 1e-10

    @pytest.mark.parametrize("degree", DEGREES)
    def test_hold_in_powers_of_seconds(self, degree):
        """For moderate b; of large ones the terms cancel, see :class:`TestPowersOfSeconds`."""
        for seed in range(20):
            motion, states = draw([degree, seed], degree=degree)
            coefficients = motion.powers_of_seconds(random_z(seed, motion, min(1.0, 10.0 ** (6 - degree))))
            assert coefficients.shape == (3, degree + 1)
            found = written(motion, coefficients).at(ENDS * motion.duration)
            assert np.abs(np.stack(found, axis=1) - states).max() < 1e-10

    @pytest.mark.parametrize("branch", [-2, -1, 0, 1, 2, 5])
    def test_argument_lies_on_its_branch(self, branch):
        sine = np.linspace(-1, 1, 41)
        still = np.zeros(41)
        p, _, _ = boundary_arguments(sine, still, still, still, np.ones(41), np.full(41, branch))
        assert np.sin(p) == pytest.approx(sine, abs=1e-14)
        assert (np.abs(p - branch * np.pi) <= np.pi / 2 + 1e-15).all()

    @pytest.mark.parametrize("edge", [-1, 1])
    @pytest.mark.parametrize("inward", [0.0, 2.5])
    @pytest.mark.parametrize("branch", [0, 1])
    def test_hold_on_the_edge_of_a_range(self, edge, inward, branch):
        """There the rate is zero and the acceleration, if any, points inwards; the free part keeps them."""
        centre, amplitude = np.array([0.4, 0.1]), np.array([1.3, 0.7])
        on_edge = np.stack((centre + edge * amplitude, np.zeros(2), np.full(2, -edge * inward)))
        inside = np.stack((centre + 0.3 * amplitude, np.array([0.2, -0.5]), np.array([0.7, 0.1])))
        for states in ((on_edge, inside), (inside, on_edge)):
            motion = polynomials(centre, amplitude, 1.2, np.stack(states), np.full((2, 2), branch), (3, 3))
            found = state_of(motion.motion(random_z(1, motion), basis(Form(3)).values(ENDS)))
            assert np.abs(found - np.stack(states)).max() < 1e-10

    @pytest.mark.parametrize("edge", [-1, 1])
    def test_hold_within_rounding_of_an_edge(self, edge):
        centre, amplitude = np.array([0.4]), np.array([1.3])
        nearly = np.nextafter(centre + edge * amplitude, centre)
        state = np.stack((nearly, np.zeros(1), np.array([-edge * 0.8])))
        motion = polynomials(centre, amplitude, 1.2, np.stack((state, state)), np.zeros((2, 1), dtype=int), (2,))
        found = state_of(motion.motion(random_z(2, motion), basis(Form(2)).values(ENDS)))
        assert np.abs(found - state).max() < 1e-10


class TestMotion:
    def test_stays_within_the_range(self):
        motion, _ = draw(3)
        found = motion.motion(random_z(3, motion, 40.0), basis(Form(3)).values(np.linspace(0, 1, 500)))
        reach = np.abs(found.positions - motion.centre) / motion.amplitude
        assert 0.999 < reach.max() <= 1 + 1e-15

    def test_velocities_and_accelerations_are_derivatives(self):
        motion, _ = draw(4)
        z, s, step = random_z(4, motion), np.linspace(0.1, 0.9, 9), 1e-4
        here = motion.motion(z, basis(Form(3)).values(s))
        ahead, behind = (
            motion.motion(z, basis(Form(3)).values(s + shift / motion.duration)) for shift in (step, -step)
        )
        for order, size in ((0, np.abs(here.velocities).max()), (1, np.abs(here.accelerations).max())):
            difference = (state_of(ahead)[:, order] - state_of(behind)[:, order]) / (2 * step)
            assert np.abs(state_of(here)[:, order + 1] - difference).max() < 1e-5 * size

    @pytest.mark.parametrize("what", ["positions", "velocities", "accelerations"])
    def test_jacobian_is_that_of_differences(self, what):
        motion, _ = draw(5)
        values = basis(Form(3)).values(np.linspace(0, 1, 7))
        z, step = random_z(5, motion), 1e-5
        partials = {
            "positions": ("position_by_p",),
            "velocities": ("velocity_by_p", "velocity_by_rate"),
            "accelerations": ("acceleration_by_p", "acceleration_by_rate", "acceleration_by_curvature"),
        }
        here = motion.motion(z, values)
        for joint in range(3):
            for k in range(3):
                shift = np.zeros_like(z)
                shift[joint, k] = step
                ahead, behind = (getattr(motion.motion(z + sign * shift, values), what) for sign in (1, -1))
                column = sum(
                    getattr(JointSlopes.of(here), name) * values[order][:, CONDITIONS + k, None]
                    for order, name in enumerate(partials[what])
                )
                expected = np.zeros_like(column)
                expected[:, joint] = column[:, joint]
                size = max(1.0, np.abs(column).max())
                assert (ahead - behind) / (2 * step) == pytest.approx(expected, abs=1e-7 * size)

    def test_joints_of_lower_degree_leave_the_last_free_numbers_alone(self):
        motion = SinePolynomials(np.zeros(2), np.ones(2), 1.0, np.zeros((2, 6)), (1, 3))
        assert motion.width == 3
        assert motion.free_indices.tolist() == [0, 3, 4, 5]


class TestBasis:
    def test_hermite_part_is_the_unit_conditions(self):
        at_ends = np.stack([values[:, :CONDITIONS] for values in basis(Form(2)).values(ENDS)], axis=1)
        assert at_ends.reshape(6, 6) == pytest.approx(np.eye(6), abs=1e-13)

    def test_free_part_vanishes_at_the_ends_with_two_derivatives(self):
        for order, values in enumerate(basis(Form(8)).values(ENDS)):
            assert np.abs(values[:, CONDITIONS:]).max() < 1e-15 * 100.0**order

    def test_free_part_is_orthonormal(self):
        nodes, weights = np.polynomial.legendre.leggauss(20)
        free = basis(Form(8)).values((nodes + 1) / 2)[0][:, CONDITIONS:]
        assert free.T @ (weights[:, None] / 2 * free) == pytest.approx(np.eye(8), abs=1e-12)

    @pytest.mark.parametrize("free", [0, 2, 4, 8])
    def test_values_are_those_of_the_powers(self, free):
        """Powers evaluated exactly: in floating point their terms, up to 1e7 for degree 13, cancel."""
        s = np.linspace(0, 1, 11)
        found = basis(Form(free)).values(s)
        for column, powers in enumerate(basis(Form(free)).powers.T):
            exact = np.array([Fraction(power) for power in powers])
            for order in range(3):
                expected = [float(sum(c * Fraction(at) ** k for k, c in enumerate(exact))) for at in s]
                size = float(max(abs(c) for c in exact))
                assert np.abs(found[order][:, column] - expected).max() < 1e-15 * (100.0**order + size)
                exact = exact[1:] * np.arange(1, len(exact))


class TestPowersOfSeconds:
    @pytest.mark.parametrize("degree", DEGREES)
    def test_are_the_motion_of_the_basis(self, degree):
        """Up to rounding of b, whose terms cancel."""
        motion, _ = draw([6, degree], degree=degree)
        z, s = random_z(6, motion), np.linspace(0, 1, 21)
        expected = motion.motion(z, basis(Form(degree - 5)).values(s))
        b = motion.powers_of_seconds(z)
        found = written(motion, b).at(s * motion.duration)
        terms = (np.abs(b) * motion.duration ** np.arange(degree + 1)).sum(axis=1).max()
        rounding = 2e-16 * terms * motion.amplitude.max()
        for order, (have, want) in enumerate(zip(found, state_of(expected).swapaxes(0, 1), strict=True)):
            assert np.abs(have - want).max() < 5 * rounding * (degree / motion.duration) ** order

    def test_rounding_is_small_for_the_paper_s_degree(self):
        motion, _ = draw(8, degree=7)
        z = random_z(8, motion)
        found = written(motion, motion.powers_of_seconds(z)).at(ENDS * motion.duration)
        expected = motion.motion(z, basis(Form(2)).values(ENDS))
        assert np.abs(found[0] - expected.positions).max() < 1e-11

    def test_motion_is_numpy_s(self):
        rng = np.random.default_rng(7)
        times, centre, amplitude = rng.uniform(0, 1.5, 40), rng.normal(size=3), rng.uniform(0.5, 3, 3)
        coefficients = rng.normal(size=(3, 9))
        found = WrittenMotion.from_powers(centre, amplitude, coefficients, 1.5).at(times)
        for i, row in enumerate(coefficients):
            p = Polynomial(row)
            position = centre[i] + amplitude[i] * np.sin(p(times))
            velocity = amplitude[i] * np.cos(p(times)) * p.deriv()(times)
            acceleration = amplitude[i] * (
                np.cos(p(times)) * p.deriv(2)(times) - np.sin(p(times)) * p.deriv()(times) ** 2
            )
            for have, want in zip(found, (position, velocity, acceleration), strict=True):
                assert np.abs(have[:, i] - want).max() < 1e-13 * max(1.0, np.abs(want).max())
