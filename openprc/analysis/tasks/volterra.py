"""A Volterra system of second order: memory and nonlinearity in one filter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.tasks.scoring import Metric
from openprc.analysis.tasks.series import TargetSeries
from openprc.analysis.tasks.task import ImitationTask, input_symbols, positive_number
from openprc.errors import TaskError


@dataclass(frozen=True)
class VolterraTask(ImitationTask):
    """Square of what a Gaussian window sees of the past, as a Volterra series.

    ``y(t) = sum_ij h(s_i, s_j) u(t - s_i) u(t - s_j) dt^2`` with a Gaussian kernel in both
    lags. The kernel is a product of two functions of one lag each, so the double sum is the
    product of two convolutions, exactly. The kernel is scaled to a sum of one, which no
    normalised error notices.

    Parameters
    ----------
    dt : float [s]
        Time between rows.
    mean : float [s]
        Lag that the window is centred on.
    width : float [s]
        Its standard deviation.
    support : float [s]
        Longest lag; the rows before it are left out, since they would need earlier input.
    """

    dt: float = 0.001
    mean: float = 0.1
    width: float = 0.05
    support: float = 0.2
    metric: ClassVar[Metric] = "nrmse"
    name: ClassVar[str] = "volterra2"
    source: ClassVar[str] = (
        "second-order Volterra series with Gaussian kernel after Hauser et al. 2011, "
        "doi:10.1007/s00422-012-0471-0"
    )

    def __post_init__(self) -> None:
        for key in ("dt", "width", "support"):
            positive_number(getattr(self, key), key)
        positive_number(self.mean, "mean", zero=True)
        if not self.n_warmup:
            raise TaskError(
                f"the support of {self.support:g} s is shorter than a row of {self.dt:g} s",
                expected="at least one row of memory",
                fix="lengthen mean, width and support together, or shorten dt",
                key="support",
            )

    @property
    def formula(self) -> str:
        """The double sum and the kernel."""
        return (
            "y(t) = sum_ij h(s_i) h(s_j) u(t-s_i) u(t-s_j), "
            f"h(s) ~ exp(-(s - {self.mean:g})^2 / (2 {self.width:g}^2)) for s in "
            f"[0, {self.support:g}] s, sum h = 1"
        )

    @property
    def n_warmup(self) -> int:
        """Whole rows in the longest lag."""
        return math.floor(self.support / self.dt + 1e-9)

    def kernel(self) -> NDArray[np.float64]:
        """Return h at the lags 0, dt, ..., support, (n_warmup + 1,), with sum one."""
        lags = self.dt * np.arange(self.n_warmup + 1)
        exponent = -((lags - self.mean) ** 2) / (2.0 * self.width**2)
        # Taken relative to the largest, so that a narrow window does not underflow.
        h = np.exp(exponent - exponent.max())
        return h / h.sum()

    def target(self, u: ArrayLike) -> TargetSeries:
        """Return one output per column of the input, (K, C)."""
        values = input_symbols(u)
        h, start = self.kernel(), self.n_warmup
        y = np.full_like(values, np.nan)
        if len(values) > start:
            for column in range(values.shape[1]):
                y[start:, column] = np.convolve(values[:, column], h, mode="valid") ** 2
        return TargetSeries(y, n_warmup=start)
