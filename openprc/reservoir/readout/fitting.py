"""Fitting any scikit-learn style estimator, whatever shapes and outputs it likes."""

from __future__ import annotations

import copy
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.readout.affine_map import affine_map
from openprc.reservoir.readout.classifier import as_labels, is_classifier, linear_decision, named
from openprc.reservoir.training.row_blocks import RowBlocks
from openprc.reservoir.training.standardizer import Standardizer

# Training rows on which stored weights have to reproduce the estimator.
_PROBE = 256


@dataclass(frozen=True)
class FittedReadout:
    """A trained readout.

    ``weights`` (F, O) and ``bias`` (O,) act on standardised states; they are None when the
    estimator is not an affine map. ``train_prediction`` is (n, O). Of a classifier, `classes`
    are its labels, weights and bias give its decision function, and predictions are labels (n,).
    """

    estimator: Any
    standardizer: Standardizer
    n_outputs: int
    weights: NDArray[np.float64] | None
    bias: NDArray[np.float64] | None
    train_prediction: NDArray[Any]
    warnings: tuple[str, ...]
    classes: NDArray[Any] | None = None

    def predict(self, states: NDArray[np.float64]) -> NDArray[Any]:
        """Return predictions, (n, O), or labels, (n,), for states (n, F)."""
        return self.predict_rows(RowBlocks.all_of(np.asarray(states)))

    def predict_rows(self, blocks: RowBlocks) -> NDArray[Any]:
        """Return predictions for chosen rows of a state matrix."""
        if self.weights is not None and self.bias is not None:
            values = self.standardizer.apply_affine(blocks, self.weights, self.bias)
            return values if self.classes is None else named(self.classes, values)
        x = self.standardizer.transform(blocks.matrix())
        return _predict(self.estimator, x, None if self.classes is not None else self.n_outputs)


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
    target: NDArray[Any],
    *,
    rows: NDArray[np.intp] | None = None,
    standardize: bool = True,
) -> FittedReadout:
    """Fit a copy of `readout`; the object itself is left as it was.

    A readout with ``fit_blocks``, such as `openprc.reservoir.readout.ridge.Ridge`, reads the
    states where they are; for any other they are copied once, standardised.

    Parameters
    ----------
    states : (R, F) float64
    target : (n, O) float64, or labels (n,) for a classifier
        Of the training rows.
    rows : (n,) int, optional
        Numbers of the training rows; all by default. Mean and scale are taken from them only.
    standardize : bool
        Bring every column to zero mean and unit variance first.

    Raises
    ------
    TaskError
        When `readout` is no estimator, or a classifier is given no labels.
    """
    blocks = RowBlocks.all_of(states) if rows is None else RowBlocks(states, rows)
    return fit_rows(readout, blocks, target, standardize=standardize)


def reads_in_place(readout: Any) -> bool:
    """Say whether a readout needs no copy of the states: it asks for their moments only."""
    return callable(getattr(readout, "fit_blocks", None)) or _is_plain_ridge(readout)


def fit_rows(
    readout: Any, blocks: RowBlocks, target: NDArray[Any], *, standardize: bool = True
) -> FittedReadout:
    """Fit a copy of `readout` to chosen rows; see `fit_readout`."""
    check_readout(readout)
    classifies = is_classifier(readout)
    target = as_labels(target) if classifies else target
    n_outputs = 1 if target.ndim == 1 else target.shape[1]
    estimator = _clone(readout)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if callable(getattr(estimator, "fit_blocks", None)):
            fitted = _fit_in_place(estimator, blocks, target, standardize=standardize)
        elif _is_plain_ridge(estimator):
            fitted = _fit_plain_ridge(estimator, blocks, target, standardize=standardize)
        elif classifies:
            fitted = _fit_classifier(estimator, blocks, target, standardize=standardize)
        else:
            estimator = _multi_output(estimator, n_outputs)
            fitted = _fit_regressor(estimator, blocks, target, standardize=standardize)
    notes = {f"readout: {w.category.__name__}: {w.message}" for w in caught}
    notes.update(fitted.warnings)
    return replace(fitted, warnings=tuple(sorted(notes)))


