"""Recursive least squares: ridge row by row, weighted least squares, digits and long runs."""

import warnings

import numpy as np
import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from openprc.errors import TaskError
from openprc.reservoir import Channels, Ridge, StateLoader, Trainer
from openprc.reservoir.readout.rls import RLS
from openprc.reservoir.readout.saved import Readout
from openprc.reservoir.readout.triangular import LEAST_BLOCK, TriangularFactor


def rows_of(model, x, y, sizes):
    """Learn in blocks of the given sizes, again and again until the rows are used up."""
    start, turn = 0, 0
    while start < len(x):
        stop = start + sizes[turn % len(sizes)]
        model.partial_fit(x[start:stop], y[start:stop])
        start, turn = stop, turn + 1
    return model


@pytest.fixture
def data():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(400, 12)) + 3.0
    return x, x @ rng.normal(size=(12, 2)) - 5.0 + 0.3 * rng.normal(size=(400, 2))


@parametrize_with_checks([RLS(), RLS(1e-3, forgetting=0.999)])
def test_scikit_learn_conventions(estimator, check):
    with warnings.catch_warnings():
        # The checks warn about the data that they make up.
        warnings.simplefilter("ignore")
        check(estimator)


@pytest.mark.parametrize("sizes", [(400,), (1,), (7,), (1, 50, 3)])
def test_without_forgetting_it_is_ridge(data, sizes):
    x, y = data
    ridge, own = Ridge(2.5).fit(x, y), rows_of(RLS(2.5), x, y, sizes)
    np.testing.assert_allclose(own.coef_, ridge.coef_, rtol=0, atol=1e-8)
    np.testing.assert_allclose(own.intercept_, ridge.intercept_, rtol=0, atol=1e-8)
    np.testing.assert_allclose(own.predict(x), ridge.predict(x), rtol=0, atol=1e-8)
    assert own.n_samples_seen_ == 400


@pytest.mark.parametrize("sizes", [(1,), (64,)])
def test_forgetting_is_weighted_least_squares(data, sizes):
    x, y = data
    weight = np.sqrt(0.97 ** np.arange(399, -1, -1.0))[:, np.newaxis]
    columns = np.hstack([np.ones((400, 1)), x])
    expected = np.linalg.lstsq(weight * columns, weight * y, rcond=None)[0]
    own = rows_of(RLS(1e-9, forgetting=0.97), x, y, sizes)
    np.testing.assert_allclose(own.coef_.T, expected[1:], rtol=0, atol=1e-7)
    np.testing.assert_allclose(own.intercept_, expected[0], rtol=0, atol=1e-7)


