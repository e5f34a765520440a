"""Ranks, condition and groups of channels against closed forms."""

import numpy as np
import pytest
from scipy.linalg import hadamard

from openprc.analysis.correlation import Redundancy
from openprc.errors import TaskError

#: 64 rows, 63 columns: orthogonal, centred, equal variance.
ORTHOGONAL = hadamard(64)[:, 1:].astype(float)


def correlated(correlation, rows=ORTHOGONAL):
    """States whose sample correlation is exactly as given."""
    return rows[:, : len(correlation)] @ np.linalg.cholesky(np.asarray(correlation)).T


def equicorrelated(r, n):
    return np.full((n, n), r) + (1 - r) * np.eye(n)


@pytest.mark.parametrize(
    ("states", "eigenvalues", "singular"),
    [
        (ORTHOGONAL[:, :8], 8.0, 8.0),
        (ORTHOGONAL[:, :16], 16.0, 16.0),
        (np.repeat(ORTHOGONAL[:, :4], 3, axis=1), 4.0, 4.0),
        (correlated(equicorrelated(0.6, 2)), 1.649385, 1.889882),
        (correlated(equicorrelated(0.5, 10)), 5.348894, 8.918225),
    ],
    ids=["8 alike", "16 alike", "4 groups of 3", "r = 0.6", "all r = 0.5"],
)
def test_effective_rank(states, eigenvalues, singular):
    found = Redundancy(3.0 * states + 7.0)
    assert found.rank == pytest.approx(eigenvalues, abs=1e-6)
    assert found.effective_rank(spectrum="eigenvalues") == found.rank
    assert found.effective_rank(spectrum="singular") == pytest.approx(singular, abs=1e-6)


def test_effective_rank_of_noise():
    found = Redundancy(np.random.default_rng(0).normal(size=(1000, 50)))
    assert found.rank == pytest.approx(48.83, abs=0.1)
    assert found.effective_rank(spectrum="singular") == pytest.approx(49.70, abs=0.1)


def test_condition_number():
    # Of equal correlations r: 1 + (n - 1) r and 1 - r.
    found = Redundancy(correlated(equicorrelated(0.5, 10)))
    assert found.condition == pytest.approx(5.5 / 0.5, rel=1e-9)
    np.testing.assert_allclose(found.eigenvalues, [5.5] + 9 * [0.5], rtol=1e-9)
    assert found.numerical_rank == 10


def test_duplicates_have_no_condition_number():
    found = Redundancy(np.column_stack([ORTHOGONAL[:, :3], 1e-3 * ORTHOGONAL[:, 0] + 5]))
    assert found.condition == np.inf
    assert found.numerical_rank == 3
    assert Redundancy(ORTHOGONAL[:, :3]).condition == pytest.approx(1.0)


def test_constant_channels_are_named_and_count_nowhere():
    states = np.column_stack([ORTHOGONAL[:, :2], np.full(64, 0.1 + 0.2)])
    found = Redundancy(states, names=["a", "b", "clamped"])
    assert found.dropped == ("clamped",)
    assert found.rank == pytest.approx(2.0)
    assert found.condition == pytest.approx(1.0)
    assert found.groups_named() == [["a"], ["b"]]
    assert np.isnan(found.correlation["clamped"]).all()
    assert found.correlation.dropped == ("clamped",)


def test_groups_are_chains():
    # a-b and b-c correlate at 0.9, a-c at 0.81 only: single linkage joins all three.
    chain = 0.9 ** np.abs(np.subtract.outer(np.arange(3), np.arange(3)))
    whole = np.eye(5)
    whole[1:4, 1:4] = chain
    found = Redundancy(correlated(whole) * [1, 1, -2, 1, 1], names=list("pabcq"))
    assert found.groups(0.85) == [[1, 2, 3], [0], [4]]
    assert found.groups_named(threshold=0.85) == [["a", "b", "c"], ["p"], ["q"]]
    assert found.groups(0.9) == found.groups(0.85)
    assert found.groups(0.91) == [[0], [1], [2], [3], [4]]
    # The middle one is closest to both others.
    assert found.representatives(0.85) == [0, 2, 4]
    assert found.groups(0.0) == [[0, 1, 2, 3, 4]]


def test_one_representative_a_group_lowers_the_condition_number():
    rng = np.random.default_rng(1)
    states = np.repeat(ORTHOGONAL[:, :4], 3, axis=1) + 0.01 * rng.normal(size=(64, 12))
    found = Redundancy(states)
    kept = found.representatives(0.95)
    assert [k // 3 for k in kept] == [0, 1, 2, 3]
    assert found.condition > 1e4
    assert Redundancy(states[:, kept]).condition < 1.2


def test_correlation_matrix():
    rng = np.random.default_rng(2)
    states = rng.normal(size=(200, 4))
    states[:, 1] += states[:, 0]
    found = Redundancy(states).correlation
    np.testing.assert_allclose(found.values, np.corrcoef(states.T), atol=1e-12)
    assert np.isnan(np.diag(found.p_values)).all()
    expected = np.zeros((4, 4), dtype=bool)
    expected[0, 1] = expected[1, 0] = True
    np.testing.assert_array_equal(found.significant(correction="bonferroni"), expected)


def test_one_channel():
    found = Redundancy(np.arange(20.0), names=["only"])
    assert found.groups_named() == [["only"]]
    assert found.rank == 1.0
    with pytest.raises(TaskError, match="a single channel that changes"):
        found.dendrogram()


@pytest.mark.parametrize("threshold", [-0.1, 1.5])
def test_thresholds_out_of_range(threshold):
    for method in ("groups", "representatives", "dendrogram"):
        with pytest.raises(TaskError, match=rf"the threshold is {threshold}\n.*from 0 to 1"):
            getattr(Redundancy(ORTHOGONAL[:, :3]), method)(threshold)


def test_nothing_changes():
    with pytest.raises(TaskError, match="Y: none of the 2 channels changes"):
        Redundancy(np.ones((20, 2)))
