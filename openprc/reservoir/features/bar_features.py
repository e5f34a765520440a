"""Lengths of bars as reservoir states: what strain sensors along the bars would read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from openprc.reservoir.features.base import Feature
from openprc.reservoir.io.state_loader import Origin, StateLoader


class BarLengths(Feature):
    """Bar lengths, in the unit of the file.

    Parameters
    ----------
    bar_ids : sequence of int, optional
        Which bars, from 0; all by default.
    """

    #: After the number of the bar, where the column is not its length.
    _suffix = ""

    def __init__(self, bar_ids: Sequence[int] | None = None) -> None:
        self.bar_ids = bar_ids

    def _transform(self, loader: StateLoader) -> NDArray[np.float64]:
        return loader.bar_lengths(self.bar_ids)

    def _names(self, loader: StateLoader) -> list[str]:
        bars = loader.check_ids(self.bar_ids, loader.n_bars, what="bar")
        return [f"bar{i}{self._suffix}" for i in bars]


class BarExtensions(BarLengths):
    """Bar lengths less the rest lengths: a length, not a strain.

    Parameters
    ----------
    bar_ids : sequence of int, optional
    origin : {"auto", "rest", "first"}
        Stored rest lengths where the file has them and the first frame otherwise, or one of
        the two.
    """

    _suffix = ".extension"

    def __init__(self, bar_ids: Sequence[int] | None = None, *, origin: Origin = "auto") -> None:
        super().__init__(bar_ids)
        self.origin = origin

    def _transform(self, loader: StateLoader) -> NDArray[np.float64]:
        return loader.bar_extensions(self.bar_ids, origin=self.origin)


class BarStrains(BarExtensions):
    """Bar strains, ``(l - l_rest) / l_rest``; what the file recorded, where it did.

    Parameters
    ----------
    bar_ids : sequence of int, optional
    origin : {"auto", "rest", "first"}
        As for `BarExtensions`.
    """

    _suffix = ".strain"

    def _transform(self, loader: StateLoader) -> NDArray[np.float64]:
        return loader.bar_strains(self.bar_ids, origin=self.origin)