@pytest.mark.parametrize("forgetting", [1.0, 0.999, 0.9, 0.3])
def test_blocks_are_their_rows(data, forgetting):
    x, y = data
    one, other = TriangularFactor(12, 2, penalty=0.1, forgetting=forgetting), None
    for row, target in zip(x, y, strict=True):
        one.add_row(row, target)
    other = TriangularFactor(12, 2, penalty=0.1, forgetting=forgetting)
    for part in (slice(0, 5), slice(5, 5 + LEAST_BLOCK), slice(5 + LEAST_BLOCK, 400)):
        other.add_rows(x[part], y[part])
    np.testing.assert_allclose(other.root.T @ other.root, one.root.T @ one.root, rtol=1e-10)
    np.testing.assert_allclose(other.solution(), one.solution(), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("sizes", [(1000,), (1,)])
def test_the_bias_is_learned_with_the_weights(sizes):
    """A bias from a running mean beside the weights is 12.14 here instead of 12."""
    x = np.random.default_rng(1).normal(size=(1000, 5))
    own = rows_of(RLS(1e-6), x, x @ np.arange(5.0) + 12.0, sizes)
    assert own.intercept_ == pytest.approx(12.0, abs=1e-6)
    assert isinstance(own.intercept_, float)


@pytest.mark.parametrize("sizes", [(1000,), (1,)])
def test_small_motion_about_a_large_offset(sizes):
    rng = np.random.default_rng(2)
    z = rng.normal(size=(1000, 8))
    y = z @ rng.normal(size=8)
    own = rows_of(RLS(1e-9), z + 1e6, y, sizes)
    error = np.sqrt(np.mean((own.predict(z + 1e6) - y) ** 2)) / y.std()
    assert error < 1e-6


def test_a_long_run_with_dead_columns_stays_positive_definite():
    """Half of the columns fall silent; the covariance of textbook RLS winds up beyond 1e300."""
    rng = np.random.default_rng(3)
    factor = TriangularFactor(6, 1, penalty=1e-2, forgetting=0.98)
    weights = np.arange(1.0, 7.0)
    for _ in range(100):
        x = rng.normal(size=(1000, 6))
        x[:, 3:] = 0.0
        factor.add_rows(x, (x @ weights)[:, np.newaxis])
    assert factor.n_rows == 100_000
    information = factor.root.T @ factor.root
    eigenvalues = np.linalg.eigvalsh(information)
    assert eigenvalues.min() == pytest.approx(1e-2, rel=0.1)
    assert eigenvalues.max() < 100.0  # about 1 / (1 - forgetting)
    solution = factor.solution()[1:, 0]
    np.testing.assert_allclose(solution[:3], [1, 2, 3], rtol=1e-3)
    np.testing.assert_allclose(solution[3:], 0.0, atol=1e-12)


def test_single_rows_over_a_long_run():
    rng = np.random.default_rng(4)
    factor = TriangularFactor(4, 1, penalty=1e-6, forgetting=0.999)
    weights, x = np.array([1.0, -2.0, 0.5, 3.0]), rng.normal(size=(100_000, 4))
    target = (x @ weights + 7.0)[:, np.newaxis]
    for row, y in zip(x, target, strict=True):
        factor.add_row(row, y)
    assert (np.diag(factor.root) > 0.0).all()
    np.testing.assert_allclose(factor.solution()[:, 0], [7.0, *weights], atol=1e-7)


def test_forgetting_follows_a_change():
    rng = np.random.default_rng(5)
    x = rng.normal(size=(2000, 3))
    y = np.where(np.arange(2000) < 1000, x @ [1.0, 1.0, 1.0], x @ [-1.0, 2.0, 0.0] + 4.0)
    follower, other = RLS(forgetting=0.98).fit(x, y), RLS().fit(x, y)
    np.testing.assert_allclose(follower.coef_, [-1.0, 2.0, 0.0], atol=1e-6)
    assert np.abs(other.coef_ - [-1.0, 2.0, 0.0]).max() > 0.5


def test_the_trainer_stores_its_weights(delay_line, tmp_path):
    loader = StateLoader(delay_line)
    trainer = Trainer(
        Channels("taps"),
        RLS(1e-8),
        loader=loader,
        washout=1.0,
        train_duration=9.0,
        test_duration=4.0,
        experiment_dir=tmp_path,
    )
    target = np.random.default_rng(7).uniform(-1.0, 1.0, 300)  # the file's symbols
    result = trainer.train(np.roll(target, 3), "recall")
    saved = Readout.load(result.save())
    states = trainer.states.values
    np.testing.assert_allclose(saved.predict(states)[20:, 0], np.roll(target, 3)[20:], atol=1e-6)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"regularization": 0.0}, "regularization of 0.0"),
        ({"regularization": float("nan")}, "regularization of nan"),
        ({"forgetting": 1.5}, "forgetting factor of 1.5"),
        ({"forgetting": 0.0}, "1 - 1/n for a memory of n rows"),
    ],
)
def test_parameters_without_a_solution(settings, words, data):
    with pytest.raises(TaskError, match=words):
        RLS(**settings).fit(*data)


def test_another_number_of_targets(data):
    x, y = data
    with pytest.raises(TaskError, match="a target with 1 columns") as failure:
        RLS().fit(x, y).partial_fit(x, y[:, 0])
    assert "call fit" in str(failure.value)


def test_missing_values_are_refused(data):
    x, y = data
    model = RLS().fit(x, y)
    with pytest.raises(ValueError, match="NaN"):
        model.partial_fit(np.full((1, 12), np.nan), y[:1])
