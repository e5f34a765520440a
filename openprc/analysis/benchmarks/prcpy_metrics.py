"""The numbers that PRCpy reports, for comparison with results that were obtained with it.

PRCpy's capacity divides by the variance of the target over *all* rows although the covariance is
that of the last quarter. It is no squared correlation then: of a perfect copy it is
``var(u_test) / var(u)``, which may lie anywhere above 0. `prcpy_scores` therefore returns beside
each such number the one with both variances over the same rows, named ``..._corrected``.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError

Denominator = Literal["all rows", "test rows"]
#: PRCpy's share of the rows that its capacities are trained on.
_TRAIN_SHARE = 0.75


def prcpy_scores(
    states: ArrayLike,
    u: ArrayLike | None = None,
    *,
    target: ArrayLike,
    tau: int = 0,
    test_size: float = 0.3,
    alpha: float = 1e-3,
    k_max: int = 25,
    n_lags: int = 25,
) -> dict[str, Any]:
    """Return what PRCpy 0.1.14 reports for a matrix of states.

    Nothing is shuffled, scaled, or washed out.

    Parameters
    ----------
    states : (T, F)
    u : (T,), optional
        The input; without it the memory and the nonlinearity are left out.
    target : (n,)
        At least T values; the first T are used. PRCpy drops the others, too, and says nothing.
    tau : int
        0 pairs row t with target t, and the last ``ceil(test_size T)`` rows are for the test;
        above 0, row t is paired with target t + tau, and the first ``int(T (1 - test_size))``
        rows train.
    test_size : float
        Share of the rows, between 0 and 1.
    alpha : float
        Penalty of scikit-learn's ``Ridge``.
    k_max : int
        Delays 1 to ``k_max - 1`` make the memory capacity.
    n_lags : int
        Inputs u[t], ..., u[t - n_lags + 1] from which every state is predicted for the
        nonlinearity, which is 1 minus the mean capacity.

    Returns
    -------
    dict
        ``train_mse``, ``test_mse``, ``train_mae``, ``test_mae``; ``test_nmse``, the test MSE over
        the variance of the test target, which PRCpy does not have. With `u`:
        ``non_linearity``; ``linear_memory_capacity`` and ``linear_memory_curve`` (k_max - 1,);
        ``linear_memory_capacity_without_input`` and its curve, from which the capacity of the
        present input alone was subtracted (``remove_auto_correlation=True``); the first three
        again as ``..._corrected``. ``remarks``, a tuple of sentences.

    Raises
    ------
    TaskError
        When shapes do not fit, there are too few rows, values are missing, or something does not
        vary, which gives NaN in PRCpy.

    Examples
    --------
    >>> import numpy as np
    >>> u = np.random.default_rng(0).uniform(size=400)
    >>> states = np.column_stack([u, np.roll(u, 1)])
    >>> scores = prcpy_scores(states, u, target=np.roll(u, 1), alpha=1e-9, k_max=4)
    >>> round(scores["linear_memory_capacity_corrected"], 2)
    1.0
    """
    x = _matrix(states, "states")
    remarks: list[str] = []
    y = _series(target, len(x), "target", remarks)
    scores = _errors(x, y, tau=tau, test_size=test_size, alpha=alpha, remarks=remarks)
    if u is not None:
        v = _series(u, len(x), "u", remarks)
        scores |= _reservoir_metrics(x, v, k_max=k_max, n_lags=n_lags, remarks=remarks)
    return {**scores, "remarks": tuple(remarks)}


def estimator_capacity(
    targets: ArrayLike, predictors: ArrayLike, *, denominator: Denominator = "all rows"
) -> NDArray[np.float64]:
    """Return PRCpy's capacity of reconstructing each target by a linear regression.

    The regression is fitted on the first ``int(0.75 T)`` rows; on the others,
    ``cov(y, p)^2 / (var(y) var(p))`` of target and prediction.

    Parameters
    ----------
    targets : (T,) or (T, C)
    predictors : (T, F)
    denominator : {"all rows", "test rows"}
        Rows of the variance of the target. ``"all rows"`` is PRCpy's, and not bounded by 1;
        ``"test rows"`` is the squared correlation.

    Returns
    -------
    (C,) array

    Raises
    ------
    TaskError
        When a target or a prediction does not vary, or rows are too few.
    """
    y = np.asarray(targets, dtype=np.float64)
    both = _capacities(y.reshape(len(y), -1), _matrix(predictors, "predictors"), name="target")
    return both[0 if denominator == "all rows" else 1]


def linear_memory_curve(
    u: ArrayLike, states: ArrayLike, *, k_max: int = 25, denominator: Denominator = "all rows"
) -> NDArray[np.float64]:
    """Return the capacities of u[t - k] for k = 1, ..., k_max - 1, (k_max - 1,).

    Parameters
    ----------
    u : (T,)
    states : (T, F)
    k_max : int
    denominator : {"all rows", "test rows"}
        As for `estimator_capacity`.

    Raises
    ------
    TaskError
        As `estimator_capacity`.
    """
    x = _matrix(states, "states")
    both = _memory_curves(_series(u, len(x), "u", []), x, k_max)
    return both[0 if denominator == "all rows" else 1]


def non_linearity(
    u: ArrayLike, states: ArrayLike, *, n_lags: int = 25, denominator: Denominator = "all rows"
) -> float:
    """Return 1 minus the mean capacity of predicting each state from the last `n_lags` inputs.

    Inputs before the first are taken as zero.

    Parameters
    ----------
    u : (T,)
    states : (T, F)
    n_lags : int
    denominator : {"all rows", "test rows"}
        As for `estimator_capacity`.

    Raises
    ------
    TaskError
        As `estimator_capacity`; a state that is constant is named.
    """
    x = _matrix(states, "states")
    both = _linearity(_series(u, len(x), "u", []), x, n_lags)
    return float(1.0 - both[0 if denominator == "all rows" else 1].mean())


# --- task errors ---------------------------------------------------------------------------------


def _errors(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    *,
    tau: int,
    test_size: float,
    alpha: float,
    remarks: list[str],
) -> dict[str, Any]:
    from sklearn.linear_model import Ridge

    n_train, train, test = _split(len(x), tau, test_size)
    if n_train < x.shape[1]:
        remarks.append(
            f"{n_train} training rows for {x.shape[1]} features: without the penalty the fit "
            "would be exact, so the training error says nothing"
        )
    model = Ridge(alpha=alpha).fit(x[train], y[_shifted(train, tau)])
    off_train = model.predict(x[train]) - y[_shifted(train, tau)]
    y_test = y[_shifted(test, tau)]
    off_test = model.predict(x[test]) - y_test
    mse = float(np.mean(off_test**2))
    if np.ptp(y_test) == 0.0:
        raise TaskError(
            "the target is constant on the test rows",
            expected="a target that varies",
            fix="use a longer target, or a larger test_size",
            key="target",
        )
    return {
        "train_mse": float(np.mean(off_train**2)),
        "test_mse": mse,
        "train_mae": float(np.mean(np.abs(off_train))),
        "test_mae": float(np.mean(np.abs(off_test))),
        "test_nmse": mse / float(np.var(y_test)),
    }


def _split(n_rows: int, tau: int, test_size: float) -> tuple[int, slice, slice]:
    if not 0.0 < test_size < 1.0:
        raise TaskError(
            f"test_size is {test_size}",
            expected="a share between 0 and 1",
            fix="PRCpy's example has 0.3",
            key="test_size",
        )
    if tau < 0 or tau != int(tau):
        raise TaskError(
            f"tau is {tau}",
            expected="0, or the number of rows to look ahead",
            fix="correct it",
            key="tau",
        )
    # The very expressions of PRCpy: it rounds 1 - test_size before it multiplies when it looks
    # ahead, and leaves the split to scikit-learn when it does not.
    n_train = int(n_rows * (1 - test_size)) if tau else n_rows - math.ceil(test_size * n_rows)
    n_test = n_rows - n_train - tau
    if n_train < 2 or n_test < 2:
        raise TaskError(
            f"{n_rows} rows leave {n_train} for training and {max(n_test, 0)} for the test",
            expected="at least 2 for each",
            fix="use more rows, a smaller tau, or another test_size",
            key="test_size",
        )
    return n_train, slice(0, n_train), slice(n_train, n_rows - tau)


def _shifted(rows: slice, tau: int) -> slice:
    return slice(rows.start + tau, rows.stop + tau)


# --- capacities ----------------------------------------------------------------------------------


def _reservoir_metrics(
    x: NDArray[np.float64],
    u: NDArray[np.float64],
    *,
    k_max: int,
    n_lags: int,
    remarks: list[str],
) -> dict[str, Any]:
    linear, linear_corrected = _linearity(u, x, n_lags)
    curve, corrected = _memory_curves(u, x, k_max)
    own, _ = _memory_curves(u, u[:, np.newaxis], k_max)
    n_train = int(_TRAIN_SHARE * (len(x) - k_max + 1))
    if n_train <= x.shape[1]:
        remarks.append(
            f"the capacities are fitted on {n_train} rows with {x.shape[1]} features: no more "
            "than fitted noise may be left of them"
        )
    if max(curve.max(), linear.max()) > 1.0:
        remarks.append(
            "a capacity is above 1: PRCpy divides by the variance of all rows, not of the test "
            "rows; see the corrected numbers"
        )
    return {
        "non_linearity": float(1.0 - linear.mean()),
        "non_linearity_corrected": float(1.0 - linear_corrected.mean()),
        "linear_memory_capacity": float(curve.sum()),
        "linear_memory_curve": curve,
        "linear_memory_capacity_corrected": float(corrected.sum()),
        "linear_memory_curve_corrected": corrected,
        "linear_memory_capacity_without_input": float((curve - own).sum()),
        "linear_memory_curve_without_input": curve - own,
    }


def _memory_curves(
    u: NDArray[np.float64], x: NDArray[np.float64], k_max: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if k_max < 2:
        raise TaskError(
            f"k_max is {k_max}",
            expected="2 or more: the delays are 1 to k_max - 1",
            fix="PRCpy's default is 25",
            key="k_max",
        )
    pairs = [_capacities(u[:-k, np.newaxis], x[k:], name="u") for k in range(1, k_max)]
    return np.array([p[0][0] for p in pairs]), np.array([p[1][0] for p in pairs])


def _linearity(
    u: NDArray[np.float64], x: NDArray[np.float64], n_lags: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if n_lags < 1:
        raise TaskError(
            f"n_lags is {n_lags}",
            expected="1 or more inputs",
            fix="PRCpy's default is 25",
            key="n_lags",
        )
    padded = np.concatenate([np.zeros(n_lags - 1), u])
    history = np.lib.stride_tricks.sliding_window_view(padded, n_lags)
    return _capacities(x, history, name="state")


def _capacities(
    y: NDArray[np.float64], x: NDArray[np.float64], *, name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the capacities (C,) with the variance of all rows, and of the test rows."""
    from sklearn.linear_model import LinearRegression

    if len(y) != len(x):
        raise TaskError(
            f"{len(y)} rows of targets and {len(x)} of predictors",
            expected="equally many",
            fix="bring both to one clock",
            key=name,
        )
    n_train = int(_TRAIN_SHARE * len(y))
    if n_train < 2 or len(y) - n_train < 2:
        raise TaskError(
            f"{len(y)} rows are left for a capacity",
            expected="5 or more",
            fix="use more rows, or fewer delays",
            key=name,
        )
    test = y[n_train:]
    predicted = LinearRegression().fit(x[:n_train], y[:n_train]).predict(x[n_train:])
    for values, what in (
        (y, ""),
        (test, "the last quarter of "),
        (predicted, "the prediction of "),
    ):
        flat = np.flatnonzero(np.ptp(values, axis=0) == 0.0)
        if len(flat):
            column = f" {flat[0]}" if values.shape[1] > 1 else ""
            raise TaskError(
                f"{what}{name}{column} is constant",
                expected="values that vary; a capacity is undefined otherwise",
                fix="leave out what does not vary",
                key=name,
            )
    # Centred before they are multiplied: mean(y p) - mean(y) mean(p) loses the digits of an
    # offset, and is the same otherwise.
    p = predicted - predicted.mean(axis=0)
    covariance = np.mean((test - test.mean(axis=0)) * p, axis=0)
    shared = covariance**2 / np.mean(p**2, axis=0)
    return shared / np.var(y, axis=0), shared / np.var(test, axis=0)


# --- what is given -------------------------------------------------------------------------------


def _matrix(values: ArrayLike, name: str) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or 0 in array.shape:
        raise TaskError(
            f"{name} has shape {array.shape}",
            expected="(T, F): a row for each time step",
            fix="reshape one column with states[:, np.newaxis]",
            key=name,
        )
    return _finite(array, name)


def _series(values: ArrayLike, n_rows: int, name: str, remarks: list[str]) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1 or len(array) < n_rows:
        raise TaskError(
            f"{name} has shape {array.shape} and there are {n_rows} rows of states",
            expected=f"({n_rows},)",
            fix="bring it to the clock of the states",
            key=name,
        )
    if len(array) > n_rows:
        remarks.append(f"the last {len(array) - n_rows} values of {name} have no state: not used")
    return _finite(array[:n_rows], name)


def _finite(array: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        raise TaskError(
            f"{name} is not finite at {tuple(bad[0].tolist())}",
            expected="finite numbers",
            fix="leave out rows in which something is missing",
            key=name,
        )
    return array
