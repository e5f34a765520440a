"""A trained linear readout read back from readout.h5."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.schema import results


@dataclass(frozen=True)
class Readout:
    """Weights, bias and scaling of a trained linear readout.

    Parameters
    ----------
    weights : (F, O) float64
        On standardised states.
    bias : (O,) float64
    mean, scale : (F,) float64
        Of the training rows, in the unit of the states.
    feature_names : tuple of str
    attrs : mapping
        Everything else that readout.h5 says about the training.
    """

    weights: NDArray[np.float64]
    bias: NDArray[np.float64]
    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    feature_names: tuple[str, ...]
    attrs: Mapping[str, Any]

    @classmethod
    def load(cls, path: str | Path) -> Readout:
        """Read a file that `TrainingResult.save` wrote.

        Raises
        ------
        TaskError
            When the file holds predictions of an estimator that is not a linear map.
        UnreadableFile, SchemaError
            When it is not a readout file.
        """
        stored = results.read_result(path)
        if stored.kind != "readout" or "model/weights" not in stored.arrays:
            estimator = stored.attrs.get("estimator", stored.kind)
            raise TaskError(
                f"the file holds no linear weights ({estimator})",
                expected="model/weights of a linear readout",
                fix="train again with a linear readout such as Ridge, or keep the estimator itself",
                file=path,
                key="model/weights",
            )
        return cls(
            weights=stored.array("model/weights"),
            bias=stored.array("model/bias"),
            mean=stored.array("preprocessing/X_mean"),
            scale=stored.array("preprocessing/X_scale"),
            feature_names=tuple(str(name) for name in stored.array("model/feature_names")),
            attrs=stored.attrs,
        )

    def predict(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return predictions (n, O), in the unit of the target, for raw states (n, F).

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
                + ", ".join(self.feature_names[:5])
                + (", ..." if len(self.feature_names) > 5 else ""),
                key="states",
            )
        return ((x - self.mean) / self.scale) @ self.weights + self.bias
