"""How many of the channels tell something that the others do not."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.correlation.channels import as_states
from openprc.analysis.correlation.effective_size import correlation_p_values, pair_sizes
from openprc.analysis.correlation.result import Result
from openprc.errors import TaskError

if TYPE_CHECKING:
    from openprc.analysis.dimension.spectra import SpectrumKind, StateSpectrum
    from openprc.analysis.visualization.figure import Plot

Array = NDArray[np.float64]


class Redundancy:
    """Structure of the channels among themselves.

    Constant channels belong to no group and count in no figure; `dropped` names them.

    Parameters
    ----------
    Y : (T, N)
        The channels. The first axis is time.
    names : sequence of str, optional
        Of the channels, as a feature's ``names(loader)`` gives them.

    Raises
    ------
    TaskError
        When the array holds NaN, or no channel changes.
    """

    def __init__(self, Y: Any, *, names: Sequence[str] | None = None) -> None:
        self._channels = as_states(Y, key="Y", names=names, prefix="y")
        self._rows = self._channels.rows[self._channels.kept]
        # As recorded: how far channels are from rank deficiency depends on how they are stored.
        self._states = np.asarray(Y).reshape(self._channels.n_rows, -1)

    @property
    def dropped(self) -> tuple[str, ...]:
        """Names of the constant channels."""
        return self._channels.dropped

    @cached_property
    def spectrum(self) -> StateSpectrum:
        """Spectrum of the correlation matrix of the channels that change."""
        from openprc.analysis.dimension.spectra import state_spectrum  # noqa: PLC0415 - heavy

        return state_spectrum(self._states)

    @property
    def rank(self) -> float:
        """Effective rank: exponential of the entropy of the eigenvalues; see `effective_rank`."""
        return self.effective_rank()

    def effective_rank(self, *, spectrum: SpectrumKind = "eigenvalues") -> float:
        """Return the exponential of the entropy of the normalised spectrum.

        Parameters
        ----------
        spectrum : {"eigenvalues", "singular"}
            Of the correlation matrix, or of the standardised states, as Roy and Vetterli 2007
            defined it. They are different numbers; see `dimension.spectra.effective_rank`.
        """
        return self.spectrum.effective_rank(spectrum=spectrum)

    @property
    def condition(self) -> float:
        """Largest over smallest eigenvalue of the correlation matrix.

        Infinite when a channel is a combination of others, such as a duplicate.
        """
        return self.spectrum.condition_number

    @property
    def numerical_rank(self) -> int:
        """Number of independent directions above rounding errors."""
        return self.spectrum.numerical_rank()

    @property
    def eigenvalues(self) -> Array:
        """Eigenvalues of the correlation matrix, descending; one for each channel that changes."""
        return self.spectrum.eigenvalues

    @cached_property
    def correlation(self) -> Result:
        """Pearson's r of every pair of channels, (N, N), with p-values as those of `Linear`."""
        r = self._r
        sizes = pair_sizes(self._rows, self._rows)
        p = correlation_p_values(r, sizes)
        np.fill_diagonal(p, np.nan)
        return Result(
            method="correlation",
            label="Pearson r",
            names=self._channels.names,
            values=self._square(r),
            tested=self._square(p),
            n_effective=self._square(sizes),
            dropped=self.dropped,
        )

    def groups(self, threshold: float = 0.9) -> list[list[int]]:
        """Return the channels in groups, by single linkage of \\|r\\|.

        Two channels are in one group when a chain of channels connects them, of which each
        correlates with the next by at least the threshold.

        Parameters
        ----------
        threshold : float
            Of the absolute correlation, from 0 to 1.

        Returns
        -------
        list of list of int
            Column numbers, the largest group first; channels on their own are groups of one.

        Raises
        ------
        TaskError
            When the threshold is out of range.
        """
        from scipy.cluster import hierarchy

        _check_threshold(threshold)
        kept = self._channels.kept
        if len(kept) == 1:
            return [[int(kept[0])]]
        # Correlations that ought to equal the threshold may miss it by rounding errors.
        labels = hierarchy.fcluster(self.linkage, 1.0 - threshold + 1e-12, criterion="distance")
        found = [kept[labels == label].tolist() for label in np.unique(labels)]
        return sorted(found, key=lambda group: (-len(group), group[0]))

    def groups_named(self, threshold: float = 0.9) -> list[list[str]]:
        """Return the groups by the names of their channels; see `groups`."""
        return [[self._channels.names[k] for k in group] for group in self.groups(threshold)]

    def representatives(self, threshold: float = 0.9) -> list[int]:
        """Return one channel of every group, in the order of the columns.

        It is the one whose correlations with the others of its group are largest on average.

        Parameters
        ----------
        threshold : float
            See `groups`.
        """
        size = np.abs(self._square(self._r))
        chosen = []
        for group in self.groups(threshold):
            chosen.append(group[int(np.argmax(size[np.ix_(group, group)].mean(axis=1)))])
        return sorted(chosen)

    @cached_property
    def linkage(self) -> Array:
        """Single linkage of the channels that change at distances ``1 - |r|``, (N - 1, 4)."""
        from scipy.cluster import hierarchy
        from scipy.spatial import distance

        apart = np.clip(1.0 - np.abs(self._r), 0.0, 1.0)
        np.fill_diagonal(apart, 0.0)
        condensed = distance.squareform(0.5 * (apart + apart.T), checks=False)
        return np.asarray(hierarchy.linkage(condensed, method="single"))

    def dendrogram(self, threshold: float = 0.9) -> Plot:
        """Draw how the channels join as the threshold falls, with groups at `threshold` marked.

        Raises
        ------
        TaskError
            When there are fewer than two channels, or the threshold is out of range.
        MissingDependency
            When matplotlib is not installed.
        """
        from openprc.analysis.correlation.pictures import draw_dendrogram  # noqa: PLC0415 - pictures use results

        _check_threshold(threshold)
        names = [self._channels.names[k] for k in self._channels.kept]
        if len(names) < 2:
            raise TaskError(
                "there is a single channel that changes",
                expected="two or more, which can be joined",
                fix="pass more channels",
                key="Y",
            )
        return draw_dendrogram(self.linkage, names, threshold=threshold)

    def __repr__(self) -> str:
        """Show the sizes."""
        return f"Redundancy({len(self._channels.names)} channels, {self._channels.n_rows} rows)"

    @cached_property
    def _r(self) -> Array:
        unit = self._rows / np.linalg.norm(self._rows, axis=1, keepdims=True)
        r = np.clip(unit @ unit.T, -1.0, 1.0)
        np.fill_diagonal(r, 1.0)
        return np.asarray(r)

    def _square(self, values: Array) -> Array:
        return self._channels.spread(self._channels.spread(values).T)


def _check_threshold(threshold: float) -> None:
    if not 0.0 <= threshold <= 1.0:
        raise TaskError(
            f"the threshold is {threshold!r}",
            expected="an absolute correlation from 0 to 1",
            fix="choose one such as 0.9",
            key="threshold",
        )
