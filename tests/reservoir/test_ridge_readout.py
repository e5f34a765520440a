import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.utils.estimator_checks import parametrize_with_checks

from openprc.errors import TaskError
from openprc.reservoir.readout.ridge import Ridge, penalty_of


@parametrize_with_checks([Ridge()])
def test_scikit_learn_conventions(estimator, check):
    with warnings.catch_warnings():
        # The checks warn about the data that they make up.
        warnings.simplefilter("ignore")
        check(estimator)


def test_closed_form():
    """w = (Z'Z + a I)^-1 Z'(y - mean), b = mean(y) - mean(X) w, with Z = X - mean(X)."""
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(200, 4)) + 3.0, rng.normal(size=(200, 2)) - 5.0
    z = x - x.mean(axis=0)
    weights = np.linalg.solve(z.T @ z + 10.0 * np.eye(4), z.T @ (y - y.mean(axis=0)))
    model = Ridge(10.0).fit(x, y)
    np.testing.assert_allclose(model.coef_.T, weights, rtol=1e-10)
    np.testing.assert_allclose(
        model.intercept_, y.mean(axis=0) - x.mean(axis=0) @ weights, rtol=1e-10
    )
    np.testing.assert_allclose(model.predict(x), x @ weights + model.intercept_, rtol=1e-10)


