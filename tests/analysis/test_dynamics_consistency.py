"""Consistency: closed forms of identical, noisy and unrelated replicas."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from openprc.analysis.dynamics import consistency
from openprc.errors import TaskError
from openprc.reservoir.networks import EchoStateNetwork

T = 20_000


def mixed(rng, n_rows=T, n=6):
    """Return correlated states of very different variances."""
    return rng.normal(size=(n_rows, n)) * 10.0 ** -np.arange(n) @ rng.normal(size=(n, n))


def test_identical_replicas_have_the_rank_as_capacity():
    states = mixed(np.random.default_rng(0), 500)
    doubled = np.column_stack([states, states[:, :2]])
    found = consistency([doubled, doubled.copy()])
    np.testing.assert_allclose(found.spectrum, 1.0, atol=1e-9)
    assert found.rank == 6
    assert found.capacity == pytest.approx(6.0, abs=1e-9)
    assert found.mean_level == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(found.per_channel, 1.0, atol=1e-12)
    np.testing.assert_array_equal(found.mean_shift, 0.0)


@pytest.mark.parametrize("rho", [0.25, 1.0, 4.0])
@pytest.mark.parametrize("n_replicas", [2, 3])
def test_independent_noise_lowers_every_level_to_one_over_one_plus_rho(rho, n_replicas):
    rng = np.random.default_rng(1)
    common = rng.normal(size=(T, 5))
    replicas = [common + np.sqrt(rho) * rng.normal(size=common.shape) for _ in range(n_replicas)]
    found = consistency(replicas)
    assert found.capacity == pytest.approx(5.0 / (1.0 + rho), abs=0.06)
    np.testing.assert_allclose(found.spectrum, 1.0 / (1.0 + rho), atol=0.03)
    np.testing.assert_allclose(found.per_channel, 1.0 / (1.0 + rho), atol=0.02)
    np.testing.assert_allclose(found.per_component, 1.0 / (1.0 + rho), atol=0.02)
    assert found.mean_level == pytest.approx(1.0 / (1.0 + rho), abs=0.01)


def test_the_spectrum_tells_directions_of_different_noise_apart_however_they_are_mixed():
    rng = np.random.default_rng(2)
    common, rho = rng.normal(size=(T, 4)), np.array([0.0, 0.25, 1.0, 9.0])
    mixing = rng.normal(size=(4, 4))
    replicas = [(common + np.sqrt(rho) * rng.normal(size=common.shape)) @ mixing for _ in range(2)]
    found = consistency(replicas)
    np.testing.assert_allclose(found.spectrum, 1.0 / (1.0 + rho), atol=0.02)
    scale = np.sqrt(np.mean([rows.var(axis=0) for rows in replicas], axis=0))
    best = [rows / scale @ found.directions[:, 0] for rows in replicas]
    assert np.corrcoef(best[0], best[1])[0, 1] == pytest.approx(1.0, abs=1e-6)


def test_unrelated_replicas_have_no_capacity_on_average():
    rng = np.random.default_rng(3)
    capacities = [consistency(rng.normal(size=(2, 400, 8))).capacity for _ in range(40)]
    assert np.mean(capacities) == pytest.approx(0.0, abs=0.1)
    assert min(consistency(rng.normal(size=(2, 400, 8))).spectrum) < 0.0


def test_a_network_forgets_and_a_chaotic_one_does_not():
    u = np.random.default_rng(4).uniform(-1, 1, 800)
    start = np.random.default_rng(5).normal(size=60)
    levels = []
    for radius in (0.8, 2.5):
        network = EchoStateNetwork(60, spectral_radius=radius, input_scaling=0.1, seed=5)
        replicas = [network.drive(u)[200:], network.drive(u, initial=start)[200:]]
        levels.append(consistency(replicas).mean_level)
    assert levels[0] == pytest.approx(1.0, abs=1e-9)
    assert levels[1] < 0.3


def test_means_are_compared_apart_from_the_rest():
    states = np.random.default_rng(7).normal(size=(300, 3))
    found = consistency([states, states + np.array([0.0, 5.0, 0.0])])
    assert found.capacity == pytest.approx(3.0, abs=1e-9)
    np.testing.assert_allclose(found.mean_shift, [0.0, 5.0 / states[:, 1].std(), 0.0], atol=1e-9)


def test_constant_columns_are_named_and_left_out():
    states = np.random.default_rng(8).normal(size=(300, 3))
    states[:, 1] = 4.2
    found = consistency([states, states])
    assert found.constant == (1,)
    assert found.rank == 2


def test_relative_cut_leaves_faint_directions_out():
    rng = np.random.default_rng(9)
    states = np.repeat(rng.normal(size=(500, 1)), 3, axis=1)
    noisy = [states + 1e-3 * rng.normal(size=states.shape) for _ in range(2)]
    assert consistency(noisy).rank == 3
    found = consistency(noisy, relative=0.01)
    assert (found.rank, found.capacity) == (1, pytest.approx(1.0, abs=1e-5))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**16))
def test_units_offsets_and_order_do_not_matter(seed):
    rng = np.random.default_rng(seed)
    common = rng.normal(size=(200, 4))
    replicas = [common + 0.7 * rng.normal(size=common.shape) for _ in range(2)]
    scale, shift = rng.uniform(0.01, 100.0, 4), rng.normal(size=4) * 1e3
    reference = consistency(replicas)
    moved = consistency([rows * scale + shift for rows in reversed(replicas)])
    np.testing.assert_allclose(moved.spectrum, reference.spectrum, atol=1e-7)
    assert reference.spectrum.max() <= 1.0 + 1e-9


@pytest.mark.parametrize(
    ("replicas", "words"),
    [
        ([np.eye(4)], "there are 1 replicas"),
        ([np.zeros((9, 2)), np.zeros((8, 2))], r"2 replicas of shapes \(8, 2\), \(9, 2\)"),
        ([np.ones((9, 2)), np.zeros((9, 2))], "none of the 2 columns changes in any replica"),
        ([np.eye(4), np.eye(4)], "there are 4 rows and 4 columns"),
        ([np.eye(4), np.full((4, 4), np.nan)], "4 of 4 rows of replica 1 hold NaN"),
    ],
)
def test_what_cannot_be_compared_is_refused(replicas, words):
    with pytest.raises(TaskError, match=words):
        consistency(replicas)
