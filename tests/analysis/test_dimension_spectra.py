"""Ranks and spectra of state matrices whose correlation matrix is known exactly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import hadamard

from openprc.analysis.dimension import (
    condition_number,
    constant_columns,
    effective_rank,
    explained_variance,
    numerical_rank,
    participation_ratio,
    state_spectrum,
)
from openprc.errors import TaskError


def states_with(correlation, *, n_rows=64, seed=0):
    """Return (n_rows, N) states whose sample correlation matrix is `correlation`."""
    correlation = np.asarray(correlation, dtype=float)
    noise = np.random.default_rng(seed).normal(size=(n_rows, len(correlation)))
    white, _ = np.linalg.qr(noise - noise.mean(axis=0))
    white -= white.mean(axis=0)
    white, _ = np.linalg.qr(white)
    return white @ np.linalg.cholesky(correlation).T * 3.0


def equicorrelated(n, r):
    return np.full((n, n), r) + (1.0 - r) * np.eye(n)


@pytest.mark.parametrize(
    ("correlation", "eigenvalues", "singular"),
    [
        (np.eye(8), 8.0, 8.0),
        (equicorrelated(2, 0.6), 1.649385, 1.889882),
        (equicorrelated(10, 0.5), 5.348894, 8.918225),
    ],
    ids=["white", "pair of 0.6", "ten of 0.5"],
)
def test_effective_rank_of_known_correlations(correlation, eigenvalues, singular):
    states = states_with(correlation)
    assert effective_rank(states) == pytest.approx(eigenvalues, abs=1e-6)
    assert effective_rank(states, spectrum="singular") == pytest.approx(singular, abs=1e-6)


def test_hadamard_columns_are_all_independent():
    states = hadamard(32)[:, 1:17].astype(float)
    for spectrum in ("eigenvalues", "singular"):
        assert effective_rank(states, spectrum=spectrum) == pytest.approx(16.0, abs=1e-9)
    assert condition_number(states) == pytest.approx(1.0, abs=1e-9)
    assert participation_ratio(states) == pytest.approx(16.0, abs=1e-9)


def test_copies_add_no_rank():
    states = np.repeat(states_with(np.eye(4)), 3, axis=1)
    assert effective_rank(states) == pytest.approx(4.0, abs=1e-6)
    assert effective_rank(states, spectrum="singular") == pytest.approx(4.0, abs=1e-6)
    assert numerical_rank(states) == 4
    assert participation_ratio(states) == pytest.approx(4.0, abs=1e-9)


def test_white_noise_falls_short_of_its_number_of_columns():
    states = np.random.default_rng(0).normal(size=(1000, 50))
    assert effective_rank(states) == pytest.approx(48.83, abs=0.1)
    assert effective_rank(states, spectrum="singular") == pytest.approx(49.70, abs=0.1)


@pytest.mark.parametrize("r", [0.6, 0.999, 1.0 - 1e-9])
def test_condition_number_of_a_pair(r):
    """Eigenvalues 1 + r and 1 - r."""
    states = states_with(equicorrelated(2, r))
    assert condition_number(states) == pytest.approx((1 + r) / (1 - r), rel=1e-6)


def test_exact_duplicates_make_the_condition_infinite():
    states = states_with(np.eye(3))
    assert condition_number(np.column_stack([states, states[:, 1]])) == np.inf
    assert condition_number(states[:3]) == np.inf, "three centred rows span two directions"


@pytest.mark.parametrize("offset", [0.0, 1.0, 1e6])
def test_affine_copies_are_recognised_at_any_offset(offset):
    states = states_with(np.eye(3), seed=4) + offset
    copied = np.column_stack([states, 3.3 * states[:, 0] + 7.1])
    assert numerical_rank(copied) == 3
    assert condition_number(copied) == np.inf


def test_an_offset_of_a_million_standard_deviations_changes_nothing():
    states = states_with(equicorrelated(6, 0.5), n_rows=500)
    states /= states.std()
    far = states + 1e6
    assert effective_rank(far) == pytest.approx(effective_rank(states), rel=1e-9)
    assert condition_number(far) == pytest.approx(condition_number(states), rel=1e-8)
    assert numerical_rank(far) == 6


def test_single_precision_copies_are_recognised_by_their_own_rounding():
    states = (states_with(np.eye(3), n_rows=200) + 1.0).astype(np.float32)
    copied = np.column_stack([states, np.float32(1.7) * states[:, 0]])
    assert copied.dtype == np.float32
    assert numerical_rank(copied) == 3


def test_constant_columns_are_left_out_and_named():
    states = states_with(np.eye(3))
    padded = np.column_stack([np.full(64, 0.3), states, np.zeros(64)])
    spectrum = state_spectrum(padded)
    assert spectrum.constant == (0, 4)
    assert spectrum.n_columns == 5
    assert spectrum.n_changing == 3
    np.testing.assert_array_equal(constant_columns(padded), [0, 4])
    assert spectrum.condition_number == pytest.approx(1.0, abs=1e-9)
    assert spectrum.effective_rank() == pytest.approx(3.0, abs=1e-9)


def test_relative_cut():
    states = states_with(np.eye(3)) * [1.0, 0.1, 0.001]
    assert numerical_rank(states, standardize=False) == 3
    assert numerical_rank(states, standardize=False, relative=0.01) == 2
    assert numerical_rank(states, standardize=False, relative=0.5) == 1
    assert numerical_rank(states, relative=0.5) == 3, "standardised columns are alike"


def test_explained_variance_of_known_variances():
    states = states_with(np.eye(4))
    states *= np.sqrt([80.0, 12.0, 6.0, 2.0]) / states.std(axis=0)
    found = explained_variance(states, standardize=False)
    np.testing.assert_allclose(found.variance, [80, 12, 6, 2], rtol=1e-9)
    np.testing.assert_allclose(found.ratio, [0.80, 0.12, 0.06, 0.02], atol=1e-12)
    np.testing.assert_allclose(found.cumulative, [0.80, 0.92, 0.98, 1.0], atol=1e-12)
    assert (found.n_90, found.n_95, found.n_99) == (2, 3, 4)
    assert found.n_components(0.80) == 1, "a share that is met exactly is met"
    assert found.n_components(1.0) == 4


def test_explained_variance_of_the_correlation_matrix_with_too_few_rows():
    states = np.random.default_rng(3).normal(size=(5, 9))
    found = explained_variance(states)
    assert found.variance.shape == (9,)
    assert found.variance.sum() == pytest.approx(9.0)
    np.testing.assert_allclose(found.variance[4:], 0.0, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**16), n=st.integers(1, 8), copies=st.integers(0, 4))
def test_ranks_are_ordered(seed, n, copies):
    """1 <= eigenvalue form <= singular form <= numerical rank, and scales do not matter."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(60, n)) @ rng.normal(size=(n, n)) + rng.normal(size=n)
    states = np.column_stack([states, states[:, rng.integers(0, n, copies)]])
    rank = numerical_rank(states)
    eigen, singular = effective_rank(states), effective_rank(states, spectrum="singular")
    assert rank <= n
    assert 1.0 - 1e-9 <= participation_ratio(states) <= eigen + 1e-9
    # Copies leave singular values at rounding level, whose entropy is as small as they are.
    assert eigen <= singular + 1e-9 <= rank + 1e-6
    scaled = states * rng.uniform(0.1, 10.0, states.shape[1])
    assert effective_rank(scaled) == pytest.approx(eigen, rel=1e-9)


@pytest.mark.parametrize(
    ("states", "words"),
    [
        (np.zeros(4), r"states has shape \(4,\)"),
        (np.zeros((1, 3)), "at least two rows"),
        (np.zeros((5, 2)), "none of the 2 columns changes"),
        (np.array([[1.0, 2.0], [np.nan, 3.0], [0.0, 1.0]]), "1 of 3 rows of states hold NaN"),
    ],
)
def test_what_is_no_state_matrix_is_refused(states, words):
    with pytest.raises(TaskError, match=words):
        effective_rank(states)


def test_unknown_choices_are_refused():
    states = states_with(np.eye(3))
    with pytest.raises(TaskError, match=r"spectrum is 'both'"):
        effective_rank(states, spectrum="both")
    with pytest.raises(TaskError, match=r"relative cut is 1\.0"):
        numerical_rank(states, relative=1.0)
    with pytest.raises(TaskError, match="share is 95"):
        explained_variance(states).n_components(95)
