"""Washout, training rows, test rows: in this order, and never overlapping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError


@dataclass(frozen=True)
class Split:
    """Consecutive spans of rows, counted in rows.

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
        spans = {
            "washout": self.washout,
            "train": self.train,
            "test": self.test,
            "gap": self.gap,
        }
        for name, rows in spans.items():
            least = 1 if name in ("train", "test") else 0
            if isinstance(rows, bool) or not isinstance(rows, int) or rows < least:
                raise TaskError(
                    f"the {name} span is {rows!r} rows",
                    expected=f"a whole number of rows, at least {least}",
                    fix="give a longer duration, or count the rows yourself",
                    key=name,
                )

    @classmethod
    def from_seconds(
        cls,
        n_rows: int,
        step: float,
        *,
        washout: float,
        train: float,
        test: float,
        gap: float = 0.0,
        unit: str = "s",
        file: str | None = None,
    ) -> Split:
        """Turn durations into rows.

        The edges of the spans are rounded to the nearest row, one by one from the start, so
        that rounding never adds up and spans that fit in time fit in rows.

        Parameters
        ----------
        n_rows : int
            Rows that there are.
        step : float
            Time from row to row, in `unit`.
        washout, train, test, gap : float
            Durations in `unit`.

        Raises
        ------
        TaskError
            When a duration is negative or not finite, when it rounds to no row where one is
            needed, or when the rows do not suffice.
        """
        durations = {"washout": washout, "train": train, "gap": gap, "test": test}
        for name, value in durations.items():
            if not (np.isfinite(value) and value >= 0):
                raise TaskError(
                    f"the {name} duration is {value!r}",
                    expected=f"a duration of at least 0 {unit}",
                    fix="correct it",
                    file=file,
                    key=name,
                )
        edges = np.cumsum([0.0, *durations.values()]) / step
        rows = np.diff(np.rint(edges).astype(np.int64))
        needed = int(np.rint(edges[-1]))
        if needed > n_rows:
            listed = " + ".join(f"{name} {value:g}" for name, value in durations.items() if value)
            raise TaskError(
                f"there are {n_rows * step:g} {unit} of states ({n_rows} rows of {step:g} {unit})",
                expected=f"{sum(durations.values()):g} {unit} = {listed} ({needed} rows)",
                fix="shorten the spans, or record for longer",
                file=file,
                key="/time_series/time",
            )
        counts = dict(zip(durations, (int(r) for r in rows), strict=True))
        return cls(**counts)

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
