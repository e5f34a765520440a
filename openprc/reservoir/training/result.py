"""What a training gives: predictions, errors, remarks, and readout.h5."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc import __version__
from openprc.errors import TaskError
from openprc.reservoir.readout.stored_estimator import (
    ESTIMATOR,
    VERSIONS,
    pack_estimator,
    skops_is_there,
    versions,
)
from openprc.reservoir.training.classification import Classification
from openprc.reservoir.training.evaluation import Evaluation
from openprc.reservoir.training.row_clock import RowClock
from openprc.reservoir.training.row_split import RowSplit
from openprc.reservoir.training.scores import NMSE_DEFINITION, NRMSE_DEFINITION
from openprc.schema import Provenance, results


@dataclass(frozen=True)
class TrainingResult:
    """One trained readout on one target.

    Parameters
    ----------
    task_name : str
    evaluation : Evaluation
    target : (R, O) float64, or labels (R,) of a classifier
        On every row of the clock.
    flat : bool
        The target was given as (n,), and `cache` gives it back that way.
    clock : RowClock
    split : RowSplit
    feature_names : tuple of str
    warnings : tuple of str
        What a reader of the score should know.
    settings : mapping
        Plain values that go into the provenance.
    source : (str, str)
        Base name and run id of the trajectory.
    experiment_dir : Path or None
    """

    task_name: str
    evaluation: Evaluation
    target: NDArray[Any]
    flat: bool
    clock: RowClock
    split: RowSplit
    feature_names: tuple[str, ...]
    warnings: tuple[str, ...]
    settings: Mapping[str, Any]
    source: tuple[str, str]
    experiment_dir: Path | None

    @property
    def nmse(self) -> float:
        """Normalised mean squared error on the test rows, mean over outputs.

        Raises
        ------
        TaskError
            When the readout is a classifier.
        """
        return self.evaluation.mean_nmse

    @property
    def nrmse(self) -> float:
        """Root of the NMSE on the test rows, mean over outputs; raises as `nmse`."""
        return self.evaluation.mean_nrmse

    @property
    def accuracy(self) -> float:
        """Share of test rows that a classifier gave their label.

        Raises
        ------
        TaskError
            When the readout is no classifier.
        """
        return self._labels.accuracy

    @property
    def symbol_error_rate(self) -> float:
        """One less the accuracy; raises as `accuracy`."""
        return self._labels.symbol_error_rate

    @property
    def confusion(self) -> NDArray[np.int64]:
        """Test rows by true label (matrix row) and named one (column); raises as `accuracy`."""
        return self._labels.confusion

    @property
    def _labels(self) -> Classification:
        if self.evaluation.classification is None:
            raise TaskError(
                "the readout is a regressor, and numbers are not right or wrong",
                expected="a classifier",
                fix="ask for nrmse, or decide with scores of labels such as symbol_error_rate",
                key="accuracy",
            )
        return self.evaluation.classification

    @property
    def weights(self) -> NDArray[np.float64] | None:
        """Weights on standardised states, (F, O), or None for a readout that is not affine."""
        return self.evaluation.fitted.weights

    @property
    def bias(self) -> NDArray[np.float64] | None:
        """Bias, (O,), or None for a readout that is not affine."""
        return self.evaluation.fitted.bias

    @property
    def constant_columns(self) -> tuple[str, ...]:
        """Names of the states that do not change over the training rows."""
        flags = self.evaluation.fitted.standardizer.constant
        return tuple(n for n, flag in zip(self.feature_names, flags, strict=True) if flag)

    @property
    def cache(self) -> dict[str, tuple[NDArray[np.float64], ...]]:
        """``"train"`` and ``"test"``, each (time, target, prediction).

        Target and prediction are (n,) when the target was given that way, else (n, O).
        """
        flat = self.flat and self.target.ndim == 2
        spans = {
            "train": (self.evaluation.train_rows, self.evaluation.fitted.train_prediction),
            "test": (self.evaluation.test_rows, self.evaluation.prediction),
        }
        return {
            name: (
                self.clock.time[rows],
                self.target[rows, 0] if flat else self.target[rows],
                prediction[:, 0] if flat else prediction,
            )
            for name, (rows, prediction) in spans.items()
        }

    @property
    def readout_path(self) -> Path:
        """Where `save` writes: ``<experiment_dir>/readout/readout_<task_name>.h5``.

        Raises
        ------
        TaskError
            When the trainer was made without an experiment folder.
        """
        if self.experiment_dir is None:
            raise TaskError(
                "the trainer has no experiment_dir, so there is no place to write to",
                expected="a folder",
                fix="pass experiment_dir to Trainer",
                key="experiment_dir",
            )
        return self.experiment_dir / "readout" / f"readout_{self.task_name}.h5"

    def save(self, *, estimator: bool | None = None) -> Path:
        """Write readout.h5 in one step, replacing an earlier one of this task.

        A readout that is an affine map of the states is stored as weights. Of any other the
        predictions are stored, and the estimator itself where that can be done without pickle.

        Parameters
        ----------
        estimator : bool, optional
            Store an estimator that is no affine map: by default if skops is installed.

        Raises
        ------
        TaskError
            When there is no experiment folder, or skops cannot store the estimator.
        MissingDependency
            When the estimator is to be stored and skops is not installed.
        """
        attrs, arrays = self._attrs(), self._arrays()
        if self.weights is None and (skops_is_there() if estimator is None else estimator):
            arrays[ESTIMATOR] = pack_estimator(self.evaluation.fitted.estimator)
            attrs[VERSIONS] = versions()
        return results.write_result(
            self.readout_path,
            kind="readout",
            attrs=attrs,
            arrays=arrays,
            provenance=Provenance(
                "openprc.reservoir",
                producer_version=__version__,
                plugin_version=__version__,
                config=dict(self.settings),
                parents=(self.source[1],),
            ),
            overwrite=True,
        )

    def _attrs(self) -> dict[str, Any]:
        attrs: dict[str, Any] = {
            "task_name": self.task_name,
            "source_name": self.source[0],
            "source_run_id": self.source[1],
            **self._scores(),
            "n_states": len(self.feature_names),
            "n_outputs": self.evaluation.fitted.n_outputs,
            "n_train": len(self.evaluation.train_rows),
            "n_test": len(self.evaluation.test_rows),
            "clock": self.clock.kind,
            "row_step": self.clock.step,
            "samples_per_symbol": self.clock.samples_per_row,
            "time_unit": "s" if self.clock.unit == "s" else "1",
            "estimator": repr(self.evaluation.fitted.estimator),
            "linear": int(self.weights is not None),
            "washout_rows": self.split.washout,
            "gap_rows": self.split.gap,
        }
        if self.warnings:
            attrs["warnings"] = list(self.warnings)
        return attrs

    def _scores(self) -> dict[str, Any]:
        test, train = self.evaluation.classification, self.evaluation.train_classification
        if test is None or train is None:
            return {
                "NMSE": self.nmse,
                "NRMSE": self.nrmse,
                "NMSE_definition": NMSE_DEFINITION,
                "NRMSE_definition": NRMSE_DEFINITION,
                "NMSE_train": float(self.evaluation.train_nmse.mean()),
            }
        return {
            "accuracy": test.accuracy,
            "symbol_error_rate": test.symbol_error_rate,
            "majority_accuracy": test.majority,
            "accuracy_train": train.accuracy,
        }

    def _arrays(self) -> dict[str, NDArray[Any]]:
        fitted = self.evaluation.fitted
        arrays: dict[str, NDArray[Any]] = {
            "preprocessing/X_mean": fitted.standardizer.mean,
            "preprocessing/X_scale": fitted.standardizer.scale,
            "model/feature_names": np.asarray(self.feature_names, dtype=str),
        }
        if fitted.classes is None:
            arrays["validation/NMSE"] = self.evaluation.nmse
            arrays["training/NMSE"] = self.evaluation.train_nmse
        else:
            arrays["model/classes"] = fitted.classes
        if self.evaluation.classification is not None:
            arrays["validation/confusion"] = self.evaluation.classification.confusion
            arrays["validation/labels"] = self.evaluation.classification.labels
        if fitted.weights is not None and fitted.bias is not None:
            arrays["model/weights"] = fitted.weights
            arrays["model/bias"] = fitted.bias
        if self.constant_columns:
            arrays["preprocessing/constant_columns"] = np.asarray(self.constant_columns, dtype=str)
        spans = {
            "training": (self.evaluation.train_rows, self.evaluation.fitted.train_prediction),
            "validation": (self.evaluation.test_rows, self.evaluation.prediction),
        }
        for name, (rows, prediction) in spans.items():
            arrays[f"{name}/time"] = self.clock.time[rows]
            arrays[f"{name}/target"] = self.target[rows]
            arrays[f"{name}/prediction"] = prediction
        return arrays
