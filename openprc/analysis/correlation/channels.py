"""The recorded channels, checked once, with the constant ones set apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.features.base import is_constant

#: Fewer rows than this say nothing about dependence.
FEWEST_ROWS = 8


@dataclass(frozen=True)
class Channels:
    """Channels as rows, centred.

    Attributes
    ----------
    rows : (N, T) float64
        Each channel less its mean; contiguous in time, as all that works on one channel wants it.
    names : tuple of str
    constant : (N,) bool
    """

    rows: NDArray[np.float64]
    names: tuple[str, ...]
    constant: NDArray[np.bool_]

    @property
    def n_rows(self) -> int:
        """Number of rows T of the recording."""
        return self.rows.shape[1]

    @property
    def kept(self) -> NDArray[np.intp]:
        """Numbers of the channels that vary."""
        return np.flatnonzero(~self.constant)

    @property
    def dropped(self) -> tuple[str, ...]:
        """Names of the constant channels."""
        return tuple(self.names[k] for k in np.flatnonzero(self.constant))

    def spread(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of the kept channels along axis 0 with NaN for the constant ones."""
        full = np.full((len(self.names), *values.shape[1:]), np.nan)
        full[self.kept] = values
        return full


def as_channels(
    states: Any, *, key: str, names: Sequence[str] | None = None, prefix: str = "x"
) -> Channels:
    """Check a state matrix (T, N), or one channel (T,), and centre it.

    Raises
    ------
    TaskError
        When the shape, the number of rows, the values or the names are unusable.
    """
    try:
        values = np.asarray(states, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TaskError(
            f"the values are no real numbers ({error})",
            expected="an array (T, N) of numbers, one row per frame or symbol",
            fix="convert the data before",
            key=key,
        ) from error
    if values.ndim == 1:
        values = values[:, None]
    if values.ndim != 2 or not values.shape[1]:
        raise TaskError(
            f"the shape is {np.shape(states)}",
            expected="(T, N): one row per frame or symbol, one column per channel",
            fix="reshape, for instance with X.reshape(len(X), -1)",
            key=key,
        )
    if len(values) < FEWEST_ROWS:
        raise TaskError(
            f"there are {len(values)} rows",
            expected=f"at least {FEWEST_ROWS}",
            fix="record longer; the first axis is time",
            key=key,
        )
    bad = ~np.isfinite(values).all(axis=1)
    if bad.any():
        raise TaskError(
            f"{int(bad.sum())} of {len(values)} rows are not finite, the first is row"
            f" {int(np.flatnonzero(bad)[0])}",
            expected="measured numbers in every row",
            fix="choose a gap-free span of rows, or fill the gaps knowingly",
            key=key,
        )
    rows = np.ascontiguousarray(values.T)
    centred = rows - rows.mean(axis=1, keepdims=True)
    # Once more: the mean of large numbers is rounded, that of small ones is not.
    centred -= centred.mean(axis=1, keepdims=True)
    return Channels(centred, _checked_names(names, len(rows), prefix=prefix), is_constant(values))


def as_states(
    states: Any, *, key: str, names: Sequence[str] | None = None, prefix: str = "x"
) -> Channels:
    """Check a state matrix as `as_channels` does, and that some channel changes."""
    found = as_channels(states, key=key, names=names, prefix=prefix)
    if found.constant.all():
        raise TaskError(
            f"none of the {len(found.names)} channels changes",
            expected="at least one that does",
            fix="leave out clamped nodes, or drive the body",
            key=key,
        )
    return found


def as_input(u: Any, *, n_rows: int, key: str) -> Channels:
    """Check an input (T,) or (T, C) that belongs to T rows of states.

    Raises
    ------
    TaskError
        When its length differs from that of the states, or when it never changes.
    """
    found = as_channels(u, key=key, prefix=key)
    if found.n_rows != n_rows:
        raise TaskError(
            f"the input has {found.n_rows} rows and the states have {n_rows}",
            expected="one value of the input for every row of the states",
            fix="cut or resample both to the same rows",
            key=key,
        )
    if found.constant.any():
        raise TaskError(
            f"column {int(np.flatnonzero(found.constant)[0])} of the input never changes",
            expected="an input that varies",
            fix="choose the driven degree of freedom, and rows in which it is driven",
            key=key,
        )
    return found


def as_scalar_input(u: Any, *, n_rows: int, key: str) -> NDArray[np.float64]:
    """Check an input (T,) and return it centred."""
    found = as_input(u, n_rows=n_rows, key=key)
    if len(found.rows) != 1:
        raise TaskError(
            f"the input has {len(found.rows)} columns",
            expected="one column; only cca() takes several",
            fix=f"choose one, such as {key}[:, 0]",
            key=key,
        )
    return found.rows[0]


def _checked_names(names: Sequence[str] | None, n: int, *, prefix: str) -> tuple[str, ...]:
    if names is None:
        return tuple(f"{prefix}{k}" for k in range(n))
    given = tuple(str(name) for name in names)
    if len(given) != n or len(set(given)) != n:
        raise TaskError(
            f"{len(given)} names, {len(set(given))} of them different, for {n} channels",
            expected="one name of its own for every channel",
            fix="pass what features.names(loader) returns",
            key="names",
        )
    return given
