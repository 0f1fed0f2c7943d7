"""What a plan makes of itself: a page, and files for other programs."""

import webbrowser

import numpy as np
import pytest

from floatplan.errors import InputError


@pytest.fixture(scope="module")
def plan(planned):
    return planned("new_configuration")


@pytest.fixture
def opened(monkeypatch):
    """Addresses that the browser was told to open."""
    addresses = []
    monkeypatch.setattr(webbrowser, "open", lambda address: addresses.append(address))
    return addresses


class TestShow:
    def test_writes_the_report_and_opens_it(self, plan, tmp_path, opened):
        page = plan.show(tmp_path / "page.html")
        assert page == tmp_path / "page.html"
        assert plan.problem.name in page.read_text()
        assert opened == [page.resolve().as_uri()]

    def test_opens_nothing_where_that_is_not_wanted(self, plan, tmp_path, opened):
        assert plan.show(tmp_path / "page.html", browse=False).is_file()
        assert opened == []


class TestSample:
    def test_is_the_motion_at_even_instants_and_at_the_end(self, plan):
        sample = plan.sample(7.0)
        assert np.diff(sample.times)[:-1] == pytest.approx(1 / 7)
        assert (sample.times[0], sample.times[-1]) == (0.0, plan.duration)
        for name in ("q", "v", "a", "tau"):
            np.testing.assert_array_equal(getattr(sample, name), getattr(plan, name)(sample.times))
        assert (sample.q.shape[1], sample.v.shape[1]) == (plan.robot.nq, plan.robot.nv)

    @pytest.mark.parametrize(
        ("rate", "words"),
        [(0.0, "positive"), (-1.0, "positive"), (np.nan, "rate"), (np.inf, "rate"), (1e9, "100000 rows")],
    )
    def test_refuses_rates_that_give_no_instants_or_too_many(self, plan, rate, words):
        with pytest.raises(InputError, match=words):
            plan.sample(rate)
