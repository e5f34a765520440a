"""Why two arrays differ: the usual mistakes of importers, tried one after the other."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: What a factor between two arrays may come from.
_FACTORS = {
    1e3: "mm taken for m, or ms for s",
    1e-3: "m taken for mm, or s for ms",
    1e2: "cm taken for m",
    1e-2: "m taken for cm",
    1e6: "um taken for m, or us for s",
    1e-6: "m taken for um, or s for us",
    180.0 / np.pi: "degrees taken for radians",
    np.pi / 180.0: "radians taken for degrees",
    -1.0: "the sign",
    60.0: "minutes taken for seconds",
    2.0: "a factor of two",
    0.5: "a factor of one half",
}


def deviation(found: Array, truth: Array) -> float:
    """Return the largest difference where both are finite, relative to the spread of `truth`."""
    both = np.isfinite(found) & np.isfinite(truth)
    if not both.any():
        return np.inf
    # A constant has no spread; then its size is the scale.
    scale = float(np.ptp(truth[both])) or float(np.abs(truth[both]).max()) or 1.0
    return float(np.abs(found - truth)[both].max()) / scale


def explain(found: Any, truth: Any, *, tolerance: float) -> str:
    """Return what would make `found` equal to `truth`, or an empty text.

    Parameters
    ----------
    found, truth : (T, ...)
        Time is the first axis.
    tolerance : float
        Relative to the spread of `truth`.
    """
    one, two = np.asarray(found, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    slack = max(tolerance, 1e-6)
    if one.shape != two.shape:
        return _explain_shape(one, two, slack)
    for factor, meaning in _FACTORS.items():
        if deviation(one * factor, two) <= slack:
            return f"it fits with a factor of {factor:.6g}: {meaning}"
    for step in (1, -1, 2, -2):
        if len(one) > 2 * abs(step) + 1:
            kept = one[step:] if step > 0 else one[:step]
            wanted = two[:-step] if step > 0 else two[-step:]
            if deviation(kept, wanted) <= slack:
                late = "late" if step > 0 else "early"
                return f"it fits {abs(step)} frame{'s' * (abs(step) > 1)} {late}: off by one"
    return _explain_order(one, two, slack)


def _explain_shape(one: Array, two: Array, slack: float) -> str:
    for axes in itertools.permutations(range(one.ndim)):
        turned = one.transpose(axes)
        if turned.shape == two.shape and deviation(turned, two) <= slack:
            return f"it fits with its axes in the order {axes}"
    if one.ndim == two.ndim and one.shape[1:] == two.shape[1:]:
        lost = len(two) - len(one)
        if 0 < lost <= 3:
            if deviation(one, two[lost:]) <= slack:
                return f"the first {lost} frame(s) are lost"
            if deviation(one, two[:-lost]) <= slack:
                return f"the last {lost} frame(s) are lost"
    if one.ndim == two.ndim == 3 and one.shape[:2] == two.shape[:2]:
        least = min(one.shape[2], two.shape[2])
        if deviation(one[..., :least], two[..., :least]) <= slack:
            return "a coordinate was added" if one.shape[2] > least else "a coordinate is lost"
    return ""


def _explain_order(one: Array, two: Array, slack: float) -> str:
    if one.ndim == 3:
        for order in itertools.permutations(range(one.shape[2])):
            if deviation(one[..., order], two) <= slack:
                return f"it fits with the coordinates in the order {order}"
        swapped = one.reshape(len(one), -1)
        flat = two.shape[2], two.shape[1]
        if deviation(swapped.reshape(len(one), *flat).swapaxes(1, 2), two) <= slack:
            return "it fits when (3, n) is read as (n, 3): the axes of a sample are swapped"
        # The other way round: (3, n) was there, and was laid out as (n, 3).
        if deviation(one.swapaxes(1, 2).reshape(two.shape), two) <= slack:
            return "it fits when (n, 3) is read as (3, n): the axes of a sample are swapped"
    if one.ndim >= 2:
        if one.shape[1] > 1 and deviation(one[:, ::-1], two) <= slack:
            return "it fits with the columns in reverse order"
        shifted = one - one[:1] + two[:1]
        if deviation(shifted, two) <= slack:
            return "it differs by a constant: displacements taken for positions, or an offset"
        if len(one) > 1 and deviation(one[::-1], two) <= slack:
            return "it fits backwards in time"
    elif len(one) and deviation(one - one[0] + two[0], two) <= slack:
        return f"it differs by the constant {one[0] - two[0]:.6g}"
    return ""


__all__ = ["deviation", "explain"]
