"""Earlier rows beside the present one."""
# ruff: noqa: TID253 - the base classes of scikit-learn are what makes it a transformer

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import _check_feature_names_in, check_is_fitted, validate_data

from openprc.errors import TaskError


class DelayTaps(TransformerMixin, BaseEstimator):
    """Put the rows of the last instants side by side: x(k), x(k - s), ..., x(k - (n - 1) s).

    Rows are consecutive instants, so it acts on whole recordings and not on batches of them.
    The first ``(n_taps - 1) * spacing`` rows have no history. What is missing there is NaN, and
    a trainer uses none of these rows: its washout has to cover them.

    Parameters
    ----------
    n_taps : int
        Instants, the present one included.
    spacing : int
        Rows from one tap to the next.

    Attributes
    ----------
    n_history_rows_ : int
        Rows at the start without a complete history.

    Examples
    --------
    >>> DelayTaps(2).fit_transform([[1.0], [2.0], [3.0]])
    array([[ 1., nan],
           [ 2.,  1.],
           [ 3.,  2.]])
    """

    #: Tells a trainer to pass every row, in order, and not only those that were measured.
    acts_along_rows = True

    def __init__(self, n_taps: int = 2, spacing: int = 1) -> None:
        self.n_taps = n_taps
        self.spacing = spacing

    def fit(self, X: ArrayLike, y: object = None) -> Self:
        """Note the number of columns; nothing is learned.

        Raises
        ------
        TaskError
            When `n_taps` or `spacing` is not a positive whole number.
        """
        validate_data(self, X, ensure_all_finite="allow-nan")
        for name in ("n_taps", "spacing"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
                raise TaskError(
                    f"{name} is {value!r}",
                    expected="a whole number, 1 or more",
                    fix="pass such a number",
                    key=name,
                )
        self.n_history_rows_ = (self.n_taps - 1) * self.spacing
        return self

    def transform(self, X: ArrayLike) -> NDArray[Any]:
        """Return the taps, (R, n_taps * F): all columns at delay 0 first, then the next delay."""
        check_is_fitted(self)
        states = validate_data(
            self, X, reset=False, ensure_all_finite="allow-nan", dtype=(np.float64, np.float32)
        )
        n_rows, n_columns = states.shape
        taps = np.full((n_rows, self.n_taps, n_columns), np.nan, dtype=states.dtype)
        for tap in range(self.n_taps):
            delay = tap * self.spacing
            taps[delay:, tap] = states[: max(n_rows - delay, 0)]
        return taps.reshape(n_rows, -1)

    def get_feature_names_out(self, input_features: ArrayLike | None = None) -> NDArray[np.object_]:
        """Return the column names, such as ``"node3.z[k-2]"`` for a delay of two rows."""
        check_is_fitted(self)
        names = _check_feature_names_in(self, input_features)
        delays = [tap * self.spacing for tap in range(self.n_taps)]
        return np.asarray(
            [f"{name}[k-{delay}]" if delay else name for delay in delays for name in names],
            dtype=object,
        )

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        tags.transformer_tags.preserves_dtype = ["float64", "float32"]
        return tags
