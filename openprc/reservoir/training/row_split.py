"""Washout, training rows, test rows, counted in rows: in this order, and never overlapping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError


@dataclass(frozen=True)
class RowSplit:
    """Consecutive spans of rows, counted in rows. `Split.resolve` makes one from durations.

    Parameters
    ----------
    washout : int
        Rows at the start that are thrown away, because the body still remembers how it began.
    train, test : int
        Rows to fit on and rows to score on.
    gap : int
        Rows thrown away between the two, so that test states do not remember training ones.

    Raises
    ------
    TaskError
        When a span is negative, or when there is nothing to train or to test on.
    """

    washout: int
    train: int
    test: int
    gap: int = 0

    def __post_init__(self) -> None:
        for name, rows in self.spans.items():
            least = 1 if name in ("train", "test") else 0
            if isinstance(rows, bool) or not isinstance(rows, int) or rows < least:
                raise TaskError(
                    f"the {name} span is {rows!r} rows",
                    expected=f"a whole number of rows, at least {least}",
                    fix="give a longer duration, or count the rows yourself",
                    key=name,
                )

    @property
    def spans(self) -> dict[str, int]:
        """Rows of each span, in the order in which they follow each other."""
        return {
            "washout": self.washout,
            "train": self.train,
            "gap": self.gap,
            "test": self.test,
        }

    @property
    def n_rows(self) -> int:
        """Rows from the start of the washout to the end of the test."""
        return self.washout + self.train + self.gap + self.test

    @property
    def train_rows(self) -> slice:
        """Rows to fit on."""
        return slice(self.washout, self.washout + self.train)

    @property
    def test_rows(self) -> slice:
        """Rows to score on."""
        return slice(self.n_rows - self.test, self.n_rows)

    def masks(self, usable: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the numbers of the training and test rows that are `usable` (n,).

        Raises
        ------
        TaskError
            When no row of a span is usable.
        """
        chosen = []
        for name, span in (("training", self.train_rows), ("test", self.test_rows)):
            rows = span.start + np.flatnonzero(usable[span])
            if not rows.size:
                raise TaskError(
                    f"none of the {span.stop - span.start} {name} rows was measured completely",
                    expected="rows without missing samples",
                    fix="leave out the nodes with long gaps (node_ids)",
                    key="missing",
                )
            chosen.append(rows)
        return chosen[0], chosen[1]
