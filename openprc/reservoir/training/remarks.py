"""What a reader of a score should know about the clock, the drive and the states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.training.evaluation import Evaluation

if TYPE_CHECKING:
    from openprc.reservoir.training.trainer import Trainer

#: Above this autocorrelation from row to row a drive is not called white.
WHITE_LIMIT = 0.1
_LISTED = 5


def lag_one_autocorrelation(signal: NDArray[np.float64]) -> float:
    """Return the autocorrelation of a signal (n,) at lag 1; 0 when it does not vary."""
    centred = signal - signal.mean()
    power = float(centred @ centred)
    return float(centred[1:] @ centred[:-1]) / power if power > 0 else 0.0


def clock_remarks(trainer: Trainer) -> Iterator[str]:
    """Yield remarks on spans, symbols without states, and drives that are not white."""
    clock, split = trainer.rows, trainer.split
    spans = {
        "washout": (trainer.washout, split.washout),
        "train_duration": (trainer.train_duration, split.train),
        "gap": (trainer.gap, split.gap),
        "test_duration": (trainer.test_duration, split.test),
    }
    for name, (asked, rows) in spans.items():
        if abs(asked / clock.step - rows) > 1e-6 * max(1, rows):
            yield (
                f"{name} {asked:g} {clock.unit} is not a whole number of rows of "
                f"{clock.step:g} {clock.unit}; {rows} rows were used"
            )
    if clock.symbols is not None and clock.n_rows < clock.symbols.n_total:
        left_out = clock.symbols.n_total - clock.n_rows
        yield f"{left_out} of {clock.symbols.n_total} symbols have no states and were left out"
    if clock.kind == "frames" and trainer.loader.inputs:
        drive = drive_of(trainer)
        r = 0.0 if drive is None else lag_one_autocorrelation(drive)
        if abs(r) > max(WHITE_LIMIT, 3.0 / np.sqrt(clock.n_rows)):
            yield (
                f"frame clock; drive autocorrelation {r:.3f} at lag 1: NARMA at frame rate is "
                "nearly memoryless, and memory capacities are inflated"
            )


def drive_of(trainer: Trainer) -> NDArray[np.float64] | None:
    """Return the first column of the trainer's input that varies, (T,), or None."""
    name = trainer.loader.input_name(trainer.input_name or 0)
    value = np.asarray(trainer.loader.trajectory.input(name).value, dtype=np.float64)
    varying = np.flatnonzero(np.ptp(value, axis=0) > 0)
    return value[:, varying[0]] if varying.size else None


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
