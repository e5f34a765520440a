"""What all features share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.io.state_loader import StateLoader, as_loader
from openprc.schema import Trajectory

#: Changes below this fraction of a value are rounding errors.
ROUND_OFF = 8.0 * float(np.finfo(np.float64).eps)


class Feature(ABC):
    """Trajectory to state matrix.

    A feature stores its settings when it is made and reads the file when it is applied, so one
    object serves many files.
    """

    def transform(self, source: StateLoader | Trajectory) -> NDArray[np.float64]:
        """Return the state matrix, (T, F), one row per frame.

        Columns that never change are kept: which ones they are is for the trainer to report,
        and `constant_columns` tells. Rows of frames that were not measured are NaN when the
        loader was made with ``missing="drop"``.
        """
        return self._transform(as_loader(source))

    def names(self, source: StateLoader | Trajectory) -> list[str]:
        """Return the F column names, such as ``"node3.z"``."""
        return self._names(as_loader(source))

    def constant_columns(self, source: StateLoader | Trajectory) -> list[str]:
        """Return the names of the columns that never change."""
        loader = as_loader(source)
        constant = is_constant(self._transform(loader))
        return [name for name, flag in zip(self._names(loader), constant, strict=True) if flag]

    @abstractmethod
    def config(self) -> dict[str, Any]:
        """Return the settings as plain values, with the class name under ``"type"``."""

    @abstractmethod
    def _transform(self, loader: StateLoader) -> NDArray[np.float64]: ...

    @abstractmethod
    def _names(self, loader: StateLoader) -> list[str]: ...

    def __repr__(self) -> str:
        """Show the class and its settings."""
        settings = ", ".join(f"{k}={v!r}" for k, v in self.config().items() if k != "type")
        return f"{type(self).__name__}({settings})"


class Stacked(Feature):
    """Several features side by side, in the order given."""

    def __init__(self, features: Sequence[Feature]) -> None:
        self.features = tuple(features)
        if not self.features:
            raise TaskError(
                "no features given",
                expected="at least one",
                fix="pass a feature such as NodeDisplacements()",
                key="features",
            )

    def config(self) -> dict[str, Any]:
        """Return the settings of every part."""
        return {"type": "Stacked", "features": [feature_config(f) for f in self.features]}

    def _transform(self, loader: StateLoader) -> NDArray[np.float64]:
        return np.hstack([feature.transform(loader) for feature in self.features])

    def _names(self, loader: StateLoader) -> list[str]:
        return [name for feature in self.features for name in feature.names(loader)]


def feature_config(feature: Any) -> dict[str, Any]:
    """Return the settings of a feature; of a foreign one without `config`, its class name."""
    config = getattr(feature, "config", None)
    return dict(config()) if callable(config) else {"type": type(feature).__name__}


def is_constant(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (F,) flags of the columns of `values` (T, F) that do not change.

    Rows with NaN are ignored. A range of a few rounding errors of the largest value counts as
    no change, so that the sum of a constant and round-off is not taken for a state.
    """
    rows = values[~np.isnan(values).any(axis=1)]
    if not len(rows):
        return np.ones(values.shape[1], dtype=bool)
    size = np.abs(rows).max(axis=0)
    return np.ptp(rows, axis=0) <= ROUND_OFF * size
