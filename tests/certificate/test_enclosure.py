"""Taylor models, their ranges and the search: what they enclose is checked against Arb at 200 bits."""

import flint
import numpy as np
import pytest
from flint import arb

from floatplan.certificate.branch_and_bound import Goal, Items, bernstein, lower, magnitude, smallest, split, upper
from floatplan.certificate.cells import ORDER, TimeCells, recentred
from floatplan.certificate.enclosure import Balls, Taylor, cos_sin, integral, reciprocal

POINTS = [-1.0, -0.77, -0.125, 0.0, 0.3, 0.99, 1.0]


def draw(rng, size=1.0, decay=0.5, items=3, radius=0.0):
    c = size * rng.uniform(-1, 1, (ORDER, 2, items)) * decay ** np.arange(ORDER)[:, None, None]
    return Taylor(c, np.full((2, items), radius))


def exact(model, cell, item, u):
    """The polynomial part at u, in Arb."""
    return flint.arb_poly([float(x) for x in model.c[:, cell, item]])(arb(u))


def assert_contains(model, truth):
    """``truth(cell, item, u)`` lies within the model's radius of its polynomial."""
    with flint.ctx.workprec(200):
        for cell, item in np.ndindex(*model.e.shape):
            assert np.isfinite(model.e[cell, item])
            for u in POINTS:
                off = abs(truth(cell, item, u) - exact(model, cell, item, u))
                assert off <= arb(float(model.e[cell, item])), (cell, item, u, off)


@pytest.mark.parametrize("seed", range(4))
def test_operations_contain_the_exact_result(seed):
    rng = np.random.default_rng(seed)
    decay = [0.9, 0.5, 0.1, 1e-3][seed]
    a, b = draw(rng, 3.0, decay), draw(rng, 2.0, decay)
    at = exact
    assert_contains(a * b, lambda *k: at(a, *k) * at(b, *k))
    assert_contains(a + b, lambda *k: at(a, *k) + at(b, *k))
    assert_contains(a - b, lambda *k: at(a, *k) - at(b, *k))
    cosine, sine = cos_sin(a)
    assert_contains(cosine, lambda *k: at(a, *k).cos())
    assert_contains(sine, lambda *k: at(a, *k).sin())
    assert_contains(integral(a), lambda c, i, u: _integral(a, c, i, u))
    matrix = Balls.exact(rng.uniform(-1, 1, (2, 3)))
    rows = matrix.mid.tolist()
    assert_contains(a.linear(matrix), lambda c, o, u: sum(arb(rows[o][i]) * at(a, c, i, u) for i in range(3)))
    assert_contains(a.sum(), lambda c, o, u: sum(at(a, c, i, u) for i in range(3)))
    third = Balls.from_arb([arb(1) / 3], (1,))
    assert_contains(a.times(third), lambda *k: at(a, *k) / 3)


@pytest.mark.parametrize("seed", range(4))
def test_reciprocal_contains_the_exact_result(seed):
    a = draw(np.random.default_rng(seed), 0.3, [0.8, 0.5, 0.1, 0.01][seed])
    a.c[0] += [2.0, -1.0, 1.0, 100.0][seed]
    assert_contains(reciprocal(a), lambda *k: 1 / exact(a, *k))


def test_reciprocal_of_what_may_vanish_proves_nothing():
    a = draw(np.random.default_rng(0), 1.0)
    a.c[0] = 0.1
    assert np.isinf(reciprocal(a).e).all()


@pytest.mark.parametrize("operation", ["product", "cos", "reciprocal", "integral"])
def test_radii_of_the_operands_are_carried(operation):
    """Shift the operands by their radius: results must still contain the truth."""
    rng = np.random.default_rng(7)
    a, b = draw(rng, 0.3, radius=1e-3), draw(rng, 0.3, radius=2e-3)
    a.c[0] += 2.0
    up, down = arb(1e-3), -arb(2e-3)

    def moved_a(*k):
        return exact(a, *k) + up

    def moved_b(*k):
        return exact(b, *k) + down

    results = {
        "product": (lambda: a * b, lambda *k: moved_a(*k) * moved_b(*k)),
        "cos": (lambda: cos_sin(a)[0], lambda *k: moved_a(*k).cos()),
        "reciprocal": (lambda: reciprocal(a), lambda *k: 1 / moved_a(*k)),
        "integral": (lambda: integral(a), lambda c, i, u: _integral(a, c, i, u) + up * (arb(u) + 1)),
    }
    model, truth = results[operation]
    assert_contains(model(), truth)


