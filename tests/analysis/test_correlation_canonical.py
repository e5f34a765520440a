"""Canonical correlations against least squares and their own definition."""

import numpy as np
import pytest

from openprc.analysis.correlation import Linear
from openprc.errors import TaskError


@pytest.fixture
def rng():
    return np.random.default_rng(8)


def r_squared(u, X):
    design = np.column_stack([np.ones(len(u)), X])
    left = u - design @ np.linalg.lstsq(design, u, rcond=None)[0]
    return 1 - left.var() / u.var()


def test_one_input_gives_the_multiple_correlation(rng):
    X = rng.normal(size=(400, 6)) + 1e4
    u = X[:, 0] - 2 * X[:, 3] + rng.normal(size=400)
    found = Linear(u, X).cca()
    expected = r_squared(u, X)
    assert found.values.shape == (1,)
    assert found.values[0] ** 2 == pytest.approx(expected, abs=1e-12)
    assert found.adjusted[0] == pytest.approx(1 - (1 - expected) * 399 / 393, abs=1e-12)
    assert found.p_values[0] == pytest.approx(1 / 200, rel=0.2)
    assert found.rank == 6
    assert "R^2 = 0.015" in found.notes[0]


def test_weights_make_the_variates(rng):
    U = rng.normal(size=(500, 2)) * [1.0, 50.0]
    X = U @ rng.normal(size=(2, 5)) + rng.normal(size=(500, 5))
    X = np.column_stack([X, np.full(500, 3.0)])
    found = Linear(U, X).cca()
    a = (U - U.mean(0)) @ found.input_weights
    b = (X - X.mean(0))[:, :5] @ found.channel_weights[:5]
    both = np.corrcoef(np.column_stack([a, b]).T)
    np.testing.assert_allclose(np.diag(both[:2, 2:]), found.values, atol=1e-12)
    np.testing.assert_allclose(both[:2, 2:] - np.diag(found.values), 0.0, atol=1e-12)
    np.testing.assert_allclose(both[:2, :2], np.eye(2), atol=1e-12)
    np.testing.assert_allclose(a.std(0), 1.0)
    np.testing.assert_allclose(b.std(0), 1.0)
    assert np.all(np.diff(found.values) < 0)
    assert np.isnan(found.channel_weights[5]).all()
    assert found.dropped == ("x5",)
    assert np.isnan(found.adjusted).all()


def test_scikit_learn(rng):
    from sklearn.cross_decomposition import CCA

    U = rng.normal(size=(300, 2))
    X = U @ rng.normal(size=(2, 4)) + rng.normal(size=(300, 4))
    peer = CCA(n_components=2, max_iter=5000, tol=1e-12).fit(X, U)
    a, b = peer.transform(X, U)
    expected = [np.corrcoef(a[:, k], b[:, k])[0, 1] for k in range(2)]
    np.testing.assert_allclose(Linear(U, X).cca().values, expected, atol=1e-6)


def test_unrelated_channels_reach_what_the_remark_says(rng):
    n, n_channels = 200, 20
    found = [
        Linear(rng.normal(size=n), rng.normal(size=(n, n_channels))).cca(n_surrogates=19)
        for _ in range(60)
    ]
    squares = np.array([f.values[0] ** 2 for f in found])
    # A beta variable with mean r/(T - 1); three standard errors.
    assert squares.mean() == pytest.approx(n_channels / (n - 1), abs=3 * squares.std() / 60**0.5)
    assert np.mean([f.adjusted[0] for f in found]) == pytest.approx(0.0, abs=0.02)
    assert np.mean([f.p_values[0] <= 0.05 for f in found]) < 0.15


def test_repeated_channels_change_nothing(rng):
    X = rng.normal(size=(300, 3))
    u = X.sum(axis=1) + rng.normal(size=300)
    once, twice = Linear(u, X).cca(), Linear(u, np.hstack([X, X])).cca()
    assert twice.rank == 3
    assert twice.values[0] == pytest.approx(once.values[0], abs=1e-12)
    np.testing.assert_allclose(twice.channel_weights[:3], once.channel_weights / 2, atol=1e-12)


def test_as_many_channels_as_rows(rng):
    with pytest.raises(TaskError, match=r"span 29 directions in 30 rows\n.*fits exactly"):
        Linear(rng.normal(size=30), rng.normal(size=(30, 40))).cca()


def test_only_cca_takes_several_inputs(rng):
    lin = Linear(rng.normal(size=(50, 2)), rng.normal(size=(50, 3)))
    assert lin.cca().values.shape == (2,)
    with pytest.raises(TaskError, match=r"u: the input has 2 columns\n.*\n.*u\[:, 0\]"):
        _ = lin.pearson
