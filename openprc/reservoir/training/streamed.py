"""Training on files that are larger than the memory: states are read in blocks of frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.reservoir.features.base import Stacked
from openprc.reservoir.io.frame_window import windowed
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.fitting import fit_rows, reads_in_place
from openprc.reservoir.training.evaluation import scored
from openprc.reservoir.training.remarks import state_remarks
from openprc.reservoir.training.result import TrainingResult
from openprc.reservoir.training.row_blocks import rows_per_block
from openprc.reservoir.training.row_clock import RowClock
from openprc.reservoir.training.states import States, read_states

if TYPE_CHECKING:
    from openprc.reservoir.training.trainer import Trainer


@dataclass(frozen=True)
class StreamedRows:
    """Chosen rows of a file's states, read again each time they are gone through.

    It stands in for `openprc.reservoir.training.row_blocks.RowBlocks`.

    Parameters
    ----------
    loader : StateLoader
    features : feature
        Of every frame and those near it, such as positions, but not delay taps.
    clock : RowClock
    rows : (n,) int
        Numbers of the chosen rows, rising.
    block_frames : int
        Frames that are read at a time.
    context : int
        Frames before and after each block that features may look at.
    """

    loader: StateLoader
    features: Any
    clock: RowClock
    rows: NDArray[np.intp]
    block_frames: int
    context: int
    n_columns: int = field(default=0)

    def __len__(self) -> int:
        """Return the number of rows, n."""
        return len(self.rows)

    def part(self, start: int, stop: int) -> StreamedRows:
        """Return the chosen rows from `start` to `stop`, counted among the chosen ones."""
        return replace(self, rows=self.rows[start:stop])

    def sample(self) -> NDArray[np.float64]:
        """Return the rows of the first block."""
        return self.read(0, self._stop(0)).values

    def __iter__(self) -> Iterator[tuple[slice, NDArray[np.float64]]]:
        """Yield each block with its place among the chosen rows."""
        for first, states in self.blocks():
            step = rows_per_block(states.values.shape[1])
            for start in range(0, len(states.values), step):
                part = states.values[start : start + step]
                yield slice(first + start, first + start + len(part)), part

    def blocks(self) -> Iterator[tuple[int, States]]:
        """Yield the states of each block of frames with the place of its first row.

        Raises
        ------
        TaskError
            When a row depends on the block that it is read with: the feature then looks further
            than `context` frames.
        """
        first, last = 0, None
        while first < len(self):
            stop = self._stop(first)
            overlap = 0 if last is None else 1
            states = self.read(first - overlap, stop)
            if last is not None and not np.array_equal(states.values[0], last, equal_nan=True):
                raise TaskError(
                    f"{self.features!r} gives other states when it reads other blocks of frames",
                    expected=f"features that look at most {self.context} frames away",
                    fix="pass a larger context, or train with Trainer.train",
                    file=self.loader.path,
                    key="features",
                )
            last = states.values[-1].copy()
            own = States(states.values[overlap:], states.names, states.usable[overlap:])
            yield first, own
            first = stop

    def read(self, start: int, stop: int) -> States:
        """Return the states of the chosen rows from `start` to `stop`."""
        frames = self.clock.frames[self.rows[start:stop]]
        # One frame more than features may look at: the frame next to frame 0 is not its neighbour.
        begin = max(0, int(frames.min()) - self.context - 1)
        end = min(self.loader.n_frames, int(frames.max()) + self.context + 2)
        window = windowed(self.loader, begin, end)
        local = frames - begin + (1 if begin else 0)
        inside = replace(
            self.clock,
            frames=local,
            time=self.clock.time[self.rows[start:stop]],
            n_frames=window.n_frames,
        )
        return read_states(self.features, window, rows=inside)

    def _stop(self, first: int) -> int:
        """Return the place after the last row of the block that begins at place `first`."""
        ends = self.clock.frames[self.rows[first:], -1]
        limit = int(self.clock.frames[self.rows[first], 0]) + self.block_frames
        return first + max(1, int(np.searchsorted(ends, limit)))


def train_streamed(
    trainer: Trainer,
    y: ArrayLike,
    task_name: str = "task",
    *,
    block_frames: int = 4096,
    context: int = 1,
) -> TrainingResult:
    """Do what ``trainer.train(y, task_name)`` does without holding the states in memory.

    The file is read block by block: for the second moments of the training rows, and
    for the predictions. What is kept is one block, one matrix (F + O, F + O), and what has one
    value per row: time, target and predictions.

    Parameters
    ----------
    trainer : Trainer
        Its readout is `openprc.reservoir.Ridge`, ``TemporalRidgeCV`` or scikit-learn's Ridge.
    y, task_name
        As for `openprc.reservoir.Trainer.train`.
    block_frames : int
        Frames that are read at a time.
    context : int
        Frames before and after each block that features may look at, as differences in time do.

    Raises
    ------
    TaskError
        When the readout needs all states at once, when features learn from the states or look
        further than `context`, and as `Trainer.train`.
    """
    trainer.check_task_name(task_name)
    _check(trainer, block_frames, context)
    target, note = trainer.align_target(y)
    clock = trainer.rows
    names: tuple[str, ...] = ()
    usable = np.ones(clock.n_rows, dtype=bool)
    everything = StreamedRows(
        trainer.loader, trainer.features, clock, np.arange(clock.n_rows), block_frames, context
    )
    if trainer.loader.missing == "drop":
        for first, states in everything.blocks():
            usable[first : first + len(states.usable)] = states.usable
    names = everything.read(0, 1).names
    train, test = trainer.split.masks(usable)
    chosen = replace(everything, rows=train, n_columns=len(names))
    fitted = fit_rows(trainer.readout, chosen, target[train], standardize=trainer.standardize)
    prediction = fitted.predict_rows(replace(chosen, rows=test))
    evaluation = scored(fitted, target, train=train, test=test, prediction=prediction)
    n_incomplete = int(np.count_nonzero(~usable))
    return trainer.result(
        evaluation,
        target,
        task_name=task_name,
        flat=np.ndim(y) == 1,
        names=names,
        remarks=(note, *state_remarks(evaluation, names, n_incomplete)),
    )


def _check(trainer: Trainer, block_frames: int, context: int) -> None:
    if not reads_in_place(trainer.readout):
        raise TaskError(
            f"the readout, {type(trainer.readout).__name__}, needs all states at once",
            expected="a readout that needs second moments only",
            fix="use Ridge or TemporalRidgeCV, or train with Trainer.train",
            key="readout",
        )
    parts = trainer.features.features if isinstance(trainer.features, Stacked) else []
    if not all(callable(getattr(f, "names", None)) for f in (trainer.features, *parts)):
        raise TaskError(
            f"{trainer.features!r} learns from the states, or has steps that may",
            expected="features alone, which read a file frame by frame",
            fix="leave the steps after the features out, or train with Trainer.train",
            key="features",
        )
    if block_frames < 1 or context < 0:
        raise TaskError(
            f"block_frames is {block_frames} and context is {context}",
            expected="at least 1, and at least 0",
            fix="choose such numbers",
            key="block_frames",
        )
