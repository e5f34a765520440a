"""Separation: closed forms of linear bodies and of classes on a line."""

import numpy as np
import pytest

from openprc.analysis.dimension.rank_tests import final_states
from openprc.analysis.dimension.separation import (
    class_separation,
    separation_profile,
    separation_ratio,
)
from openprc.errors import TaskError
from openprc.reservoir.networks import DelayLine, EchoStateNetwork, LinearNetwork


def test_separation_by_delay_is_a_power_of_the_spectral_radius():
    """An orthogonal network turns a difference and shrinks it by rho a step."""
    network = LinearNetwork(25, spectral_radius=0.8, input_scaling=0.7, seed=1)
    stream = np.random.default_rng(0).uniform(-1, 1, 60)
    found = separation_profile(network, stream, max_delay=40, difference=0.3)
    np.testing.assert_allclose(found, 0.7 * 0.8 ** np.arange(41), rtol=1e-9, atol=1e-14)


def test_a_delay_line_separates_up_to_its_length():
    found = separation_profile(DelayLine(5), np.zeros(12), max_delay=8, difference=-2.0)
    np.testing.assert_array_equal(found, [1, 1, 1, 1, 1, 0, 0, 0, 0])


def test_saturation_brings_large_inputs_closer():
    network = EchoStateNetwork(20, spectral_radius=0.5, input_scaling=1.0, seed=0)
    near, far = (
        separation_profile(network, np.full(10, level), max_delay=0, difference=0.1)[0]
        for level in (0.0, 20.0)
    )
    assert far < 0.2 * near


def test_a_delay_line_as_long_as_the_streams_keeps_all_distances():
    streams = np.random.default_rng(2).normal(size=(12, 9))
    found = separation_ratio(final_states(DelayLine(9), streams), streams)
    assert found.rms == pytest.approx(1.0, abs=1e-12)
    assert found.mean == pytest.approx(1.0, abs=1e-12)
    assert found.correlation == pytest.approx(1.0, abs=1e-12)
    assert found.n_pairs == 66


def test_ratio_of_an_orthogonal_network():
    """``E|dx|^2 / E|du|^2 = |v|^2 (1 - rho^(2L)) / ((1 - rho^2) L)`` for white input."""
    rho, length = 0.9, 30
    streams = np.random.default_rng(3).uniform(-1, 1, (400, length))
    network = LinearNetwork(60, spectral_radius=rho, seed=5)
    found = separation_ratio(final_states(network, streams), streams)
    expected = np.sqrt((1 - rho ** (2 * length)) / (1 - rho**2) / length)
    assert found.rms == pytest.approx(expected, rel=0.02)


def test_equally_distant_inputs_have_no_correlation():
    streams = np.eye(3)
    found = separation_ratio(final_states(DelayLine(2), streams), streams)
    assert not found.has_correlation
    assert np.isnan(found.correlation)


def test_separation_of_classes_on_a_line():
    """Centres 10 apart: c_d = 10 / 2 over ordered pairs; every state 1 from its centre."""
    states = np.array([[-1.0], [1.0], [9.0], [11.0]])
    assert class_separation(states, ["a", "a", "b", "b"]) == pytest.approx(5.0 / 2.0)
    assert class_separation(states, [0, 1, 0, 1]) == pytest.approx(1.0 / (5.0 + 1.0))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: class_separation(np.zeros((3, 1)), [1, 1, 1]), "and 1 classes, for 3 states"),
        (lambda: separation_ratio(np.zeros((3, 1)), np.eye(4)), "3 states and 4 streams"),
        (lambda: separation_ratio(np.eye(2), np.ones((2, 4))), "1 pairs of streams are equal"),
        (
            lambda: separation_profile(DelayLine(2), np.zeros(4), max_delay=4, difference=1.0),
            "max_delay is 4",
        ),
        (
            lambda: separation_profile(DelayLine(2), np.zeros(4), max_delay=1, difference=0.0),
            "difference is 0",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(call, words):
    with pytest.raises(TaskError, match=words):
        call()
