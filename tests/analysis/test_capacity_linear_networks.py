"""Linear networks, whose capacities have a closed form, and a tanh network."""

import numpy as np
import pytest

from openprc.analysis.capacity import (
    information_processing_capacity,
    linear_network_memory,
    memory_capacity,
)
from openprc.errors import TaskError


def orthogonal(n, seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(n, n)))[0]


def driven(recurrent, into, u, function=lambda x: x):
    states = np.empty((len(u), len(into)))
    x = np.zeros(len(into))
    for k, value in enumerate(u):
        x = function(recurrent @ x + into * value)
        states[k] = x
    return states


@pytest.mark.parametrize(
    ("n", "radius", "present"), [(20, 0.9, 0.98522), (50, 0.95, 0.99408), (100, 0.98, 0.98241)]
)
def test_an_orthogonal_network_in_closed_form(n, radius, present):
    """C_0 = 1 - radius^2N, and all capacities together are N."""
    into = np.random.default_rng(n).normal(size=n)
    c = linear_network_memory(radius * orthogonal(n, n), into, max_delay=3000)
    assert c[0] == pytest.approx(1 - radius ** (2 * n), abs=1e-6)
    assert c[0] == pytest.approx(present, abs=5e-6)
    assert c.sum() == pytest.approx(n, abs=1e-6)
    assert c[1:].sum() == pytest.approx(n - c[0], abs=1e-6)


def test_a_ring_in_closed_form():
    n, radius = 20, 0.9
    ring = radius * np.roll(np.eye(n), 1, axis=0)
    k = np.arange(101)
    expected = radius ** (2 * n * (k // n)) * (1 - radius ** (2 * n))
    c = linear_network_memory(ring, np.eye(n)[0], max_delay=100)
    np.testing.assert_allclose(c, expected, atol=1e-12)


@pytest.mark.parametrize("ring", [False, True])
def test_measured_as_in_closed_form(ring):
    n, radius, most = 20, 0.9, 120
    rng = np.random.default_rng(5)
    recurrent = radius * (np.roll(np.eye(n), 1, axis=0) if ring else orthogonal(n, 5))
    into = np.eye(n)[0] if ring else rng.normal(size=n)
    u = rng.uniform(-1, 1, 20300)
    found = memory_capacity(driven(recurrent, into, u), u, max_delay=most, washout=300)
    expected = linear_network_memory(recurrent, into, max_delay=most)
    np.testing.assert_allclose(found.raw, expected, atol=0.01)
    assert found.linear == pytest.approx(n, rel=0.006)
    assert found.memory_capacity == pytest.approx(n - expected[0], rel=0.006)


def test_sensor_noise_lowers_the_closed_form():
    """Without recurrence the only memory is of the present: C_0 = 1 / (1 + s^2)."""
    c = linear_network_memory([[0.0]], [1.0], max_delay=3, sensor_noise=2.0)
    np.testing.assert_allclose(c, [0.2, 0, 0, 0], atol=1e-15)
    into = np.random.default_rng(0).normal(size=50)
    into *= np.sqrt(50) / np.linalg.norm(into)
    network = 0.95 * orthogonal(50, 1)
    totals = [
        linear_network_memory(network, into, max_delay=400, sensor_noise=noise).sum()
        for noise in (0.0, 0.01, 0.1, 1.0)
    ]
    assert totals[0] == pytest.approx(50, abs=1e-6)
    assert np.all(np.diff(totals) < 0)


def test_networks_that_do_not_forget_are_refused():
    with pytest.raises(TaskError, match="the spectral radius is 1"):
        linear_network_memory(np.eye(2), [1.0, 1.0], max_delay=3)
    with pytest.raises(TaskError, match=r"shape \(2, 2\) and the input weights \(3,\)"):
        linear_network_memory(np.eye(2), [1.0, 1.0, 1.0], max_delay=3)


@pytest.fixture(scope="module")
def network():
    rng = np.random.default_rng(12)
    weights = rng.normal(size=(30, 30))
    weights *= 0.9 / np.abs(np.linalg.eigvals(weights)).max()
    into = rng.uniform(-1, 1, 30)
    u = rng.uniform(-1, 1, 10200)
    return driven(weights, into, u, lambda x: np.tanh(x + 0.1)), u


def test_a_tanh_network_holds_no_more_than_its_rank(network):
    states, u = network
    budget = {"delays": {1: 40, 2: 20, 3: 10}, "washout": 200}
    found = information_processing_capacity(states, u, **budget)
    assert found.rank == 30
    assert 20 < found.total <= 30
    assert found.total == pytest.approx(found.corrected_total, abs=1.5)
    assert set(found.by_degree()) == {1, 2, 3}
    assert sum(found.by_degree().values()) == pytest.approx(found.total)
    assert found.linear + found.nonlinear == pytest.approx(found.total)
    exact = information_processing_capacity(states, u, orthonormalize="exact", **budget)
    assert exact.raw_total <= 30 + 1e-9
    assert exact.total == pytest.approx(found.total, rel=0.05)


def test_exactly_orthonormal_targets_sum_to_the_rank_at_most(network):
    """So many targets that they nearly fill the space: then the sum nearly is the rank."""
    states, u = network
    budget = {"delays": {1: 40, 2: 20, 3: 10}, "washout": 200}
    found = information_processing_capacity(
        states[:800], u[:800], orthonormalize="exact", excess="report", **budget
    )
    assert len(found.terms) > 550
    assert 29 < found.raw_total <= 30 + 1e-9
    with pytest.raises(TaskError, match="558 targets over 500 rows"):
        information_processing_capacity(states[:700], u[:700], orthonormalize="exact", **budget)
