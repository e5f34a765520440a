"""What drove the body: choosing an input, a column of it, and its symbols."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingInputError
from openprc.reservoir.io.symbol_clock import SymbolClock, symbol_clock
from openprc.schema import Trajectory

ATTACH = (
    "attach what drove the body with `openprc attach-input FILE`, or name it while writing with "
    "TrajectoryWriter.declare_input"
)
_AXES = ("x", "y", "z")


def input_name(trajectory: Trajectory, which: int | str = 0) -> str:
    """Return the name of an input given by position or by name.

    Raises
    ------
    MissingInputError
        When the file has no input, or none of that position or name.
    """
    names = tuple(trajectory.inputs)
    if not names:
        raise MissingInputError(
            "the file does not say what drove the body",
            expected="at least one input",
            fix=ATTACH,
            file=trajectory.path,
            key="/inputs",
        )
    if isinstance(which, str):
        if which in names:
            return which
    elif 0 <= int(which) < len(names):
        return names[int(which)]
    raise MissingInputError(
        f"there is no input {which!r}",
        expected="a position from 0, or one of " + ", ".join(names),
        fix="name one of these, or " + ATTACH,
        file=trajectory.path,
        key="/inputs",
    )


def column_of(columns: tuple[str, ...], dof: int | str) -> int | None:
    """Return the position of a column given by name, by axis number or by position.

    Where every column is an axis, numbers mean axes: of the columns ``("z",)``, 2 is the only
    one there is. Digits that are no name count as a number, as they come from a command line.
    """
    if isinstance(dof, str):
        if dof in columns or not dof.isdecimal():
            return columns.index(dof) if dof in columns else None
        dof = int(dof)
    if columns and all(column in _AXES for column in columns):
        axis = _AXES[dof] if 0 <= dof < len(_AXES) else None
        return columns.index(axis) if axis in columns else None
    return int(dof) if 0 <= dof < len(columns) else None


def column_index(trajectory: Trajectory, *, name: str, dof: int | str) -> int:
    """Return the position of a column of an input; see `column_of`.

    Raises
    ------
    MissingInputError
        When the input has no such column.
    """
    columns = tuple(trajectory.input(name).columns)
    column = column_of(columns, dof)
    if column is None:
        raise MissingInputError(
            f"input {name!r} has no column {dof!r}",
            expected="one of " + ", ".join(columns),
            fix="pass the name or the position of a column as dof",
            file=trajectory.path,
            key=f"/inputs/{name}/value",
        )
    return column


def columns_of(
    trajectory: Trajectory,
    which: int | str | Sequence[int | str] | None = None,
    *,
    dof: int | str | Sequence[int | str] | None = None,
) -> list[tuple[str, int]]:
    """Return (input, column) pairs: of all inputs, or those in `which`; all columns, or `dof`.

    Raises
    ------
    MissingInputError
        When the file has no input, or there is none of that name or position.
    """
    input_name(trajectory)
    names = [input_name(trajectory, w) for w in _listed(which, len(trajectory.inputs))]
    return [
        (name, column_index(trajectory, name=name, dof=item))
        for name in names
        for item in (trajectory.input(name).columns if dof is None else _listed(dof))
    ]


def _listed(items: int | str | Sequence[int | str] | None, count: int = 0) -> list[int | str]:
    if items is None:
        return list(range(count))
    return [items] if isinstance(items, int | np.integer | str) else list(items)


def stores_symbols(trajectory: Trajectory, name: str | None = None) -> bool:
    """Say whether the input called `name`, or any input for ``None``, stores its symbols."""
    names = tuple(trajectory.inputs) if name is None else (input_name(trajectory, name),)
    return any(trajectory.input(item).sequence is not None for item in names)


def read_symbols(
    trajectory: Trajectory,
    name: str | None = None,
    *,
    time: NDArray[np.float64],
    seconds: float = 1.0,
) -> SymbolClock:
    """Return the symbol clock of an input, by default of the first that stores its symbols.

    Parameters
    ----------
    time : (T,) [s]
        Frame times.
    seconds : float
        Factor from the time unit of the file to seconds.

    Raises
    ------
    MissingInputError
        When the file has no input, or the input in question stores no symbols.
    TaskError
        When the states do not cover the symbols.
    """
    if name is None:
        input_name(trajectory)
        stored = [n for n in trajectory.inputs if stores_symbols(trajectory, n)]
        name = stored[0] if stored else None
    signal = None if name is None else trajectory.input(input_name(trajectory, name))
    if signal is None or signal.sequence is None or signal.hold is None:
        raise MissingInputError(
            f"{'no input' if name is None else f'input {name!r}'} stores the symbols that were "
            "held or interpolated",
            expected="/inputs/<name>/sequence with its hold and start",
            fix=ATTACH + ', or work on frames with clock="frames"',
            file=trajectory.path,
            key="/inputs" if name is None else f"/inputs/{name}",
        )
    return symbol_clock(
        name=signal.name,
        sequence=np.asarray(signal.sequence, dtype=np.float64),
        hold=float(signal.hold) * seconds,
        start=float(signal.start) * seconds,
        time=time,
        columns=tuple(signal.columns),
        file=str(trajectory.path),
    )
