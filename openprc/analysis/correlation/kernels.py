"""Sums over all pairs of samples in O(n log n), compiled."""
# ruff: noqa: TID253, ANN001, ANN201 - compiled as a whole, for the types of the caller

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

#: Shortest run that is sorted by merging; shorter ones are paired and sorted directly.
RUN = 8


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile, and keep the compiled code on disk where there is a folder for it."""
    options = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:
        # There is no folder in which the compiled code could be kept.
        return numba.njit(**options)(function)


@kernel
def _sort_runs(ys, xs, rs):
    """Sort runs by y, and return the sum of (x_j - x_i)(y_j - y_i) over pairs that agree."""
    n = ys.size
    agreeing = 0.0
    for low in range(0, n, RUN):
        for j in range(low + 1, min(low + RUN, n)):
            yj, xj, rj = ys[j], xs[j], rs[j]
            i = j - 1
            while i >= low and ys[i] > yj:
                ys[i + 1], xs[i + 1], rs[i + 1] = ys[i], xs[i], rs[i]
                i -= 1
            ys[i + 1], xs[i + 1], rs[i + 1] = yj, xj, rj
            part = 0.0
            for k in range(low, i + 1):
                part += (xj - xs[k]) * (yj - ys[k])
            agreeing += part
    return agreeing


@kernel
def _merge_equal(low, width, ys, xs, rs, yt, xt, rt):
    """Merge two runs of equal width from both ends at once, and return the same sum of pairs.

    Neither end can leave its run, so nothing is checked; the two do not wait for each other;
    and all is written without jumps, which the processor could not foresee.
    """
    i, j = low, low + width
    p, q = low + width - 1, low + 2 * width - 1
    count, sum_x, sum_y, sum_xy = 0.0, 0.0, 0.0, 0.0
    rest, rest_x, rest_y, rest_xy = float(width), 0.0, 0.0, 0.0
    for k in range(low, low + width):
        rest_x += xs[k]
        rest_y += ys[k]
        rest_xy += xs[k] * ys[k]
    first = last = 0.0
    for k in range(width):
        left = np.int64(ys[i] <= ys[j])
        source = j + (i - j) * left
        yk, xk = ys[source], xs[source]
        yt[low + k], xt[low + k], rt[low + k] = yk, xk, rs[source]
        weight = float(left)
        xy = xk * yk
        first += (1.0 - weight) * (count * xy - xk * sum_y - yk * sum_x + sum_xy)
        count += weight
        sum_x += weight * xk
        sum_y += weight * yk
        sum_xy += weight * xy
        i += left
        j += 1 - left
        # From the other end; equal values of the left run come before those of the right one.
        left = np.int64(ys[p] > ys[q])
        source = q + (p - q) * left
        yk, xk = ys[source], xs[source]
        target = low + 2 * width - 1 - k
        yt[target], xt[target], rt[target] = yk, xk, rs[source]
        weight = float(left)
        xy = xk * yk
        last += (1.0 - weight) * (rest * xy - xk * rest_y - yk * rest_x + rest_xy)
        rest -= weight
        rest_x -= weight * xk
        rest_y -= weight * yk
        rest_xy -= weight * xy
        p -= left
        q -= 1 - left
    return first + last


@kernel
def _merge(low, middle, high, ys, xs, rs, yt, xt, rt):
    """Merge two runs of any width, and return the same sum of pairs."""
    i, j, k = low, middle, low
    count = sum_x = sum_y = sum_xy = part = 0.0
    while i < middle and j < high:
        left = np.int64(ys[i] <= ys[j])
        source = j + (i - j) * left
        yk, xk = ys[source], xs[source]
        yt[k], xt[k], rt[k] = yk, xk, rs[source]
        k += 1
        weight = float(left)
        xy = xk * yk
        part += (1.0 - weight) * (count * xy - xk * sum_y - yk * sum_x + sum_xy)
        count += weight
        sum_x += weight * xk
        sum_y += weight * yk
        sum_xy += weight * xy
        i += left
        j += 1 - left
    while i < middle:
        yt[k], xt[k], rt[k] = ys[i], xs[i], rs[i]
        i, k = i + 1, k + 1
    while j < high:
        yk, xk = ys[j], xs[j]
        yt[k], xt[k], rt[k] = yk, xk, rs[j]
        part += count * xk * yk - xk * sum_y - yk * sum_x + sum_xy
        j, k = j + 1, k + 1
    return part


@kernel
def distance_products(x, a, y):
    """Return sums over pairs of distances, each pair counted twice.

    The sum of |x_i - x_j| |y_i - y_j| is split by the sign of (x_i - x_j)(y_i - y_j): of those
    pairs that y orders as x does, the products follow from running sums while the samples,
    which come in the order of x, are merged into the order of y (Chaudhuri & Hu 2019,
    https://doi.org/10.1016/j.csda.2019.01.016). O(n log n) time, O(n) memory.

    Parameters
    ----------
    x : (n,) float64
        Ascending; best centred, since differences of products are taken.
    a : (n,) float64
        Row sums of |x_i - x_j|, in the same order.
    y : (n,) float64
        The other variable in the order of x, centred.

    Returns
    -------
    products, row_products, total, squares : float
        Sums of |dx||dy| over pairs, of a_k b_k, of b_k and of b_k^2 over samples, where b_k are
        the row sums of |y_i - y_j|.
    """
    n = x.size
    ys, xs, rs = y.copy(), x.copy(), a.copy()
    yt, xt, rt = np.empty(n), np.empty(n), np.empty(n)
    agreeing = _sort_runs(ys, xs, rs)
    width = RUN
    while width < n:
        for low in range(0, n, 2 * width):
            middle, high = min(low + width, n), min(low + 2 * width, n)
            if high - middle == width:
                agreeing += _merge_equal(low, width, ys, xs, rs, yt, xt, rt)
            else:
                agreeing += _merge(low, middle, high, ys, xs, rs, yt, xt, rt)
        ys, yt = yt, ys
        xs, xt = xt, xs
        rs, rt = rt, rs
        width *= 2
    sum_x = sum_y = sum_xy = 0.0
    for k in range(n):
        sum_x += xs[k]
        sum_y += ys[k]
        sum_xy += xs[k] * ys[k]
    below = row_products = squares = total = 0.0
    for k in range(n):
        b = (2.0 * k - n) * ys[k] - 2.0 * below + sum_y
        below += ys[k]
        row_products += rs[k] * b
        squares += b * b
        total += b
    # Of all pairs i < j, whatever their order in y: sum of (x_j - x_i)(y_j - y_i).
    signed = n * sum_xy - sum_x * sum_y
    return 2.0 * (2.0 * agreeing - signed), row_products, total, squares


@kernel
def channel_products(order, x, a, rows):
    """Return `distance_products` of x with each of the rows (N, T), and their sums of squares.

    Rows are centred; they are divided by their largest magnitude, so that no product leaves
    float64, and taken into the order of x.

    Returns
    -------
    sums : (N, 5) float64
        Products, products of row sums, total, squares of row sums, squared distances.
    """
    n_rows, n = rows.shape
    found = np.empty((n_rows, 5))
    y = np.empty(n)
    for c in range(n_rows):
        largest = 0.0
        for k in range(n):
            largest = max(largest, abs(rows[c, k]))
        total = square = 0.0
        for k in range(n):
            y[k] = rows[c, order[k]] / largest
            total += y[k]
            square += y[k] * y[k]
        found[c, :4] = distance_products(x, a, y)
        found[c, 4] = 2.0 * (n * square - total * total)
    return found


@kernel
def discordant_pairs(groups, y):
    """Return how many pairs two variables order oppositely, and how many tie in both.

    Counts inversions while sorting by merging (Knight 1966,
    https://doi.org/10.1080/01621459.1966.10480879). O(n log n) time, O(n) memory.

    Parameters
    ----------
    groups : (G + 1,) int64
        Where in the order of x its groups of equal values start, and n at the end.
    y : (n,) int64
        Ranks of the other variable in the order of x.
    """
    n = y.size
    ys, yt = y.copy(), np.empty_like(y)
    both = 0
    for g in range(groups.size - 1):
        low, high = groups[g], groups[g + 1]
        if high - low > 1:
            # Pairs that tie in x are neither: in order, they count as no inversion.
            ys[low:high] = np.sort(ys[low:high])
            same = 1
            for k in range(low + 1, high):
                same = same + 1 if ys[k] == ys[k - 1] else 1
                both += same - 1
    inversions = 0
    width = 1
    while width < n:
        for low in range(0, n, 2 * width):
            middle, high = min(low + width, n), min(low + 2 * width, n)
            i, j, k = low, middle, low
            while i < middle and j < high:
                left = ys[i] <= ys[j]
                yt[k] = ys[i] if left else ys[j]
                inversions += 0 if left else middle - i
                i += left
                j += not left
                k += 1
            while i < middle:
                yt[k] = ys[i]
                i, k = i + 1, k + 1
            while j < high:
                yt[k] = ys[j]
                j, k = j + 1, k + 1
        ys, yt = yt, ys
        width *= 2
    return inversions, both


@kernel
def ordered_distance(ordered, rank):
    """Return the `rank`-th smallest and the next distance of pairs of samples, exactly.

    The smallest distance that at least `rank` pairs do not exceed is found by halving the
    range of float64 numbers by their bits; pairs are counted by two pointers.

    Parameters
    ----------
    ordered : (n,) float64
        Ascending.
    rank : int
        From 1 to n (n - 1) / 2.
    """
    n = ordered.size
    low = np.int64(-1)
    bits = np.empty(1, np.int64)
    number = bits.view(np.float64)
    number[0] = ordered[n - 1] - ordered[0]
    high = bits[0]
    # Bits of non-negative numbers are ordered as the numbers are.
    while high - low > 1:
        bits[0] = low + (high - low) // 2
        distance = number[0]
        count, i = 0, 0
        for j in range(n):
            while ordered[j] - ordered[i] > distance:
                i += 1
            count += j - i
        if count >= rank:
            high = bits[0]
        else:
            low = bits[0]
    bits[0] = high
    distance = number[0]
    count, i = 0, 0
    following = np.inf
    for j in range(n):
        while ordered[j] - ordered[i] > distance:
            following = min(following, ordered[j] - ordered[i])
            i += 1
        if i > 0:
            following = min(following, ordered[j] - ordered[i - 1])
        count += j - i
    return distance, (distance if count > rank else following)
