"""What the input alone achieves, without any body: the numbers a body has to beat."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.reservoir.readout.ridge import Ridge, penalty_of
from openprc.reservoir.training.evaluation import Evaluation, evaluate
from openprc.reservoir.training.trainer import Trainer


def tap_count(order: int) -> int:
    """Return how many input values the shift register holds for a task of this order.

    ``min(50, max(10, 5 order))``: from there on more taps do not lower the error of the NARMA
    systems noticeably.
    """
    return min(50, max(10, 5 * order))


def shift_register(u: NDArray[np.float64], n_taps: int) -> NDArray[np.float64]:
    """Return the last `n_taps` inputs as states, (K, n_taps), the newest in column 0.

    The input before the first symbol is zero, as it is for the targets.
    """
    padded = np.concatenate([np.zeros(n_taps - 1), u])
    return np.lib.stride_tricks.sliding_window_view(padded, n_taps)[:, ::-1].copy()


def input_cubic(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return u, u^2 and u^3 of the present input, (K, 3): no memory at all."""
    return np.stack([u, u**2, u**3], axis=1)


def baseline_readout(readout: Any) -> Ridge:
    """Return a ridge with the penalty of `readout`, or the default one if it is no ridge."""
    penalty = penalty_of(readout)
    return Ridge() if penalty is None else Ridge(penalty)


def evaluate_baseline(
    trainer: Trainer, states: NDArray[np.float64], target: NDArray[np.float64]
) -> Evaluation:
    """Fit and score `states` on the very rows that `trainer` uses.

    Parameters
    ----------
    states : (R, F)
    target : (R,) or (R, O)
    """
    return evaluate(
        baseline_readout(trainer.readout),
        states,
        target.reshape(len(states), -1),
        split=trainer.split,
        usable=trainer.states.usable,
    )
