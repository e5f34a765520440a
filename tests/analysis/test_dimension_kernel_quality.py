"""Kernel and generalisation rank: exact on a delay line, bounds on a network."""

import numpy as np
import pytest

from openprc.analysis.dimension.rank_tests import final_states, kernel_quality, kernel_rank
from openprc.analysis.dimension.recorded_kernel_quality import (
    recorded_generalisation_rank,
    recorded_kernel_rank,
)
from openprc.errors import TaskError
from openprc.reservoir.networks import DelayLine, EchoStateNetwork, LinearNetwork

N, M = 20, 60


class Stepped:
    """A body that can only be stepped."""

    def __init__(self, network):
        self.network, self.n_states = network, network.n_states

    def reset(self):
        self.network.reset()

    def step(self, u):
        return self.network.step(u)


@pytest.mark.parametrize(("common", "rank"), [(1, 20), (5, 16), (10, 11), (19, 2), (20, 1)])
def test_a_delay_line_has_ranks_in_closed_form(common, rank):
    """Rank N, and N - k + 1 once the last k inputs agree: what is common is one direction."""
    found = kernel_quality(DelayLine(N), n_streams=M, length=40, common=common, seed=0)
    assert found.kernel.numerical == N
    assert found.generalisation.numerical == rank
    assert found.computational_power == N - rank
    assert found.similarity == f"the last {common} of 40 symbols agree"


def test_without_the_mean_what_is_common_is_no_direction():
    found = kernel_quality(DelayLine(N), n_streams=M, length=40, common=5, centre=True, seed=0)
    assert (found.kernel.numerical, found.generalisation.numerical) == (N, N - 5)


def test_jitter_does_not_lower_the_numerical_rank_and_does_lower_the_relative_one():
    found = kernel_quality(DelayLine(N), n_streams=M, length=40, jitter=1e-4, seed=0)
    assert (found.generalisation.numerical, found.generalisation.relative) == (N, 1)
    assert found.kernel.relative == N
    assert found.relative_computational_power == N - 1


def test_a_body_that_can_only_be_stepped_gives_the_same_states():
    network = EchoStateNetwork(12, input_scaling=0.5, bias_scaling=0.2, seed=4)
    streams = np.random.default_rng(1).uniform(-1, 1, (5, 30))
    np.testing.assert_allclose(
        final_states(Stepped(network), streams), final_states(network, streams), atol=1e-14
    )


def test_a_forgetting_network_has_full_kernel_rank_and_less_generalisation_rank():
    network = EchoStateNetwork(30, spectral_radius=0.6, input_scaling=0.5, seed=2)
    found = kernel_quality(network, n_streams=90, length=120, common=60, seed=3)
    assert found.kernel.numerical == 30
    assert found.generalisation.relative == 1
    assert found.generalisation.numerical < 30


def test_rank_rules():
    states = np.diag([1.0, 0.5, 0.009, 1e-20])
    found = kernel_rank(states)
    assert (found.numerical, found.relative, found.cut) == (3, 2, 0.01)
    np.testing.assert_allclose(found.singular_values, [1.0, 0.5, 0.009, 1e-20])
    assert kernel_rank(states, cut=0.6).relative == 1


def test_an_offset_is_a_direction_unless_it_is_taken_off():
    states = np.random.default_rng(0).normal(size=(50, 4)) * 1e-3 + 7.0
    assert kernel_rank(states).relative == 1
    assert kernel_rank(states, centre=True).relative == 4
    assert kernel_rank(np.full((6, 3), 0.1), centre=True).numerical == 0


def test_the_kernel_rank_can_be_had_from_one_recording():
    u = np.random.default_rng(0).uniform(-1, 1, 4000)
    found = recorded_kernel_rank(DelayLine(N).drive(u)[N:], memory=N)
    assert (found.rank.numerical, found.n_streams, found.saturated) == (N, 199, False)
    assert found.remark == ""


def test_too_short_a_recording_says_that_its_rank_is_a_bound():
    u = np.random.default_rng(0).uniform(-1, 1, 300)
    found = recorded_kernel_rank(DelayLine(N).drive(u)[N:], memory=N)
    assert found.saturated
    assert found.rank.numerical == found.n_streams == 14
    assert "a lower bound; record for longer" in found.remark


@pytest.mark.parametrize("common", [1, 3, 5])
def test_the_generalisation_rank_can_be_had_from_a_recording_under_bits(common):
    n = 8
    bits = np.random.default_rng(5).choice([-1.0, 1.0], 6000)
    states = DelayLine(n).drive(bits)[n:]
    found = recorded_generalisation_rank(states, bits[n:], common=common)
    assert found.rank.numerical == n - common + 1
    assert found.n_streams > 6000 / 2**common / 2


def test_continuous_inputs_have_no_generalisation_rank_from_one_recording():
    u = np.random.default_rng(0).uniform(-1, 1, 500)
    with pytest.raises(TaskError, match="no 2 symbols in a row occur twice among 500"):
        recorded_generalisation_rank(DelayLine(4).drive(u), u, common=2)


def test_full_kernel_rank_of_an_orthogonal_network():
    found = kernel_quality(LinearNetwork(15, seed=1), n_streams=45, length=200, common=3, seed=2)
    assert found.kernel.numerical == 15
    assert found.generalisation.numerical == 15, "a long memory sees beyond the common end"


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "neither common nor jitter"),
        ({"common": 2, "jitter": 0.1}, "both common and jitter"),
        ({"common": 41}, "common is 41 and a stream has 40 symbols"),
        ({"jitter": -1.0}, r"jitter is -1\.0"),
        ({"common": 2, "low": 1.0}, r"the range is \[1\.0, 1\.0\]"),
        ({"common": 2, "cut": 2.0}, r"the relative cut is 2\.0"),
    ],
)
def test_what_makes_no_sense_is_refused(settings, words):
    with pytest.raises(TaskError, match=words):
        kernel_quality(DelayLine(N), n_streams=M, length=40, seed=0, **settings)


def test_recordings_that_do_not_fit_are_refused():
    states = np.random.default_rng(0).normal(size=(10, 3))
    with pytest.raises(TaskError, match="memory is 10 and there are 10 rows"):
        recorded_kernel_rank(states, memory=10)
    with pytest.raises(TaskError, match="there are 10 rows and 9 symbols"):
        recorded_generalisation_rank(states, np.zeros(9), common=1)
    with pytest.raises(TaskError, match=r"streams has shape \(4,\)"):
        final_states(DelayLine(3), np.zeros(4))
