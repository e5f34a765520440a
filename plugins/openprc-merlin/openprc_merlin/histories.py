"""Finding and cleaning the displacement and load histories of a workspace.

Scripts name them ``U_his`` and ``LF_his`` (MERLIN), ``Uhis`` and ``Fhis`` (MERLIN2), and
users rename them, so names come first and shapes second.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData, SchemaError

_DISPLACEMENT = re.compile(r"u_?his(t|tory)?\Z", re.IGNORECASE)
_LOAD = re.compile(r"(lf|f|load)_?his(t|tory)?\Z", re.IGNORECASE)
_WITHIN = re.compile(r"u_?his", re.IGNORECASE)
_NUMBERED = r"_?\d+\Z"
#: Names of MERLIN's scripts that are no history whatever their shape.
_OTHERS = frozenset({"Node", "F", "Load", "Supp", "indp", "indsupp", "ff", "BDRY"})
#: Imaginary parts below this share of the largest value are round-off.
_IMAGINARY = 1e-8
#: No length or displacement is larger; beyond it, products of four of them overflow.
PLAUSIBLE = 1e60


def is_displacement(name: str) -> bool:
    """Tell whether a variable is named like a displacement history."""
    return bool(_DISPLACEMENT.match(_unnumbered(name)))


def hints_displacement(name: str, shape: tuple[int, ...] | None) -> bool:
    """Tell whether a longer name and the shape together mean one, as OrigamiUhis (T, N, 3) does.

    Only for telling whose file it is: which variable is read is decided with the rest shape.
    """
    if shape is None or not _WITHIN.search(name):
        return False
    return (len(shape) == 3 and shape[2] == 3) or (len(shape) == 2 and 0 in (n % 3 for n in shape))


def is_load(name: str) -> bool:
    """Tell whether a variable is named like a load history."""
    return bool(_LOAD.match(_unnumbered(name)))


def _unnumbered(name: str) -> str:
    return re.sub(_NUMBERED, "", name)


def find_displacement(
    variables: Mapping[str, Any], *, n_nodes: int | None, name: str | None, file: Path
) -> tuple[str, list[str]]:
    """Return the name of the displacement history, and notes.

    Raises
    ------
    ConfigError
        When `name` is not a numeric variable, or several histories compete.
    MissingData
        When there is none.
    """
    numeric = [key for key, value in variables.items() if isinstance(value, np.ndarray)]
    if name is not None:
        if name not in numeric:
            raise ConfigError(
                f"there is no numeric variable {name!r}",
                expected=f"one of {', '.join(sorted(numeric)) or 'none'}",
                fix="correct the option",
                file=file,
                key="displacement",
            )
        return name, []
    found = [key for key in numeric if _DISPLACEMENT.match(key)]
    found = found or [key for key in numeric if is_displacement(key)]
    if len(found) > 1 and all(_same(variables[found[0]], variables[key]) for key in found):
        found = found[:1]
    guessed = not found
    if guessed and n_nodes is not None:
        found = [
            key
            for key in numeric
            if key not in _OTHERS and not is_load(key) and _fits(variables[key].shape, n_nodes)
        ]
    if len(found) > 1:
        raise ConfigError(
            f"several variables could be the displacement history: {', '.join(found)}",
            expected="one",
            fix="name it with the option displacement=NAME",
            file=file,
            key="displacement",
        )
    if not found:
        held = ", ".join(f"{k} {_shape(v)}" for k, v in sorted(variables.items())[:20])
        raise MissingData(
            f"no displacement history among: {held}",
            expected="U_his, Uhis or U_history with one column an increment",
            fix="save it together with truss and angles, or name it with displacement=NAME",
            file=file,
            key="U_his",
        )
    notes = [f"{found[0]} is taken for the displacement history by its shape"] if guessed else []
    return found[0], notes


def _same(one: NDArray[Any], two: NDArray[Any]) -> bool:
    return one.shape == two.shape and bool(np.array_equal(one, two, equal_nan=True))


def _fits(shape: tuple[int, ...], n_nodes: int) -> bool:
    if len(shape) == 3:
        return shape[1:] == (n_nodes, 3)
    return len(shape) == 2 and min(shape) >= 2 and 3 * n_nodes in shape


def _shape(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return "x".join(str(n) for n in value.shape)
    return "struct" if isinstance(value, dict) else type(value).__name__


def real(array: NDArray[Any], *, key: str, file: Path) -> tuple[NDArray[np.float64], list[str]]:
    """Drop a negligible imaginary part.

    Raises
    ------
    SchemaError
        When the imaginary part is more than round-off.
    """
    if array.dtype.kind != "c":
        return np.asarray(array, dtype=np.float64), []
    finite = np.isfinite(array)
    scale = float(np.abs(array[finite]).max(initial=0.0))
    worst = float(np.abs(array[finite].imag).max(initial=0.0))
    if worst > _IMAGINARY * scale:
        raise SchemaError(
            f"complex numbers with imaginary parts up to {worst:.3g} beside values of {scale:.3g}",
            expected="real numbers, or imaginary parts of round-off size",
            fix="the solver left the real axis: find the increment, and save the part before it",
            file=file,
            key=key,
        )
    return array.real.astype(np.float64), [
        f"{key}: imaginary parts up to {worst:.3g} were dropped as round-off"
    ]


def by_increment(
    array: NDArray[np.float64], *, n_nodes: int, key: str, file: Path, hint: str = ""
) -> tuple[NDArray[np.float64], list[str]]:
    """Arrange a displacement history as (T, N, 3).

    Parameters
    ----------
    array : (3N, T), (T, 3N) or (T, N, 3)
        Rows x1 y1 z1 x2 ... as MERLIN writes them, the same transposed by hand, or the
        three-dimensional array of Sim-FAST.
    n_nodes : int
    key, file : what to name in an error
    hint : str
        Why the number of rows may differ.

    Raises
    ------
    SchemaError
        When the shape does not belong to `n_nodes` nodes.
    """
    dofs = 3 * n_nodes
    if array.ndim == 3 and array.shape[1:] == (n_nodes, 3):
        return array, []
    if array.ndim == 2 and array.shape[0] == dofs:
        return array.T.reshape(-1, n_nodes, 3), []
    if array.ndim == 2 and array.shape[1] == dofs:
        return array.reshape(-1, n_nodes, 3), [
            f"{key} is stored as (increments, 3N), transposed from what MERLIN writes"
        ]
    raise SchemaError(
        f"the displacement history has shape {'x'.join(map(str, array.shape))} and the rest "
        f"shape has {n_nodes} nodes",
        expected=f"{dofs} rows (3 for each node), or (increments, {n_nodes}, 3)",
        fix=hint or "save truss and the displacement history of one and the same run",
        file=file,
        key=key,
    )


def finite_length(u: NDArray[np.float64], *, key: str, file: Path) -> tuple[int, list[str]]:
    """Return how many increments stand before the solver diverged.

    Parameters
    ----------
    u : (T, N, 3)

    Raises
    ------
    SchemaError
        When nothing is finite, or finite increments follow after the first bad one.
    """
    # A diverging solver passes through huge numbers on its way to NaN. Extremes need no
    # intermediate array of the size of the history, and pass NaN on.
    low, high = u.min(axis=(1, 2), initial=0.0), u.max(axis=(1, 2), initial=0.0)
    good: NDArray[np.bool_] = (low > -PLAUSIBLE) & (high < PLAUSIBLE)
    if not len(good):
        raise SchemaError(
            "the displacement history has no increment",
            expected="at least one converged increment",
            fix="save after the run has ended",
            file=file,
            key=key,
        )
    if good.all():
        moved = np.flatnonzero((low < 0) | (high > 0))
        n_zero = len(u) - 1 - int(moved[-1]) if len(moved) else 0
        if n_zero > 1:
            return len(u), [
                f"the last {n_zero} increments of {key} are exactly zero; a history that was "
                "allocated beforehand looks like that where it was never filled"
            ]
        return len(u), []
    first = int(np.flatnonzero(~good)[0])
    if first == 0 or good[first:].any():
        raise SchemaError(
            f"NaN, infinite or huge displacements at increment {first + 1}, "
            f"and {int(good[first:].sum())} finite increments after it",
            expected="finite displacements, or a run that ends where it diverged",
            fix="cut the history before the first bad increment",
            file=file,
            key=key,
        )
    return first, [
        f"{key}: the solver diverged at increment {first + 1}; "
        f"{len(good) - first} increments without finite values were cut off"
    ]


def find_load(
    variables: Mapping[str, Any],
    *,
    n_increments: int,
    name: str | None,
    exclude: str,
    file: Path,
) -> tuple[NDArray[np.float64] | None, str, list[str]]:
    """Return the load history as (T, C) or None, its name, and notes.

    Parameters
    ----------
    n_increments : int
        Columns of the displacement history as stored.
    name : str, optional
        The variable, or ``"none"``.
    exclude : str
        The displacement history.

    Raises
    ------
    ConfigError
        When `name` is not a numeric variable.
    SchemaError
        When the length differs from that of the displacement history.
    """
    if name is not None and name.lower() == "none":
        return None, "", ["the load history was left out on request"]
    numeric = {k: v for k, v in variables.items() if isinstance(v, np.ndarray) and k != exclude}
    if name is not None and name not in numeric:
        raise ConfigError(
            f"there is no numeric variable {name!r}",
            expected=f"one of {', '.join(sorted(numeric)) or 'none'}, or none",
            fix="correct the option",
            file=file,
            key="load",
        )
    found = [name] if name is not None else [key for key in numeric if _LOAD.match(key)]
    found = found or [key for key in numeric if is_load(key)]
    notes = []
    if not found:
        found = [
            key
            for key, value in numeric.items()
            if key not in _OTHERS
            and n_increments > 2
            and value.size == n_increments == max(value.shape)
        ]
        if len(found) > 1:
            return None, "", [f"which is the load history cannot be told: {', '.join(found)}"]
        notes = [f"{key} is taken for the load history by its length" for key in found]
    if not found:
        return None, "", ["the file holds no load history"]
    if len(found) > 1:
        raise ConfigError(
            f"several variables could be the load history: {', '.join(found)}",
            expected="one",
            fix="name it with the option load=NAME, or load=none",
            file=file,
            key="load",
        )
    key = found[0]
    array, complaints = real(numeric[key], key=key, file=file)
    return _load_columns(array, n_increments, key, file), key, notes + complaints


def _load_columns(
    array: NDArray[np.float64], n_increments: int, key: str, file: Path
) -> NDArray[np.float64]:
    if array.ndim == 2 and array.shape[0] == n_increments:
        return array
    if array.ndim == 2 and array.shape[1] == n_increments:
        return array.T
    raise SchemaError(
        f"the load history has shape {'x'.join(map(str, array.shape))} "
        f"for {n_increments} increments",
        expected=f"one row an increment: {n_increments} x 1, or {n_increments} x imposed DOFs",
        fix="save both histories of one and the same run, or leave it out with load=none",
        file=file,
        key=key,
    )
