"""Linear dependence of channels on an input: at once, later, one by one and all together."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.correlation.canonical import (
    CCAResult,
    canonical_correlations,
    orthonormal_basis,
    total_under,
)
from openprc.analysis.correlation.channels import as_input, as_scalar_input, as_states
from openprc.analysis.correlation.cross_correlation import (
    correlation_at,
    cross_correlation,
    pearson,
)
from openprc.analysis.correlation.effective_size import (
    correlation_p_values,
    critical_correlation,
    pair_sizes,
)
from openprc.analysis.correlation.partial import RIDGE, partial_correlation
from openprc.analysis.correlation.result import Result
from openprc.analysis.correlation.surrogates import Shifts, shifts_of
from openprc.errors import TaskError

Array = NDArray[np.float64]

#: Lags are swept so far unless the caller says otherwise, or up to a quarter of the rows.
MOST_LAGS = 500


class Linear:
    """Linear dependence between an input and channels.

    Parameters
    ----------
    u : (T,) or (T, C)
        The input, one row per row of the states; several columns are for `cca` only.
    X : (T, N)
        The states, one column per channel. The first axis is time.
    names : sequence of str, optional
        Of the channels, as a feature's ``names(loader)`` gives them.
    lag_sweep : bool
        Compute `ccf` at once instead of when it is first read.
    max_lag : int, optional
        Largest lag of `ccf` and `peak` [rows]; by default a quarter of the rows, at most 500.
    dt : float, optional [s]
        Time between rows, so that plots show lags in seconds.

    Raises
    ------
    TaskError
        When the arrays do not fit, hold NaN, or the input never changes.
    """

    def __init__(
        self,
        u: Any,
        X: Any,
        *,
        names: Sequence[str] | None = None,
        lag_sweep: bool = False,
        max_lag: int | None = None,
        dt: float | None = None,
    ) -> None:
        self._channels = as_states(X, key="X", names=names)
        self._rows = self._channels.rows[self._channels.kept]
        self._inputs = as_input(u, n_rows=self._channels.n_rows, key="u")
        self.max_lag = checked_lag(max_lag, n_rows=self._channels.n_rows)
        self.dt = dt
        if lag_sweep:
            _ = self.ccf

    @property
    def dropped(self) -> tuple[str, ...]:
        """Names of the constant channels, whose values are NaN."""
        return self._channels.dropped

    @cached_property
    def pearson(self) -> Result:
        """Pearson's r at lag 0, (N,).

        p-values are those of Student's t with the number of independent samples that the
        autocorrelations of both series leave; see `effective_size.pair_sizes`.
        """
        r = pearson(self._u, self._rows)
        return self._result(
            "pearson",
            "Pearson r",
            r,
            p=correlation_p_values(r, self._sizes),
            threshold=critical_correlation(self._sizes),
        )

    @cached_property
    def ccf(self) -> Result:
        """Cross-correlation at lags -max_lag to max_lag, (N, 2 max_lag + 1).

        A channel that follows the input later peaks at a positive lag. p-values are those of
        each lag by itself.
        """
        values = cross_correlation(self._u, self._rows, max_lag=self.max_lag)
        return self._result(
            "ccf",
            "cross-correlation",
            values,
            p=correlation_p_values(values, self._sizes[:, None]),
            lags=np.arange(-self.max_lag, self.max_lag + 1),
            threshold=critical_correlation(self._sizes),
        )

    @cached_property
    def peak(self) -> Result:
        """Pearson's r at the lag where the cross-correlation is largest, (N,), and that lag.

        r is that of the rows which both series have at that lag. p-values are Bonferroni's over
        the lags that were searched.
        """
        profile = self.ccf.values[self._channels.kept]
        lags = np.argmax(np.abs(profile), axis=1) - self.max_lag
        r = np.array(
            [correlation_at(self._u, x, lag=int(k)) for x, k in zip(self._rows, lags, strict=True)]
        )
        left = 1.0 - np.abs(lags) / self._channels.n_rows
        every = np.zeros(len(self._channels.names), dtype=np.int64)
        every[self._channels.kept] = lags
        n_lags = 2 * self.max_lag + 1
        return self._result(
            "peak",
            "r at the peak lag",
            r,
            p=np.minimum(n_lags * correlation_p_values(r, self._sizes * left), 1.0),
            lags=every,
            notes=(f"p-values allow for a search over {n_lags} lags.",),
        )

    @cached_property
    def partial(self) -> Result:
        """Correlation of two channels given all others, (N, N), from the precision matrix.

        The input plays no part in it. With a singular correlation matrix (see `notes`) a small
        ridge is added and there are no p-values.
        """
        found = partial_correlation(self._rows)
        n_kept = len(self._rows)
        notes, p = [], np.full(found.values.shape, np.nan)
        sizes = None
        if found.regularized:
            notes.append(
                f"The correlation matrix of {n_kept} channels has rank {found.rank}, or nearly so:"
                f" {RIDGE:.1e} of its largest eigenvalue was added to the diagonal, and there are"
                " no p-values."
            )
        else:
            # Removing slow channels takes slow parts of the others along, so that residuals
            # alone seem worth more samples than they are.
            sizes = np.minimum(
                pair_sizes(found.residuals, found.residuals), pair_sizes(self._rows, self._rows)
            )
            p = correlation_p_values(found.values, sizes, conditioned=max(n_kept - 2, 0))
            np.fill_diagonal(p, np.nan)
            sizes = self._channels.spread(self._channels.spread(sizes).T)
        return Result(
            method="partial",
            label="partial correlation",
            names=self._channels.names,
            values=self._channels.spread(self._channels.spread(found.values).T),
            tested=None if found.regularized else self._channels.spread(self._channels.spread(p).T),
            n_effective=sizes,
            dropped=self.dropped,
            notes=tuple(notes),
        )

    def cca(self, *, n_surrogates: int = 199, seed: int = 0) -> CCAResult:
        """Return canonical correlations of input and channels; for one input the multiple R.

        Their squares are the in-sample R^2 of the best linear readout of the input (of its
        canonical variates), and grow with the number of channels whether they tell anything or
        not: compare with `CCAResult.adjusted`, and see the p-value. The p-value, one for all
        pairs, is that of the sum of squares under circular shifts of the input.

        Parameters
        ----------
        n_surrogates : int
            Number of shifts.
        seed : int
            Of the generator that draws them.

        Raises
        ------
        TaskError
            When the channels span as many directions as there are rows: any input is a
            combination of them.
        """
        inputs = orthonormal_basis(self._inputs.rows)
        channels = orthonormal_basis(self._rows)
        n = self._channels.n_rows
        if channels.rank >= n - 1:
            raise TaskError(
                f"the channels span {channels.rank} directions in {n} rows",
                expected="fewer directions than rows less one, or every input fits exactly",
                fix="record longer, or leave channels out",
                key="X",
            )
        r, into, out = canonical_correlations(inputs, channels)
        pairs = [shift for u in self._inputs.rows for shift in shifts_of(u, self._rows)]
        moves = Shifts(
            n,
            int(np.median([pair.least for pair in pairs])),
            float(np.median([pair.alike for pair in pairs])),
        )
        drawn = moves.draw(n_surrogates, np.random.default_rng(seed))
        orders = (np.arange(n) + drawn[:, None]) % n
        p = moves.p_value(float(np.sum(r**2)), total_under(inputs, channels, orders))
        adjusted = np.full(len(r), np.nan)
        if len(self._inputs.rows) == 1:
            adjusted = 1.0 - (1.0 - r**2) * (n - 1) / (n - 1 - channels.rank)
        chance = channels.rank / (n - 1)
        return CCAResult(
            method="cca",
            label="canonical correlation",
            names=tuple(f"pair {k + 1}" for k in range(len(r))),
            values=r,
            tested=np.full(len(r), p),
            dropped=self.dropped,
            notes=(
                f"In-sample: {channels.rank} channels without any relation to a white input reach"
                f" R^2 = {chance:.3g} on average.",
                f"One p-value for all pairs, from {len(drawn)} circular shifts.",
            ),
            bounds=(0.0, 1.0),
            input_weights=into,
            channel_weights=self._channels.spread(out),
            channel_names=self._channels.names,
            rank=channels.rank,
            adjusted=adjusted,
        )

    def __repr__(self) -> str:
        """Show the sizes."""
        return f"Linear({len(self._channels.names)} channels, {self._channels.n_rows} rows)"

    @cached_property
    def _u(self) -> Array:
        return as_scalar_input(self._inputs.rows.T, n_rows=self._channels.n_rows, key="u")

    @cached_property
    def _sizes(self) -> Array:
        return pair_sizes(self._u[None], self._rows)[0]

    def _result(
        self,
        method: str,
        label: str,
        values: Array,
        *,
        p: Array,
        lags: NDArray[np.int64] | None = None,
        threshold: Array | None = None,
        notes: tuple[str, ...] = (),
    ) -> Result:
        spread = self._channels.spread
        sizes = spread(self._sizes)
        return Result(
            method=method,
            label=label,
            names=self._channels.names,
            values=spread(values),
            tested=spread(p),
            lags=lags,
            dt=self.dt,
            n_effective=sizes if values.ndim == 1 else sizes[:, None],
            threshold=None if threshold is None else spread(threshold),
            dropped=self.dropped,
            notes=notes,
        )


def checked_lag(max_lag: int | None, *, n_rows: int) -> int:
    """Return the largest lag [rows].

    Raises
    ------
    TaskError
        When it is negative, or leaves fewer than two rows.
    """
    if max_lag is None:
        return min(n_rows // 4, MOST_LAGS)
    if not 0 <= max_lag <= n_rows - 2:
        raise TaskError(
            f"max_lag is {max_lag}",
            expected=f"0 to {n_rows - 2}, with {n_rows} rows",
            fix="choose a lag well below the number of rows",
            key="max_lag",
        )
    return int(max_lag)
