"""Symbols of an input, recovered from the signal in which each of them was held."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError


def recover_symbols(
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    *,
    hold: float,
    path: Path,
    name: str,
) -> NDArray[np.float64]:
    """Return the symbols (K, C) of which each was held for `hold`.

    Symbol k acts on ``start + k hold <= t < start + (k + 1) hold`` with the first row at
    ``start``. A last symbol that the table shows for fewer rows than the first one did not
    act in full and is left out.

    Parameters
    ----------
    time : (T,)
    values : (T, C)
    hold : float
        In the unit of `time`.
    path, name : named in errors

    Raises
    ------
    ConfigError
        When a value changes while it should be held, or a symbol has no row.
    """
    if not (np.isfinite(hold) and hold > 0):
        raise ConfigError(
            f"hold is {hold}", expected="a number above 0", fix="correct it", file=path, key="hold"
        )
    # The small number keeps a row at the very start of a symbol from rounding into the one
    # before: 0.3 / 0.1 is 2.9999999999999996.
    index = np.floor((time - time[0]) / hold + 1e-6).astype(np.int64)
    first = np.flatnonzero(np.diff(index, prepend=-1))
    if len(first) != index[-1] + 1:
        raise ConfigError(
            f"input {name!r}: some symbols held for {hold} have no row at all",
            expected="at least one row for each symbol",
            fix="correct the option hold",
            file=path,
            key="hold",
        )
    symbols = values[first]
    changed = np.flatnonzero((values != symbols[index]).any(axis=1))
    if len(changed):
        raise ConfigError(
            f"input {name!r} changes at t = {float(time[changed[0]])}, inside a symbol",
            expected=f"values that stay for {hold} from t = {float(time[0])} on",
            fix="correct the option hold, or leave it out",
            file=path,
            key="hold",
        )
    rows = np.bincount(index)
    return symbols[:-1] if len(rows) > 1 and rows[-1] < rows[0] else symbols
