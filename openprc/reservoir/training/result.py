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
from openprc.reservoir.training.evaluation import Evaluation
from openprc.reservoir.training.row_clock import RowClock
from openprc.reservoir.training.scores import NMSE_DEFINITION, NRMSE_DEFINITION
from openprc.reservoir.training.split import Split
from openprc.schema import Provenance, results


@dataclass(frozen=True)
class TrainingResult:
    """One trained readout on one target.

    Parameters
    ----------
    task_name : str
    evaluation : Evaluation
    target : (R, O) float64
        On every row of the clock.
    flat : bool
        The target was given as (n,), and `cache` gives it back that way.
    clock : RowClock
    split : Split
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
    target: NDArray[np.float64]
    flat: bool
    clock: RowClock
    split: Split
    feature_names: tuple[str, ...]
    warnings: tuple[str, ...]
    settings: Mapping[str, Any]
    source: tuple[str, str]
    experiment_dir: Path | None

    @property
    def nmse(self) -> float:
        """Normalised mean squared error on the test rows, mean over outputs."""
        return self.evaluation.mean_nmse

    @property
    def nrmse(self) -> float:
        """Root of the normalised mean squared error on the test rows, mean over outputs."""
        return self.evaluation.mean_nrmse

    @property
    def weights(self) -> NDArray[np.float64] | None:
        """Weights on standardised states, (F, O), or None for a readout that is not linear."""
        return self.evaluation.fitted.weights

    @property
    def bias(self) -> NDArray[np.float64] | None:
        """Bias, (O,), or None for a readout that is not linear."""
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
        spans = {
            "train": (self.evaluation.train_rows, self.evaluation.fitted.train_prediction),
            "test": (self.evaluation.test_rows, self.evaluation.prediction),
        }
        return {
            name: (
                self.clock.time[rows],
                self.target[rows, 0] if self.flat else self.target[rows],
                prediction[:, 0] if self.flat else prediction,
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

    def save(self) -> Path:
        """Write readout.h5 in one step, replacing an earlier one of this task.

        Raises
        ------
        TaskError
            When there is no experiment folder.
        """
        return results.write_result(
            self.readout_path,
            kind="readout",
            attrs=self._attrs(),
            arrays=self._arrays(),
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
            "NMSE": self.nmse,
            "NRMSE": self.nrmse,
            "NMSE_definition": NMSE_DEFINITION,
            "NRMSE_definition": NRMSE_DEFINITION,
            "NMSE_train": float(self.evaluation.train_nmse.mean()),
            "n_states": len(self.feature_names),
            "n_outputs": self.target.shape[1],
            "n_train": len(self.evaluation.train_rows),
            "n_test": len(self.evaluation.test_rows),
            "clock": self.clock.kind,
            "row_step": self.clock.step,
            "time_unit": "s" if self.clock.unit == "s" else "1",
            "estimator": repr(self.evaluation.fitted.estimator),
            "linear": int(self.weights is not None),
            "washout_rows": self.split.washout,
            "gap_rows": self.split.gap,
        }
        if self.warnings:
            attrs["warnings"] = list(self.warnings)
        return attrs

    def _arrays(self) -> dict[str, NDArray[Any]]:
        fitted = self.evaluation.fitted
        arrays: dict[str, NDArray[Any]] = {
            "preprocessing/X_mean": fitted.standardizer.mean,
            "preprocessing/X_scale": fitted.standardizer.scale,
            "model/feature_names": np.asarray(self.feature_names, dtype=str),
            "validation/NMSE": self.evaluation.nmse,
            "training/NMSE": self.evaluation.train_nmse,
        }
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
