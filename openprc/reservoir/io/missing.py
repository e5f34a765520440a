"""What to do with samples that were not measured. Nothing is filled in unless asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData

MissingPolicy = Literal["error", "drop", "interpolate"]
POLICIES: tuple[MissingPolicy, ...] = ("error", "drop", "interpolate")

_WORST = 5


def apply_policy(
    values: NDArray[np.float64],
    policy: MissingPolicy,
    *,
    time: NDArray[np.float64],
    labels: Sequence[str],
    file: str,
    key: str,
) -> NDArray[np.float64]:
    """Treat the NaN samples of `values` as `policy` says.

    Parameters
    ----------
    values : (T, N, ...) float64
        Axis 1 is what can be missing as one: a node, a bar, a column.
    policy : {"error", "drop", "interpolate"}
        ``error`` refuses. ``drop`` leaves the NaN in place, for the trainer to leave those
        rows out of training and test. ``interpolate`` joins the neighbours of an interior gap
        by a straight line in time; this looks ahead, so it is for short gaps only.
    time : (T,) float64
        Abscissa of the interpolation.
    labels : N names, for the message.

    Raises
    ------
    MissingData
        With ``error`` when a sample is missing; with ``interpolate`` when a gap touches the
        first or last frame, because nothing is extrapolated.
    """
    missing = np.isnan(values).reshape(values.shape[0], values.shape[1], -1).any(axis=2)
    if not missing.any() or policy == "drop":
        return values
    if policy == "error":
        raise MissingData(
            f"{_summary(missing, labels)} not measured",
            expected="a value in every frame",
            fix='leave those out with node_ids, or say missing="drop" (rows with a gap are not '
            'used) or missing="interpolate" (interior gaps are joined by straight lines)',
            file=file,
            key=key,
        )
    open_ended = missing & (_leading(missing) | _leading(missing[::-1])[::-1])
    if open_ended.any():
        raise MissingData(
            f"{_summary(open_ended, labels)} missing before the first or after the last "
            "measurement",
            expected="gaps with a measurement on either side",
            fix="leave those out with node_ids, or trim the recording; nothing is extrapolated",
            file=file,
            key=key,
        )
    filled = values.copy()
    for n in np.flatnonzero(missing.any(axis=0)):
        gap = missing[:, n]
        columns = filled[:, n].reshape(filled.shape[0], -1)
        for c in range(columns.shape[1]):
            columns[gap, c] = np.interp(time[gap], time[~gap], columns[~gap, c])
        filled[:, n] = columns.reshape(filled[:, n].shape)
    return filled


def _leading(missing: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask of the missing samples before the first measurement of each column."""
    return np.logical_and.accumulate(missing, axis=0)


def _summary(missing: NDArray[np.bool_], labels: Sequence[str]) -> str:
    counts = missing.sum(axis=0)
    worst = [n for n in np.argsort(-counts, kind="stable")[:_WORST] if counts[n]]
    shares = ", ".join(f"{labels[n]} in {counts[n]} of {missing.shape[0]} frames" for n in worst)
    total, affected = int(counts.sum()), int(np.count_nonzero(counts))
    return f"{total} of {missing.size} samples ({affected} of {len(counts)}; worst: {shares})"
