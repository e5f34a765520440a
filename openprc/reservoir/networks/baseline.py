"""An echo state network of the size of a body: what as many ordinary units make of the input."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.reservoir.networks.echo_state import EchoStateNetwork

#: Settings of the reference, the same for every task and every body. Of 64 combinations these
#: have the least error on average over NARMA2, 5, 10 and 20, recall of the input 15 symbols ago
#: and the product of three inputs, at 50 to 200 nodes and ridge penalties from 1e-8 to 1e-4
#: (benchmarks/echo_state_reference.py --settings). Networks tuned to one of the NARMA tasks
#: have errors that are lower by a factor of 1.1 to 2.5. The input is weak, so that the states
#: stay nearly linear in it and remember; a penalty far above 1e-4 would leave no more of them.
REFERENCE_SETTINGS = {
    "spectral_radius": 0.8,
    "input_scaling": 0.01,
    "bias_scaling": 0.2,
    "leak_rate": 1.0,
}


def reference_network(n_states: int, u: ArrayLike, *, seed: int = 0) -> NDArray[np.float64]:
    """Return the states of an echo state network that is driven by `u`, (K, n_states).

    Every column of the input is brought to zero mean and unit variance first, so that the
    reference does not depend on the unit of the drive. For a readout of standardised states
    with a ridge penalty of 1e-4 at most.

    Parameters
    ----------
    n_states : int
        Number of nodes: as many as the body has states.
    u : (K,) or (K, C)
        One row per symbol.
    seed : int

    Raises
    ------
    TaskError
        When the input does not change, or is no matrix of finite numbers.
    """
    symbols = np.asarray(u, dtype=np.float64)
    symbols = symbols[:, None] if symbols.ndim == 1 else symbols
    if symbols.ndim != 2 or not len(symbols) or not np.isfinite(symbols).all():
        raise TaskError(
            f"the input has shape {np.shape(u)}"
            + ("" if np.isfinite(symbols).all() else " and is not finite"),
            expected="(K,) or (K, C), finite numbers",
            fix="pass one row per symbol",
            key="u",
        )
    centred = symbols - symbols.mean(axis=0)
    spread = centred.std(axis=0)
    changing = spread > 1e-12 * np.abs(symbols).max(axis=0)
    if not changing.any():
        raise TaskError(
            "no column of the input changes",
            expected="an input that drives something",
            fix="check which input drove the body",
            key="u",
        )
    driving = centred[:, changing] / spread[changing]
    network = EchoStateNetwork(n_states, n_inputs=driving.shape[1], seed=seed, **REFERENCE_SETTINGS)
    return network.drive(driving)
