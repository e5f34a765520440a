"""Orthonormal polynomials of the input, evaluated once per sample.

Targets are products of these rows, so no polynomial is ever evaluated twice.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError

Basis = Literal["empirical", "legendre", "hermite"]

#: A polynomial whose new direction is below this fraction of its size adds nothing but
#: rounding: the input has no more distinct values. Values closer than this fraction of the
#: spread of the input count as one.
_NO_NEW_DIRECTION = 1e-6


def polynomial_rows(
    u: NDArray[np.float64], *, max_degree: int, basis: Basis = "empirical"
) -> NDArray[np.float64]:
    """Return polynomials of degree 1 up to `max_degree` of an input, one row per degree.

    ``empirical``: orthonormal under the distribution of the samples themselves, by the
    discrete Stieltjes procedure (Gautschi 2004, Orthogonal Polynomials, section 2.2.3.1) with
    one pass of reorthogonalisation. An input with M distinct values has polynomials up to
    degree M - 1, so there may be fewer rows than asked for: a binary input has one.

    ``legendre``: ``sqrt(2n+1) P_n`` of the input brought to [-1, 1] by its extremes, as in
    Dambre et al. 2012 (doi:10.1038/srep00514); orthonormal for a uniform input only.

    ``hermite``: ``He_n / sqrt(n!)`` of the input at zero mean and unit variance; orthonormal
    for a normal input only.

    Parameters
    ----------
    u : (T,)
    max_degree : int
    basis : {"empirical", "legendre", "hermite"}

    Returns
    -------
    (M, T)
        Row n - 1 has degree n; M <= max_degree.

    Raises
    ------
    TaskError
        When the input is constant, or the basis is unknown.
    """
    spread = float(u.std())
    if not spread > 8.0 * np.finfo(np.float64).eps * float(np.abs(u).max(initial=0.0)):
        raise TaskError(
            "the input does not vary",
            expected="a drive",
            fix="choose another column of the input",
            key="u",
        )
    if basis == "empirical":
        return _stieltjes((u - u.mean()) / spread, max_degree)
    if basis == "legendre":
        least, most = float(u.min()), float(u.max())
        return _legendre(2.0 * (u - least) / (most - least) - 1.0, max_degree)
    if basis == "hermite":
        return _hermite((u - u.mean()) / spread, max_degree)
    raise TaskError(
        f"the basis is {basis!r}",
        expected="empirical, legendre or hermite",
        fix="choose one of these",
        key="basis",
    )


def _stieltjes(x: NDArray[np.float64], max_degree: int) -> NDArray[np.float64]:
    n = len(x)
    rows = np.empty((max_degree + 1, n))
    rows[0] = 1.0
    for degree in range(max_degree):
        product = x * rows[degree]
        size = float(np.sqrt(product @ product / n))
        # Of all earlier polynomials, not just the last two: the recurrence alone loses
        # orthogonality on discrete distributions.
        for _ in range(2):
            earlier = rows[: degree + 1]
            product -= (earlier @ product / n) @ earlier
        norm = float(np.sqrt(product @ product / n))
        if norm <= _NO_NEW_DIRECTION * size:
            return rows[1 : degree + 1]
        rows[degree + 1] = product / norm
    return rows[1:]


def _legendre(x: NDArray[np.float64], max_degree: int) -> NDArray[np.float64]:
    """(n+1) P_{n+1} = (2n+1) x P_n - n P_{n-1}; DLMF 18.9.1."""
    rows = np.empty((max_degree + 1, len(x)))
    rows[0] = 1.0
    rows[1] = x
    for n in range(1, max_degree):
        rows[n + 1] = ((2 * n + 1) * x * rows[n] - n * rows[n - 1]) / (n + 1)
    degrees = np.arange(1, max_degree + 1)
    return rows[1:] * np.sqrt(2 * degrees + 1)[:, None]


def _hermite(x: NDArray[np.float64], max_degree: int) -> NDArray[np.float64]:
    """sqrt(n+1) h_{n+1} = x h_n - sqrt(n) h_{n-1} for h_n = He_n / sqrt(n!)."""
    rows = np.empty((max_degree + 1, len(x)))
    rows[0] = 1.0
    rows[1] = x
    for n in range(1, max_degree):
        rows[n + 1] = (x * rows[n] - np.sqrt(n) * rows[n - 1]) / np.sqrt(n + 1)
    return rows[1:]
