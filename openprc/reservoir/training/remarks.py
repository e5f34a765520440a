"""What a reader of a score should know about the clock, the drive and the states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.io.drive_shape import symbol_spacing
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.io.symbol_clock import SymbolClock
from openprc.reservoir.io.whiteness import decorrelation_lag, drive_whiteness
from openprc.reservoir.training.evaluation import Evaluation
from openprc.reservoir.training.row_clock import RowClock
from openprc.reservoir.training.split import ResolvedSplit

_LISTED = 5
_FEWEST_SYMBOLS = 10


def split_remarks(
    loader: StateLoader, resolved: ResolvedSplit, *, input_name: str | None = None
) -> Iterator[str]:
    """Yield remarks on spans, symbols without states, and drives that are not white.

    They depend on the file and the split only, so one reading serves every target.

    Parameters
    ----------
    input_name : str, optional
        The drive in question, where the split does not name it; the first by default.
    """
    yield from resolved.remarks()
    clock = resolved.clock
    symbols = clock.symbols
    if symbols is not None and clock.n_rows < symbols.n_total:
        left_out = symbols.n_total - clock.n_rows
        yield f"{left_out} of {symbols.n_total} symbols have no states and were left out"
    if not loader.inputs:
        return
    name = resolved.split.input_name or input_name
    if symbols is not None:
        yield from _symbol_remarks(symbols)
    elif loader.time_kind == "physical":
        yield from _frame_remarks(loader, clock, loader.input_name(name or 0))


def _symbol_remarks(symbols: SymbolClock) -> Iterator[str]:
    if not _testable(symbols.sequence):
        return
    whiteness = drive_whiteness(symbols.sequence)
    if not whiteness.white:
        yield (
            f"the symbols of {symbols.name!r} are not independent, {whiteness.sentence}: "
            "capacities also count what the drive itself remembers"
        )


def _frame_remarks(loader: StateLoader, clock: RowClock, name: str) -> Iterator[str]:
    """Say how white a drive is from row to row, and which symbols seem to be behind it."""
    value = np.asarray(loader.trajectory.input(name).value, dtype=np.float64)
    rows = value[clock.frames[:, -1]]
    if not _testable(rows):
        return
    whiteness = drive_whiteness(rows)
    if whiteness.white:
        return
    if loader.has_symbols(name):
        advice = 'the file stores its symbols: leave clock at "auto"'
    else:
        advice = _advice(value)
    yield (
        f"frame clock; drive {whiteness.sentence}: NARMA at frame rate is nearly memoryless, "
        f"and memory capacities are inflated; {advice}"
    )


def _advice(value: NDArray[np.float64]) -> str:
    spacing = symbol_spacing(value)
    if spacing is None:
        varying = value[:, np.ptp(value, axis=0) > 0]
        lags = [decorrelation_lag(column) for column in varying.T]
        known = [lag for lag in lags if lag is not None]
        after = f"; it decorrelates after about {max(known)} frames" if known else ""
        return (
            f"no symbols are recognised in it{after}: drive the body with independent symbols, or "
            "attach them with `openprc attach-input`"
        )
    whole = spacing.frames == round(spacing.frames)
    frames = f"{spacing.frames:.{6 if whole else 4}g}"
    seen = (
        f"the drive changes every {frames} frames"
        if spacing.kind == "held"
        else f"the drive is symbols {frames} frames apart, {spacing.kind}"
    )
    otherwise = f", or say frames_per_row={frames}" if whole else ""
    return f"{seen}: attach its symbols with `openprc attach-input`{otherwise}"


def _testable(rows: NDArray[np.float64]) -> bool:
    return bool(
        len(rows) >= _FEWEST_SYMBOLS and np.isfinite(rows).all() and np.ptp(rows, axis=0).any()
    )


def state_remarks(evaluation: Evaluation, names: Sequence[str], n_incomplete: int) -> Iterator[str]:
    """Yield remarks on states that do not change, on too few rows, and on rows left out.

    Raises
    ------
    TaskError
        When no state changes at all.
    """
    constant = [
        name
        for name, flag in zip(names, evaluation.fitted.standardizer.constant, strict=True)
        if flag
    ]
    if len(constant) == len(names):
        raise TaskError(
            f"none of the {len(names)} states changes over the training rows",
            expected="a body that moves",
            fix="check that the drive reached the body, or choose other features",
            key="features",
        )
    if constant:
        listed = ", ".join(constant[:_LISTED]) + (", ..." if len(constant) > _LISTED else "")
        yield f"{len(constant)} of {len(names)} states do not change: {listed}"
    n_train = len(evaluation.train_rows)
    if n_train < 2 * len(names):
        yield (
            f"{n_train} training rows for {len(names)} states: with fewer than two rows a state "
            "the readout fits noise; record for longer, use fewer states, or raise the "
            "regularization"
        )
    if n_incomplete:
        yield f"{n_incomplete} rows have missing samples and were left out"
