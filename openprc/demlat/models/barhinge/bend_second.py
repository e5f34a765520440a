"""Second derivatives of the bend of one hinge, compiled."""

from __future__ import annotations

import math
from typing import Any

from openprc.demlat.compiled.jit import jit

#: Pairs of a hinge's nodes j, k, i, l, the later one first.
PAIRS = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2), (3, 0), (3, 1), (3, 2), (3, 3))


@jit
def _cross_times(out: Any, row: int, scale: float, n: Any, square: float, u: Any) -> None:
    """Set ``out[row]`` to ``scale (I - 2 n n^T / square) [u]x``."""
    for c in range(3):
        # Column c of the cross product's matrix: u x e_c.
        w0 = -u[2] if c == 1 else (u[1] if c == 2 else 0.0)
        w1 = u[2] if c == 0 else (-u[0] if c == 2 else 0.0)
        w2 = -u[1] if c == 0 else (u[0] if c == 1 else 0.0)
        along = 2.0 * (n[0] * w0 + n[1] * w1 + n[2] * w2) / square
        out[row, 0, c] = scale * (w0 - along * n[0])
        out[row, 1, c] = scale * (w1 - along * n[1])
        out[row, 2, c] = scale * (w2 - along * n[2])


@jit
def edge(x: Any, stride: int, p: int, q: int) -> Any:
    """Return the vector from node q to node p."""
    return x[p] - x[q], x[stride + p] - x[stride + q], x[2 * stride + p] - x[2 * stride + q]


@jit
def _cross(u: Any, w: Any) -> Any:
    return (
        u[1] * w[2] - u[2] * w[1],
        u[2] * w[0] - u[0] * w[2],
        u[0] * w[1] - u[1] * w[0],
    )


@jit
def _dot(u: Any, w: Any) -> float:
    return u[0] * w[0] + u[1] * w[1] + u[2] * w[2]


@jit
def bend_second(a: Any, b: Any, c: Any, out: Any) -> None:
    """Set `out` (5, 3, 3) to second derivatives of the bend by edges: aa, ab, bb, cb, cc.

    With ``a = x_i - x_j``, ``b = x_k - x_j``, ``c = x_k - x_l``, ``m = a x b``, ``n = b x c``
    the gradients are ``|b| m / m.m`` by a, ``|b| n / n.n`` by c and minus a.b / b.b and
    c.b / b.b times those by b; differentiated once more. They agree with Tamstorf & Grinspun
    2013, doi:10.1016/j.gmod.2013.07.001.
    """
    m, n = _cross(a, b), _cross(b, c)
    bb, mm, nn = _dot(b, b), _dot(m, m), _dot(n, n)
    crease = math.sqrt(bb)
    p, q = _dot(a, b) / bb, _dot(c, b) / bb
    _cross_times(out, 0, -crease / mm, m, mm, b)
    _cross_times(out, 1, crease / mm, m, mm, a)
    _cross_times(out, 3, -crease / nn, n, nn, c)
    _cross_times(out, 4, crease / nn, n, nn, b)
    for r in range(3):
        for s in range(3):
            out[1, r, s] += m[r] / mm * b[s] / crease
            out[3, r, s] += n[r] / nn * b[s] / crease
            by_p = crease / mm * m[r] * (a[s] - 2.0 * p * b[s]) / bb
            by_q = crease / nn * n[r] * (c[s] - 2.0 * q * b[s]) / bb
            out[2, r, s] = -(by_p + p * out[1, r, s] + by_q + q * out[3, r, s])


@jit
def pair_second(s: Any, pair: int, r: int, c: int) -> float:
    """Return an entry of the second derivative by the two nodes of a pair, from `bend_second`."""
    if pair == 0:  # j, j
        return s[0, r, c] + s[1, r, c] + s[1, c, r] + s[2, r, c]
    if pair == 1:  # k, j
        return -s[1, c, r] - s[2, c, r] - s[3, r, c]
    if pair == 2:  # k, k
        return s[2, r, c] + s[3, r, c] + s[3, c, r] + s[4, r, c]
    if pair == 3:  # i, j
        return -s[0, r, c] - s[1, r, c]
    if pair == 4:  # i, k
        return s[1, r, c]
    if pair == 5:  # i, i
        return s[0, r, c]
    if pair == 6:  # l, j
        return s[3, r, c]
    if pair == 7:  # l, k
        return -s[3, r, c] - s[4, r, c]
    if pair == 8:  # l, i
        return 0.0
    return s[4, r, c]
