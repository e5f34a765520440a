"""Delay recall and parity."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from openprc.analysis.tasks import DelayRecallTask, ParityTask
from openprc.errors import TaskError


def test_recall_by_hand():
    series = DelayRecallTask([0, 2]).target([[1.0, 10.0], [2.0, 20.0], [3.0, 30.0], [4.0, 40.0]])
    assert series.n_warmup == 2
    assert series.values[2:].tolist() == [[3, 30, 1, 10], [4, 40, 2, 20]]
    assert np.isnan(series.values[:2]).all()
    assert series.names == ("u0(k-0)", "u1(k-0)", "u0(k-2)", "u1(k-2)")


def test_recall_tells_its_delays():
    assert DelayRecallTask(3).name == "delay3"
    assert DelayRecallTask(3).formula == "y(k) = u(k-3)"
    assert DelayRecallTask(range(1, 21)).name == "delay1-20"
    assert DelayRecallTask(np.array([0, 1])).formula == "y(k) = u(k); y(k) = u(k-1)"


def test_xor_truth_table():
    bits = [0, 0, 1, 1, 0]
    assert ParityTask(2).target(bits).values[1:, 0].tolist() == [1, -1, 1, -1]
    assert ParityTask(2, delay=1).target(bits).values[2:, 0].tolist() == [1, -1, 1]


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_parity_counts_the_lower_symbols(n):
    """The product is -1 exactly where the number of -1 is odd, over every word of n symbols."""
    for word in itertools.product([-1.0, 1.0], repeat=n):
        # Two more symbols in front, so that both values occur in every input.
        u = [-1.0, 1.0, *word]
        expected = 1.0 if word.count(-1.0) % 2 == 0 else -1.0
        assert ParityTask(n).target(u).values[-1, 0] == expected


@settings(max_examples=50, deadline=None)
@given(
    n=st.integers(1, 5),
    delay=st.integers(0, 4),
    seed=st.integers(0, 999),
    low=st.floats(-5, 0),
    span=st.floats(0.01, 5),
)
def test_parity_for_any_two_values(n, delay, seed, low, span):
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], 60)
    signs[:2] = -1.0, 1.0
    series = ParityTask(n, delay=delay).target(low + span * (signs > 0))
    assert series.n_warmup == n + delay - 1
    for k in range(series.n_warmup, 60):
        product = np.prod([signs[k - i] for i in range(delay, delay + n)])
        assert series.values[k, 0] == product


def test_xor_is_uncorrelated_with_every_past_symbol():
    u = np.random.default_rng(2).choice([-1.0, 1.0], 20_000)
    y = ParityTask(2).target(u).values[10:, 0]
    for delay in range(5):
        assert abs(np.mean(y * u[10 - delay : len(u) - delay])) < 4 / np.sqrt(len(y))


@pytest.mark.parametrize(
    ("delays", "words"),
    [
        (-1, "delays is -1\n.*from 0 on"),
        (1.5, "delays is 1.5"),
        ([], "the delays are \\[\\]"),
        ([1, 1], "each once"),
    ],
)
def test_wrong_delays(delays, words):
    with pytest.raises(TaskError, match=words):
        DelayRecallTask(delays)


def test_wrong_parities():
    with pytest.raises(TaskError, match="n is 0"):
        ParityTask(0)
    with pytest.raises(TaskError, match="delay is -1"):
        ParityTask(2, delay=-1)


@pytest.mark.parametrize(
    ("task", "u", "words"),
    [
        (DelayRecallTask(3), [1.0, 2.0, 3.0], "3 symbols and the task leaves 3"),
        (DelayRecallTask(), [1.0, np.inf], "1 of 2 input symbols are NaN or infinite"),
        (DelayRecallTask(), [], "shape \\(0,\\)"),
        (DelayRecallTask(), np.zeros((2, 2, 2)), "\\(K,\\) or \\(K, C\\)"),
        (ParityTask(), [0.0, 1.0, 2.0], "the input takes 3 values"),
        (ParityTask(), [1.0, 1.0, 1.0], "the input takes 1 values"),
        (ParityTask(), np.zeros((4, 2)), "expected: \\(K,\\) or \\(K, 1\\)"),
        (ParityTask(3), [0.0, 1.0], "2 symbols and the task leaves 2"),
    ],
)
def test_wrong_inputs(task, u, words):
    with pytest.raises(TaskError, match=words):
        task.target(u)
