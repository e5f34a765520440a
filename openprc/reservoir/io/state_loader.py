"""States and inputs of one simulation.h5, whoever made it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from openprc.reservoir.io import actuation
from openprc.reservoir.io.elements import ElementStates
from openprc.reservoir.io.recording import Origin
from openprc.reservoir.io.symbol_clock import SymbolClock
from openprc.schema import Trajectory


class StateLoader(ElementStates):
    """Read-only access to the states and the drive of a trajectory file.

    Times are in seconds whatever unit the file stores (load steps stay load steps); all other
    quantities are in the unit of the file.

    Parameters
    ----------
    path : path-like or Trajectory
        A simulation.h5, from a simulator or from a camera.
    missing : {"error", "drop", "interpolate"}
        What to do with samples that were not measured. By default asking for them is an error
        that names the worst nodes. ``drop`` leaves NaN in place and the trainer leaves those
        rows out; ``interpolate`` joins interior gaps by straight lines, which looks ahead.

    Examples
    --------
    >>> loader = StateLoader("simulation.h5")               # doctest: +SKIP
    >>> loader.positions().shape                            # doctest: +SKIP
    (2501, 16, 3)
    """

    # --- channels ------------------------------------------------------------------------

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the sensor channels."""
        return tuple(self.trajectory.channels)

    def channel(self, name: str) -> NDArray[np.float64]:
        """Return one channel, (T, C) in the unit of the file."""
        values = np.asarray(self.trajectory.channel(name), dtype=np.float64)
        labels = [f"column {c}" for c in self.trajectory.channel_columns(name)]
        return self.treated(values, labels, f"channels/{name}")

    # --- inputs --------------------------------------------------------------------------

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, in the order of the file."""
        return tuple(self.trajectory.inputs)

    def input_name(self, which: int | str = 0) -> str:
        """Return the name of an input given by position or by name.

        Raises
        ------
        MissingInputError
            When the file has no input, or none of that position or name.
        """
        return actuation.input_name(self.trajectory, which)

    def get_actuation_signal(
        self, actuator_idx: int | str = 0, dof: int | str = 0
    ) -> NDArray[np.float64]:
        """Return one column of what drove the body, (T,) in the unit of the file.

        Parameters
        ----------
        actuator_idx : int or str
            Position of the input in the file, or its name.
        dof : int or str
            Name of a column, or its position. Where every column is named after an axis,
            0, 1, 2 mean x, y, z, whichever of them were driven.

        Raises
        ------
        MissingInputError
            When there is no such input or column. Nothing is returned in its place.
        """
        name = self.input_name(actuator_idx)
        column = self.column_index(name, dof)
        return np.asarray(self.trajectory.input(name).value, dtype=np.float64)[:, column]

    def input_columns(
        self,
        which: int | str | Sequence[int | str] | None = None,
        *,
        dof: int | str | Sequence[int | str] | None = None,
    ) -> list[str]:
        """Return the names of the columns that `input_values` gives, such as ``"base.z"``."""
        return [
            f"{name}.{self.trajectory.input(name).columns[column]}"
            for name, column in actuation.columns_of(self.trajectory, which, dof=dof)
        ]

    def input_values(
        self,
        which: int | str | Sequence[int | str] | None = None,
        *,
        dof: int | str | Sequence[int | str] | None = None,
    ) -> NDArray[np.float64]:
        """Return several columns of what drove the body, (T, C), each in the unit of its input.

        Parameters
        ----------
        which : int, str, or sequence of them, optional
            Inputs by position or name; all of them by default.
        dof : int, str, or sequence of them, optional
            Columns of each, as for `get_actuation_signal`; all of them by default.

        Raises
        ------
        MissingInputError
            When there is no such input or column. Nothing is returned in its place.
        """
        chosen = actuation.columns_of(self.trajectory, which, dof=dof)
        stored = {name: self.trajectory.input(name).value for name, _ in chosen}
        return np.stack([stored[name][:, column] for name, column in chosen], axis=1)

    def column_index(self, name: str, dof: int | str) -> int:
        """Return the position of a column of an input; `dof` as in `get_actuation_signal`."""
        return actuation.column_index(self.trajectory, name=name, dof=dof)

    def has_symbols(self, name: str | None = None) -> bool:
        """Say whether the input called `name`, or any input, stores its symbol sequence."""
        return actuation.stores_symbols(self.trajectory, name)

    def symbols(self, name: str | None = None) -> SymbolClock:
        """Return the symbol clock of an input, by default of the first that stores symbols.

        Raises
        ------
        MissingInputError
            When the file has no input, or the input in question stores no symbols.
        TaskError
            When the states do not cover the symbols.
        """
        return actuation.read_symbols(self.trajectory, name, time=self.time, seconds=self._seconds)


def as_loader(source: StateLoader | Trajectory) -> StateLoader:
    """Return a state loader for a loader or a trajectory."""
    return source if isinstance(source, StateLoader) else StateLoader(source)


__all__ = ["Origin", "StateLoader", "as_loader"]
