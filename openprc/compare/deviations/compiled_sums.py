"""Sums over blocks of frames, compiled: what has to keep pace with reading."""
# ruff: noqa: TID253, ANN001, ANN201, ANN202 - compiled as a whole, for the types of the caller

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np


def kernel(function: Callable[..., Any], *, loose: bool = False) -> Callable[..., Any]:
    """Compile, and keep the compiled code on disk where there is a folder for it.

    In `loose` functions sums may be taken in any order, which lets them be vectorised. They
    must not ask whether a number is finite: such a question would be answered beforehand.
    """
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    if loose:
        options["fastmath"] = {"reassoc", "contract", "nsz"}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:
        # There is no folder in which the compiled code could be kept.
        return numba.njit(**options)(function)


def loose_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile with sums in any order."""
    return kernel(function, loose=True)


@loose_kernel
def _squares(x, y, origin, squares):
    """Fill in squared deviations (C,); return their sum, and that of squared displacements."""
    total, moved = 0.0, 0.0
    for c in range(x.shape[0]):
        e = x[c] - y[c]
        u = x[c] - origin[c]
        squares[c] = e * e
        total += e * e
        moved += u * u
    return total, moved


@kernel
def _whole_frame(squares, part, largest, n, d):
    """Add a frame in which every node is there; return the largest squared deviation."""
    top = 0.0
    if d == 3:
        for i in range(n):
            s = squares[3 * i] + squares[3 * i + 1] + squares[3 * i + 2]
            part[i] += s
            largest[i] = max(largest[i], s)
            top = max(top, s)
    else:
        for i in range(n):
            s = squares[2 * i] + squares[2 * i + 1]
            part[i] += s
            largest[i] = max(largest[i], s)
            top = max(top, s)
    return top


@kernel
def add_frames(x, y, origin, first, width, node, bins, record):
    """Add a block of frames to the sums.

    Parameters
    ----------
    x, y : (B, n d)
        Places in both files, NaN where missing.
    origin : (n d,)
        First places in the reference, NaN until seen; filled in here.
    first : int
        Number of the first frame of the block.
    width : int
        Frames in a bin.
    node : (4, n)
        Sum of squared deviations, that of the bin at hand, number of terms, largest square.
    bins : (K, 4)
        Sum of squares, largest square, sum of squared displacements, number of terms.
    record : (4,)
        Largest square, its frame, its node, largest mean square of a frame.
    """
    n = node.shape[1]
    d = x.shape[1] // n
    squares = np.empty(n * d)
    for b in range(x.shape[0]):
        row = (first + b) // width
        total, moved = _squares(x[b], y[b], origin, squares)
        if np.isfinite(total + moved):
            top = _whole_frame(squares, node[1], node[3], n, d)
            count = n
            for i in range(n):
                node[2, i] += 1.0
        else:
            total, moved, top, count = 0.0, 0.0, 0.0, 0
            for i in range(n):
                s, u = 0.0, 0.0
                for k in range(i * d, i * d + d):
                    s += squares[k]
                if np.isnan(s):
                    continue
                if np.isnan(origin[i * d]):
                    origin[i * d : i * d + d] = x[b, i * d : i * d + d]
                for k in range(i * d, i * d + d):
                    u += (x[b, k] - origin[k]) ** 2
                node[1, i] += s
                node[2, i] += 1.0
                node[3, i] = max(node[3, i], s)
                total += s
                moved += u
                top = max(top, s)
                count += 1
        bins[row, 0] += total
        bins[row, 1] = max(bins[row, 1], top)
        bins[row, 2] += moved
        bins[row, 3] += count
        if count and total > record[3] * count:
            record[3] = total / count
        if top > record[0]:
            record[0], record[1] = top, first + b
            best = -1.0
            for i in range(n):
                s = 0.0
                for k in range(i * d, i * d + d):
                    s += squares[k]
                if s > best:
                    best, record[2] = s, i
        if (first + b + 1) % width == 0:
            # Sums of sums: rounding then grows with the bins and not with the frames.
            node[0] += node[1]
            node[1] = 0.0


@loose_kernel
def _whole_moments(x, y, a, b, sums, cross):
    """Add points in three dimensions, all of them there."""
    x0 = x1 = x2 = y0 = y1 = y2 = xx = yy = 0.0
    c00 = c01 = c02 = c10 = c11 = c12 = c20 = c21 = c22 = 0.0
    for i in range(x.shape[0] // 3):
        p, q, r = x[3 * i] - a[0], x[3 * i + 1] - a[1], x[3 * i + 2] - a[2]
        u, v, w = y[3 * i] - b[0], y[3 * i + 1] - b[1], y[3 * i + 2] - b[2]
        x0, x1, x2 = x0 + p, x1 + q, x2 + r
        y0, y1, y2 = y0 + u, y1 + v, y2 + w
        xx += p * p + q * q + r * r
        yy += u * u + v * v + w * w
        c00, c01, c02 = c00 + p * u, c01 + p * v, c02 + p * w
        c10, c11, c12 = c10 + q * u, c11 + q * v, c12 + q * w
        c20, c21, c22 = c20 + r * u, c21 + r * v, c22 + r * w
    sums[:8] = x0, x1, x2, y0, y1, y2, xx, yy
    cross[0] = c00, c01, c02
    cross[1] = c10, c11, c12
    cross[2] = c20, c21, c22


@kernel
def add_moments(x, y, origins, sums, cross):
    """Add pairs of points to the moments that a rigid motion is found from.

    Parameters
    ----------
    x, y : (B, n, d)
        NaN where missing.
    origins : (2, d)
        What x and y are counted from: far from it products lose the digits of the shape.
    sums : (2 d + 3,)
        Sum of x, sum of y, sum of |x|^2, sum of |y|^2, number of pairs.
    cross : (d, d)
        Sum of x_a y_b.
    """
    d = x.shape[2]
    part, corner = np.zeros(2 * d + 3), np.zeros((d, d))
    for b in range(x.shape[0]):
        if d == 3:
            _whole_moments(x[b].reshape(-1), y[b].reshape(-1), origins[0], origins[1], part, corner)
            if np.isfinite(part[6] + part[7]):
                part[8] = x.shape[1]
                sums += part
                cross += corner
                continue
        for i in range(x.shape[1]):
            known = 0.0
            for k in range(d):
                known += x[b, i, k] + y[b, i, k]
            if np.isnan(known):
                continue
            for k in range(d):
                p, q = x[b, i, k] - origins[0, k], y[b, i, k] - origins[1, k]
                sums[k] += p
                sums[d + k] += q
                sums[2 * d] += p * p
                sums[2 * d + 1] += q * q
                for m in range(d):
                    cross[k, m] += p * (y[b, i, m] - origins[1, m])
            sums[2 * d + 2] += 1.0


@loose_kernel
def centre_columns(rows, window):
    """Subtract the mean of every row and multiply by the window: (C, L) and (L,)."""
    length = rows.shape[1]
    for c in range(rows.shape[0]):
        total = 0.0
        for k in range(length):
            total += rows[c, k]
        mean = total / length
        for k in range(length):
            rows[c, k] = (rows[c, k] - mean) * window[k]


@loose_kernel
def add_powers(a, b, powers, cross):
    """Add ``|a|^2``, ``|b|^2`` and ``conj(a) b``: all (C, F)."""
    for c in range(a.shape[0]):
        for f in range(a.shape[1]):
            p, q, r, s = a[c, f].real, a[c, f].imag, b[c, f].real, b[c, f].imag
            powers[0, c, f] += p * p + q * q
            powers[1, c, f] += r * r + s * s
            cross[c, f] += complex(p * r + q * s, p * s - q * r)


@kernel
def combine(rows, first, weights, out):
    """Add weighted rows: ``out[p] += sum_k weights[p, k] rows[first[p] + k]``.

    Parameters
    ----------
    rows : (R, C)
    first : (P,) int
    weights : (P, K)
    out : (P, C)
    """
    for p in range(out.shape[0]):
        for k in range(weights.shape[1]):
            w = weights[p, k]
            source = rows[first[p] + k]
            target = out[p]
            for c in range(out.shape[1]):
                target[c] += w * source[c]


@kernel
def move_rigidly(y, turn, shift):
    """Replace every point by ``turn y + shift``.

    Parameters
    ----------
    y : (B, n, d)
    turn : (d, d)
        Rotation times scale.
    shift : (n, d)
    """
    d = y.shape[2]
    for b in range(y.shape[0]):
        for i in range(y.shape[1]):
            if d == 3:
                p, q, r = y[b, i, 0], y[b, i, 1], y[b, i, 2]
                y[b, i, 0] = turn[0, 0] * p + turn[0, 1] * q + turn[0, 2] * r + shift[i, 0]
                y[b, i, 1] = turn[1, 0] * p + turn[1, 1] * q + turn[1, 2] * r + shift[i, 1]
                y[b, i, 2] = turn[2, 0] * p + turn[2, 1] * q + turn[2, 2] * r + shift[i, 2]
            else:
                p, q = y[b, i, 0], y[b, i, 1]
                y[b, i, 0] = turn[0, 0] * p + turn[0, 1] * q + shift[i, 0]
                y[b, i, 1] = turn[1, 0] * p + turn[1, 1] * q + shift[i, 1]
