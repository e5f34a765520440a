"""What a metric returns: values with their p-values, ready to test, export and plot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError

if TYPE_CHECKING:
    import pandas as pd

    from openprc.analysis.visualization.figure import Plot

Array = NDArray[np.float64]
Correction = Literal["fdr", "bonferroni"]
PlotKind = Literal["bar", "heatmap", "lag_profile"]


@dataclass(frozen=True, kw_only=True)
class Result:
    """Values of one metric.

    Attributes
    ----------
    method : str
        Name of the metric, such as ``"pearson"``.
    label : str
        What an axis says, such as ``"Pearson r"``.
    names : tuple of str
        Of the N channels, or of whatever axis 0 of the values counts.
    values : (N,), (N, N) or (N, 2L + 1) float64
        By channel, by pair of channels, or by channel and lag. NaN for constant channels.
    lags : (N,) or (2L + 1,) int64, optional [rows]
        Of each channel, or of each column.
    dt : float, optional [s]
        Time between rows, for the axis of lags.
    n_effective : float64 array, optional
        How many independent samples each value is worth; it broadcasts to the values.
    threshold : (N,) float64, optional
        The value that a channel without dependence passes with probability 5 % at one lag.
    dropped : tuple of str
        Names of the constant channels.
    notes : tuple of str
        What should be known about these values, one sentence each.
    bounds : (float, float)
        Smallest and largest value that the metric can take.
    """

    method: str
    label: str
    names: tuple[str, ...]
    values: Array
    tested: Array | Callable[[], Array] | None = field(default=None, repr=False)
    lags: NDArray[np.int64] | None = None
    dt: float | None = None
    n_effective: Array | None = None
    threshold: Array | None = None
    dropped: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    bounds: tuple[float, float] = (-1.0, 1.0)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the values."""
        return self.values.shape

    @property
    def is_matrix(self) -> bool:
        """Whether the values belong to pairs of the same channels."""
        return self.values.ndim == 2 and not self.is_profile

    @property
    def is_profile(self) -> bool:
        """Whether the columns are lags."""
        return self.values.ndim == 2 and self.lags is not None

    @property
    def has_test(self) -> bool:
        """Whether there are p-values."""
        return self.tested is not None

    @property
    def is_costly(self) -> bool:
        """Whether p-values are drawn from surrogates when they are first read."""
        return callable(self.tested)

    @cached_property
    def p_values(self) -> Array:
        """p-values in the shape of the values, uncorrected. NaN where there is no test.

        Raises
        ------
        TaskError
            When the metric has no test.
        """
        if self.tested is None:
            raise TaskError(
                f"{self.method} has no p-values",
                expected="a metric with a test",
                fix=" ".join(self.notes) or "test another metric of the same channels",
                key=self.method,
            )
        return self.tested() if callable(self.tested) else self.tested

    def corrected(self, correction: Correction | None = "fdr") -> Array:
        """Return p-values corrected for the number of tests made.

        Pairs of channels count once, tests of constant channels not at all.

        Parameters
        ----------
        correction : {"fdr", "bonferroni", None}
            Benjamini and Hochberg's false discovery rate, which holds for metrics that are
            positively dependent (https://doi.org/10.1214/aos/1013699998); Bonferroni's bound of
            any false discovery; or none.

        Raises
        ------
        TaskError
            When the metric has no test, or there is no such correction.
        """
        if correction not in ("fdr", "bonferroni", None):
            raise TaskError(
                f"correction is {correction!r}",
                expected="fdr, bonferroni or None",
                fix='leave "fdr" unless a single false discovery is one too many',
                key="correction",
            )
        p = self.p_values
        if correction is None:
            return p.copy()
        counted = np.isfinite(p)
        if self.is_matrix:
            counted &= np.triu(np.ones(p.shape, dtype=bool), 1)
        found = np.full(p.shape, np.nan)
        if counted.any():
            if correction == "fdr":
                from scipy import stats

                found[counted] = stats.false_discovery_control(p[counted], method="bh")
            else:
                found[counted] = np.minimum(p[counted] * np.count_nonzero(counted), 1.0)
        return np.where(np.isnan(found), found.T, found) if self.is_matrix else found

    def significant(
        self, alpha: float = 0.05, *, correction: Correction | None = "fdr"
    ) -> NDArray[np.bool_]:
        """Return which values are too large for chance, in the shape of the values.

        Values without a test, such as those of constant channels, are not significant.

        Parameters
        ----------
        alpha : float
            Accepted share (``"fdr"``) or probability of false discoveries.
        correction : {"fdr", "bonferroni", None}
            See `corrected`.

        Raises
        ------
        TaskError
            As `corrected`; when `alpha` is not between 0 and 1.
        """
        if not 0.0 < alpha < 1.0:
            raise TaskError(
                f"alpha is {alpha!r}",
                expected="a probability between 0 and 1",
                fix="choose one such as 0.05",
                key="alpha",
            )
        # A comparison with NaN is false.
        return np.asarray(self.corrected(correction) <= alpha)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Return the values, for NumPy's functions."""
        return np.array(self.values, dtype=dtype, copy=copy)

    def __len__(self) -> int:
        """Return the number of channels."""
        return len(self.names)

    def __getitem__(self, name: str) -> Any:
        """Return the value, or the row of values, of the channel of that name."""
        if name not in self.names:
            raise TaskError(
                f"there is no channel {name!r}",
                expected="one of " + ", ".join(self.names[:20]),
                fix="correct the name, or index .values by number",
                key="name",
            )
        return self.values[self.names.index(name)]

    def __str__(self) -> str:
        """Say what was found."""
        values = np.abs(self.values)
        lines = [f"{self.label}: {len(self.names)} channels"]
        if np.isfinite(values).any():
            where = np.unravel_index(np.nanargmax(values), values.shape)
            lines[0] += f", largest {self.values[where]:.4g} ({self.names[where[0]]})"
        if self.dropped:
            lines.append("constant: " + ", ".join(self.dropped))
        return "\n".join([*lines, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, NaN as None, with p-values where there is a test."""
        from openprc.analysis.correlation.export import as_dict  # noqa: PLC0415 - tables use results

        return as_dict(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return a pandas table: channels as rows; or lags as rows and channels as columns.

        Raises
        ------
        MissingDependency
            When pandas is not installed.
        """
        from openprc.analysis.correlation.export import as_dataframe  # noqa: PLC0415 - tables use results

        return as_dataframe(self)

    def to_latex(self, *, caption: str = "", label: str = "", digits: int = 3) -> str:
        """Return a LaTeX table, which needs no packages: of profiles, each channel's peak.

        Parameters
        ----------
        caption, label : str
            With a caption the table is a float.
        digits : int
            Decimals of the values.
        """
        from openprc.analysis.correlation.export import as_latex  # noqa: PLC0415 - tables use results

        return as_latex(self, caption=caption, label=label, digits=digits)

    def plot(self, kind: PlotKind | None = None, *, alpha: float | None = None) -> Plot:
        """Draw the values and return the figure with ``save()``; no window opens.

        Parameters
        ----------
        kind : {"bar", "heatmap", "lag_profile"}, optional
            By default what suits the shape: a value a channel, a matrix, a value a lag.
        alpha : float, optional
            Mark what is significant at this level, corrected for the false discovery rate. By
            default 0.05 where p-values cost nothing, and no marks where surrogates would have
            to be drawn.

        Raises
        ------
        TaskError
            When the values cannot be drawn that way.
        MissingDependency
            When matplotlib is not installed.
        """
        from openprc.analysis.correlation.pictures import draw  # noqa: PLC0415 - pictures use results

        return draw(self, kind=kind, alpha=alpha)
