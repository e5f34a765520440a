"""Small echo state networks have the NARMA scores that such networks are known for.

Settings are those that a search over four spectral radii and four input scalings ends at; see
benchmarks/echo_state_reference.py, which also scores larger networks.
"""

from functools import cache

import numpy as np
import pytest

from openprc.analysis.tasks.imitation import NARMA_task
from openprc.reservoir.networks import EchoStateNetwork, reference_network
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.evaluation import evaluate
from openprc.reservoir.training.row_split import RowSplit

SPLIT = RowSplit(washout=200, train=2000, test=2000)
#: Nodes, order, spectral radius, input scaling; NRMSE that is known, and its standard deviation.
KNOWN = [
    (50, 2, 0.8, 0.1, 0.108, 0.036),
    (50, 5, 0.8, 0.1, 0.168, 0.027),
    (50, 10, 0.99, 0.01, 0.379, 0.037),
    (50, 20, 0.99, 0.01, 0.432, 0.048),
    (100, 2, 0.8, 0.3, 0.060, 0.010),
    (100, 5, 0.8, 0.01, 0.050, 0.012),
    (100, 10, 0.8, 0.01, 0.279, 0.053),
]


@cache
def symbols(seed):
    return np.random.default_rng([7, seed]).uniform(0.0, 0.5, SPLIT.n_rows)


def error(states, order, seed):
    target = NARMA_task(symbols(seed), order, horizon=1)[:, None]
    return evaluate(Ridge(1e-8), states, target, split=SPLIT).mean_nrmse


@pytest.mark.parametrize(("n", "order", "radius", "scaling", "known", "sd"), KNOWN)
def test_scores_are_within_two_standard_deviations_of_known_ones(
    n, order, radius, scaling, known, sd
):
    found = []
    for seed in range(3):
        network = EchoStateNetwork(
            n, spectral_radius=radius, input_scaling=scaling, bias_scaling=0.2, seed=seed
        )
        found.append(error(network.drive(symbols(seed)), order, seed))
    assert np.mean(found) == pytest.approx(known, abs=2 * sd)


def test_the_reference_beats_every_shift_register():
    """On NARMA10, a linear register of any length has 0.383 in the limit of infinite data."""
    for seed in range(3):
        assert error(reference_network(100, symbols(seed), seed=seed), 10, seed) < 0.3
