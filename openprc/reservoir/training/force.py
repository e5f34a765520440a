"""FORCE: a readout that learns while its own output already drives the body.

The readout corrects itself so fast, from the first rows on, that what it feeds back stays close
to the series; so the body meets during training the small errors that it will meet when it runs
freely, and the weights settle where these do not grow (Sussillo & Abbott 2009,
doi:10.1016/j.neuron.2009.07.018). A lesson can only correct the next output when the states have
changed little until then: the body has to be slow against a symbol, as a leaky network is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import Diverged, TaskError
from openprc.reservoir.features.base import ROUND_OFF
from openprc.reservoir.readout.fitting import FittedReadout
from openprc.reservoir.training.standardizer import Standardizer
from openprc.reservoir.training.teacher_forcing import (
    SteppedBody,
    as_series,
    teacher_forced_states,
)

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class ForceTraining:
    """A readout that was trained in the loop, and how it came there.

    Attributes
    ----------
    readout : FittedReadout
        For `run_closed_loop`; its estimator can go on learning.
    outputs : (K - L, O)
        What drove the body after the first L = washout + forced rows: predictions of
        ``teacher[L:]``, each made before its row was learned.
    weight_change : (K - L,)
        Norm of what each row changed in the weights, on standardised states; 0 where none was
        learned. It has to fade before the loop can be left alone.
    """

    readout: FittedReadout
    outputs: Reals
    weight_change: Reals


def force_train(
    body: SteppedBody,
    teacher: ArrayLike,
    *,
    washout: int,
    forced: int,
    readout: Any = None,
    every: int = 1,
    feedback: Callable[[Reals], Reals] | None = None,
    limit: float = 100.0,
) -> ForceTraining:
    """Train a readout in the loop, row by row.

    Parameters
    ----------
    body : SteppedBody
        Left in the state after the last row.
    teacher : (K,) or (K, O)
    washout : int
        The first rows, during which the series itself drives the body; nothing is learned.
    forced : int
        The rows after these, during which it still does, and which are learned; at least 2.
        Mean and scale of the states come from them. They should cover what recurs once: a body
        that falls silent in the loop has no states from which it could be woken.
    readout : estimator, optional
        With ``partial_fit``, ``coef_`` and ``intercept_``; a copy learns. By default
        ``RLS(1e-2)``, the penalty of which sets how boldly the first rows are learned.
    every : int
        Rows from one lesson to the next.
    feedback : callable, optional
        From outputs to symbols, such as a `openprc.reservoir.training.teacher_forcing.Feedback`.
    limit : float
        An output beyond this many times the largest of the teacher stops the training.

    Raises
    ------
    TaskError
        When the series is too short or unfit, or the readout cannot learn row by row.
    Diverged
        When the loop runs away all the same.
    """
    if washout < 0 or forced < 2 or every < 1:
        raise TaskError(
            f"washout={washout}, forced={forced}, every={every}",
            expected="at least 0, 2 and 1 rows",
            fix="correct it",
            key="washout" if washout < 0 else "forced" if forced < 2 else "every",
        )
    start = washout + forced
    series = as_series(teacher, "teacher", least=start + 2)
    learner = _learner(readout)
    warm = teacher_forced_states(body, series[:start], feedback=feedback)
    standardizer = _scaling(warm[washout:])
    x = standardizer.transform(warm[washout:])
    _learn(learner, x[:-1], series[washout + 1 : start])
    weights, bias = _weights(learner, series.shape[1])
    learned, state = series[start:], warm[-1]
    bound = limit * float(np.abs(series).max() or 1.0)
    outputs, change = np.zeros_like(learned), np.zeros(len(learned))
    for row, target in enumerate(learned):
        x = (state - standardizer.mean) / standardizer.scale
        outputs[row] = weights @ x + bias
        if not (np.abs(outputs[row]) <= bound).all():
            raise Diverged(
                f"the output is {outputs[row].tolist()} in row {start + row}, while learning",
                expected=f"outputs below {bound:.4g}",
                fix="learn more often (every=1) or more boldly (a smaller regularization)",
                key="teacher",
            )
        if row % every == 0:
            before = weights
            _learn(learner, x[np.newaxis], target[np.newaxis])
            weights, bias = _weights(learner, series.shape[1])
            change[row] = float(np.linalg.norm(weights - before))
        if row < len(learned) - 1:
            symbol = outputs[row : row + 1]
            symbol = symbol if feedback is None else feedback(symbol)
            state = body.step(symbol[0])
    fitted = FittedReadout(
        estimator=learner,
        standardizer=standardizer,
        n_outputs=series.shape[1],
        weights=weights.T.copy(),
        bias=bias,
        train_prediction=outputs,
        warnings=(),
    )
    return ForceTraining(fitted, outputs, change)


def _scaling(states: Reals) -> Standardizer:
    mean, scale = states.mean(axis=0), states.std(axis=0)
    constant = scale <= ROUND_OFF * (np.abs(mean) + scale)
    return Standardizer(mean, np.where(constant, 1.0, scale), constant)


def _learn(learner: Any, x: Reals, y: Reals) -> None:
    # A target of one column goes in flat: estimators disagree about (n, 1).
    learner.partial_fit(x, y[:, 0] if y.shape[1] == 1 else y)


def _weights(learner: Any, n_outputs: int) -> tuple[Reals, Reals]:
    """Return weights (O, F) and bias (O,)."""
    weights = np.asarray(learner.coef_, dtype=np.float64)
    return weights.reshape(n_outputs, -1), np.ravel(learner.intercept_).astype(np.float64)


def _learner(readout: Any) -> Any:
    """Return an untrained copy of the readout."""
    # scikit-learn is loaded when something is trained.
    from sklearn.base import clone

    from openprc.reservoir.readout.rls import RLS  # noqa: PLC0415  loads scikit-learn

    if readout is None:
        return RLS(1e-2)
    if isinstance(readout, type) or not callable(getattr(readout, "partial_fit", None)):
        name = readout.__name__ if isinstance(readout, type) else type(readout).__name__
        raise TaskError(
            f"the readout {name} cannot learn row by row",
            expected="an instance with partial_fit, coef_ and intercept_",
            fix="pass RLS(1e-2), or for example sklearn.linear_model.SGDRegressor()",
            key="readout",
        )
    return clone(readout)
