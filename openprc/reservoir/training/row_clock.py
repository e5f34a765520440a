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
        """Return one input value per row, (R,), and a remark on how it was come by.

        Parameters
        ----------
        u : (n,) or (n, 1)
            One value per row, per symbol of the file, or per frame.

        Raises
        ------
        TaskError
            When the length fits none of these, or when there are several columns.
        """
        values = np.asarray(u, dtype=np.float64)
        if values.ndim == 2 and values.shape[1] == 1:
            values = values[:, 0]
        if values.ndim != 1:
            raise TaskError(
                f"the input has shape {values.shape}",
                expected="one value per row, (n,)",
                fix="choose one column",
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

    Raises
    ------
    TaskError
        When the choice is unknown, or several samples per row are asked for on frames.
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
    physical = loader.time_kind == "physical"
    unit = "s" if physical else "load steps"
    by_symbol = clock == "symbols" or (
        clock == "auto" and bool(loader.inputs) and loader.has_symbols(input_name)
    )
    if by_symbol:
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
    return RowClock(
        kind="frames",
        frames=np.arange(loader.n_frames)[:, None],
        time=loader.time,
        step=loader.dt,
        unit=unit,
        n_frames=loader.n_frames,
        symbols=None,
    )
