"""`Trainer`: one file, one set of features, one readout, any number of targets."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.reservoir.features.base import Stacked, feature_config
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.fitting import check_readout
from openprc.reservoir.training.evaluation import evaluate
from openprc.reservoir.training.remarks import clock_remarks, state_remarks
from openprc.reservoir.training.result import TrainingResult
from openprc.reservoir.training.row_clock import ClockChoice, RowClock, row_clock
from openprc.reservoir.training.split import Split

_TASK_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*\Z")


@dataclass(frozen=True)
class States:
    """The state matrix on the rows of a clock.

    ``values`` (R, F), ``names`` F column names, ``usable`` (R,) rows without missing samples.
    """

    values: NDArray[np.float64]
    names: tuple[str, ...]
    usable: NDArray[np.bool_]


class Trainer:
    """Fit readouts on the states of one file, with one washout and one split for all of them.

    Where the file stores the symbols of its input, a row is a symbol and its states are those
    of the last frame within it; otherwise a row is a frame.

    Parameters
    ----------
    features : feature or sequence of features
        Anything with ``transform(loader) -> (T, F)`` and ``names(loader)``.
    readout : estimator
        Any object with ``fit`` and ``predict``; it is cloned, never changed.
    loader : StateLoader
    washout, train_duration, test_duration : float [s]
        Consecutive spans, from the first row on. In a file of load steps they count steps.
    experiment_dir : path-like, optional
        Where `TrainingResult.save` writes.
    gap : float [s]
        Left out between training and test.
    clock : {"auto", "symbols", "frames"}
    input_name : str, optional
        Input whose symbols count; by default the first that stores them.
    samples_per_symbol : int
        Frames within each symbol that are put side by side as virtual nodes.
    standardize : bool
        Bring the states to zero mean and unit variance, as learned from the training rows.

    Examples
    --------
    >>> trainer = Trainer(NodeDisplacements(), Ridge(1e-6), loader=loader, washout=5.0,
    ...                   train_duration=20.0, test_duration=5.0)          # doctest: +SKIP
    >>> trainer.train(target, "narma2").nrmse                              # doctest: +SKIP
    """

    def __init__(
        self,
        features: Any,
        readout: Any,
        *,
        loader: StateLoader,
        washout: float,
        train_duration: float,
        test_duration: float,
        experiment_dir: str | Path | None = None,
        gap: float = 0.0,
        clock: ClockChoice = "auto",
        input_name: str | None = None,
        samples_per_symbol: int = 1,
        standardize: bool = True,
    ) -> None:
        check_readout(readout)
        is_list = isinstance(features, Sequence) and not isinstance(features, str)
        self.features = Stacked(features) if is_list else features
        self.readout = readout
        self.loader = loader
        self.washout = washout
        self.train_duration = train_duration
        self.test_duration = test_duration
        self.experiment_dir = None if experiment_dir is None else Path(experiment_dir)
        self.gap = gap
        self.clock = clock
        self.input_name = input_name
        self.samples_per_symbol = samples_per_symbol
        self.standardize = standardize

    @cached_property
    def rows(self) -> RowClock:
        """The clock of the rows."""
        return row_clock(
            self.loader,
            clock=self.clock,
            input_name=self.input_name,
            samples_per_symbol=self.samples_per_symbol,
        )

    @cached_property
    def split(self) -> Split:
        """The spans in rows.

        Raises
        ------
        TaskError
            When the file is too short for them.
        """
        return Split.from_seconds(
            self.rows.n_rows,
            self.rows.step,
            washout=self.washout,
            train=self.train_duration,
            test=self.test_duration,
            gap=self.gap,
            unit=self.rows.unit,
            file=str(self.loader.path),
        )

    @cached_property
    def states(self) -> States:
        """The state matrix, read once for all targets.

        Raises
        ------
        TaskError
            When the feature gives something that is no state matrix of this file.
        """
        matrix = np.asarray(self.features.transform(self.loader), dtype=np.float64)
        names = list(self.features.names(self.loader))
        shape = (self.loader.n_frames, len(names))
        if matrix.shape != shape or not names:
            raise TaskError(
                f"{self.features!r} gave a matrix of shape {matrix.shape} and {len(names)} names",
                expected=f"{self.loader.n_frames} rows, and one name per column",
                fix="correct transform and names of the feature",
                file=self.loader.path,
                key="features",
            )
        if np.isinf(matrix).any():
            column = names[int(np.flatnonzero(np.isinf(matrix).any(axis=0))[0])]
            raise TaskError(
                f"state {column!r} is infinite",
                expected="finite numbers, or NaN where nothing was measured",
                fix="leave that column out",
                file=self.loader.path,
                key="features",
            )
        n = self.rows.samples_per_row
        values = matrix[self.rows.frames].reshape(self.rows.n_rows, -1)
        if n > 1:
            names = [f"{name}@{part + 1}/{n}" for part in range(n) for name in names]
        return States(values, tuple(names), ~np.isnan(values).any(axis=1))

    def align_input(self, u: ArrayLike) -> tuple[NDArray[np.float64], str]:
        """Return one input value per row, and how it was come by; see `RowClock.align_input`."""
        return self.rows.align_input(u)

    def train(self, y: ArrayLike, task_name: str = "task") -> TrainingResult:
        """Fit a copy of the readout to a target and score it on the test rows.

        Parameters
        ----------
        y : (n,) or (n, O)
            One row per row of the clock (a symbol, or a frame), or one per frame. Row k is
            paired with the states at the end of symbol k, which have seen input symbol k.
        task_name : str
            Names the results file.

        Raises
        ------
        TaskError
            When the target does not fit the rows, the file is too short, no state changes, or
            the name cannot be part of a file name.
        MissingData
            When states are missing; see `StateLoader`.
        """
        if not _TASK_NAME.match(task_name):
            raise TaskError(
                f"the task name is {task_name!r}",
                expected="letters, digits, '.', '_' or '-', since it is part of a file name",
                fix="choose such a name",
                key="task_name",
            )
        target, note = self.rows.align_target(y)
        split, states = self.split, self.states
        result = evaluate(
            self.readout,
            states.values,
            target,
            split=split,
            usable=states.usable,
            standardize=self.standardize,
        )
        remarks = (
            note,
            *clock_remarks(self),
            *state_remarks(result, states.names, int(np.count_nonzero(~states.usable))),
            *result.fitted.warnings,
        )
        return TrainingResult(
            task_name=task_name,
            evaluation=result,
            target=target,
            flat=np.ndim(y) == 1,
            clock=self.rows,
            split=split,
            feature_names=states.names,
            warnings=tuple(remark for remark in remarks if remark),
            settings=self.settings(),
            source=(self.loader.path.name, self.loader.run_id),
            experiment_dir=self.experiment_dir,
        )

    def settings(self) -> dict[str, Any]:
        """Return everything that was chosen, as plain values."""
        return {
            "features": feature_config(self.features),
            "readout": repr(self.readout),
            "washout": self.washout,
            "train_duration": self.train_duration,
            "test_duration": self.test_duration,
            "gap": self.gap,
            "clock": self.rows.kind,
            "input_name": self.rows.symbols.name if self.rows.symbols else self.input_name,
            "samples_per_symbol": self.samples_per_symbol,
            "standardize": self.standardize,
            "missing": self.loader.missing,
        }
