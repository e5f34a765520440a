"""Telling a simulation that blew up from one that moves: PyBullet says nothing and goes on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.errors import Diverged

_LARGEST = np.finfo("f8").max


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first bad frame of a block, what was found there and what had been expected."""

    row: int
    found: str
    expected: str

    def error(self, *, time: float, step: int) -> Diverged:
        """Return the error to raise; the frames before it are in the file."""
        return Diverged(
            f"the simulation blew up: {self.found} at {time:.9g} s (step {step})",
            expected=self.expected,
            fix="take a smaller time step or softer gains; if the scene does reach that far, "
            "raise limit. The frames before this one are kept in the unfinished file "
            "(openprc repair)",
            key="positions",
        )


class Guard:
    """Bounds on positions, as multiples of the size of the scene at the start.

    Speeds need no bound of their own: what is too fast is too far a step later.

    Parameters
    ----------
    rest : (N, 3) [m]
        The first frame.
    reach : float [m]
        Size of the scene, 1 m where it has none.
    labels : N names
    n_speeds : int
        How many nodes, the first ones, have velocities.
    limit : float, or None for no bounds
        How many sizes a node may go from where it began.
    """

    def __init__(
        self,
        rest: NDArray[np.float64],
        *,
        reach: float,
        labels: Sequence[str],
        n_speeds: int,
        limit: float | None,
    ) -> None:
        self._rest = rest
        self._labels = labels
        self._n_speeds = n_speeds
        self._reach = reach
        self._limit = np.inf if limit is None else limit * reach

    def check(
        self,
        positions: NDArray[np.float64],
        velocities: NDArray[np.float64] | None,
        channels: Mapping[str, NDArray[np.float64]],
    ) -> Divergence | None:
        """Look at a block: positions (B, N, 3) [m], velocities (B, N, 3) [m/s] or None."""
        found = [
            self._first("position", positions, self._rest, self._limit),
            None
            if velocities is None
            else self._first("velocity", velocities[:, : self._n_speeds], 0.0, np.inf),
            *(_not_finite(name, values) for name, values in channels.items()),
        ]
        return min((item for item in found if item), key=lambda item: item.row, default=None)

    def _first(
        self,
        what: str,
        values: NDArray[np.float64],
        origin: NDArray[np.float64] | float,
        bound: float,
    ) -> Divergence | None:
        # The extremes tell at once that all is well, as it nearly always is; NaN is neither.
        low, high = values.min(axis=0), values.max(axis=0)
        with np.errstate(invalid="ignore", over="ignore"):
            if (np.maximum(high - origin, origin - low) <= min(bound, _LARGEST)).all():
                return None
            away = values - origin
            fine = np.abs(away) <= min(bound, _LARGEST)
            row, node = (int(i) for i in np.argwhere(~fine.all(axis=2))[0])
            size = float(np.linalg.norm(away[row, node]))
        if not np.isfinite(size):
            found = f"the {what} of {self._labels[node]} is {size}"
            return Divergence(row, found, "finite numbers")
        return Divergence(
            row,
            f"{self._labels[node]} is {size:.3g} m away from where it began",
            f"less than {bound:.3g}, from limit and the size of the scene, {self._reach:.3g} m",
        )


def _not_finite(name: str, values: NDArray[np.float64]) -> Divergence | None:
    if np.isfinite(values.sum()):
        return None
    fine = np.isfinite(values)
    if fine.all():
        return None
    row, column = (int(i) for i in np.argwhere(~fine)[0])
    return Divergence(row, f"{name} is {values[row, column]}", "finite numbers")
