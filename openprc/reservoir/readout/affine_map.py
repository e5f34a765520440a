"""Finding the weights of an estimator that is an affine map, whatever it is built of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
#: Weights and bias: (F, O) and (O,).
Affine = tuple[Reals, Reals]

_RTOL = 1e-9


def affine_map(estimator: Any, x: Reals, expected: Reals) -> Affine | None:
    """Return the weights and bias of a regressor, or None when it is no affine map.

    An attribute called ``coef_`` makes no model linear, and a pipeline of linear steps has none.
    So what is found has to reproduce the estimator's own predictions.

    Parameters
    ----------
    estimator : fitted regressor
    x : (n, F)
        Rows it was trained on.
    expected : (n, O)
        What it predicts for them.
    """
    stated = _stated(estimator, n_columns=x.shape[1], n_outputs=expected.shape[1])
    if stated is not None and _reproduces(stated, x, expected):
        return stated
    return probed_map(estimator.predict, x, expected)


def probed_map(predict: Callable[[Reals], Any], x: Reals, expected: Reals) -> Affine | None:
    """Find an affine map from its values at zero and along every axis, or return None.

    Whether the map is affine at all is first asked of a few midpoints between rows, which
    most other maps fail at once.
    """
    n_outputs = expected.shape[1]

    def values(at: Reals) -> Reals:
        return np.asarray(predict(at), dtype=np.float64).reshape(len(at), n_outputs)

    size = float(np.abs(expected).max(initial=0.0))
    half = min(len(x) // 2, 16)
    between = values(0.5 * (x[:half] + x[-half:])) if half else expected[:0]
    mean = 0.5 * (expected[:half] + expected[-half:])
    if not np.allclose(between, mean, rtol=_RTOL, atol=_RTOL * size):
        return None
    bias = values(np.zeros((1, x.shape[1])))[0]
    # A step so large that the weights show beside the bias.
    spread = float(expected.std(axis=0).max(initial=0.0))
    step = 1.0 + (float(np.abs(bias).max(initial=0.0)) / spread if spread > 0 else 0.0)
    weights = (values(step * np.eye(x.shape[1])) - bias) / step
    found = (weights, bias)
    return found if _reproduces(found, x, expected) else None


def _stated(estimator: Any, *, n_columns: int, n_outputs: int) -> Affine | None:
    """Return what ``coef_`` and ``intercept_`` say, of one model or of one model per output."""
    parts = getattr(estimator, "estimators_", None)
    models = parts if isinstance(parts, list) and len(parts) == n_outputs > 1 else [estimator]
    if not all(hasattr(model, "coef_") for model in models):
        return None
    coefficients = [_dense(model.coef_) for model in models]
    if sum(c.size for c in coefficients) != n_outputs * n_columns:
        return None
    weights = np.vstack([c.reshape(-1, n_columns) for c in coefficients]).T.copy()
    offsets = [np.ravel(getattr(model, "intercept_", 0.0)) for model in models]
    joined = np.concatenate(offsets).astype(np.float64)
    if len(joined) not in (1, n_outputs):
        return None
    return weights, np.broadcast_to(joined, (n_outputs,)).copy()


def _dense(values: Any) -> Reals:
    return np.asarray(values.toarray() if hasattr(values, "toarray") else values, dtype=np.float64)


def _reproduces(found: Affine, x: Reals, expected: Reals) -> bool:
    weights, bias = found
    size = float(np.abs(expected).max(initial=0.0))
    return bool(np.allclose(x @ weights + bias, expected, rtol=_RTOL, atol=_RTOL * size))
