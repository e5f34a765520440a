"""What chance does to capacities, and the thresholds that answer it."""

import numpy as np
import pytest
from scipy import stats

from openprc.analysis.capacity import information_processing_capacity, memory_capacity
from openprc.analysis.capacity.thresholds import (
    beta_threshold,
    chance_p_values,
    chance_quantile,
    corrected_sum,
)
from openprc.errors import TaskError
from openprc.reservoir.training.row_split import RowSplit


def autoregressive(rng, shape, coefficient):
    noise = rng.normal(size=shape)
    for k in range(1, shape[0]):
        noise[k] += coefficient * noise[k - 1]
    return noise


@pytest.mark.parametrize(("n", "coefficient"), [(30, 0.0), (60, 0.95), (100, 0.95)])
def test_chance_is_beta_distributed_even_for_slow_states(n, coefficient):
    rng = np.random.default_rng(n)
    states = autoregressive(rng, (500, n), coefficient)
    draws = []
    for _ in range(8):
        # Inputs that the body never saw, each for itself.
        found = memory_capacity(
            states, rng.uniform(-1, 1, (500, 500)), max_delay=0, coloured="ignore"
        )
        draws.append(found.raw)
    law = stats.beta(n / 2, (500 - 1 - n) / 2)
    assert stats.kstest(np.concatenate(draws), law.cdf).pvalue > 1e-3
    assert found.metadata["chance_mean"] == pytest.approx(law.mean())


def test_quantile_is_that_of_scipy_stats():
    for probability in (0.5, 1e-3, 1e-7):
        law = stats.beta(25, (3000 - 1 - 50) / 2)
        found = chance_quantile(probability, rank=50, n_rows=3000)
        assert found == pytest.approx(law.isf(probability), rel=1e-9)
        p = chance_p_values(np.array([found]), rank=50, n_rows=3000)
        assert p[0] == pytest.approx(probability, rel=1e-6)
    # The largest of 200 shuffles of Kubota et al. 2021 for 50 states over 3000 rows.
    assert 0.0263 <= chance_quantile(1 / 200, rank=50, n_rows=3000) <= 0.0275


def test_false_positives_come_as_often_as_asked_for():
    """One run in ten may count a capacity of chance at alpha = 0.1; 60 runs: below 15."""
    rng = np.random.default_rng(2)
    wrong = 0
    for _ in range(60):
        states, u = rng.normal(size=(600, 20)), rng.uniform(-1, 1, 600)
        found = information_processing_capacity(
            states, u, delays={1: 20, 2: 10}, alpha=0.1, coloured="ignore"
        )
        wrong += found.n_significant > 0
    assert 0 < wrong < 15


def test_false_discovery_rate_finds_more_than_bonferroni():
    rng = np.random.default_rng(3)
    chance = stats.beta(10, 490).rvs(900, random_state=rng)
    held = np.full(100, chance_quantile(2e-5, rank=20, n_rows=1001))
    capacities = np.concatenate([chance, held])
    how = {"rank": 20, "n_rows": 1001, "alpha": 0.01}
    strict = beta_threshold(capacities, **how)
    fdr = beta_threshold(capacities, correction="benjamini-hochberg", **how)
    alone = beta_threshold(capacities, correction="none", **how)
    assert alone < fdr < strict
    assert np.count_nonzero(capacities > strict) <= 2
    assert 100 <= np.count_nonzero(capacities > fdr) <= 104
    p = chance_p_values(capacities, rank=20, n_rows=1001)
    accepted = stats.false_discovery_control(p) <= 0.01
    np.testing.assert_array_equal(capacities > fdr, accepted)
    nothing = beta_threshold(chance, correction="benjamini-hochberg", **how)
    assert nothing == pytest.approx(beta_threshold(chance, **how))


def test_the_corrected_sum_has_no_bias():
    """A 10-tap line and 390 targets that it does not hold, over a few hundred rows."""
    rng = np.random.default_rng(4)
    sums = []
    for _ in range(40):
        u = rng.uniform(-1, 1, 400)
        states = np.stack([np.roll(u, k) for k in range(10)], axis=1)
        found = memory_capacity(states, u, max_delay=99, washout=100, coloured="ignore")
        assert found.raw_total > 11
        assert found.corrected_total == pytest.approx(corrected_sum(found.raw, rank=10, n_rows=300))
        sums.append(found.corrected_total)
    assert np.mean(sums) == pytest.approx(10, abs=4 * np.std(sums) / np.sqrt(40))


def test_surrogates_agree_with_the_beta_distribution_for_a_white_input():
    rng = np.random.default_rng(5)
    u = rng.uniform(-1, 1, 1500)
    states = np.stack([np.roll(u, k) for k in range(15)], axis=1) + rng.normal(size=(1500, 15))
    budget = {"delays": {1: 30}, "washout": 30, "alpha": 0.05, "n_surrogates": 99}
    exact = information_processing_capacity(states, u, **budget)
    for kind in ("circular", "shuffle"):
        found = information_processing_capacity(states, u, null=kind, **budget)
        assert found.thresholds[0] == pytest.approx(exact.thresholds[0], rel=0.15)
        assert f"99 {kind} surrogates" in found.metadata["threshold_rule"]
        again = information_processing_capacity(states, u, null=kind, **budget)
        np.testing.assert_array_equal(found.thresholds, again.thresholds)


