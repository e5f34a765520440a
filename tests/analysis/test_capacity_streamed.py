"""Capacities of states that are read in blocks."""

import tracemalloc

import numpy as np
import pytest

from openprc.analysis.capacity import (
    CapacityWarning,
    information_processing_capacity,
    information_processing_capacity_streamed,
)
from openprc.errors import TaskError


def body(u, rows):
    """Return states of chosen rows: taps, their squares and a constant offset."""
    lags = np.stack([u[rows - k] for k in range(8)], axis=1)
    return np.hstack([lags, lags[:, :4] ** 2]) + 100.0


@pytest.mark.parametrize("length", [1, 997, 20000])
def test_blocks_of_any_length_give_the_same(length):
    rng = np.random.default_rng(1)
    n = 1500 if length == 1 else 12000
    u = rng.uniform(-1, 1, n)
    states = body(u, np.arange(n)) + rng.normal(size=(n, 12)) * 0.2
    budget = {"delays": {1: 20, 2: 12, 3: 3}, "washout": 30}
    whole = information_processing_capacity(states, u, **budget)
    blocks = (states[start : start + length] for start in range(0, n, length))
    found = information_processing_capacity_streamed(blocks, u, **budget)
    np.testing.assert_allclose(found.raw, whole.raw, atol=1e-10)
    assert (found.rank, found.n_rows) == (whole.rank, whole.n_rows)
    np.testing.assert_allclose(found.thresholds, whole.thresholds)
    assert found.metadata["method"] == "gram"
    single = information_processing_capacity_streamed([states], u, dtype=np.float32, **budget)
    assert 0 < np.abs(single.raw - whole.raw).max() < 1e-4


def test_copies_and_constants_are_seen():
    rng = np.random.default_rng(2)
    u = rng.uniform(-1, 1, 3000)
    states = body(u, np.arange(3000))
    spoilt = np.hstack([states, states[:, :5], np.full((3000, 1), 7.0)])
    found = information_processing_capacity_streamed(
        [spoilt[:1000], spoilt[1000:]], u, delays={1: 20, 2: 12}, washout=30
    )
    assert found.rank == 12
    assert found.metadata["n_constant_states"] == 1
    assert found.total == pytest.approx(12, abs=0.01)


def test_memory_is_bounded_by_a_block():
    rng = np.random.default_rng(3)
    n, n_states, length = 200_000, 60, 5000
    u = rng.uniform(-1, 1, n)

    def blocks():
        for start in range(0, n, length):
            rows = np.arange(start, start + length)
            yield np.stack([u[rows - k] for k in range(n_states)], axis=1)

    tracemalloc.start()
    found = information_processing_capacity_streamed(
        blocks(), u, delays={1: 80, 2: 10}, washout=100, coloured="ignore"
    )
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.linear == pytest.approx(n_states, abs=1e-6)
    whole = n * n_states * 8
    assert peak < whole / 3


def test_what_blocks_may_not_be():
    rng = np.random.default_rng(4)
    u = rng.uniform(-1, 1, 500)
    states = rng.normal(size=(500, 3))
    how = {"delays": {1: 5}, "coloured": "ignore"}
    streamed = information_processing_capacity_streamed
    with pytest.raises(TaskError, match="the blocks hold 400 rows and the input 500"):
        streamed([states[:400]], u, **how)
    with pytest.raises(TaskError, match="the blocks hold at least 900 rows and the input 500"):
        streamed([states, states[:400], states], u, **how)
    with pytest.raises(TaskError, match=r"a block has shape \(100, 2\)\n.*\(n, 3\)"):
        streamed([states[:400], states[400:, :2]], u, **how)
    spoilt = states.copy()
    spoilt[300, 1] = np.nan
    with pytest.raises(TaskError, match="1 rows of the states are NaN"):
        streamed([spoilt], u, **how)
    with pytest.raises(TaskError, match="none of the 3 states changes"):
        streamed([np.ones((500, 3))], u, **how)
    with pytest.raises(TaskError, match="washout and delays take 499 of 500 rows"):
        streamed([states], u, delays={1: 5}, washout=499)
    with pytest.raises(TaskError, match='coloured is "adapt" and the states are read once'):
        streamed([states], u, delays={1: 5}, coloured="adapt")
    with pytest.raises(TaskError, match=r"autocorrelation 0\.9"):
        streamed([states], np.cumsum(u), delays={1: 5})
    with pytest.raises(TaskError, match="neither delays nor terms were given"):
        streamed([states], u)


def test_an_excess_is_reported():
    u = np.random.default_rng(5).exponential(size=2000)
    with pytest.warns(CapacityWarning, match="linear readouts of 1 independent"):
        information_processing_capacity_streamed(
            [u[:, None]], u, delays=dict.fromkeys(range(1, 5), 0), basis="legendre",
            excess="report",
        )  # fmt: skip
