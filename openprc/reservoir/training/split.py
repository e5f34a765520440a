"""`Split`: which rows a task runs on, what is thrown away, what is learned from, what is scored."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.training.row_clock import ClockChoice, RowClock, row_clock
from openprc.reservoir.training.row_split import RowSplit

SpanUnit = Literal["s", "frames", "rows", "symbols"]
UNITS: tuple[SpanUnit, ...] = ("s", "frames", "rows", "symbols")

#: Of the rows that are there, and of those that washout and gap leave, for spans not given.
_WASHOUT, _TRAIN = 0.1, 2.0 / 3.0


@dataclass(frozen=True, kw_only=True)
class Split:
    """Washout, training, gap and test, one after the other, on one clock.

    Parameters
    ----------
    washout : float, optional
        Thrown away at the start, because the body still remembers how it began; a tenth of the
        rows by default.
    train, test : float, optional
        To fit on and to score on. One that is not given takes what is left; when neither is
        given, training takes two thirds of it.
    gap : float
        Thrown away between training and test, so that test states do not remember training.
    unit : {"s", "frames", "rows", "symbols"}
        What the four durations count. Seconds by default (load steps in a file of load steps);
        ``symbols`` insists on the clock of symbols.
    clock : {"auto", "symbols", "frames"}
        What a row is: ``auto`` takes a symbol where the file stores them, and a frame otherwise.
    input_name : str, optional
        Input whose symbols count; by default the first that stores them.
    samples_per_symbol : int
        Frames within each symbol that are put side by side as virtual nodes.
    frames_per_row : int
        On the clock of frames, every how many frames there is a row.

    Examples
    --------
    >>> Split(washout=5.0, train=20.0, test=5.0).resolve(loader).rows       # doctest: +SKIP
    RowSplit(washout=500, train=2000, test=500, gap=0)
    """

    washout: float | None = None
    train: float | None = None
    test: float | None = None
    gap: float = 0.0
    unit: SpanUnit = "s"
    clock: ClockChoice = "auto"
    input_name: str | None = None
    samples_per_symbol: int = 1
    frames_per_row: int = 1

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise TaskError(
                f"unit is {self.unit!r}",
                expected="one of " + ", ".join(UNITS),
                fix="choose one of these",
                key="unit",
            )
        for name, value in self.durations.items():
            if value is None:
                continue
            number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            if not (number and np.isfinite(value) and value >= 0):
                raise TaskError(
                    f"the {name} duration is {value!r}",
                    expected=f"a duration of at least 0 {self.unit}",
                    fix="correct it",
                    key=name,
                )

    @property
    def durations(self) -> dict[str, float | None]:
        """The four durations in `unit`, in the order in which they follow each other."""
        return {
            "washout": self.washout,
            "train": self.train,
            "gap": self.gap,
            "test": self.test,
        }

    def resolve(self, loader: StateLoader) -> ResolvedSplit:
        """Lay the spans over the rows of a file.

        The edges between spans are rounded to the nearest row, one by one from the start, so
        that rounding never adds up and spans that fit in time fit in rows.

        Raises
        ------
        TaskError
            When a span rounds to no row where one is needed, or the rows do not suffice, or
            the clock is unknown.
        MissingInputError
            When symbols are asked for and the file stores none.
        NonUniformTime
            On frames that are not evenly spaced.
        """
        clock = "symbols" if self.unit == "symbols" and self.clock == "auto" else self.clock
        rows = row_clock(
            loader,
            clock=clock,
            input_name=self.input_name,
            samples_per_symbol=self.samples_per_symbol,
            frames_per_row=self.frames_per_row,
        )
        if self.unit == "symbols" and rows.kind != "symbols":
            raise TaskError(
                f"the spans count symbols and the rows are {rows.kind}",
                expected="the clock of symbols",
                fix='leave clock at "auto", or count in rows, frames or seconds',
                file=loader.path,
                key="unit",
            )
        in_frames = self.unit == "frames"
        return self.over(
            rows,
            frames_per_row=rows.step / loader.dt if in_frames else 1.0,
            file=str(loader.path),
        )

    def over(
        self, clock: RowClock, *, frames_per_row: float = 1.0, file: str | None = None
    ) -> ResolvedSplit:
        """Lay the spans over the rows of a clock; raises as `resolve`.

        Parameters
        ----------
        frames_per_row : float
            Frames from row to row, for spans that count frames.
        """
        unit = clock.unit if self.unit == "s" else self.unit
        size = {"s": clock.step, "frames": frames_per_row}.get(self.unit, 1.0)
        durations = self.durations
        asked = {name: None if v is None else v / size for name, v in durations.items()}
        edges = _edges(clock.n_rows, **asked)
        if edges[-1] > clock.n_rows or (np.diff(edges, prepend=0) < 0).any():
            given = {name: float(v) for name, v in durations.items() if v}
            total = sum(given.values())
            listed = " + ".join(f"{name} {value:g}" for name, value in given.items())
            raise TaskError(
                f"there are {clock.n_rows * size:g} {unit} of states "
                f"({clock.n_rows} rows of {size:g} {unit})",
                expected=f"{total:g} {unit} = {listed} ({round(total / size)} rows)",
                fix="shorten the spans, or record for longer",
                file=file,
                key="/time_series/time",
            )
        counts = dict(zip(asked, np.diff(edges, prepend=0).tolist(), strict=True))
        return ResolvedSplit(self, clock, RowSplit(**counts), size, unit)


@dataclass(frozen=True)
class ResolvedSplit:
    """A split laid over a file: its clock, and its spans in rows.

    ``size`` is the length of one row in ``unit``, the unit of the durations.
    """

    split: Split
    clock: RowClock
    rows: RowSplit
    size: float
    unit: str

    def remarks(self) -> Iterator[str]:
        """Yield a remark for each duration that is not a whole number of rows."""
        for name, asked in self.split.durations.items():
            rows = self.rows.spans[name]
            if asked is not None and abs(asked / self.size - rows) > 1e-6 * max(1, rows):
                yield (
                    f"{name} {asked:g} {self.unit} is not a whole number of rows of "
                    f"{self.size:g} {self.unit}; {rows} rows were used"
                )


def _edges(
    n_rows: int,
    *,
    washout: float | None,
    train: float | None,
    gap: float | None,
    test: float | None,
) -> NDArray[np.int64]:
    """Return the ends of the four spans, (4,) int, from durations in rows."""
    gap = gap or 0.0
    start = float(np.rint(_WASHOUT * n_rows)) if washout is None else washout
    if train is None and test is None:
        train = float(np.rint(_TRAIN * (n_rows - np.rint(start + gap))))
    if train is None:
        ends = [start, n_rows - (test or 0.0) - gap, n_rows - (test or 0.0), n_rows]
    else:
        stop = start + train
        ends = [start, stop, stop + gap, n_rows if test is None else stop + gap + test]
    return np.rint(ends).astype(np.int64)
