"""The clock of the input symbols, which is the clock that delay and memory tasks run on.

A body is driven by K symbols that are each held, or interpolated, for a time `hold`, while the
states are saved at a much finer step. A task such as NARMA is defined from symbol to symbol;
run on frames, its delays are a small fraction of one symbol and it needs no memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError


@dataclass(frozen=True)
class SymbolClock:
    """The symbols of one input that the states of a file cover.

    Parameters
    ----------
    name : str
        Name of the input.
    sequence : (K, C) float64
        The covered symbols, in the unit of the input.
    hold : float [s]
        Duration of one symbol.
    start : float [s]
        Time at which the first covered symbol begins.
    frames : (K,) int
        Last frame strictly within each symbol: it has seen its own symbol nearly to the end and
        nothing of the next one. Where frames stand on the borders between symbols only, the
        frame at the end of each symbol: the state there is what that symbol led to.
    first : int
        Position of the first covered symbol in the sequence of the file.
    n_total : int
        Length of the sequence of the file.
    columns : tuple of str
        Names of the C columns.
    time : (T,) float64 [s]
        Times of all frames of the file.
    on_borders : bool
        Whether every frame stands on a border between symbols.
    """

    name: str
    sequence: NDArray[np.float64]
    hold: float
    start: float
    frames: NDArray[np.intp]
    first: int
    n_total: int
    columns: tuple[str, ...]
    time: NDArray[np.float64] = field(repr=False)
    on_borders: bool = False

    @property
    def n_symbols(self) -> int:
        """Number of covered symbols."""
        return len(self.frames)

    def frames_within(self, n: int) -> NDArray[np.intp]:
        """Return (K, n) frames: the last frame of each of `n` equal parts of every symbol.

        The last column equals `frames`. Parts of a symbol serve as virtual nodes
        (Appeltant et al. 2011, doi:10.1038/ncomms1476).

        Raises
        ------
        TaskError
            When a part contains no frame.
        """
        if n < 1:
            raise TaskError(
                f"samples_per_symbol is {n}",
                expected="1 or more",
                fix="pass a positive whole number",
                key="samples_per_symbol",
            )
        if n == 1:
            return self.frames[:, None]
        edges = self.start + self.hold * np.arange(self.n_symbols * n + 1) / n
        last = _last_before(self.time, edges[1:])
        first = _first_from(self.time, edges[:-1])
        if (last < first).any():
            per_symbol = np.diff(self.frames).min(initial=len(self.time))
            raise TaskError(
                f"samples_per_symbol is {n} and a symbol has {per_symbol} frames at least",
                expected="at least one frame in every part of a symbol",
                fix="ask for fewer samples per symbol, or save the states more often",
                key="samples_per_symbol",
            )
        return last.reshape(self.n_symbols, n)

    def sample(self, values: NDArray[np.float64]) -> tuple[NDArray[np.float64], str]:
        """Return one value per symbol of a signal given at every frame, and where it was read.

        A held signal is read at the last frame of each symbol. One that moves between the
        middle and the end of a symbol was interpolated between symbols: it is read where the
        symbol begins, since its end already belongs to the next symbol.

        Parameters
        ----------
        values : (T,) or (T, C) float64
        """
        starts = self.start + self.hold * np.arange(self.n_symbols)
        begin = _first_from(self.time, starts)
        if self.on_borders and abs(self.time[begin[0]] - starts[0]) > 1e-3 * self.hold:
            raise TaskError(
                "no frame stands at the beginning of the first symbol, so a signal given per "
                "frame does not tell its value",
                expected="one value per symbol",
                fix="pass the symbols themselves",
                key="u_input",
            )
        middle = np.maximum(_last_before(self.time, starts + 0.5 * self.hold), begin)
        span = float(np.ptp(values)) if values.size else 0.0
        moves = np.abs(values[self.frames] - values[middle]).max(initial=0.0)
        if moves <= 1e-9 * span:
            return values[self.frames], "last frame of each symbol"
        return values[begin], "first frame of each symbol (the signal moves within symbols)"


def symbol_clock(
    *,
    name: str,
    sequence: NDArray[np.float64],
    hold: float,
    start: float,
    time: NDArray[np.float64],
    columns: tuple[str, ...],
    file: str | None = None,
) -> SymbolClock:
    """Lay a symbol sequence over the frames of a file; see `SymbolClock`.

    Symbols outside the recording are left out: leading ones that ended before the first frame,
    trailing ones whose end was not recorded.

    Raises
    ------
    TaskError
        When no symbol is covered, or when a symbol in between has no frame.
    """
    key = f"/inputs/{name}/sequence"
    n_total = len(sequence)
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    starts = start + hold * np.arange(n_total)
    ends = start + hold * np.arange(1, n_total + 1)
    last, begin = _last_before(time, ends), _first_from(time, starts)
    on_borders = _on_borders(time, hold=hold, start=start)
    if on_borders:
        last, begin = _last_until(time, ends), _first_after(time, starts)
    has_frame = last >= begin
    finished = time[-1] + step >= ends - 1e-6 * step
    usable = np.flatnonzero(has_frame & finished)
    if not usable.size:
        raise TaskError(
            f"the states run from {time[0]:g} s to {time[-1]:g} s and cover none of the "
            f"{n_total} symbols, which run from {start:g} s to {ends[-1]:g} s",
            expected="states recorded while the input was applied",
            fix="check hold and start of the input",
            file=file,
            key=key,
        )
    lead, trail = int(usable[0]), int(usable[-1]) + 1
    empty = int(np.count_nonzero(~has_frame[lead:trail]))
    if empty:
        raise TaskError(
            f"{empty} of {trail - lead} symbols have no frame: a symbol lasts {hold:g} s and "
            f"frames are {step:g} s apart",
            expected="at least one frame in every symbol",
            fix="save the states at least once per symbol",
            file=file,
            key=key,
        )
    return SymbolClock(
        name=name,
        sequence=sequence[lead:trail],
        hold=hold,
        start=float(starts[lead]),
        frames=last[lead:trail],
        first=lead,
        n_total=n_total,
        columns=columns,
        time=time,
        on_borders=on_borders,
    )


def _on_borders(time: NDArray[np.float64], *, hold: float, start: float) -> bool:
    phase = (time - start) / hold
    return bool((np.abs(phase - np.round(phase)) <= 1e-6).all())


def _tolerance(time: NDArray[np.float64]) -> float:
    # Frame times carry rounding errors; a frame that close to an edge is meant to be on it.
    return 1e-6 * float(np.median(np.diff(time))) if len(time) > 1 else 0.0


def _last_before(time: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.intp]:
    return np.searchsorted(time, edges - _tolerance(time), side="left") - 1


def _first_from(time: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.intp]:
    return np.searchsorted(time, edges - _tolerance(time), side="left")


def _last_until(time: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.intp]:
    return np.searchsorted(time, edges + _tolerance(time), side="right") - 1


def _first_after(time: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.intp]:
    return np.searchsorted(time, edges + _tolerance(time), side="right")
