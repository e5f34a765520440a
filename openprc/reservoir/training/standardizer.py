"""Zero mean and unit variance, learned from the training rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.reservoir.features.base import ROUND_OFF
from openprc.reservoir.training.moments import Moments
from openprc.reservoir.training.row_blocks import RowBlocks, rows_per_block


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
    def from_moments(cls, moments: Moments, *, scaled: bool = True) -> Standardizer:
        """Take mean and scale from moments; with ``scaled=False`` they are 0 and 1."""
        return cls._of(moments.mean_x, moments.std_x, scaled=scaled)

    @classmethod
    def _of(
        cls, mean: NDArray[np.float64], scale: NDArray[np.float64], *, scaled: bool
    ) -> Standardizer:
        constant = scale <= ROUND_OFF * (np.abs(mean) + scale)
        if not scaled:
            return cls(np.zeros_like(mean), np.ones_like(mean), constant)
        return cls(mean.copy(), np.where(constant, 1.0, scale), constant)

    @classmethod
    def fit_transform(
        cls, blocks: RowBlocks, *, scaled: bool = True
    ) -> tuple[Standardizer, NDArray[np.float64]]:
        """Learn from chosen rows and return them standardised, (n, F): the only copy made.

        With ``scaled=False`` the states are returned as they are, and mean and scale are 0 and
        1; constant columns are found all the same.
        """
        # About an origin within the data, since states are small motions about large offsets;
        # see `openprc.reservoir.training.moments.MomentSum`.
        origin = blocks.sample().mean(axis=0)
        total, squares = np.zeros_like(origin), np.zeros_like(origin)
        scratch = np.empty((rows_per_block(len(origin)), len(origin)))
        for _, states in blocks:
            centred = np.subtract(states, origin, out=scratch[: len(states)])
            total += np.add.reduce(centred, axis=0)
            squares += np.einsum("ij,ij->j", centred, centred)
        shift = total / len(blocks)
        scale = np.sqrt(np.maximum(squares / len(blocks) - shift**2, 0.0))
        learned = cls._of(origin + shift, scale, scaled=scaled)
        if not scaled:
            return learned, blocks.matrix()
        x = np.empty((len(blocks), blocks.n_columns))
        factor = 1.0 / learned.scale
        for place, states in blocks:
            np.subtract(states, learned.mean, out=x[place])
            x[place] *= factor
        return learned, x

    def transform(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (states - mean) / scale."""
        x = states - self.mean
        x /= self.scale
        return x

    def apply_affine(
        self,
        blocks: RowBlocks,
        weights: NDArray[np.float64],
        bias: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return ``transform(states) @ weights + bias``, (n, O), of chosen rows, block by block.

        Parameters
        ----------
        weights : (F, O)
            On standardised states.
        bias : (O,)
        """
        result = np.empty((len(blocks), weights.shape[1]))
        raw = weights / self.scale[:, None]
        if not self.mean.any():
            for place, states in blocks:
                np.matmul(states, raw, out=result[place])
        else:
            scratch = np.empty((rows_per_block(blocks.n_columns), blocks.n_columns))
            for place, states in blocks:
                # The mean goes first: subtracting products of large offsets would cancel.
                centred = np.subtract(states, self.mean, out=scratch[: len(states)])
                np.matmul(centred, raw, out=result[place])
        result += bias
        return result
