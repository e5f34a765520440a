"""Fitting any scikit-learn style estimator, whatever shapes and outputs it likes."""

from __future__ import annotations

import copy
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.training.standardizer import Standardizer

# Rows on which stored weights have to reproduce the estimator before they are called linear.
_PROBE = 256


@dataclass(frozen=True)
class FittedReadout:
    """A trained readout.

    ``weights`` (F, O) and ``bias`` (O,) act on standardised states; they are None when the
    estimator is not a linear map. ``train_prediction`` is (n, O).
    """

    estimator: Any
    standardizer: Standardizer
    n_outputs: int
    weights: NDArray[np.float64] | None
    bias: NDArray[np.float64] | None
    train_prediction: NDArray[np.float64]
    warnings: tuple[str, ...]

    def predict(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return predictions, (n, O), for states (n, F)."""
        return _predict(self.estimator, self.standardizer.transform(states), self.n_outputs)


def check_readout(readout: Any) -> None:
    """Refuse what cannot serve as a readout.

    Raises
    ------
    TaskError
        When it is a class, or has no ``fit`` and ``predict``.
    """
    if isinstance(readout, type):
        raise TaskError(
            f"the readout is the class {readout.__name__}",
            expected="an instance",
            fix=f"pass {readout.__name__}()",
            key="readout",
        )
    if not (
        callable(getattr(readout, "fit", None)) and callable(getattr(readout, "predict", None))
    ):
        raise TaskError(
            f"the readout is a {type(readout).__name__} without fit and predict",
            expected="a scikit-learn style estimator",
            fix="pass Ridge(1e-6), or any estimator with fit(X, y) and predict(X)",
            key="readout",
        )


def fit_readout(
    readout: Any,
    states: NDArray[np.float64],
    target: NDArray[np.float64],
    *,
    standardize: bool = True,
) -> FittedReadout:
    """Fit a copy of `readout`; the object itself is left as it was.

    Parameters
    ----------
    states : (n, F) float64
        Training rows only: mean and scale are taken from them.
    target : (n, O) float64
    standardize : bool
        Bring every column to zero mean and unit variance first.

    Raises
    ------
    TaskError
        When `readout` is no estimator.
    """
    check_readout(readout)
    n_outputs = target.shape[1]
    standardizer, x = Standardizer.fit_transform(states, scaled=standardize)
    estimator = _multi_output(_clone(readout), n_outputs)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        # A target of one column goes in flat: estimators disagree about (n, 1).
        estimator.fit(x, target[:, 0] if n_outputs == 1 else target)
    notes = tuple(sorted({f"readout: {w.category.__name__}: {w.message}" for w in caught}))
    prediction = _predict(estimator, x, n_outputs)
    weights, bias = _linear_map(estimator, x[:_PROBE], prediction[:_PROBE])
    return FittedReadout(estimator, standardizer, n_outputs, weights, bias, prediction, notes)


def _clone(readout: Any) -> Any:
    if hasattr(readout, "get_params"):
        from sklearn.base import clone

        return clone(readout)
    return copy.deepcopy(readout)


def _multi_output(estimator: Any, n_outputs: int) -> Any:
    """Wrap an estimator that takes one target column, when there are several."""
    if n_outputs == 1 or not hasattr(estimator, "__sklearn_tags__"):
        return estimator
    from sklearn.multioutput import MultiOutputRegressor
    from sklearn.utils import get_tags

    if get_tags(estimator).target_tags.multi_output:
        return estimator
    return MultiOutputRegressor(estimator)


def _predict(estimator: Any, x: NDArray[np.float64], n_outputs: int) -> NDArray[np.float64]:
    return np.asarray(estimator.predict(x), dtype=np.float64).reshape(len(x), n_outputs)


def _linear_map(
    estimator: Any, x: NDArray[np.float64], expected: NDArray[np.float64]
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """Return the weights (F, O) and bias (O,) of a linear estimator.

    An attribute called ``coef_`` does not make a model linear, so the map has to reproduce the
    estimator's own predictions, `expected` (n, O).
    """
    n_outputs = expected.shape[1]
    parts = getattr(estimator, "estimators_", None)
    models = parts if isinstance(parts, list) and len(parts) == n_outputs > 1 else [estimator]
    if not all(hasattr(model, "coef_") for model in models):
        return None, None
    coefficients = [np.asarray(model.coef_, dtype=np.float64) for model in models]
    if sum(c.size for c in coefficients) != n_outputs * x.shape[1]:
        return None, None
    weights = np.vstack([c.reshape(-1, x.shape[1]) for c in coefficients]).T.copy()
    offsets = [np.ravel(getattr(model, "intercept_", 0.0)) for model in models]
    bias = np.broadcast_to(np.concatenate(offsets).astype(np.float64), (n_outputs,)).copy()
    size = float(np.abs(expected).max(initial=0.0))
    if not np.allclose(x @ weights + bias, expected, rtol=1e-9, atol=1e-9 * size):
        return None, None
    return weights, bias
