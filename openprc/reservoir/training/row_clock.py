"""Which frames become rows of the state matrix, and which input value belongs to each row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.io.symbol_clock import SymbolClock

ClockChoice = Literal["auto", "symbols", "frames"]


@dataclass(frozen=True)
class RowClock:
    """The rows of a task: one per input symbol, or one per frame.

    Parameters
    ----------
    kind : {"symbols", "frames"}
    frames : (R, S) int
        Frames that are read for each row; the last one is the instant of the row.
    time : (R,) float64
        Instants of the rows, in `unit`.
    step : float
        Time from row to row, in `unit`.
    unit : {"s", "load steps"}
    n_frames : int
        Frames in the file.
    symbols : SymbolClock or None
    """

    kind: Literal["symbols", "frames"]
    frames: NDArray[np.intp]
    time: NDArray[np.float64]
    step: float
    unit: str
    n_frames: int
    symbols: SymbolClock | None

    @property
    def n_rows(self) -> int:
        """Number of rows, R."""
        return len(self.frames)

    @property
    def samples_per_row(self) -> int:
        """Number of frames read for each row, S."""
        return self.frames.shape[1]

    def align_input(self, u: ArrayLike) -> tuple[NDArray[np.float64], str]:
        """Return the input on the rows, (R,) or (R, C), and a remark on how it was come by.

        Parameters
        ----------
        u : (n,) or (n, C)
            One row per row of the clock, per symbol of the file, or per frame. A single column
            comes back flat.

        Raises
        ------
        TaskError
            When the length fits none of these.
        """
        values = np.asarray(u, dtype=np.float64)
        if values.ndim == 2 and values.shape[1] == 1:
            values = values[:, 0]
        if values.ndim not in (1, 2) or not values.size:
            raise TaskError(
                f"the input has shape {values.shape}",
                expected="one row per row of the clock, (n,) or (n, C)",
                fix="choose columns of the input",
                key="u_input",
            )
        if len(values) == self.n_rows:
            return values, ""
        if self.symbols is not None and len(values) == self.symbols.n_total:
            first = self.symbols.first
            return values[first : first + self.n_rows], "symbols without states were left out"
        if self.symbols is not None and len(values) == self.n_frames:
            sampled, where = self.symbols.sample(values)
            return sampled, f"input given per frame; read at the {where}"
        if len(values) == self.n_frames:
            return values[
                self.frames[:, -1]
            ], "input given per frame; read at the frame of each row"
        raise self._wrong_length("u_input", len(values))

    def align_target(self, y: ArrayLike) -> tuple[NDArray[np.float64], str]:
        """Return one target row per row, (R, O), and a remark; see `align_input`.

        A target given per frame is read at the instants of the rows.
        """
        values = np.asarray(y, dtype=np.float64)
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2 or not values.shape[1]:
            raise TaskError(
                f"the target has shape {np.shape(y)}",
                expected="(n,) or (n, O)",
                fix="pass one column per output",
                key="y",
            )
        note = ""
        if len(values) != self.n_rows:
            if self.symbols is not None and len(values) == self.symbols.n_total:
                first = self.symbols.first
                values = values[first : first + self.n_rows]
            elif self.symbols is not None and len(values) == self.n_frames:
                values = values[self.frames[:, -1]]
                note = "target given per frame; read at the last frame of each symbol"
            elif len(values) == self.n_frames:
                values = values[self.frames[:, -1]]
                note = "target given per frame; read at the frame of each row"
            else:
                raise self._wrong_length("y", len(values))
        if not np.isfinite(values).all():
            bad = int(np.count_nonzero(~np.isfinite(values).all(axis=1)))
            raise TaskError(
                f"{bad} of {len(values)} target rows are NaN or infinite",
                expected="finite numbers",
                fix="check the input that the target was computed from",
                key="y",
            )
        return values, note

    def _wrong_length(self, key: str, length: int) -> TaskError:
        accepted = [f"{self.n_rows} (rows on the clock of {self.kind})"]
        hint = "compute it from the input of this file"
        if self.symbols is not None:
            accepted += [f"{self.symbols.n_total} (symbols)", f"{self.n_frames} (frames)"]
        else:
            if self.n_frames != self.n_rows:
                accepted.append(f"{self.n_frames} (frames)")
            hint += '; values per symbol need clock="symbols"'
        return TaskError(
            f"the length is {length}", expected=" or ".join(accepted), fix=hint, key=key
        )


def row_clock(
    loader: StateLoader,
    *,
    clock: ClockChoice = "auto",
    input_name: str | None = None,
    samples_per_symbol: int = 1,
    frames_per_row: int = 1,
) -> RowClock:
    """Choose the rows of a file.

    Parameters
    ----------
    clock : {"auto", "symbols", "frames"}
        ``auto`` takes symbols where the file stores their sequence.
    input_name : str, optional
        Input whose symbols count; by default the first that stores them.
    samples_per_symbol : int
        Frames per symbol that are put side by side as virtual nodes.
    frames_per_row : int
        On frames, every how many there is a row: the last of each group of so many.

    Raises
    ------
    TaskError
        When the choice is unknown, several samples per row are asked for on frames, or frames
        are counted on the clock of symbols.
    MissingInputError
        When symbols are asked for and the file stores none.
    NonUniformTime
        On frames that are not evenly spaced.
    """
    if clock not in ("auto", "symbols", "frames"):
        raise TaskError(
            f"clock is {clock!r}",
            expected="auto, symbols or frames",
            fix="choose one of these",
            key="clock",
        )
    _check_count(samples_per_symbol, "samples_per_symbol")
    _check_count(frames_per_row, "frames_per_row")
    physical = loader.time_kind == "physical"
    unit = "s" if physical else "load steps"
    by_symbol = clock == "symbols" or (
        clock == "auto" and bool(loader.inputs) and loader.has_symbols(input_name)
    )
    if by_symbol:
        if frames_per_row != 1:
            raise TaskError(
                f"frames_per_row is {frames_per_row} and the rows are symbols",
                expected="1 on the clock of symbols",
                fix='say clock="frames", or leave frames_per_row at 1',
                file=loader.path,
                key="frames_per_row",
            )
        symbols = loader.symbols(input_name)
        frames = symbols.frames_within(samples_per_symbol)
        return RowClock(
            kind="symbols",
            frames=frames,
            time=symbols.time[frames[:, -1]],
            step=symbols.hold,
            unit=unit,
            n_frames=loader.n_frames,
            symbols=symbols,
        )
    if samples_per_symbol != 1:
        raise TaskError(
            f"samples_per_symbol is {samples_per_symbol} and the rows are frames",
            expected="1 on the clock of frames",
            fix="attach the symbol sequence of the input, or leave samples_per_symbol at 1",
            file=loader.path,
            key="samples_per_symbol",
        )
    frames = np.arange(frames_per_row - 1, loader.n_frames, frames_per_row)
    if not frames.size:
        raise TaskError(
            f"frames_per_row is {frames_per_row} and the file has {loader.n_frames} frames",
            expected=f"at most {loader.n_frames}",
            fix="make a row of fewer frames",
            file=loader.path,
            key="frames_per_row",
        )
    return RowClock(
        kind="frames",
        frames=frames[:, None],
        time=loader.time[frames],
        step=loader.dt * frames_per_row,
        unit=unit,
        n_frames=loader.n_frames,
        symbols=None,
    )


def _check_count(value: int, key: str) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise TaskError(
            f"{key} is {value!r}",
            expected="a whole number, 1 or more",
            fix="pass such a number",
            key=key,
        )
