"""Takeoff and landing: verdicts in words, and warnings of plans."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rich.console import Console

import floatplan as fp
from floatplan.cli.summary import plan_summary
from floatplan.robot.urdf.tree import robots_folder


def shown(summary):
    console = Console(width=400, file=io.StringIO())
    console.print(summary)
    return console.file.getvalue()


@pytest.fixture(scope="module")
def load(root):
    @cache
    def loaded(name):
        if name.startswith("gallery/") and robots_folder() is None:
            pytest.skip("example-robot-data is not installed")
        return fp.load_problem(root / "problems" / f"{name}.toml")

    return loaded


class TestVerdicts:
    @pytest.mark.parametrize(
        ("name", "end", "ratio"),
        [
            ("high_jump", fp.takeoff, 2.83),
            ("gallery/g1", fp.takeoff, 2.51),
            ("gallery/human", fp.takeoff, 3.56),
            ("gallery/g1", fp.landing, 1.27),
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

    def test_one_end_alone_has_its_own_best(self, load):
        problem = load("gallery/go2")
        flight = replace(problem.flight, landing=fp.Landing(problem.robot.tree.names[0], 0.3))
        alone = replace(problem, flight=flight)
        best = fp.takeoff(alone)
        assert best.ok
        for step in (-1, 1):
            assert fp.takeoff(alone, best.angular_momentum + step).ratio > best.ratio

    def test_no_free_momentum_for_both_ends(self, load):
        problem = load("gallery/go2")
        sentence = fp.motion.planar.contact.no_common_momentum(problem)
        ends = [float(number) for number in re.findall(r"(-?[\d.]+) (?:to|kg)", sentence)]
        for end, (low, high) in ((fp.takeoff, ends[:2]), (fp.landing, ends[2:])):
            assert end(problem, low).ratio == pytest.approx(1.0, abs=0.01)
            assert end(problem, high).ratio == pytest.approx(1.0, abs=0.01)
        assert ends[1] < ends[2]
        assert fp.motion.planar.contact.no_common_momentum(load("high_jump")) is None

    def test_stretched_out(self, load):
        found = fp.landing(load("handstand"))
        assert found.ratio == np.inf
        assert not found.ok
        assert found.rate is None
        assert "stretched out" in found.sentences[0]

    def test_json_has_no_number_that_is_not_finite(self, load):
        content = fp.landing(load("handstand")).to_dict()
        assert content["ratio"] is None
        assert content["rates"] is None
        assert content["contact"] is True
        assert content["ok"] is False
        assert content["limits"] == [None, None]


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

    def test_plan_and_takeoff_say_the_same_of_one_momentum(self, load):
        plan = fp.plan(load("gallery/go2"))
        text = " ".join(shown(plan_summary(plan, [])).split())
        for contact, end in zip(plan.contacts, (fp.takeoff, fp.landing), strict=True):
            again = end(
                replace(plan.problem, flight=replace(plan.problem.flight, angular_momentum=plan.angular_momentum))
            )
            assert again.verdict == contact.verdict
            share = re.search(r"with (.* velocity limit at \S+ kg)", contact.brief)[1]
            assert share in again.verdict
            assert share in text
            assert f"{plan.angular_momentum:.5g}" in share

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

    def test_a_plan_that_nothing_stands_in_has_none(self, planned):
        assert planned("falling_cat").contacts == ()
        assert not [w for w in planned("falling_cat").warnings if w.kind in ("takeoff", "landing")]

    def test_a_plan_does_not_look_before_it_is_asked(self, load, monkeypatch):
        def refuse(*_):
            raise AssertionError("a verdict was made")

        problem = load("high_jump")
        with monkeypatch.context() as patched:
            patched.setattr("floatplan.motion.planar.contact.contact_rates", refuse)
            plan = fp.plan(problem)
        assert {"takeoff", "landing"} <= {warning.kind for warning in plan.warnings}

    def test_they_are_the_same_after_saving(self, planned, tmp_path):
        plan = planned("handstand")
        again = fp.load_plan(plan.save(tmp_path / "plan.json"))
        assert [w.to_dict() for w in again.warnings] == [w.to_dict() for w in plan.warnings]
        fast, warning = plan.warnings
        assert (fast.kind, fast.limit) == ("takeoff", 40.0)
        assert (warning.kind, warning.subject, warning.value, warning.limit) == ("landing", "hand", None, None)
