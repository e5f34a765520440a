"""Norms of the deviation between two files, summed up frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class ErrorNorms:
    """How far two files are apart.

    Parameters
    ----------
    rms : float
        Root of the mean, over all nodes and instants, of the squared distance of a node from
        its counterpart.
    largest : float
        Largest such distance.
    largest_node, largest_sample : int
        Where it is.
    largest_frame_rms : float
        Largest over instants of the root of the mean over nodes.
    displacement : float
        Root of the mean squared distance of the reference from its own first places.
    node_rms, node_max : (n,)
        NaN for a node that is never seen in both.
    rms_over_time, max_over_time, displacement_over_time : (K,)
        By bins of `width` instants; NaN where nothing is seen.
    width : int
    n_compared, n_missing : int
        Pairs of places that entered, and that were missing in one file or both.
    """

    rms: float
    largest: float
    largest_node: int
    largest_sample: int
    largest_frame_rms: float
    displacement: float
    node_rms: Reals
    node_max: Reals
    rms_over_time: Reals
    max_over_time: Reals
    displacement_over_time: Reals
    width: int
    n_compared: int
    n_missing: int

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in self.__dict__.items()
        }


@dataclass
class ErrorSums:
    """The running sums behind `ErrorNorms`; memory does not grow with the frames.

    Parameters
    ----------
    n_samples, n_nodes : int
    bins : int
        Largest number of bins over time.
    """

    n_samples: int
    n_nodes: int
    bins: int = 2000
    width: int = field(init=False)

    def __post_init__(self) -> None:
        self.width = -(-self.n_samples // self.bins)
        self._node = np.zeros((4, self.n_nodes))
        self._bins = np.zeros((-(-self.n_samples // self.width), 4))
        self._record = np.array([-1.0, -1.0, -1.0, 0.0])
        self._origin: Reals | None = None

    def add(self, first: int, x: Reals, y: Reals) -> None:
        """Add instants from `first` on: (B, n, d) each, NaN where missing."""
        from openprc.compare.deviations.compiled_sums import add_frames  # noqa: PLC0415 - numba, heavy

        flat = [places.reshape(len(places), -1) for places in (x, y)]
        if self._origin is None:
            self._origin = np.full(flat[0].shape[1], np.nan)
        add_frames(
            flat[0], flat[1], self._origin, first, self.width, self._node, self._bins,
            self._record,
        )  # fmt: skip

    def result(self) -> ErrorNorms:
        """Return the norms.

        Raises
        ------
        MissingData
            When no node was seen in both files at one instant.
        """
        # The sum of the last bin may not have been closed.
        squares = self._node[0] + self._node[1]
        counts = self._node[2]
        total = float(counts.sum())
        if not total:
            raise MissingData(
                "no node is seen in both files at one instant: every pair of places has a gap",
                expected="places that both files have",
                fix="compare another part of the clock, or match other nodes",
                key="/time_series/nodes/observed",
            )
        sums, terms = self._bins[:, :3], self._bins[:, 3]
        with np.errstate(invalid="ignore", divide="ignore"):
            over_time = np.sqrt(sums / terms[:, np.newaxis])
            node_rms = np.sqrt(squares / counts)
        return ErrorNorms(
            rms=float(np.sqrt(squares.sum() / total)),
            largest=float(np.sqrt(self._record[0])),
            largest_node=int(self._record[2]),
            largest_sample=int(self._record[1]),
            largest_frame_rms=float(np.sqrt(self._record[3])),
            displacement=float(np.sqrt(sums[:, 2].sum() / total)),
            node_rms=node_rms,
            node_max=np.where(counts > 0, np.sqrt(self._node[3]), np.nan),
            rms_over_time=over_time[:, 0],
            max_over_time=np.where(terms > 0, np.sqrt(sums[:, 1]), np.nan),
            displacement_over_time=over_time[:, 2],
            width=self.width,
            n_compared=int(total),
            n_missing=self.n_samples * self.n_nodes - int(total),
        )


__all__ = ["ErrorNorms", "ErrorSums"]
