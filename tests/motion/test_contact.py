"""Takeoff and landing: verdicts in words, and warnings of plans."""

from functools import cache

import numpy as np
import pytest

import floatplan as fp


@pytest.fixture(scope="module")
def load(root):
    @cache
    def loaded(name):
        return fp.load_problem(root / "problems" / f"{name}.toml")

    return loaded


class TestVerdicts:
    @pytest.mark.parametrize(
        ("name", "end", "ratio"),
        [
            ("high_jump", fp.takeoff, 2.83),
            pytest.param("gallery/g1", fp.takeoff, 2.51, marks=pytest.mark.long),
            ("gallery/human", fp.takeoff, 3.56),
            pytest.param("gallery/g1", fp.landing, 1.27, marks=pytest.mark.long),
        ],
    )
    def test_ratios(self, load, name, end, ratio):
        found = end(load(name))
        assert found.ratio == pytest.approx(ratio, abs=0.005)
        assert not found.ok
        assert found.rate / found.limit == pytest.approx(found.ratio)
        assert found.joint in found.sentences[0]
        assert "cannot" in found.sentences[0]

    @pytest.mark.parametrize(("name", "rate"), [("somersault", 817), ("handstand", 354)])
    def test_rates_without_limits(self, load, name, rate):
        found = fp.takeoff(load(name))
        assert found.ratio is None
        assert found.limit is None
        assert found.ok
        assert np.abs(found.rates).max() == pytest.approx(rate, abs=0.5)
        assert found.sentences == (found.verdict,)
        assert f"{rate} rad/s" in found.verdict

    def test_a_free_base_has_none(self, load):
        found = fp.takeoff(load("falling_cat"))
        assert (found.ratio, found.joint, found.ok, found.angular_momentum) == (None, None, True, None)
        assert np.isnan(found.rates).all()
        (sentence,) = found.sentences
        assert "No frame stands on the ground" in sentence

    def test_a_free_momentum_is_one_for_both_ends(self, load):
        """That with the least larger ratio of both; nothing but it is spoken of, at either end."""
        problem = load("gallery/go2")
        ends = fp.takeoff(problem), fp.landing(problem)
        momentum = ends[0].angular_momentum
        assert momentum == ends[1].angular_momentum
        assert not all(contact.ok for contact in ends)  # no h suits both
        least = max(contact.ratio for contact in ends)
        for other in np.linspace(momentum - 8.0, momentum + 8.0, 161):
            assert max(end(problem, other).ratio for end in (fp.takeoff, fp.landing)) >= least * (1 - 1e-9)
        for contact in ends:
            assert f"at {momentum:.5g} kg m^2/s" in contact.verdict
            assert f"at {momentum:.5g} kg m^2/s" in contact.brief

    def test_stretched_out(self, load):
        found = fp.landing(load("handstand"))
        assert found.ratio == np.inf
        assert not found.ok
        assert found.rate is None
        assert "stretched out" in found.sentences[0]


class TestPlans:
    def test_warnings_use_the_plan_s_own_momentum(self, load):
        plan = fp.plan(load("gallery/go2"))
        assert plan.problem.flight.angular_momentum == "free"
        found = fp.landing(plan.problem, plan.angular_momentum)
        warnings = [warning for warning in plan.warnings if warning.kind in ("takeoff", "landing")]
        assert [warning.kind for warning in warnings] == ["landing"]
        (warning,) = warnings
        assert warning.value / warning.limit == pytest.approx(found.ratio)
        assert (warning.subject, warning.unit, warning.instant) == (found.joint, "rad/s", plan.duration)
        assert warning.message.endswith("; another posture or momentum may help.")
        assert fp.takeoff(plan.problem, plan.angular_momentum).ok

    def test_a_fast_takeoff_without_a_limit_is_a_warning(self, planned):
        """Of somersault and handstand; as fast as the rates say."""
        for name in ("handstand", "somersault"):
            plan = planned(name)
            found = fp.takeoff(plan.problem, plan.angular_momentum)
            (warning,) = [each for each in plan.warnings if each.kind == "takeoff"]
            assert warning.value == pytest.approx(np.abs(found.rates).max())
            assert warning.value > warning.limit == 40.0
            assert warning.subject == plan.robot.joints[int(np.abs(found.rates).argmax())]
            assert (warning.unit, warning.instant) == ("rad/s", 0.0)
            assert warning.subject in warning.message
