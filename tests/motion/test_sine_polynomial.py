"""Sine polynomials (12) and the conditions (13) that are built into them."""

from __future__ import annotations

import numpy as np
import pytest

from floatplan.motion.sine_polynomial import Form, SinePolynomials, WrittenMotion, basis, boundary_arguments

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
