"""Perturbations as they are written: what is read, and what is told of those that are wrong."""

import math

import numpy as np
import pytest

import floatplan as fp
from floatplan.simulation.perturbation import given_perturbation


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", {}),
        ("h=-0.1", {"h": -0.1}),
        ("inertia=5%, h=0", {"inertia": 0.05}),
        ("h=1%, mass=0.02", {"h": 0.01, "mass": 0.02}),
        ("noise=0.5deg, rate_noise=2deg/s", {"noise": math.radians(0.5), "rate_noise": math.radians(2)}),
        ("noise=0.01rad, delay=5ms", {"noise": 0.01, "delay": 0.005}),
        ("noise=0.01, delay=0.02s", {"noise": 0.01, "delay": 0.02}),
        ("rise=2%, torque=3%", {"rise": 0.02, "torque": 0.03}),
    ],
)
def test_are_read(text: str, value: dict[str, float]) -> None:
    read = given_perturbation(text)
    expected = fp.Perturbation(**value)
    for name in fp.Perturbation.checks:
        assert getattr(read, name) == pytest.approx(getattr(expected, name)), name


def test_a_sample_is_that_of_its_seed_and_number() -> None:
    perturbation = fp.Perturbation(h=0.1, inertia=0.1, torque=0.1, armature=0.1)
    samples = [perturbation.sampled(*numbers, 4, 5) for numbers in ((5, 0), (5, 0), (6, 0), (5, 1))]
    first, again, other_seed, other_number = [np.hstack([it.mass, it.inertia, it.armature]) for it in samples]
    np.testing.assert_array_equal(again, first)
    assert (other_seed != first).any()
    assert (other_number != first).any()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("g=1", "cannot perturb 'g'"),
        ("h", "is no number with its unit"),
        ("h=x", "is no number with its unit"),
        ("h=nan", "is no number with its unit"),
        ("h=1e9", "is outside -0.9 to 0.9"),
        ("mass=95%", "mass: 0.95.* is outside -0.9 to 0.9"),
        ("h=1%,h=2%", "given twice"),
        ("noise=5ms", "is no number with its unit"),
        ("noise=9", "noise: 9.* is outside"),
        ("delay=-1ms", "delay: -0.001.* is negative|is outside"),
        ("delay=5deg", "is no number with its unit"),
    ],
)
def test_wrong_ones_are_told(text: str, reason: str) -> None:
    with pytest.raises(fp.InputError, match=reason):
        given_perturbation(text)


def test_inertia_is_of_masses_too_and_mass_is_one_factor_on_both() -> None:
    own = fp.Perturbation(inertia=0.05).sampled(0, 0, 2, 8)
    assert np.abs(own.mass - 1) == pytest.approx(0.05)
    assert np.abs(own.inertia - 1) == pytest.approx(0.05)
    assert (own.mass != own.inertia).any()
    of_both = fp.Perturbation(mass=0.05).sampled(0, 0, 2, 8)
    assert np.abs(of_both.mass - 1) == pytest.approx(0.05)
    np.testing.assert_array_equal(of_both.mass, of_both.inertia)
