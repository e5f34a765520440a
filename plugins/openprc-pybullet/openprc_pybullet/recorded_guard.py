"""Telling a simulation that blew up from one that moves: PyBullet says nothing and goes on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.errors import Diverged


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
    """Bounds on positions and speeds, as multiples of the size of the scene at the start.

    Parameters
    ----------
    rest : (N, 3) [m]
        The first frame.
    reach : float [m]
        Size of the scene, 1 m where it has none.
    labels : N names
    limit : float, or None for no bounds
        A node may go `limit` sizes away from where it began, and no further in one step
        either.
    """

    def __init__(
        self,
        rest: NDArray[np.float64],
        *,
        reach: float,
        labels: Sequence[str],
        limit: float | None,
    ) -> None:
        self._rest = rest
        self._labels = labels
        self._reach = reach
        self._limit = np.inf if limit is None else limit * reach

    def check(
        self,
        positions: NDArray[np.float64],
        velocities: NDArray[np.float64] | None,
        channels: Mapping[str, NDArray[np.float64]],
        *,
        dt: float,
    ) -> Divergence | None:
        """Look at a block: positions (B, N, 3) [m], velocities (B, N, 3) [m/s] or None."""
        # Each is one pass without temporaries of the size of the block where all is well.
        found = [
            self._first(positions, self._rest, self._limit, "is {} m away from where it began"),
            None
            if velocities is None
            else self._first(velocities, None, self._limit / dt, "moves at {} m/s"),
            *(_not_finite(name, values) for name, values in channels.items()),
        ]
        return min((item for item in found if item), key=lambda item: item.row, default=None)

    def _first(
        self,
        values: NDArray[np.float64],
        origin: NDArray[np.float64] | None,
        bound: float,
        words: str,
    ) -> Divergence | None:
        with np.errstate(invalid="ignore", over="ignore"):
            away = values if origin is None else values - origin
            # Comparing what is within bounds finds NaN too.
            fine = np.isfinite(away) if bound == np.inf else np.abs(away) <= bound
            if fine.all():
                return None
            row, node = (int(i) for i in np.argwhere(~fine.all(axis=2))[0])
            size = float(np.linalg.norm(away[row, node]))
        if np.isfinite(size):
            expected = f"less than {bound:.3g}, from limit and the size of the scene, "
            expected += f"{self._reach:.3g} m"
        else:
            expected = "finite numbers"
        return Divergence(row, f"{self._labels[node]} {words.format(f'{size:.3g}')}", expected)


def _not_finite(name: str, values: NDArray[np.float64]) -> Divergence | None:
    fine = np.isfinite(values)
    if fine.all():
        return None
    row, column = (int(i) for i in np.argwhere(~fine)[0])
    return Divergence(row, f"{name} is {values[row, column]}", "finite numbers")
