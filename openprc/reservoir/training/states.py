"""The state matrix of a training: features on the rows of a clock, learned steps and all."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.features.base import Stacked
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.training.row_clock import RowClock
from openprc.reservoir.training.row_split import RowSplit

_ASKS_FOR_TARGET = re.compile(r"requires y\b|argument: 'y'")


@dataclass(frozen=True)
class States:
    """The state matrix on the rows of a clock.

    ``values`` (R, F), ``names`` F column names, ``usable`` (R,) rows without missing samples,
    ``history`` the number of rows at the start that delay taps leave incomplete.
    """

    values: NDArray[np.float64]
    names: tuple[str, ...]
    usable: NDArray[np.bool_]
    history: int = 0


def build_states(features: Any, loader: StateLoader, *, rows: RowClock, split: RowSplit) -> States:
    """Read the states of a file on the rows of a clock, and put them through a pipeline.

    The feature at the beginning reads every frame; the clock picks rows; the steps after it act
    on rows. A step that learns, such as a scaler or PCA, is cloned, fitted on the training rows
    that were measured, and applied to every row that was.

    Parameters
    ----------
    features : feature, Pipeline, FeatureUnion or Stacked
        A feature is anything with ``transform(loader) -> (T, F)`` and ``names(loader)``. The
        first step of a Pipeline, and each part of a FeatureUnion, begins with one.
    rows : RowClock
    split : RowSplit

    Raises
    ------
    TaskError
        When the feature gives something that is no state matrix of this file, when a step
        learns from the target or cannot transform, or when the washout is shorter than the
        history that delay taps need.
    """
    return _Reading(loader, rows, split).states(features)


def read_states(feature: Any, loader: StateLoader, *, rows: RowClock) -> States:
    """Read what a single feature gives on the rows of a clock; raises as `build_states`."""
    matrix = np.asarray(feature.transform(loader), dtype=np.float64)
    names = list(feature.names(loader))
    shape = (loader.n_frames, len(names))
    if matrix.shape != shape or not names:
        raise TaskError(
            f"{feature!r} gave a matrix of shape {matrix.shape} and {len(names)} names",
            expected=f"{loader.n_frames} rows, and one name per column",
            fix="correct transform and names of the feature",
            file=loader.path,
            key="features",
        )
    _check_finite(matrix, names, loader)
    n = rows.samples_per_row
    values = matrix[rows.frames].reshape(rows.n_rows, -1)
    if n > 1:
        names = [f"{name}@{part + 1}/{n}" for part in range(n) for name in names]
    return _states(values, names)


@dataclass(frozen=True)
class _Reading:
    """One file, its rows, and which of them may be learned from."""

    loader: StateLoader
    rows: RowClock
    split: RowSplit

    def states(self, node: Any) -> States:
        """Return the states of a feature or of what begins with one."""
        steps = getattr(node, "steps", None)
        if steps:
            states = self.states(steps[0][1])
            for name, step in steps[1:]:
                states = self.after(step, states, name=name)
            return states
        if hasattr(node, "transformer_list"):
            return self._union(node, [self.states(part) for _, part in _parts(node)])
        if isinstance(node, Stacked):
            return _side_by_side([self.states(part) for part in node.features])
        if not callable(getattr(node, "names", None)):
            raise TaskError(
                f"{_title(node)} does not read a file: it has no names(loader)",
                expected="a feature such as NodeDisplacements() first",
                fix="begin the pipeline with a feature",
                key="features",
            )
        return read_states(node, self.loader, rows=self.rows)

    def after(self, step: Any, states: States, *, name: str) -> States:
        """Return the states that a step of a pipeline makes of others."""
        if step is None or (isinstance(step, str) and step == "passthrough"):
            return states
        if getattr(step, "steps", None):
            for inner, part in step.steps:
                states = self.after(part, states, name=inner)
            return states
        if hasattr(step, "transformer_list"):
            made = [self.after(part, states, name=inner) for inner, part in _parts(step)]
            return self._union(step, made)
        _check_step(step, name)
        return self._fitted(step, states, name=name)

    def _fitted(self, step: Any, states: States, *, name: str) -> States:
        from sklearn.base import clone

        history = states.history
        if getattr(step, "acts_along_rows", False):
            fitted = clone(step).fit(states.values)
            history += int(getattr(fitted, "n_history_rows_", 0))
            if history > self.split.washout:
                raise TaskError(
                    f"with {step!r} states need {history} rows of history and the washout is "
                    f"{self.split.washout} rows",
                    expected=f"a washout of {history} rows or more: those before have no history",
                    fix="lengthen the washout, or shorten the taps",
                    file=self.loader.path,
                    key="washout",
                )
            values = np.asarray(fitted.transform(states.values), dtype=np.float64)
        else:
            train, _ = self.split.masks(states.usable)
            fitted = _learned(clone(step), states.values[train], name=name)
            made = fitted.transform(states.values[states.usable])
            made = np.asarray(made.toarray() if hasattr(made, "toarray") else made)
            if np.isnan(made).any():
                raise TaskError(
                    f"step {name!r}, {_title(step)}, makes NaN of states that were measured",
                    expected="finite numbers",
                    fix="correct the step",
                    key="features",
                )
            values = np.full((len(states.values), made.shape[1]), np.nan)
            values[states.usable] = made
        names = _names_after(fitted, states.names, count=values.shape[1], step=name)
        _check_finite(values, names, self.loader)
        return _states(values, names, history)

    def _union(self, union: Any, made: Sequence[States]) -> States:
        weights = union.transformer_weights or {}
        verbose = getattr(union, "verbose_feature_names_out", True)
        parts = [
            States(
                part.values * weights.get(name, 1.0),
                tuple(f"{name}__{column}" for column in part.names) if verbose else part.names,
                part.usable,
                part.history,
            )
            for (name, _), part in zip(_parts(union), made, strict=True)
        ]
        return _side_by_side(parts)


def _parts(union: Any) -> list[tuple[str, Any]]:
    return [
        (name, part)
        for name, part in union.transformer_list
        if not (isinstance(part, str) and part == "drop")
    ]


def _side_by_side(parts: Sequence[States]) -> States:
    if not parts:
        raise TaskError(
            "every part is dropped",
            expected="at least one feature",
            fix="keep one",
            key="features",
        )
    if len(parts) == 1:
        return parts[0]
    names = [name for part in parts for name in part.names]
    history = max(part.history for part in parts)
    return _states(np.hstack([part.values for part in parts]), names, history)


def _check_step(step: Any, name: str) -> None:
    if not callable(getattr(step, "transform", None)):
        raise TaskError(
            f"step {name!r}, {_title(step)}, has no transform",
            expected="transformers: states in, states out",
            fix="pass what predicts to Trainer(readout=...)",
            key="features",
        )


def _learned(step: Any, training: NDArray[np.float64], *, name: str) -> Any:
    """Fit a step to the training rows, and say it when it asks for a target."""
    try:
        return step.fit(training)
    except (TypeError, ValueError) as error:
        # The tags of scikit-learn do not tell for all of its own estimators; their words do.
        if not _ASKS_FOR_TARGET.search(str(error)):
            raise
        raise TaskError(
            f"step {name!r}, {_title(step)}, learns from the target",
            expected="steps that learn from the states alone, which serve every target",
            fix="make it part of the readout: Trainer(readout=make_pipeline(step, Ridge()))",
            key="features",
        ) from error


def _names_after(fitted: Any, names: Sequence[str], *, count: int, step: str) -> list[str]:
    if not hasattr(fitted, "get_feature_names_out"):
        return [f"{step}{i}" for i in range(count)]
    return [str(n) for n in fitted.get_feature_names_out(np.asarray(names, dtype=object))]


def _check_finite(values: NDArray[np.float64], names: Sequence[str], loader: StateLoader) -> None:
    if np.isinf(values).any():
        column = names[int(np.flatnonzero(np.isinf(values).any(axis=0))[0])]
        raise TaskError(
            f"state {column!r} is infinite",
            expected="finite numbers, or NaN where nothing was measured",
            fix="leave that column out",
            file=loader.path,
            key="features",
        )


def _states(values: NDArray[np.float64], names: Sequence[str], history: int = 0) -> States:
    return States(values, tuple(names), ~np.isnan(values).any(axis=1), history)


def _title(node: Any) -> str:
    return node if isinstance(node, str) else type(node).__name__