def test_the_intercept_is_not_penalised():
    """With a penalised intercept a ones column gives 48.35 here at a penalty of 10."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(300, 3))
    y = x @ [1.0, 2.0, 3.0] + 50.0
    heavy = Ridge(1e6).fit(x, y)
    assert heavy.predict(x).mean() == pytest.approx(y.mean(), rel=1e-12)


@pytest.mark.parametrize(("offset", "bound"), [(1e6, 1e-9), (1e8, 1e-7)])
def test_small_motion_about_a_large_offset(offset, bound):
    """States of unit variance about an offset: uncentred products lose them altogether."""
    rng = np.random.default_rng(2)
    z = rng.normal(size=(1000, 8))
    y = z @ rng.normal(size=8)
    model = Ridge(1e-9).fit(z + offset, y)
    # The offset itself rounds the states to offset * 1.1e-16.
    error = np.sqrt(np.mean((model.predict(z + offset) - y) ** 2)) / y.std()
    assert error < bound


@pytest.mark.parametrize(("condition", "bound"), [(1e2, 1e-13), (1e5, 1e-11), (1e7, 1e-8)])
def test_as_exact_as_singular_values_of_the_states(condition, bound):
    """One correction from the residual makes up for the squared condition number."""
    rng = np.random.default_rng(4)
    u, _ = np.linalg.qr(rng.normal(size=(400, 12)))
    v, _ = np.linalg.qr(rng.normal(size=(12, 12)))
    s = np.geomspace(1.0, 1.0 / condition, 12)
    x = (u * s) @ v.T
    x -= x.mean(axis=0)
    y = x @ rng.normal(size=12) + 1e-3 * rng.normal(size=400)
    penalty = 1e-15
    a, b, c = np.linalg.svd(x, full_matrices=False)
    exact = c.T @ (b / (b**2 + penalty) * (a.T @ (y - y.mean())))
    model = Ridge(penalty).fit(x, y)
    assert model.remarks_ == ()
    difference = np.abs(model.predict(x) - (x @ exact + y.mean())).max() / y.std()
    assert difference < bound


def test_copied_states_share_the_weight_and_are_remarked():
    rng = np.random.default_rng(5)
    x = rng.normal(size=(200, 3))
    y = x @ [1.0, 2.0, 3.0] + 7.0
    model = Ridge(0.0).fit(np.hstack([x, x]), y)
    np.testing.assert_allclose(model.coef_, np.tile([0.5, 1.0, 1.5], 2), atol=1e-10)
    assert model.intercept_ == pytest.approx(7.0, rel=1e-12)
    (remark,) = model.remarks_
    assert "singular to working precision" in remark
    assert "3 of 6 directions were used" in remark


def test_states_that_do_not_change_get_no_weight():
    rng = np.random.default_rng(6)
    x = rng.normal(size=(100, 2))
    with_constant = np.insert(x, 1, 1e6 / 3.0, axis=1)
    model = Ridge(0.0).fit(with_constant, x[:, 0])
    np.testing.assert_allclose(model.coef_, [1.0, 0.0, 0.0], atol=1e-12)
    assert model.remarks_ == ()


@pytest.mark.parametrize(
    ("scaling", "factor"), [("none", 1.0), ("n", 500.0), ("trace", 500.0 * 4.0)]
)
def test_what_the_penalty_is_multiplied_by(scaling, factor):
    """The states have variance 4, so that their mean sum of squares is 4 n."""
    x = np.random.default_rng(7).normal(size=(500, 3))
    x = 2.0 * (x - x.mean(axis=0)) / x.std(axis=0)
    y = x @ [1.0, -2.0, 0.5]
    scaled = Ridge(0.01, alpha_scaling=scaling).fit(x, y)
    np.testing.assert_allclose(scaled.coef_, Ridge(0.01 * factor).fit(x, y).coef_, rtol=1e-12)


def test_ten_times_the_data_leaves_a_scaled_penalty_as_strong():
    rng = np.random.default_rng(8)
    x, noise = rng.normal(size=(200, 4)), rng.normal(size=200)
    y = x.sum(axis=1) + noise
    many, targets = np.tile(x, (10, 1)), np.tile(y, 10)
    for scaling in ("n", "trace"):
        few = Ridge(0.5, alpha_scaling=scaling).fit(x, y)
        np.testing.assert_allclose(
            Ridge(0.5, alpha_scaling=scaling).fit(many, targets).coef_, few.coef_, rtol=1e-10
        )
    assert not np.allclose(Ridge(100.0).fit(many, targets).coef_, Ridge(100.0).fit(x, y).coef_)


def test_a_penalty_for_each_output():
    rng = np.random.default_rng(9)
    x, y = rng.normal(size=(150, 5)), rng.normal(size=(150, 3))
    penalties = [0.1, 10.0, 0.1]
    both = Ridge(penalties).fit(x, y)
    for k, penalty in enumerate(penalties):
        alone = Ridge(penalty).fit(x, y[:, k])
        np.testing.assert_allclose(both.coef_[k], alone.coef_, rtol=1e-10)
        assert both.intercept_[k] == pytest.approx(alone.intercept_, rel=1e-10)


def test_products_in_single_precision():
    """Errors of about 1e-7, whatever the unit, and a remark where the penalty lets them grow."""
    rng = np.random.default_rng(10)
    z = rng.normal(size=(3000, 20))
    y = z @ rng.normal(size=20) + 0.1 * rng.normal(size=3000)
    for unit in (1.0, 1e-25):
        x = (z + 1e4) * unit
        exact = Ridge(0.0).fit(x, y).predict(x)
        single = Ridge(0.0, precision="float32").fit(x, y)
        assert 0 < np.abs(single.predict(x) - exact).max() / y.std() < 1e-6
        assert single.remarks_ == ()
    copies = np.hstack([z, z + 1e-4 * rng.normal(size=z.shape)])
    (remark,) = Ridge(1e-9, precision="float32").fit(copies, y).remarks_
    assert "20 of 40 directions were used" in remark


def test_works_in_a_grid_search():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(120, 5))
    y = x @ np.arange(5.0) + rng.normal(size=120)
    grid = {"regularization": [1e-6, 1e6]}
    search = GridSearchCV(Ridge(), grid, cv=TimeSeriesSplit(3, gap=2)).fit(x, y)
    assert search.best_params_ == {"regularization": 1e-6}


def test_clone_and_parameters():
    model = clone(Ridge(0.25).set_params(regularization=0.5))
    assert model.get_params() == {
        "regularization": 0.5,
        "alpha_scaling": "none",
        "precision": "float64",
    }


@pytest.mark.parametrize(
    ("estimator", "penalty"),
    [
        (Ridge(0.1), 0.1),
        (SklearnRidge(alpha=2), 2.0),
        (SklearnRidge(alpha=[1, 2]), None),
        (Ridge([1.0, 2.0]), None),
        (Ridge(0.1, alpha_scaling="n"), None),
        ({}, None),
    ],
)
def test_penalty_of(estimator, penalty):
    assert penalty_of(estimator) == penalty


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"regularization": -1.0}, "regularization is -1.0"),
        ({"regularization": float("nan")}, "regularization is nan"),
        ({"regularization": [1.0, 2.0]}, "there are 2 penalties and 1 outputs"),
        ({"alpha_scaling": "rows"}, "alpha_scaling is 'rows'"),
    ],
)
def test_impossible_settings(keywords, words):
    with pytest.raises(TaskError, match=words):
        Ridge(**keywords).fit(np.eye(3), np.arange(3.0))