def test_recentred_polynomials_are_the_polynomials():
    coefficients = [0.3, -2.0, 11.0, -140.0, 900.0, -1300.0, 77.0, 3.0]
    cells = TimeCells.between(np.array([0.0, 0.4]), np.array([0.1, 1.0 / 3.0 + 0.2]))
    balls = recentred([flint.arb_poly(coefficients)], cells, 8)
    model = Taylor.polynomial(balls.mid, balls.rad, ORDER)

    def truth(cell, item, u):
        first, last = arb(float(cells.low[cell])), arb(float(cells.high[cell]))
        return flint.arb_poly(coefficients)((first + last) / 2 + (last - first) / 2 * arb(u))

    assert_contains(model, truth)
    assert model.e.max() < 1e-11


@pytest.mark.parametrize("seed", range(3))
def test_bernstein_bounds_contain_the_range_and_tighten(seed):
    a = draw(np.random.default_rng(seed), 2.0, 0.8)
    flat = Taylor(a.c.reshape(ORDER, -1), a.e.ravel())
    u = np.linspace(-1, 1, 4001)
    values = np.tensordot(u[:, None] ** np.arange(ORDER), flat.c, axes=1)
    form = bernstein(flat)
    for _ in range(6):
        pieces = form.e.size // 6
        low, high = lower(form).reshape(pieces, 6).min(0), upper(form).reshape(pieces, 6).max(0)
        assert (low <= values.min(0)).all()
        assert (high >= values.max(0)).all()
        assert (magnitude(form).reshape(pieces, 6).max(0) >= np.abs(values).max(0)).all()
        form = split(form, 1)
    assert (values.min(0) - low < 2e-3).all()
    assert (high - values.max(0) < 2e-3).all()


def test_search_finds_the_smallest_value_of_each_group():
    rng = np.random.default_rng(11)
    a = draw(rng, 1.0, 0.8, items=4)
    cells = TimeCells.between(np.array([0.0, 1.0]), np.array([1.0, 2.0]))
    groups = np.array([0, 0, 1, 1])
    found = smallest(
        Items.whole_cells([bernstein(a)], np.arange(2)),
        groups,
        lambda forms, member: lower(forms[0]),
        lambda values, member: values[0].mid + values[0].rad,
        Goal(np.full(2, 1e-9), np.full(2, -np.inf)),
        cells,
    )
    u = np.linspace(-1, 1, 20001)
    values = np.tensordot(u[:, None] ** np.arange(ORDER), a.c, axes=1)
    for group, minimum in enumerate(found):
        truth = values[:, :, groups == group].min()
        assert minimum.bound <= truth + 1e-12
        assert minimum.bound >= truth - 1e-7
        assert minimum.attained - minimum.bound <= 1e-8
        assert groups[minimum.member] == group


def test_search_gives_up_on_what_is_unknown():
    a = draw(np.random.default_rng(1))
    a.c[3, 0, 0] = np.nan
    cells = TimeCells.between(np.array([0.0, 1.0]), np.array([1.0, 2.0]))
    items = Items.whole_cells([bernstein(a)], np.arange(2))
    found = smallest(
        items,
        np.zeros(3, dtype=int),
        lambda forms, member: lower(forms[0]),
        lambda values, member: values[0].mid + values[0].rad,
        Goal(np.array([1e-9]), np.array([-10.0])),
        cells,
    )
    assert found[0].bound == -np.inf


def _integral(model, cell, item, u):
    antiderivative = flint.arb_poly([float(x) for x in model.c[:, cell, item]]).integral()
    return antiderivative(arb(u)) - antiderivative(arb(-1))
