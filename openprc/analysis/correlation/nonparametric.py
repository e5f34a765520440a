"""Dependence of channels on an input that is not a straight line."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.correlation import surrogates
from openprc.analysis.correlation.channels import as_scalar_input, as_states
from openprc.analysis.correlation.distance import (
    DistanceCorrelations,
    DistanceSeries,
    chi2_p_value,
    distance_correlations,
    reordered,
)
from openprc.analysis.correlation.hsic import (
    KernelSeries,
    ShiftProfile,
    hsic,
    hsic_by_shift,
    hsic_reordered,
    kernel_correlation,
)
from openprc.analysis.correlation.linear import checked_lag
from openprc.analysis.correlation.ranks import (
    OrderedRanks,
    centred_ranks,
    circular_correlation,
    kendall_tau,
)
from openprc.analysis.correlation.result import Result
from openprc.analysis.correlation.surrogates import Null, Shifts, p_value, shifts_of
from openprc.errors import TaskError

Array = NDArray[np.float64]


class Nonparametric:
    """Monotonic and arbitrary dependence between an input and channels.

    p-values are drawn when they are first read. The test compares with what the same statistic
    is after one series has been reordered.

    Parameters
    ----------
    x : (T,)
        The input, one value per row of the channels.
    Y : (T, N)
        The channels. The first axis is time.
    names : sequence of str, optional
        Of the channels, as a feature's ``names(loader)`` gives them.
    null : {"shift", "block", "permutation", "chi2"}
        How series without dependence are made. Circular shifts keep the memory of both series,
        and are right for recordings, if these are stationary. Blocks of rows in random order
        keep most of the memory. Single rows in random order, and the chi-squared limit of
        `dcor` and `hsic`, take rows for independent of each other: **on a recording they call
        most channels dependent**; they are for white data.
    n_surrogates : int
        Reorderings drawn. `spearman` and `hsic` with shifts use all shifts instead. No p-value
        is below ``1 / (n_surrogates + 1)``, which a correction for N channels multiplies by up to
        N: with many channels of which few depend on the input, ask for more.
    max_lag : int, optional
        Largest lag of `hsic_profile` [rows]; by default a quarter of the rows, at most 500.
    dt : float, optional [s]
        Time between rows, so that plots show lags in seconds.
    seed : int
        Of the generator that draws; p-values of a channel do not depend on the others.

    Raises
    ------
    TaskError
        When the arrays do not fit, hold NaN, or the input never changes; when there is no such
        null or no surrogate is to be drawn.
    """

    def __init__(
        self,
        x: Any,
        Y: Any,
        *,
        names: Sequence[str] | None = None,
        null: Null = "shift",
        n_surrogates: int = 199,
        max_lag: int | None = None,
        dt: float | None = None,
        seed: int = 0,
    ) -> None:
        self._channels = as_states(Y, key="Y", names=names, prefix="y")
        self._rows = self._channels.rows[self._channels.kept]
        self._x = as_scalar_input(x, n_rows=self._channels.n_rows, key="x")
        surrogates.check_null(null)
        if n_surrogates < 1:
            raise TaskError(
                f"n_surrogates is {n_surrogates}",
                expected="at least 1; 19 for a test at 5 %",
                fix="leave 199",
                key="n_surrogates",
            )
        self.null = null
        self.n_surrogates = n_surrogates
        self.max_lag = checked_lag(max_lag, n_rows=self._channels.n_rows)
        self.dt = dt
        self.seed = seed

    @property
    def dropped(self) -> tuple[str, ...]:
        """Names of the constant channels, whose values are NaN."""
        return self._channels.dropped

    @cached_property
    def spearman(self) -> Result:
        """Spearman's rank correlation, (N,). The test is two-sided."""
        ranks = [centred_ranks(row) for row in self._rows]
        values = [_correlation(self._ranks, row) for row in ranks]

        def test(k: int) -> float:
            if self.null == "shift":
                profile = np.abs(circular_correlation(self._ranks, ranks[k]))
                return self._shifts[k].p_value(profile[0], profile[self._shifts[k].far()])
            drawn = [_correlation(self._ranks, ranks[k][order]) for order in self._orders(k)]
            return self._p_value(k, abs(values[k]), np.abs(drawn))

        return self._result("spearman", "Spearman rank correlation", values, test=test)

    @cached_property
    def kendall(self) -> Result:
        """Kendall's tau-b, (N,), which allows for ties. The test is two-sided."""
        prepared = OrderedRanks.of(self._x)
        values = [float(kendall_tau(prepared, row, [slice(None)])[0]) for row in self._rows]

        def test(k: int) -> float:
            drawn = kendall_tau(prepared, self._rows[k], self._orders(k))
            return self._p_value(k, abs(values[k]), np.abs(drawn))

        return self._result("kendall", "Kendall tau-b", values, test=test)

    @cached_property
    def dcor(self) -> Result:
        """Distance correlation, (N,), from 0 to 1: 0 in the limit only without any dependence.

        A finite recording scores above 0 in any case, see `notes`; `dcor_unbiased` does not.
        """
        floor = 1.78 / np.sqrt(self._channels.n_rows)
        return self._result(
            "dcor",
            "distance correlation",
            self._distance.biased,
            test=self._distance_test,
            bounds=(0.0, 1.0),
            notes=(
                f"Independent white Gaussian channels score about 1.78/sqrt(T) = {floor:.2g},"
                " slow ones more: see the p-values, or dcor_unbiased.",
            ),
        )

    @cached_property
    def dcor_unbiased(self) -> Result:
        """Squared distance correlation from U-centred distances, (N,); 0 on average without
        dependence on white data, and possibly negative.
        """
        values = self._distance.unbiased
        lone = [self._kept_names[k] for k in np.flatnonzero(np.isnan(values))]
        notes = (f"Undefined where a single row differs: {', '.join(lone)}.",) if lone else ()
        return self._result(
            "dcor_unbiased",
            "unbiased squared distance correlation",
            values,
            test=self._distance_test,
            notes=notes,
        )

    @cached_property
    def hsic(self) -> Result:
        """Hilbert-Schmidt independence criterion, (N,), biased estimator, at least 0.

        Gaussian kernels as wide as the median distance of two samples. Values compare channels
        with each other; they have no scale that says what is large.
        """
        values = [hsic(self._kernel, other) for other in self._kernels]

        def test(k: int) -> float:
            if self.null == "chi2":
                return chi2_p_value(kernel_correlation(self._kernel, self._kernels[k]), self._n)
            if self.null == "shift":
                profile = self._hsic_shifts(k).values
                return self._shifts[k].p_value(profile[0], profile[self._shifts[k].far()])
            drawn = hsic_reordered(self._kernel, self._kernels[k], self._orders(k))
            return self._p_value(k, values[k], drawn)

        return self._result(
            "hsic",
            "HSIC",
            values,
            test=test,
            bounds=(0.0, np.inf),
            notes=self._kernel_notes,
        )

    @cached_property
    def hsic_profile(self) -> Result:
        """HSIC of x(t) and y(t + lag) at lags -max_lag to max_lag, (N, 2 max_lag + 1).

        Series are continued around their ends. A channel that follows the input later peaks at a
        positive lag. p-values, each lag by itself, are those of a sum of squares with the
        variances found at shifts beyond the lags swept; see `hsic.ShiftProfile`.
        """
        lags = np.arange(-self.max_lag, self.max_lag + 1)
        values = np.empty((len(self._rows), len(lags)))
        p, threshold = np.empty_like(values), np.empty(len(values))
        for k in range(len(self._rows)):
            profile = self._hsic_shifts(k)
            values[k] = profile.values[lags]
            p[k] = profile.p_values(values[k])
            threshold[k] = profile.threshold
        spread = self._channels.spread
        return Result(
            method="hsic_profile",
            label="HSIC",
            names=self._channels.names,
            values=spread(values),
            tested=spread(p),
            lags=lags,
            dt=self.dt,
            threshold=spread(threshold),
            dropped=self.dropped,
            notes=self._kernel_notes,
            bounds=(0.0, np.inf),
        )

    def __repr__(self) -> str:
        """Show the sizes."""
        return f"Nonparametric({len(self._channels.names)} channels, {self._n} rows, {self.null})"

    @property
    def _n(self) -> int:
        return self._channels.n_rows

    @property
    def _kept_names(self) -> list[str]:
        return [self._channels.names[k] for k in self._channels.kept]

    @cached_property
    def _ranks(self) -> Array:
        return centred_ranks(self._x)

    @cached_property
    def _prepared(self) -> DistanceSeries:
        return DistanceSeries.of(self._x)

    @cached_property
    def _distance(self) -> DistanceCorrelations:
        return distance_correlations(self._prepared, self._rows)

    @cached_property
    def _kernel(self) -> KernelSeries:
        return KernelSeries.of(self._x)

    @cached_property
    def _kernels(self) -> list[KernelSeries]:
        return [KernelSeries.of(row) for row in self._rows]

    @cached_property
    def _kernel_notes(self) -> tuple[str, ...]:
        every = [("the input", self._kernel), *zip(self._kept_names, self._kernels, strict=True)]
        tied = [name for name, kernel in every if kernel.bandwidth.many_ties]
        if not tied:
            return ()
        return (
            "More than half of the pairs of samples are equal, and the kernel is as wide as the"
            f" median distance of the others: {', '.join(tied)}.",
        )

    @cached_property
    def _shifts(self) -> list[Shifts]:
        return shifts_of(self._x, self._rows)

    def _p_value(self, k: int, observed: float, drawn: Array) -> float:
        if self.null == "shift":
            return self._shifts[k].p_value(observed, drawn)
        return p_value(observed, drawn)

    def _orders(self, k: int) -> Iterator[NDArray[np.int64]]:
        if self.null == "chi2":
            raise TaskError(
                "the chi-squared limit is known for dcor and hsic",
                expected='null="shift" for rank correlations',
                fix='make Nonparametric(x, Y, null="shift")',
                key="null",
            )
        return surrogates.row_orders(
            self.null,
            self._shifts[k],
            count=self.n_surrogates,
            rng=np.random.default_rng((self.seed, k)),
        )

    def _distance_test(self, k: int) -> float:
        found = self._distance
        if self.null == "chi2":
            return chi2_p_value(float(found.unbiased[k]), self._n)
        drawn = reordered(self._prepared, self._rows[k], self._orders(k))
        return self._p_value(k, float(found.biased[k]), drawn)

    @cached_property
    def _shifted(self) -> dict[int, ShiftProfile]:
        return {}

    def _hsic_shifts(self, k: int) -> ShiftProfile:
        if k not in self._shifted:
            far = self._shifts[k].far(beyond=self.max_lag)
            self._shifted[k] = hsic_by_shift(self._kernel, self._kernels[k], far=far)
        return self._shifted[k]

    def _result(
        self,
        method: str,
        label: str,
        values: Sequence[float] | Array,
        *,
        test: Callable[[int], float],
        notes: tuple[str, ...] = (),
        bounds: tuple[float, float] = (-1.0, 1.0),
    ) -> Result:
        return Result(
            method=method,
            label=label,
            names=self._channels.names,
            values=self._channels.spread(np.asarray(values, dtype=np.float64)),
            tested=partial(self._tested, test),
            dropped=self.dropped,
            notes=notes,
            bounds=bounds,
        )

    def _tested(self, test: Callable[[int], float]) -> Array:
        p = np.array([test(k) for k in range(len(self._rows))], dtype=np.float64)
        return self._channels.spread(p)


def _correlation(a: Array, b: Array) -> float:
    return float(np.clip(a @ b / np.sqrt((a @ a) * (b @ b)), -1.0, 1.0))
