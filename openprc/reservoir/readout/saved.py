"""A trained readout read back from readout.h5, without pickle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc import __version__
from openprc.errors import TaskError
from openprc.reservoir.features.base import Stacked
from openprc.reservoir.io.state_loader import StateLoader, as_loader
from openprc.reservoir.readout.classifier import named
from openprc.reservoir.readout.stored_estimator import (
    ESTIMATOR,
    VERSIONS,
    unpack_estimator,
    version_remarks,
)
from openprc.reservoir.training.row_blocks import RowBlocks
from openprc.reservoir.training.row_clock import ClockChoice, row_clock
from openprc.reservoir.training.standardizer import Standardizer
from openprc.reservoir.training.states import read_states
from openprc.schema import Provenance, Trajectory, results

_LISTED = 5


@dataclass(frozen=True)
class Readout:
    """A trained readout: weights, bias and scaling, or a whole estimator.

    Parameters
    ----------
    weights : (F, O) float64 or None
        On standardised states; of a linear classifier, those of its decision function, (F, K).
        None where there is an `estimator` instead.
    bias : (O,) float64 or None
    mean, scale : (F,) float64
        Of the training rows, in the unit of the states.
    feature_names : tuple of str
    attrs : mapping
        Everything else that readout.h5 says about the training.
    classes : (C,) or None
        Labels, of a classifier.
    estimator : object or None
        Acts on standardised states.
    remarks : tuple of str
        What is doubtful about the file, such as an estimator of another version.
    """

    weights: NDArray[np.float64] | None
    bias: NDArray[np.float64] | None
    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    feature_names: tuple[str, ...]
    attrs: Mapping[str, Any]
    classes: NDArray[Any] | None = None
    estimator: Any = None
    remarks: tuple[str, ...] = ()

    @classmethod
    def load(cls, path: str | Path, *, trusted: Sequence[str] = ()) -> Readout:
        """Read a file that `TrainingResult.save` wrote.

        Parameters
        ----------
        trusted : sequence of str
            Names of types that a stored estimator may be made of, beyond those of scikit-learn
            and NumPy. Weights need no trust.

        Raises
        ------
        TaskError
            When the file holds only the predictions of an estimator.
        MissingDependency
            When it holds an estimator and skops is not installed.
        UnreadableFile, SchemaError
            When it is not a readout file.
        UnsafeFile
            When an estimator is made of types that are not trusted.
        """
        stored = results.read_result(path)
        arrays, estimator, remarks = stored.arrays, None, ()
        linear = "model/weights" in arrays
        if stored.kind != "readout" or not (linear or ESTIMATOR in arrays):
            described = stored.attrs.get("estimator", stored.kind)
            raise TaskError(
                f"the file holds no linear weights ({described}) and no estimator",
                expected="model/weights of a linear readout, or a stored estimator",
                fix="install skops and save the training again, or use a linear readout",
                file=path,
                key="model/weights",
            )
        if not linear:
            estimator = unpack_estimator(arrays[ESTIMATOR], trusted=trusted, file=Path(path))
            remarks = version_remarks(stored.attrs.get(VERSIONS, ()))
        return cls(
            weights=stored.array("model/weights") if linear else None,
            bias=stored.array("model/bias") if linear else None,
            mean=stored.array("preprocessing/X_mean"),
            scale=stored.array("preprocessing/X_scale"),
            feature_names=tuple(str(name) for name in stored.array("model/feature_names")),
            attrs=stored.attrs,
            classes=arrays.get("model/classes"),
            estimator=estimator,
            remarks=remarks,
        )

    def predict(self, states: ArrayLike) -> NDArray[Any]:
        """Return predictions (n, O), in the unit of the target, for raw states (n, F).

        A classifier gives labels, (n,).

        Raises
        ------
        TaskError
            When the number of columns is not that of the training.
        """
        x = np.atleast_2d(np.asarray(states, dtype=np.float64))
        if x.shape[1] != len(self.mean):
            raise TaskError(
                f"the states have {x.shape[1]} columns",
                expected=f"{len(self.mean)} columns, as in training",
                fix="use the features that the readout was trained on: "
                + _listed(self.feature_names),
                key="states",
            )
        standardizer = Standardizer(self.mean, self.scale, np.zeros(len(self.mean), dtype=bool))
        if self.weights is None or self.bias is None:
            prediction = np.asarray(self.estimator.predict(standardizer.transform(x)))
            return prediction.reshape(len(x), *(() if self.classes is not None else (-1,)))
        values = standardizer.apply_affine(RowBlocks.all_of(x), self.weights, self.bias)
        return values if self.classes is None else named(self.classes, values)

    def predict_file(
        self,
        source: StateLoader | Trajectory,
        features: Any,
        *,
        clock: ClockChoice | None = None,
        input_name: str | None = None,
        samples_per_symbol: int | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[Any]]:
        """Return times (n,) and predictions (n, O), or labels (n,), for the rows of a file.

        Rows with missing samples are left out.

        Parameters
        ----------
        features : feature
            Those of the training: their column names have to agree.
        clock, input_name, samples_per_symbol
            As for `openprc.reservoir.Trainer`; by default what the training had.

        Raises
        ------
        TaskError
            When the columns are not those of the training, by name and order.
        """
        loader = as_loader(source)
        samples = samples_per_symbol or int(self.attrs.get("samples_per_symbol", 1))
        rows = row_clock(
            loader,
            clock=clock or self.attrs.get("clock", "auto"),
            input_name=input_name,
            samples_per_symbol=samples,
        )
        features = Stacked(features) if isinstance(features, list | tuple) else features
        if not callable(getattr(features, "names", None)):
            raise TaskError(
                f"{type(features).__name__} is no feature: it has no names(loader)",
                expected="features that learn nothing: what steps learned is not in the file",
                fix="pass a feature, or predict from the states of the trainer",
                key="features",
            )
        states = read_states(features, loader, rows=rows)
        if states.names != self.feature_names:
            raise TaskError(
                f"the features give {len(states.names)} columns: {_listed(states.names)}",
                expected=f"the {len(self.feature_names)} columns of the training: "
                + _listed(self.feature_names),
                fix="use the features that the readout was trained on",
                file=loader.path,
                key="features",
            )
        chosen = np.flatnonzero(states.usable)
        return rows.time[chosen], self.predict(RowBlocks(states.values, chosen).matrix())

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write weights, bias, scaling and names to a readout.h5, without the training's rows.

        Raises
        ------
        TaskError
            When the readout is an estimator: `TrainingResult.save` stores those.
        ResultExists
            When the file is there and `overwrite` is false.
        """
        if self.weights is None or self.bias is None:
            raise TaskError(
                "the readout is an estimator, not a table of weights",
                expected="a readout that is an affine map of the states",
                fix="copy the file that it was loaded from",
                file=path,
                key="model/weights",
            )
        arrays: dict[str, NDArray[Any]] = {
            "model/weights": self.weights,
            "model/bias": self.bias,
            "model/feature_names": np.asarray(self.feature_names, dtype=str),
            "preprocessing/X_mean": self.mean,
            "preprocessing/X_scale": self.scale,
        }
        if self.classes is not None:
            arrays["model/classes"] = self.classes
        parent = self.attrs.get("source_run_id")
        return results.write_result(
            path,
            kind="readout",
            attrs=dict(self.attrs),
            arrays=arrays,
            provenance=Provenance(
                "openprc.reservoir",
                producer_version=__version__,
                plugin_version=__version__,
                parents=(str(parent),) if parent else (),
            ),
            overwrite=overwrite,
        )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
