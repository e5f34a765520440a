import warnings

import numpy as np
import pytest
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.utils.estimator_checks import parametrize_with_checks

from openprc.errors import TaskError
from openprc.reservoir.readout.fitting import fit_readout
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.readout.temporal_ridge import TemporalRidgeCV, forgetting_lag
from openprc.reservoir.training.cross_validation import (
    Fold,
    choose_regularization,
    temporal_folds,
)

PENALTIES = np.array([0.0, 1e-6, 1e-2, 1.0, 100.0, 1e4])


@parametrize_with_checks([TemporalRidgeCV()])
def test_scikit_learn_conventions(estimator, check):
    with warnings.catch_warnings():
        # The checks warn about the data that they make up.
        warnings.simplefilter("ignore")
        check(estimator)


def body(n=600, n_states=12, *, seed=0):
    """Return correlated states about 100 and two noisy targets."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(n, n_states)) @ rng.normal(size=(n_states, n_states)) + 100.0
    return states, states @ rng.normal(size=(n_states, 2)) + 3.0 * rng.normal(size=(n, 2))


@pytest.mark.parametrize("scheme", ["blocked", "forward"])
@pytest.mark.parametrize("standardize", [True, False])
@pytest.mark.parametrize("gap", [0, 7, 100])
def test_exactly_what_refitting_gives(scheme, standardize, gap):
    states, target = body()
    cv = choose_regularization(
        states, target, gap=gap, penalties=PENALTIES, n_folds=3, scheme=scheme,
        standardize=standardize,
    )  # fmt: skip
    tested = np.concatenate([np.arange(f.test.start, f.test.stop) for f in cv.folds])
    variance = target[tested].var(axis=0)
    total = np.zeros((len(PENALTIES), 2))
    for k, fold in enumerate(cv.folds):
        train = fold.train(600)
        mean, scale = states[train].mean(axis=0), states[train].std(axis=0)
        if not standardize:
            mean, scale = np.zeros(12), np.ones(12)
        for p, penalty in enumerate(PENALTIES):
            model = SklearnRidge(penalty, solver="svd")
            model.fit((states[train] - mean) / scale, target[train])
            predicted = model.predict((states[fold.test] - mean) / scale)
            squares = (predicted - target[fold.test]) ** 2
            np.testing.assert_allclose(
                cv.fold_nmse[k, p], squares.mean(axis=0) / variance, rtol=1e-10
            )
            total[p] += squares.sum(axis=0)
    np.testing.assert_allclose(cv.nmse, total / len(tested) / variance, rtol=1e-10)
    np.testing.assert_array_equal(cv.best, PENALTIES[cv.nmse.argmin(axis=0)])


@pytest.mark.parametrize("gap", [0, 1, 10])
def test_no_training_row_within_the_gap_of_a_tested_one(gap):
    rows = np.sort(np.random.default_rng(1).choice(500, 400, replace=False))
    for fold in temporal_folds(rows, n_folds=5, gap=gap):
        distance = np.abs(rows[fold.train(400)][:, None] - rows[fold.test]).min(axis=1)
        assert distance.min() > gap
        left_out = np.setdiff1d(np.arange(400), [*fold.train(400), *range(400)[fold.test]])
        nearest = np.abs(rows[left_out][:, None] - rows[fold.test]).min(axis=1)
        assert nearest.max(initial=0) <= gap
    tested = [k for fold in temporal_folds(rows, n_folds=5, gap=gap) for k in range(400)[fold.test]]
    assert tested == list(range(400))


def test_forward_folds_never_train_on_what_comes_later():
    folds = temporal_folds(np.arange(100), n_folds=4, gap=3, scheme="forward")
    assert folds == tuple(
        Fold(slice(start, start + 20), before=start - 3, after=100) for start in (20, 40, 60, 80)
    )


def test_shuffled_folds_prefer_too_small_a_penalty():
    """Slow states and noise as slow: next to a tested row there is always a trained one."""
    rng = np.random.default_rng(2)
    noise = rng.normal(size=(1500, 41))
    slow = np.empty_like(noise)
    slow[0] = noise[0]
    for k in range(1, 1500):
        slow[k] = 0.98 * slow[k - 1] + noise[k]
    states, target = slow[:, :40], slow[:, 40]
    penalties = 10.0 ** np.arange(-3, 6)
    in_time = choose_regularization(states[:1000], target[:1000], gap=100, penalties=penalties)
    order = rng.permutation(1000)
    shuffled = choose_regularization(states[order], target[order], gap=0, penalties=penalties)
    assert in_time.best[0] > 10.0 * shuffled.best[0]
    later = [
        np.mean((Ridge(float(p)).fit(states[:1000], target[:1000]).predict(states[1100:])
                 - target[1100:]) ** 2)
        for p in (in_time.best[0], shuffled.best[0])
    ]  # fmt: skip
    assert later[0] < later[1]


def test_a_readout_that_chooses_its_penalty():
    states, target = body(seed=3)
    fitted = fit_readout(TemporalRidgeCV(PENALTIES, gap=5), states, target)
    chosen = fitted.estimator
    cv = choose_regularization(states, target, gap=5, penalties=PENALTIES)
    assert chosen.regularization_ == cv.best_overall
    same = fit_readout(Ridge(chosen.regularization_), states, target)
    np.testing.assert_allclose(fitted.weights, same.weights, rtol=1e-9)
    np.testing.assert_allclose(fitted.bias, same.bias, rtol=1e-12)
    each = fit_readout(TemporalRidgeCV(PENALTIES, gap=5, per_output=True), states, target)
    np.testing.assert_array_equal(each.estimator.regularization_, cv.best)


def test_the_gap_counts_rows_that_were_not_measured():
    states, target = body(seed=4)
    kept = np.delete(np.arange(600), np.arange(195, 215))
    fitted = fit_readout(
        TemporalRidgeCV(gap=10, n_folds=3), states, target[kept], rows=kept
    ).estimator
    first = fitted.cv_.folds[0]
    last_tested = kept[first.test.stop - 1]
    assert kept[first.after] > last_tested + 10
    assert kept[first.after - 1] <= last_tested + 10


def test_how_long_a_target_is_remembered():
    rng = np.random.default_rng(5)
    white = rng.normal(size=(20_000, 1))
    assert forgetting_lag(white) == 1
    moving = np.convolve(white[:, 0], np.ones(10), mode="valid")[:, None]
    # The autocorrelation of a mean of ten falls as 1 - lag / 10: to 0.1 at lag 9.
    assert forgetting_lag(moving) in (9, 10)
    assert forgetting_lag(np.zeros((50, 1))) == 1
    states = rng.normal(size=(len(moving), 2))
    assert TemporalRidgeCV().fit(states, moving).gap_ in (9, 10)


def test_a_best_penalty_at_the_edge_is_told():
    states, target = body()
    assert choose_regularization(states, target, gap=0, penalties=[1e3, 1e4]).at_edge
    assert not choose_regularization(states, target, gap=0, penalties=[1e-6, 1.0, 1e6]).at_edge


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"gap": 0, "scheme": "random"}, "scheme is 'random'"),
        ({"gap": 0, "n_folds": 1}, "n_folds is 1 and gap is 0"),
        ({"gap": -1}, "n_folds is 5 and gap is -1"),
        ({"gap": 100}, "60 rows in 5 folds with gaps of 100 leave nothing to train on"),
        ({"gap": 0, "penalties": [-1.0]}, r"penalties are \[-1.0\]"),
    ],
)
def test_impossible_folds(keywords, words):
    states, target = body(60)
    with pytest.raises(TaskError, match=words):
        choose_regularization(states, target, **keywords)


def test_states_and_target_belong_together():
    with pytest.raises(TaskError, match=r"states have shape \(10, 2\) and the target has \(9,\)"):
        choose_regularization(np.zeros((10, 2)), np.zeros(9), gap=0)
