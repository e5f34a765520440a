"""The channel term by term, its noise, and that it can be undone."""

import math

import numpy as np
import pytest

from openprc.analysis.tasks import ChannelEqualizationTask
from openprc.errors import TaskError


def test_channel_term_by_term():
    d = np.random.default_rng(0).choice([-3.0, -1.0, 1.0, 3.0], 40)
    u = ChannelEqualizationTask().channel(d)
    assert len(u) == 31
    for k in range(31):
        at = {lag: d[k + 7 + lag] for lag in range(-7, 3)}
        q = (
            0.08 * at[2] - 0.12 * at[1] + at[0] + 0.18 * at[-1] - 0.1 * at[-2]
            + 0.091 * at[-3] - 0.05 * at[-4] + 0.04 * at[-5] + 0.03 * at[-6] + 0.01 * at[-7]
        )  # fmt: skip
        assert u[k] == pytest.approx(q + 0.036 * q**2 - 0.011 * q**3, abs=1e-12)


@pytest.mark.parametrize("delay", [0, 2, 7, 12])
def test_target_is_the_symbol_sent_delay_rows_ago(delay):
    task = ChannelEqualizationTask(snr=math.inf, delay=delay, quadratic=0.0, cubic=0.0)
    data = task.generate(400, rng=1)
    assert set(np.unique(data.target.values)) == {-3.0, -1.0, 1.0, 3.0}
    assert data.target.usable.all()
    sent = data.target.values[:, 0]
    # d(k) stands in row k + delay of the target; the channel then is a sum of shifted targets.
    taps = (0.08, -0.12, 1.0, 0.18, -0.1, 0.091, -0.05, 0.04, 0.03, 0.01)
    k = np.arange(20, 380)
    rebuilt = sum(w * sent[k + lag + delay] for w, lag in zip(taps, range(2, -8, -1), strict=True))
    np.testing.assert_allclose(data.input[k, 0], rebuilt, atol=1e-12)


def linear_equaliser(data, n_taps, train):
    u, d = data.input[:, 0], data.target.values
    x = np.stack([u[n_taps - 1 - lag : len(u) - lag] for lag in range(n_taps)], axis=1)
    d = d[n_taps - 1 :]
    weights = np.linalg.lstsq(x[:train], d[:train], rcond=None)[0]
    return d[train:], x[train:] @ weights


@pytest.mark.parametrize(
    ("delay", "n_taps", "error"), [(2, 30, 0.2), (6, 30, 2e-3), (10, 60, 1e-5)]
)
def test_a_linear_channel_without_noise_is_undone_by_taps(delay, n_taps, error):
    """The inverse filter is infinite both ways: delay and taps say where it is cut."""
    task = ChannelEqualizationTask(snr=math.inf, delay=delay, quadratic=0.0, cubic=0.0)
    sent, got = linear_equaliser(task.generate(6000, rng=2), n_taps, 3000)
    assert task.score(sent, got)[0] == 0.0
    assert np.abs(got - sent).max() < error


def test_symbol_errors_grow_with_noise():
    rates = []
    for snr in (28.0, 16.0, 12.0):
        task = ChannelEqualizationTask(snr=snr)
        sent, got = linear_equaliser(task.generate(9000, rng=3), 15, 3000)
        rates.append(task.score(sent, got)[0])
    assert 0.0 < rates[0] < rates[1] < rates[2] < 0.3


@pytest.mark.parametrize("snr", [12.0, 20.0, 32.0])
def test_signal_to_noise_ratio(snr):
    clean = ChannelEqualizationTask(snr=math.inf).generate(20_000, rng=4).input
    noisy = ChannelEqualizationTask(snr=snr).generate(20_000, rng=4)
    noise = noisy.input - clean
    assert 10 * np.log10(np.mean(clean**2) / noise.var()) == pytest.approx(snr, abs=0.1)
    assert noisy.metadata["noise_std"] == pytest.approx(noise.std(), rel=0.02)


def test_the_same_data_from_the_seed():
    task = ChannelEqualizationTask()
    data = task.generate(100, rng=7)
    assert task.generate(100, rng=data.seed).target_for(0.01 * data.input) is not None
    with pytest.raises(TaskError, match="not the input of this task"):
        task.generate(100, rng=8).target_for(data.input)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"snr": math.nan}, "signal-to-noise ratio is nan"),
        ({"snr": -math.inf}, "signal-to-noise ratio is -inf"),
        ({"delay": -1}, "delay is -1"),
    ],
)
def test_wrong_parameters(parameters, words):
    with pytest.raises(TaskError, match=words):
        ChannelEqualizationTask(**parameters)


def test_wrong_length():
    with pytest.raises(TaskError, match="n is 0"):
        ChannelEqualizationTask().generate(0, rng=0)
