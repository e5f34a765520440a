"""`Trainer`: one file, one set of features, one readout, any number of targets."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.reservoir.features.base import Stacked, feature_config
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.classifier import as_labels, is_classifier
from openprc.reservoir.readout.fitting import check_readout
from openprc.reservoir.training.evaluation import Evaluation, evaluate
from openprc.reservoir.training.remarks import split_remarks, state_remarks
from openprc.reservoir.training.result import TrainingResult
from openprc.reservoir.training.row_clock import ClockChoice, RowClock
from openprc.reservoir.training.row_split import RowSplit
from openprc.reservoir.training.split import ResolvedSplit, Split
from openprc.reservoir.training.states import States, build_states

_TASK_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*\Z")


class Trainer:
    """Fit readouts on the states of one file, with one washout and one split for all of them.

    Where the file stores the symbols of its input, a row is a symbol and its states are those
    of the last frame within it; otherwise a row is a frame.

    Parameters
    ----------
    features : feature or sequence of features
        Anything with ``transform(loader) -> (T, F)`` and ``names(loader)``.
    readout : estimator
        Any object with ``fit`` and ``predict``, classifiers among them; it is cloned, never
        changed.
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
    split : Split, optional
        Spans and clock in one object, in place of the seven arguments that say the same.

    Raises
    ------
    TaskError
        When spans are given twice or not at all, or the readout is no estimator.

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
        washout: float | None = None,
        train_duration: float | None = None,
        test_duration: float | None = None,
        experiment_dir: str | Path | None = None,
        gap: float | None = None,
        clock: ClockChoice | None = None,
        input_name: str | None = None,
        samples_per_symbol: int | None = None,
        standardize: bool = True,
        split: Split | None = None,
    ) -> None:
        check_readout(readout)
        is_list = isinstance(features, Sequence) and not isinstance(features, str)
        self.features = Stacked(features) if is_list else features
        self.readout = readout
        self.loader = loader
        self.experiment_dir = None if experiment_dir is None else Path(experiment_dir)
        self.standardize = standardize
        self.spans = _spans(
            split,
            {
                "washout": washout,
                "train_duration": train_duration,
                "test_duration": test_duration,
                "gap": gap,
                "clock": clock,
                "input_name": input_name,
                "samples_per_symbol": samples_per_symbol,
            },
        )

    @property
    def input_name(self) -> str | None:
        """Input whose symbols count, where one was named."""
        return self.spans.input_name

    @cached_property
    def resolved(self) -> ResolvedSplit:
        """Clock and spans, laid over the file.

        Raises
        ------
        TaskError
            When the file is too short for them.
        """
        return self.spans.resolve(self.loader)

    @property
    def rows(self) -> RowClock:
        """The clock of the rows."""
        return self.resolved.clock

    @property
    def split(self) -> RowSplit:
        """The spans in rows; raises as `resolved`."""
        return self.resolved.rows

    @cached_property
    def states(self) -> States:
        """The state matrix, read once for all targets.

        Raises
        ------
        TaskError
            When the feature gives something that is no state matrix of this file.
        """
        return build_states(self.features, self.loader, rows=self.rows, split=self.split)

    @cached_property
    def _clock_remarks(self) -> tuple[str, ...]:
        return tuple(split_remarks(self.loader, self.resolved))

    def align_input(self, u: ArrayLike) -> tuple[NDArray[np.float64], str]:
        """Return one input value per row, and how it was come by; see `RowClock.align_input`."""
        return self.rows.align_input(u)

    def train(
        self,
        y: ArrayLike,
        task_name: str = "task",
        *,
        usable: NDArray[np.bool_] | None = None,
    ) -> TrainingResult:
        """Fit a copy of the readout to a target and score it on the test rows.

        Parameters
        ----------
        y : (n,) or (n, O)
            One row per row of the clock (a symbol, or a frame), or one per frame. Row k is
            paired with the states at the end of symbol k, which have seen input symbol k.
            For a classifier, labels (n,): text or whole numbers.
        task_name : str
            Names the results file.
        usable : (R,) bool, optional
            Rows of the clock whose target is defined; the others are left out.

        Raises
        ------
        TaskError
            When the target does not fit the rows, the file is too short, no state changes, or
            the name cannot be part of a file name.
        MissingData
            When states are missing; see `StateLoader`.
        """
        self.check_task_name(task_name)
        target, note = self.align_target(y)
        states = self.states
        measured = states.usable if usable is None else states.usable & usable
        evaluation = evaluate(
            self.readout,
            states.values,
            target,
            split=self.split,
            usable=measured,
            standardize=self.standardize,
        )
        n_incomplete = int(np.count_nonzero(~states.usable))
        remarks = (note, *state_remarks(evaluation, states.names, n_incomplete))
        return self.result(
            evaluation,
            target,
            task_name=task_name,
            flat=np.ndim(y) == 1,
            names=states.names,
            remarks=remarks,
        )

    @staticmethod
    def check_task_name(task_name: str) -> None:
        """Refuse a name that cannot be part of a file name."""
        if not _TASK_NAME.match(task_name):
            raise TaskError(
                f"the task name is {task_name!r}",
                expected="letters, digits, '.', '_' or '-', since it is part of a file name",
                fix="choose such a name",
                key="task_name",
            )

    def align_target(self, y: ArrayLike) -> tuple[NDArray[Any], str]:
        """Return the target (R, O), or labels (R,) for a classifier, and how it was come by."""
        if not is_classifier(self.readout):
            if np.asarray(y).dtype.kind in "USO":
                raise TaskError(
                    f"the target is text and the readout, {type(self.readout).__name__}, is no "
                    "classifier",
                    expected="numbers, or a classifier",
                    fix="pass a classifier such as LogisticRegression(), or numbers",
                    key="y",
                )
            return self.rows.align_target(y)
        labels, codes = np.unique(as_labels(y), return_inverse=True)
        aligned, note = self.rows.align_target(codes)
        return labels[aligned[:, 0].astype(np.intp)], note

    def result(
        self,
        evaluation: Evaluation,
        target: NDArray[Any],
        *,
        task_name: str,
        flat: bool,
        names: tuple[str, ...],
        remarks: tuple[str, ...],
    ) -> TrainingResult:
        """Put together what was trained, with what a reader of the score should know."""
        all_remarks = (*self._clock_remarks, *remarks, *evaluation.fitted.warnings)
        return TrainingResult(
            task_name=task_name,
            evaluation=evaluation,
            target=target,
            flat=flat,
            clock=self.rows,
            split=self.split,
            feature_names=names,
            warnings=tuple(remark for remark in all_remarks if remark),
            settings=self.settings(),
            source=(self.loader.path.name, self.loader.run_id),
            experiment_dir=self.experiment_dir,
        )

    def settings(self) -> dict[str, Any]:
        """Return everything that was chosen, as plain values."""
        spans = self.spans
        return {
            "features": feature_config(self.features),
            "readout": repr(self.readout),
            "washout": spans.washout,
            "train_duration": spans.train,
            "test_duration": spans.test,
            "gap": spans.gap,
            "span_unit": spans.unit,
            "clock": self.rows.kind,
            "input_name": self.rows.symbols.name if self.rows.symbols else self.input_name,
            "samples_per_symbol": spans.samples_per_symbol,
            "frames_per_row": spans.frames_per_row,
            "standardize": self.standardize,
            "missing": self.loader.missing,
        }


def _spans(split: Split | None, given: dict[str, Any]) -> Split:
    """Return the split that was given, or the one that single arguments describe."""
    named = {name: value for name, value in given.items() if value is not None}
    if split is not None:
        if named:
            raise TaskError(
                f"both split and {', '.join(named)} are given",
                expected="spans and clock in one place",
                fix="put them into Split, or leave split out",
                key="split",
            )
        return split
    missing = [name for name in ("washout", "train_duration", "test_duration") if name not in named]
    if missing:
        raise TaskError(
            f"{', '.join(missing)} not given",
            expected="washout, train_duration and test_duration, or a split",
            fix="say how long to wait, to train and to test, or pass split=Split()",
            key=missing[0],
        )
    renamed = {"train_duration": "train", "test_duration": "test"}
    return Split(**{renamed.get(name, name): value for name, value in named.items()})
