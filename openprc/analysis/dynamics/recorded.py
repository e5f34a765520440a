"""Replica tests on files: the same drive recorded two times or more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.dynamics.replica_consistency import Consistency, consistency
from openprc.analysis.dynamics.replica_convergence import Convergence, convergence
from openprc.errors import MissingInputError, TaskError
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.training.row_clock import ClockChoice, RowClock, row_clock
from openprc.schema import Trajectory

#: Drives that differ by less than this fraction of their range are the same.
SAME_DRIVE = 1e-6


@dataclass(frozen=True)
class Replicas:
    """States of several recordings of one drive, row by row.

    Parameters
    ----------
    states : tuple of (R, F) float64
    names : tuple of str
        Of the F columns.
    kind : {"symbols", "frames"}
        What a row is.
    step : float
        Time from row to row, in `unit`.
    unit : {"s", "load steps"}
    """

    states: tuple[NDArray[np.float64], ...]
    names: tuple[str, ...]
    kind: str
    step: float
    unit: str


def read_replicas(
    sources: Sequence[str | Path | StateLoader],
    features: Any,
    *,
    clock: ClockChoice = "auto",
    input_name: str | None = None,
    washout: int = 0,
    same_drive: float | None = SAME_DRIVE,
) -> Replicas:
    """Read the same features of several recordings, and make sure that their drives agree.

    Parameters
    ----------
    sources : paths or StateLoaders
        Two or more.
    features : Feature
    clock : {"auto", "symbols", "frames"}
        What a row is, as in `openprc.reservoir.training.row_clock.row_clock`.
    input_name : str, optional
        The input whose symbols count; by default the first that stores them.
    washout : int
        Rows to leave out at the start.
    same_drive : float or None
        Drives may differ by this fraction of their range: raise it to the noise of a measured
        drive. None does not compare them.

    Raises
    ------
    TaskError
        When there are fewer than two recordings, or they differ in their columns, clocks or
        drives, or nothing is left after the washout.
    MissingInputError
        When drives are to be compared and a file has none.
    """
    if len(sources) < 2:
        raise TaskError(
            f"{len(sources)} recordings are given",
            expected="two or more of the same drive",
            fix="repeat the run, from another initial state or with its own noise",
            key="sources",
        )
    loaders = [s if isinstance(s, StateLoader) else StateLoader(s) for s in sources]
    try:
        clocks = [row_clock(item, clock=clock, input_name=input_name) for item in loaders]
        names = _common_names(loaders, features)
        _check_clocks(clocks, loaders)
        if same_drive is not None:
            _check_drives(loaders, clocks, input_name=input_name, tolerance=same_drive)
        n_rows = min(rows.n_rows for rows in clocks)
        if not 0 <= washout < n_rows:
            raise TaskError(
                f"washout is {washout} and there are {n_rows} rows",
                expected=f"from 0 to {n_rows - 1}",
                fix="shorten the washout",
                key="washout",
            )
        states = tuple(
            np.asarray(features.transform(item), dtype=np.float64)[rows.frames[washout:n_rows, -1]]
            for item, rows in zip(loaders, clocks, strict=True)
        )
    finally:
        for item, source in zip(loaders, sources, strict=True):
            if item is not source:
                item.close()
    first = clocks[0]
    return Replicas(states, names, kind=first.kind, step=first.step, unit=first.unit)


def consistency_of_files(
    sources: Sequence[str | Path | StateLoader],
    features: Any,
    *,
    washout: int,
    relative: float | None = None,
    **reading: Any,
) -> Consistency:
    """Compare recordings of one drive; see `consistency` and `read_replicas`.

    Parameters
    ----------
    washout : int
        Rows left out at the start, while the initial states still show.
    relative : float, optional
        As in `consistency`.
    **reading
        The other keywords of `read_replicas`.
    """
    replicas = read_replicas(sources, features, washout=washout, **reading)
    return consistency(replicas.states, relative=relative)


def convergence_of_files(
    sources: Sequence[str | Path | StateLoader],
    features: Any,
    *,
    per_second: bool = True,
    fit: tuple[int, int] | None = None,
    **reading: Any,
) -> Convergence:
    """Measure how two recordings of one drive from different initial states approach.

    Parameters
    ----------
    sources : two paths or StateLoaders
    per_second : bool
        Times in the unit of time of the files; otherwise in rows, which are symbols or frames.
    fit : (int, int), optional
        As in `convergence`.
    **reading
        The other keywords of `read_replicas`.

    Raises
    ------
    TaskError
        When there are not two recordings; as `read_replicas` and `convergence`.
    """
    if len(sources) != 2:
        raise TaskError(
            f"{len(sources)} recordings are given",
            expected="two",
            fix="compare them pair by pair",
            key="sources",
        )
    replicas = read_replicas(sources, features, **reading)
    return convergence(
        *replicas.states,
        step=replicas.step if per_second else 1.0,
        unit=replicas.unit if per_second else replicas.kind,
        fit=fit,
    )


def _common_names(loaders: list[StateLoader], features: Any) -> tuple[str, ...]:
    names = [tuple(features.names(item)) for item in loaders]
    for item, other in zip(loaders, names, strict=True):
        if other != names[0]:
            raise TaskError(
                f"the features give {len(other)} columns here and {len(names[0])} in "
                f"{loaders[0].path.name}, or other names",
                expected="the same columns in all recordings",
                fix="name nodes, bars or channels that all recordings have",
                file=item.path,
                key="features",
            )
    return names[0]


def _check_clocks(clocks: list[RowClock], loaders: list[StateLoader]) -> None:
    first = clocks[0]
    for item, rows in zip(loaders, clocks, strict=True):
        same = rows.kind == first.kind and abs(rows.step - first.step) <= 1e-9 * first.step
        if not same:
            raise TaskError(
                f"a row is one of {rows.kind}, {rows.step:g} {rows.unit} long, and in "
                f"{loaders[0].path.name} one of {first.kind}, {first.step:g} {first.unit} long",
                expected="one clock for all recordings",
                fix='save all at the same rate, or say clock="symbols"',
                file=item.path,
                key="clock",
            )


def _check_drives(
    loaders: list[StateLoader],
    clocks: list[RowClock],
    *,
    input_name: str | None,
    tolerance: float,
) -> None:
    drives = [
        _drive(item, rows, input_name=input_name)
        for item, rows in zip(loaders, clocks, strict=True)
    ]
    n_rows = min(len(drive) for drive in drives)
    first = drives[0][:n_rows]
    span = float(np.ptp(first))
    for item, drive in zip(loaders, drives, strict=True):
        apart = (
            float(np.abs(drive[:n_rows] - first).max())
            if drive.shape[1] == first.shape[1]
            else float("inf")
        )
        if apart > tolerance * span:
            raise TaskError(
                f"the drive differs from that of {loaders[0].path.name} by {apart:.3g}, its range "
                f"being {span:.3g}",
                expected="the same drive in all recordings",
                fix="repeat the run with the same input; for a measured drive set same_drive to "
                "the fraction of its range that is noise",
                file=item.path,
                key="/inputs",
            )


def _drive(loader: StateLoader, rows: RowClock, *, input_name: str | None) -> NDArray[np.float64]:
    if rows.symbols is not None:
        return np.asarray(rows.symbols.sequence, dtype=np.float64)
    try:
        name = loader.input_name(0 if input_name is None else input_name)
    except MissingInputError as error:
        raise MissingInputError(
            error.found,
            expected="the drive of every replica, because the test is about one and the same",
            fix=f"{error.fix}; or say same_drive=None if you know that they agree",
            file=error.file,
            key=error.key,
        ) from error
    trajectory: Trajectory = loader.trajectory
    return np.asarray(trajectory.input(name).value, dtype=np.float64)
