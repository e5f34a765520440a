"""What all features share: the protocol of a scikit-learn transformer, with a loader as X."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from inspect import signature
from typing import Any, Self

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
    object serves many files. It can be cloned and set up like any scikit-learn transformer and
    stand first in a Pipeline, or in a FeatureUnion; what scikit-learn calls X is a loader.
    Features are put side by side with ``+``.
    """

    def transform(self, source: StateLoader | Trajectory) -> NDArray[np.float64]:
        """Return the state matrix, (T, F), one row per frame.

        Columns that never change are kept: which ones they are is for the trainer to report,
        and `constant_columns` tells. Rows of frames that were not measured are NaN when the
        loader was made with ``missing="drop"``.
        """
        return self._transform(_loader(source, self))

    def names(self, source: StateLoader | Trajectory) -> list[str]:
        """Return the F column names, such as ``"node3.z"``."""
        return self._names(_loader(source, self))

    def constant_columns(self, source: StateLoader | Trajectory) -> list[str]:
        """Return the names of the columns that never change."""
        loader = _loader(source, self)
        constant = is_constant(self._transform(loader))
        return [name for name, flag in zip(self._names(loader), constant, strict=True) if flag]

    @abstractmethod
    def _transform(self, loader: StateLoader) -> NDArray[np.float64]: ...

    @abstractmethod
    def _names(self, loader: StateLoader) -> list[str]: ...

    # --- the protocol of scikit-learn ----------------------------------------------------------

    def fit(self, source: StateLoader | Trajectory, y: object = None) -> Self:
        """Note the column names of a file. Nothing else is learned; `y` is ignored."""
        self.feature_names_out_ = np.asarray(self.names(source), dtype=object)
        return self

    def fit_transform(
        self, source: StateLoader | Trajectory, y: object = None
    ) -> NDArray[np.float64]:
        """Return ``fit(source).transform(source)``."""
        return self.fit(source, y).transform(source)

    def get_feature_names_out(self, input_features: object = None) -> NDArray[np.object_]:
        """Return the column names of the file that the feature was fitted to, (F,).

        Raises
        ------
        TaskError
            When it was not fitted: how many columns there are depends on the file. `names`
            asks a file directly.
        """
        if not hasattr(self, "feature_names_out_"):
            raise TaskError(
                f"{type(self).__name__} was not fitted, so its columns are not known",
                expected="fit(loader) before get_feature_names_out()",
                fix="fit it, or ask names(loader)",
                key="feature_names_out_",
            )
        return self.feature_names_out_.copy()

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the settings as they were given."""
        return {name: getattr(self, name) for name in signature(type(self)).parameters}

    def set_params(self, **params: Any) -> Self:
        """Change settings.

        Raises
        ------
        TaskError
            When there is no setting of that name.
        """
        known = self.get_params()
        for name, value in params.items():
            if name not in known:
                raise TaskError(
                    f"{type(self).__name__} has no setting {name!r}",
                    expected="one of " + (", ".join(known) or "none: it has no settings"),
                    fix="correct the name",
                    key=name,
                )
            setattr(self, name, value)
        return self

    def set_output(self, *, transform: str | None = None) -> Self:
        """Accept arrays, the only container that a feature returns.

        Raises
        ------
        TaskError
            When another one is asked for.
        """
        if transform not in (None, "default"):
            raise TaskError(
                f"set_output asks for {transform!r}",
                expected='"default": features return arrays',
                fix="build the table from transform(loader) and names(loader), or set the output "
                "of a later step of the pipeline",
                key="transform",
            )
        return self

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import InputTags, Tags, TargetTags, TransformerTags

        return Tags(
            estimator_type=None,
            target_tags=TargetTags(required=False),
            transformer_tags=TransformerTags(),
            # X is a loader, which scikit-learn is not to look into.
            input_tags=InputTags(two_d_array=False, allow_nan=True),
            no_validation=True,
            requires_fit=False,
        )

    # --- settings ------------------------------------------------------------------------------

    def config(self) -> dict[str, Any]:
        """Return the settings as plain values, with the class name under ``"type"``."""
        settings = {name: plain(value) for name, value in self.get_params().items()}
        return {"type": type(self).__name__, **settings}

    def __add__(self, other: Feature) -> Stacked:
        if not isinstance(other, Feature):
            return NotImplemented
        left = self.features if isinstance(self, Stacked) else [self]
        right = other.features if isinstance(other, Stacked) else [other]
        return Stacked([*left, *right])

    def __repr__(self) -> str:
        """Show the class and the settings that are not the default."""
        settings = ", ".join(f"{k}={v!r}" for k, v in self.config().items() if k != "type")
        return f"{type(self).__name__}({settings})"


class Stacked(Feature):
    """Several features side by side, in the order given.

    Parameters
    ----------
    features : sequence of feature
        Anything with ``transform(loader) -> (T, F)`` and ``names(loader)``. In a `Trainer`, also
        a scikit-learn Pipeline or FeatureUnion that begins with such.
    """

    def __init__(self, features: Sequence[Any]) -> None:
        self.features = features
        if not len(features):
            raise TaskError(
                "no features given",
                expected="at least one",
                fix="pass a feature such as NodeDisplacements()",
                key="features",
            )

    def config(self) -> dict[str, Any]:
        """Return the settings of every part."""
        return {"type": "Stacked", "features": [feature_config(f) for f in self.features]}

    def __repr__(self) -> str:
        """Show the parts."""
        return f"Stacked({list(self.features)!r})"

    def _transform(self, loader: StateLoader) -> NDArray[np.float64]:
        self._names(loader)
        return np.hstack([feature.transform(loader) for feature in self.features])

    def _names(self, loader: StateLoader) -> list[str]:
        return [name for feature in self.features for name in _names_of(feature, loader)]


def _names_of(feature: Any, loader: StateLoader) -> list[str]:
    if callable(getattr(feature, "names", None)):
        return list(feature.names(loader))
    raise TaskError(
        f"{type(feature).__name__} is no feature: it has no names(loader)",
        expected="features, which learn nothing",
        fix="pass a pipeline to Trainer(features=...), which fits it on the training rows only",
        key="features",
    )


def feature_config(feature: Any) -> dict[str, Any]:
    """Return the settings of a feature; of a foreign one without `config`, what it prints."""
    config = getattr(feature, "config", None)
    if callable(config):
        return dict(config())
    steps = getattr(feature, "steps", None) or getattr(feature, "transformer_list", None)
    if steps:
        return {
            "type": type(feature).__name__,
            "steps": [{"name": name, **feature_config(step)} for name, step in steps],
        }
    if isinstance(feature, str):
        return {"type": feature}
    return {"type": type(feature).__name__, "settings": _settings_of(feature)}


def _settings_of(feature: Any) -> dict[str, Any]:
    get_params = getattr(feature, "get_params", None)
    params: Mapping[str, Any] = get_params(deep=False) if callable(get_params) else {}
    return {name: plain(value) for name, value in params.items()}


def plain(value: Any) -> Any:
    """Return a setting as a value that JSON can hold; of an object, what it prints."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Sequence):
        return [plain(item) for item in value]
    return repr(value)


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


def _loader(source: StateLoader | Trajectory, feature: Feature) -> StateLoader:
    if isinstance(source, StateLoader | Trajectory):
        return as_loader(source)
    raise TaskError(
        f"{type(feature).__name__} was given {type(source).__name__}",
        expected="a StateLoader or a Trajectory: features read a file, not a matrix",
        fix="let the feature stand first in the pipeline, and pass the loader",
        key="source",
    )
