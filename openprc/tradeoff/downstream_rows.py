"""The rows of a run that the downstream side works on: states, input, targets, spans."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.analysis.benchmarks.choices import Choices, choose_input, open_trainer
from openprc.compare.task_scores import (
    FEWEST,
    capacities,
    check_rows,
    choices_for,
    standard_tasks,
)
from openprc.errors import TaskError
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.training.evaluation import evaluate
from openprc.reservoir.training.row_clock import RowClock
from openprc.reservoir.training.row_split import RowSplit
from openprc.reservoir.training.split import Split

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.scenes.scene import Scene

    Reals = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DownstreamRows:
    """What is trained on, apart from the states.

    Parameters
    ----------
    loader : StateLoader
        Of the open file.
    clock : RowClock
    split : RowSplit
    states : (R, F)
        Of the features of the scene.
    u : (R,)
    usable : (R,) bool
        Rows with states, and with targets of all tasks.
    targets : (R, O)
    names : tuple of str
        Figures of the O targets.
    left_out : mapping of str to str
        Tasks that are not defined on this input, and why.
    """

    loader: StateLoader
    clock: RowClock
    split: RowSplit
    states: Reals
    u: Reals
    usable: NDArray[np.bool_]
    targets: Reals
    names: tuple[str, ...]
    left_out: dict[str, str]

    @property
    def remarks(self) -> str:
        """What was left out, in one line."""
        return "; ".join(f"{name}: {reason}" for name, reason in self.left_out.items())

    def errors(
        self, readout: Any, states: Reals | None = None, *, standardize: bool = True
    ) -> dict[str, float]:
        """Return the NRMSE of every task, by one fit.

        Parameters
        ----------
        states : (R, F), optional
            In place of those of the file.

        Raises
        ------
        TaskError
        """
        found = evaluate(
            readout,
            self.states if states is None else states,
            self.targets,
            split=self.split,
            usable=self.usable,
            standardize=standardize,
        )
        return dict(zip(self.names, np.sqrt(found.nmse).tolist(), strict=True))

    def capacities(self, states: Reals | None = None) -> dict[str, float]:
        """Return memory and information processing capacity, in-sample.

        Raises
        ------
        TaskError
            When the input admits none.
        """
        found = capacities(
            self.states if states is None else states, self.u, split=self.split, usable=self.usable
        )
        return {"memory_capacity": found.memory_capacity, "ipc": found.total}

    def on_rows(self, frames: Reals) -> Reals:
        """Return states (R, F) from values at every frame, (T, F)."""
        return np.ascontiguousarray(frames[self.clock.frames[:, -1]])


@contextmanager
def downstream_rows(
    run: str | Path, scene: Scene | None, choices: Choices | None = None
) -> Iterator[DownstreamRows]:
    """Open a run and yield what its readouts are trained on.

    Raises
    ------
    MissingInputError, MissingData, NonUniformTime, TaskError
        When the run admits no task; see `openprc.compare.task_scores.task_scores`.
    """
    choices = choices_for(scene, choices or Choices())
    if choices.split == Split(input_name=choices.split.input_name):
        choices = replace(choices, split=default_spans(run, choices))
    with open_trainer(run, choices) as trainer:
        trainer.loader.require_physical_time("a task")
        trainer.loader.input_name(choices.split.input_name or 0)
        u = choose_input(trainer, choices.input_column).values
        check_rows(trainer, u)
        rows = DownstreamRows(
            loader=trainer.loader,
            clock=trainer.rows,
            split=trainer.split,
            states=trainer.states.values,
            u=u,
            usable=trainer.states.usable,
            targets=np.empty((len(u), 0)),
            names=(),
            left_out={},
        )
        yield _with_targets(rows)


def default_spans(run: str | Path, choices: Choices) -> Split:
    """Return a fifth of the rows to wash out, a tenth to test on, and the rest to train on.

    Least squares without a penalty learns what is left of the start of a body as well, and
    weights that are large hold the better the more rows they were learned from.
    """
    with open_trainer(run, choices) as trainer:
        n_rows = trainer.rows.n_rows
    spans = {"washout": n_rows // 5, "test": max(n_rows // 10, min(FEWEST, n_rows // 3))}
    return replace(choices.split, unit="rows", **spans)


def _with_targets(rows: DownstreamRows) -> DownstreamRows:
    columns, names, left_out = [], [], {}
    usable = rows.usable.copy()
    for name, task, given in standard_tasks(rows.u, step=rows.clock.step):
        try:
            series = task.target(given)
        except TaskError as problem:
            left_out[name] = problem.found
            continue
        usable &= series.usable
        columns.append(series.for_rows(series.usable)[:, 0])
        names.append(name)
    return replace(
        rows,
        usable=usable,
        targets=np.stack(columns, axis=1),
        names=tuple(names),
        left_out=left_out,
    )