def test_held_out_chance_is_negative_on_average():
    rng = np.random.default_rng(6)
    states = rng.normal(size=(1400, 30))
    split = RowSplit(washout=100, train=1000, test=300)
    draws = []
    for _ in range(30):
        u = rng.uniform(-1, 1, 1400)
        found = memory_capacity(
            states, u, max_delay=100, split=split, estimator="heldout", coloured="ignore",
            alpha=0.01, correction="none",
        )  # fmt: skip
        draws.append(found.raw)
    draws = np.concatenate(draws)
    assert found.metadata["chance_mean"] == pytest.approx(draws.mean(), abs=2e-3)
    assert -0.05 < draws.mean() < -0.03
    above = np.mean(draws > found.thresholds[0])
    assert above == pytest.approx(0.01, abs=0.006)
    # The rule of the paper, 2 chi2.isf(1e-4, 30) / 300, is twenty times as much.
    assert found.thresholds[0] < 0.02 < 2 * stats.chi2.isf(1e-4, 30) / 300 / 10


def test_held_out_capacities_are_those_of_one_ridge_after_the_other():
    sklearn_ridge = pytest.importorskip("sklearn.linear_model").Ridge
    rng = np.random.default_rng(7)
    u = rng.uniform(-1, 1, 1200)
    states = np.stack([np.roll(u, k) for k in range(6)], axis=1) ** 3
    states += 0.1 * rng.normal(size=states.shape) + 5.0
    split = RowSplit(washout=20, train=700, test=400, gap=30)
    for ridge in (0.0, 1e-6, 0.1):
        found = memory_capacity(
            states, u, max_delay=10, split=split, estimator="heldout", ridge=ridge
        )
        train, test = split.train_rows, split.test_rows
        scaled = (states - states[train].mean(axis=0)) / states[train].std(axis=0)
        for k in range(11):
            z = np.roll(u, k)
            model = sklearn_ridge(ridge * 700).fit(scaled[train], z[train])
            assert found.raw[k] == pytest.approx(model.score(scaled[test], z[test]), abs=1e-9)


def test_copies_of_states_do_not_upset_held_out_capacities():
    rng = np.random.default_rng(8)
    u = rng.uniform(-1, 1, 1200)
    states = np.stack([np.roll(u, k) for k in range(6)], axis=1)
    split = RowSplit(washout=20, train=700, test=400)
    for ridge in (0.0, 1e-6):
        found = memory_capacity(
            np.hstack([states, states]), u, max_delay=10, split=split, estimator="heldout",
            ridge=ridge,
        )  # fmt: skip
        assert found.rank == 6
        np.testing.assert_allclose(found.raw[:6], 1.0, atol=1e-9)


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"alpha": 0.0}, "alpha is 0.0"),
        ({"correction": "holm"}, "the correction is 'holm'"),
        ({"null": "gauss"}, "null is 'gauss'\n.*beta or circular or shuffle"),
        ({"null": "circular", "n_surrogates": 50}, "50 surrogates cannot resolve a level of 0.01"),
        ({"null": "circular", "n_surrogates": 600}, "circular shifts of at least 20 rows"),
        ({"estimator": "heldout"}, "a held-out capacity was asked for without a split"),
        ({"eps": np.nan}, "eps is nan"),
        (
            {"estimator": "heldout", "correction": "benjamini-hochberg"},
            "held-out capacities and a false discovery rate",
        ),
        ({"dtype": np.int64}, "dtype is int64"),
        ({"blas_threads": 0}, "blas_threads is 0"),
        (
            {"estimator": "heldout", "orthonormalize": "exact"},
            "exactly orthonormal targets and held-out scores",
        ),
        ({"estimator": "heldout", "ridge": -1.0, "split": RowSplit(10, 300, 200)}, "ridge is -1.0"),
    ],
)
def test_wrong_choices(choices, words):
    rng = np.random.default_rng(9)
    u = rng.uniform(-1, 1, 600)
    with pytest.raises(TaskError, match=words):
        memory_capacity(rng.normal(size=(600, 4)), u, max_delay=10, **choices)


def test_given_thresholds_are_used_as_they_are():
    rng = np.random.default_rng(10)
    u = rng.uniform(-1, 1, 600)
    states = np.stack([u, rng.normal(size=600)], axis=1)
    found = memory_capacity(states, u, max_delay=5, eps=0.5)
    assert found.thresholds.tolist() == [0.5] * 6
    assert found.metadata["threshold_rule"] == "eps = 0.5, as given"
    with pytest.warns(UserWarning, match="eps is 1.075, and no capacity exceeds 1"):
        memory_capacity(
            states, u, max_delay=5, eps=1.075, estimator="heldout", split=RowSplit(10, 300, 200)
        )