def _fit_in_place(
    estimator: Any, blocks: RowBlocks, target: NDArray[np.float64], *, standardize: bool
) -> FittedReadout:
    standardizer = estimator.fit_blocks(blocks, target, standardize=standardize)
    weights, bias = estimator.coef_.T.copy(), np.array(estimator.intercept_)
    prediction = standardizer.apply_affine(blocks, weights, bias)
    remarks = tuple(getattr(estimator, "remarks_", ()))
    return FittedReadout(
        estimator, standardizer, target.shape[1], weights, bias, prediction, remarks
    )


def _is_plain_ridge(estimator: Any) -> bool:
    """Say whether an estimator is scikit-learn's own ridge, free to solve it as it likes."""
    if not type(estimator).__module__.startswith("sklearn.linear_model"):
        return False
    from sklearn.linear_model import Ridge

    return (
        type(estimator) is Ridge
        and estimator.solver in ("auto", "cholesky")
        and estimator.fit_intercept
        and not estimator.positive
    )


def _fit_plain_ridge(
    estimator: Any, blocks: RowBlocks, target: NDArray[np.float64], *, standardize: bool
) -> FittedReadout:
    """Fit scikit-learn's ridge without the two copies of the states that it would take.

    The minimum is the same; what the estimator learns is put into it.
    """
    # Imported late, since that file needs scikit-learn.
    from openprc.reservoir.readout.ridge import Ridge  # noqa: PLC0415

    ours = Ridge(estimator.alpha)
    fitted = _fit_in_place(ours, blocks, target, standardize=standardize)
    flat = target.shape[1] == 1
    estimator.coef_ = ours.coef_[0] if flat else ours.coef_
    estimator.intercept_ = float(ours.intercept_[0]) if flat else ours.intercept_
    estimator.n_features_in_, estimator.n_iter_ = ours.n_features_in_, None
    estimator.solver_ = "cholesky"
    return replace(fitted, estimator=estimator, warnings=ours.remarks_)


def _fit_regressor(
    estimator: Any, blocks: RowBlocks, target: NDArray[np.float64], *, standardize: bool
) -> FittedReadout:
    n_outputs = target.shape[1]
    standardizer, x = Standardizer.fit_transform(blocks, scaled=standardize)
    # A target of one column goes in flat: estimators disagree about (n, 1).
    estimator.fit(x, target[:, 0] if n_outputs == 1 else target)
    probe = _probe(x)
    found = affine_map(estimator, probe, _predict(estimator, probe, n_outputs))
    if found is None:
        prediction = _predict(estimator, x, n_outputs)
        return FittedReadout(estimator, standardizer, n_outputs, None, None, prediction, ())
    prediction = x @ found[0] + found[1]
    return FittedReadout(estimator, standardizer, n_outputs, *found, prediction, ())


def _fit_classifier(
    estimator: Any, blocks: RowBlocks, labels: NDArray[Any], *, standardize: bool
) -> FittedReadout:
    standardizer, x = Standardizer.fit_transform(blocks, scaled=standardize)
    estimator.fit(x, labels)
    classes = np.asarray(getattr(estimator, "classes_", np.unique(labels)))
    probe = _probe(x)
    found = linear_decision(estimator, probe, _predict(estimator, probe, None)) or (None, None)
    prediction = _predict(estimator, x, None)
    return FittedReadout(estimator, standardizer, 1, *found, prediction, (), classes)


def _probe(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return up to `_PROBE` rows from all over the training rows."""
    return x[:: max(1, len(x) // _PROBE)][:_PROBE]


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
    from sklearn.neural_network import MLPRegressor
    from sklearn.utils import get_tags

    # MLPRegressor takes several columns and its tag denies it.
    if get_tags(estimator).target_tags.multi_output or isinstance(estimator, MLPRegressor):
        return estimator
    return MultiOutputRegressor(estimator)


def _predict(estimator: Any, x: NDArray[np.float64], n_outputs: int | None) -> NDArray[Any]:
    """Return predictions (n, O), or labels (n,) where there is no number of outputs."""
    if n_outputs is None:
        return np.asarray(estimator.predict(x)).reshape(len(x))
    return np.asarray(estimator.predict(x), dtype=np.float64).reshape(len(x), n_outputs)
