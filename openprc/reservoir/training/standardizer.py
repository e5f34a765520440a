"""Zero mean and unit variance, learned from the training rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.reservoir.features.base import ROUND_OFF


@dataclass(frozen=True)
class Standardizer:
    """Column means and scales.

    Parameters
    ----------
    mean, scale : (F,) float64
        The scale of a constant column is 1, so that it stays a column of zeros.
    constant : (F,) bool
    """

    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    constant: NDArray[np.bool_]

    @classmethod
    def fit_transform(
        cls, states: NDArray[np.float64], *, scaled: bool = True
    ) -> tuple[Standardizer, NDArray[np.float64]]:
        """Learn from states (n, F) and return them standardised, from a single copy.

        With ``scaled=False`` the states are returned as they are, and mean and scale are 0 and
        1; constant columns are found all the same.
        """
        mean = states.mean(axis=0)
        # Centred before squaring: states are small motions about large offsets.
        x = states - mean
        scale = np.sqrt(np.einsum("ij,ij->j", x, x) / len(x))
        constant = scale <= ROUND_OFF * (np.abs(mean) + scale)
        if not scaled:
            return cls(np.zeros_like(mean), np.ones_like(mean), constant), states
        scale[constant] = 1.0
        x /= scale
        return cls(mean, scale, constant), x

    def transform(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (states - mean) / scale."""
        x = states - self.mean
        x /= self.scale
        return x
