import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.utils.estimator_checks import parametrize_with_checks

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


def test_small_motion_about_a_large_offset():
    """States of unit variance about 1e6: forming the Gram matrix uncentred loses the states."""
    rng = np.random.default_rng(2)
    z = rng.normal(size=(1000, 8))
    y = z @ rng.normal(size=8)
    model = Ridge(1e-9).fit(z + 1e6, y)
    error = np.sqrt(np.mean((model.predict(z + 1e6) - y) ** 2)) / y.std()
    assert error < 1e-6


def test_works_in_a_grid_search():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(120, 5))
    y = x @ np.arange(5.0) + rng.normal(size=120)
    grid = {"regularization": [1e-6, 1e6]}
    search = GridSearchCV(Ridge(), grid, cv=TimeSeriesSplit(3, gap=2)).fit(x, y)
    assert search.best_params_ == {"regularization": 1e-6}


def test_clone_and_parameters():
    model = clone(Ridge(0.25).set_params(regularization=0.5))
    assert model.get_params() == {"regularization": 0.5}


@pytest.mark.parametrize(
    ("estimator", "penalty"),
    [
        (Ridge(0.1), 0.1),
        (SklearnRidge(alpha=2), 2.0),
        (SklearnRidge(alpha=[1, 2]), None),
        ({}, None),
    ],
)
def test_penalty_of(estimator, penalty):
    assert penalty_of(estimator) == penalty


def test_negative_penalty_is_refused():
    with pytest.raises(ValueError, match="alpha"):
        Ridge(-1.0).fit(np.eye(3), np.arange(3.0))
