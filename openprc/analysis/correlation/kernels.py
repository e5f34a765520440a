"""Sums over all pairs of samples in O(n log n), compiled."""
# ruff: noqa: TID253, ANN001, ANN201, ANN202 - compiled as a whole, for the types of the caller

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

#: Shorter runs than this are paired and sorted directly, longer ones by merging.
RUN = 4
#: Samples between the series in the scratch, lest all of them fall into the same cache lines.
GAP = 168
#: Sums are made in parts of so many terms, whose rounding errors do not add up to those of one
#: long sum.
PART = 128
#: Place of the sign in 64 bits. It is handed over at run time, see `_merge`.
SIGN_BIT = 63


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile, and keep the compiled code on disk where there is a folder for it."""
    options = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:
        # There is no folder in which the compiled code could be kept.
        return numba.njit(**options)(function)


@kernel
def run_width(n):
    """Return the width of the runs that are sorted first; their number is a power of two.

    The last sample is repeated until they are full: to `width` times the number of runs.
    """
    n_runs = 1
    while n > 2 * RUN * n_runs:
        n_runs *= 2
    return (n + n_runs - 1) // n_runs


def workspace(n: int) -> np.ndarray:
    """Return scratch memory for `distance_products` of n samples."""
    width = int(run_width(n))
    size = width
    while size < n:
        size *= 2
    work = np.empty(6 * (size + GAP) + 1)
    work[-1] = SIGN_BIT
    return work


@kernel
def _sort_runs(width, ys, xs, rs, yt, xt, rt):
    """Sort runs by y, and return the sum of (x_j - x_i)(y_j - y_i) over pairs that agree."""
    agreeing = 0.0
    place = np.empty(width, np.int64)
    for low in range(0, ys.size, width):
        part = 0.0
        for j in range(width):
            yj, xj = ys[low + j], xs[low + j]
            before = 0
            for i in range(j):
                agrees = ys[low + i] <= yj
                before += agrees
                place[i] += not agrees
                part += np.float64(agrees) * (xj - xs[low + i]) * (yj - ys[low + i])
            place[j] = before
        agreeing += part
        for j in range(width):
            k = low + place[j]
            yt[k], xt[k], rt[k] = ys[low + j], xs[low + j], rs[low + j]
    return agreeing


@kernel
def _merge(low, width, sign, keys, ys, xs, rs, yt, xt, rt):
    """Merge two runs of equal width from both ends at once, and return the same sum of pairs.

    Neither end can leave its run, so nothing is checked; the two do not wait for each other. Of
    random data no processor foresees which run comes next, so there is no jump for it either:
    the sign of a difference of keys, all ones or all zeros, chooses by masking. Keys are the bits
    of y; those of numbers that are not negative are ordered as the numbers are. `sign` is
    `SIGN_BIT`: if the compiler knew its value, it would make a jump of the shift.
    """
    i, j = low, low + width
    p, q = low + width - 1, low + 2 * width - 1
    head, tail = low, q
    count, sum_x, sum_y, sum_xy = 0.0, 0.0, 0.0, 0.0
    rest, rest_x, rest_y, rest_xy = float(width), 0.0, 0.0, 0.0
    for k in range(width):
        y, x = ys[np.uint64(low + k)], xs[np.uint64(low + k)]
        rest_x += x
        rest_y += y
        rest_xy += x * y
    total = 0.0
    for start in range(0, width, PART):
        first = last = 0.0
        for _ in range(start, min(start + PART, width)):
            # Unsigned, or an index would be checked for being negative.
            right = (keys[np.uint64(j)] - keys[np.uint64(i)]) >> sign
            source, target = np.uint64(i + ((j - i) & right)), np.uint64(head)
            y, x = ys[source], xs[source]
            yt[target], xt[target], rt[target] = y, x, rs[source]
            weight = np.float64(1 + right)
            head += 1
            i += 1 + right
            j -= right
            first += (1.0 - weight) * (x * (count * y - sum_y) + (sum_xy - y * sum_x))
            count += weight
            sum_x += weight * x
            sum_y += weight * y
            sum_xy += weight * x * y
            # From the other end; equal values of the left run come before those of the right one.
            left = (keys[np.uint64(q)] - keys[np.uint64(p)]) >> sign
            source, target = np.uint64(q + ((p - q) & left)), np.uint64(tail)
            y, x = ys[source], xs[source]
            yt[target], xt[target], rt[target] = y, x, rs[source]
            weight = np.float64(-left)
            tail -= 1
            p += left
            q -= 1 + left
            last += (1.0 - weight) * (x * (rest * y - rest_y) + (rest_xy - y * rest_x))
            rest -= weight
            rest_x -= weight * x
            rest_y -= weight * y
            rest_xy -= weight * x * y
        total += first + last
    return total


@kernel
def distance_products(x, a, y, work):
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
    work : float64
        Scratch, see `workspace`: fresh memory would cost more than what is done with it.

    Returns
    -------
    products, row_products, total, squares : float
        Sums of |dx||dy| over pairs, of a_k b_k, of b_k and of b_k^2 over samples, where b_k are
        the row sums of |y_i - y_j|.
    """
    n = x.size
    width, size = run_width(n), work.size // 6 - GAP
    far = size + GAP
    ys, xs, rs = work[:size], work[far : far + size], work[2 * far : 2 * far + size]
    yt, xt = work[3 * far : 3 * far + size], work[4 * far : 4 * far + size]
    rt = work[5 * far : 5 * far + size]
    sum_x = sum_y = sum_xy = 0.0
    last_x, last_y, first_y = x[n - 1], y[0], y[0]
    for k in range(n):
        first_y, last_y = min(first_y, y[k]), max(last_y, y[k])
    last_y -= first_y
    for start in range(0, n, PART):
        part_x, part_y, part_xy = 0.0, 0.0, 0.0
        for k in range(start, min(start + PART, n)):
            yk, xk = y[k] - first_y, x[k]
            ys[k], xs[k], rs[k] = yk, xk, a[k]
            part_x += xk
            part_y += yk
            part_xy += xk * yk
        sum_x += part_x
        sum_y += part_y
        sum_xy += part_xy
    ys[n:], xs[n:], rs[n:] = last_y, last_x, 0.0
    # The filling is last in both orders, and agrees with every sample.
    agreeing = -(size - n) * (n * last_x * last_y - last_x * sum_y - last_y * sum_x + sum_xy)
    agreeing += _sort_runs(width, ys, xs, rs, yt, xt, rt)
    ys, yt, xs, xt, rs, rt = yt, ys, xt, xs, rt, rs
    sign = np.int64(work[-1])
    keys, other_keys = ys.view(np.int64), yt.view(np.int64)
    while width < size:
        for low in range(0, size, 2 * width):
            agreeing += _merge(low, width, sign, keys, ys, xs, rs, yt, xt, rt)
        ys, yt, xs, xt, rs, rt = yt, ys, xt, xs, rt, rs
        keys, other_keys = other_keys, keys
        width *= 2
    below = row_products = squares = total = 0.0
    for start in range(0, n, PART):
        part, part_squares, part_total, part_below = 0.0, 0.0, 0.0, 0.0
        for k in range(start, min(start + PART, n)):
            b = (2.0 * k - n) * ys[k] - 2.0 * (below + part_below) + sum_y
            part_below += ys[k]
            part += rs[k] * b
            part_squares += b * b
            part_total += b
        below += part_below
        row_products += part
        squares += part_squares
        total += part_total
    # Of all pairs i < j, whatever their order in y: sum of (x_j - x_i)(y_j - y_i).
    signed = n * sum_xy - sum_x * sum_y
    return 2.0 * (2.0 * agreeing - signed), row_products, total, squares


@kernel
def channel_products(order, x, a, rows, work):
    """Return `distance_products` of x with each of the rows (N, T), and their own distances.

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
        factor = 1.0 / largest
        for k in range(n):
            y[k] = rows[c, order[k]] * factor
            total += y[k]
            square += y[k] * y[k]
        found[c, :4] = distance_products(x, a, y, work)
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
