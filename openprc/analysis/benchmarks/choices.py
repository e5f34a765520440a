"""What is chosen before a file can be scored: states, input, spans, readout."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, TaskError
from openprc.reservoir.features.base import Feature, is_constant
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.features.node_features import NodeDisplacements
from openprc.reservoir.io.missing import MissingPolicy
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.row_clock import RowClock
from openprc.reservoir.training.split import Split
from openprc.reservoir.training.trainer import Trainer


@dataclass(frozen=True, kw_only=True)
class Choices:
    """How a file is to be read and trained on; whatever is not said is chosen and told.

    Parameters
    ----------
    features : feature or sequence of features, optional
        By default the displacements of the nodes that move and are known in every frame, in the
        coordinates in which any of them moves; in a file without positions, or where no node
        moves, all channels.
    readout : estimator, optional
        By default ``Ridge()``.
    split : Split
        Clock, input and spans; by default a tenth of the rows is washed out, and two thirds and
        one third of the rest are trained and tested on.
    input_column : str or int, optional
        By default the first column of the input that varies.
    missing : {"error", "drop", "interpolate"}
    """

    features: Any = None
    readout: Any = None
    split: Split = field(default_factory=Split)
    input_column: str | int | None = None
    missing: MissingPolicy = "error"


@dataclass(frozen=True)
class ChosenInput:
    """One column of what drove the body.

    ``values`` (R,) on the rows of the clock, in the unit of the file.
    """

    values: NDArray[np.float64]
    name: str
    column: str

    @property
    def scaled(self) -> NDArray[np.float64]:
        """The values brought to [0, 0.5] by the least and the largest of them, (R,)."""
        least, most = float(self.values.min()), float(self.values.max())
        return 0.5 * (self.values - least) / (most - least)


@contextmanager
def open_trainer(
    path: str | Path, choices: Choices, *, experiment_dir: str | Path | None = None
) -> Iterator[Trainer]:
    """Open a file and yield a trainer on it, as `choices` say.

    Raises
    ------
    MissingData
        When states are missing, or there are none.
    TaskError
        When the file is too short.
    """
    with StateLoader(path, missing=choices.missing) as loader:
        yield Trainer(
            default_features(loader) if choices.features is None else choices.features,
            Ridge() if choices.readout is None else choices.readout,
            loader=loader,
            experiment_dir=experiment_dir,
            split=choices.split,
        )


def default_features(loader: StateLoader) -> Feature:
    """Choose the states of a file: displacements of what moves, else all channels.

    Nodes that never move, and coordinates in which no node moves, carry no information; they
    would only inflate the number of states. Nodes with missing samples are passed over as long as
    nothing was said about those (``missing="error"``) and there are others.

    Raises
    ------
    MissingData
        When the file has neither moving nodes nor channels.
    """
    if loader.n_nodes:
        nodes = complete_nodes(loader)
        positions = loader.positions(nodes.tolist())
        flat = positions.reshape(len(positions), -1)
        moves = ~is_constant(flat).reshape(positions.shape[1:])
        if moves.any():
            return NodeDisplacements(
                node_ids=nodes[moves.any(axis=1)].tolist(),
                dims=np.flatnonzero(moves.any(axis=0)).tolist(),
            )
    if loader.channels:
        return Channels()
    raise MissingData(
        "no node moves and there are no channels",
        expected="states that change over time",
        fix="check that the drive reached the body",
        file=loader.path,
        key="/time_series",
    )


def complete_nodes(loader: StateLoader) -> NDArray[np.intp]:
    """Return the nodes that may become states, (n,): those that are known in every frame.

    All nodes where the loader has been told what to do about missing samples, and where no node
    is complete, so that the loader says what is missing.
    """
    every = np.arange(loader.n_nodes)
    if loader.missing != "error":
        return every
    gaps = np.isnan(np.asarray(loader.trajectory.positions())).any(axis=(0, 2))
    return every if gaps.all() else every[~gaps]


def left_out_remark(loader: StateLoader) -> str:
    """Say how many nodes `default_features` passed over, or nothing."""
    if not loader.n_nodes:
        return ""
    count = loader.n_nodes - len(complete_nodes(loader))
    if not count:
        return ""
    return (
        f"{count} of {loader.n_nodes} nodes were not measured in every frame and are no states; "
        "--missing interpolate or --missing drop takes them in"
    )


def choose_input(trainer: Trainer, column: str | int | None) -> ChosenInput:
    """Return a column of the input of a trainer's file, on its rows.

    Raises
    ------
    MissingInputError
        When the file does not say what drove the body, or there is no such column.
    TaskError
        When the input, or that column of it, does not vary.
    """
    loader, rows = trainer.loader, trainer.rows
    name = rows.symbols.name if rows.symbols else loader.input_name(trainer.input_name or 0)
    columns = tuple(loader.trajectory.input(name).columns)
    values = _on_rows(loader, rows, name)
    if column is None:
        varying = np.flatnonzero(~is_constant(values))
        if not varying.size:
            raise _idle(loader, f"input {name!r}", name)
        index = int(varying[0])
    else:
        index = loader.column_index(name, column)
    u = values[:, index]
    if not float(u.max()) > float(u.min()):
        raise _idle(loader, f"column {columns[index]!r} of input {name!r}", name)
    return ChosenInput(u, name, columns[index])


def _on_rows(loader: StateLoader, rows: RowClock, name: str) -> NDArray[np.float64]:
    if rows.symbols is not None:
        return rows.symbols.sequence
    return np.asarray(loader.trajectory.input(name).value, dtype=np.float64)[rows.frames[:, -1]]


def _idle(loader: StateLoader, what: str, name: str) -> TaskError:
    return TaskError(
        f"{what} does not vary",
        expected="a drive",
        fix="name another input or column",
        file=loader.path,
        key=f"/inputs/{name}",
    )
