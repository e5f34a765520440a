"""States and inputs of one simulation.h5, whoever made it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, TaskError
from openprc.reservoir.io import actuation
from openprc.reservoir.io.missing import POLICIES, MissingPolicy, apply_policy
from openprc.reservoir.io.symbol_clock import SymbolClock
from openprc.schema import UNITS, Trajectory

Origin = Literal["auto", "rest", "first"]


class StateLoader:
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

    def __init__(self, path: str | Path | Trajectory, *, missing: MissingPolicy = "error") -> None:
        if missing not in POLICIES:
            raise TaskError(
                f"missing is {missing!r}",
                expected="one of " + ", ".join(POLICIES),
                fix="choose one of these",
                key="missing",
            )
        self.trajectory = path if isinstance(path, Trajectory) else Trajectory(path)
        self.missing = missing
        self.path = Path(self.trajectory.path)

    def close(self) -> None:
        """Close the file."""
        self.trajectory.close()

    def __enter__(self) -> StateLoader:
        """Return the loader itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()

    # --- clock ---------------------------------------------------------------------------

    @property
    def n_frames(self) -> int:
        """Number of saved frames, T."""
        return self.trajectory.n_frames

    @property
    def n_nodes(self) -> int:
        """Number of nodes, N; 0 in a file without positions."""
        return self.trajectory.n_nodes

    @property
    def dims(self) -> int:
        """Number of measured coordinates, D."""
        return self.trajectory.dims

    @property
    def run_id(self) -> str:
        """Identifier of the run that the file holds."""
        return self.trajectory.run_id

    @property
    def time_kind(self) -> str:
        """``"physical"``, or ``"pseudo"`` for quasi-static load steps."""
        return self.trajectory.time_kind

    @property
    def time(self) -> NDArray[np.float64]:
        """Frame times, (T,) [s]."""
        return self.trajectory.time * self._seconds

    @property
    def dt(self) -> float:
        """Time between frames [s].

        Raises
        ------
        NonUniformTime
            When the frames are not evenly spaced.
        """
        return float(self.trajectory.dt) * self._seconds

    @property
    def _seconds(self) -> float:
        if self.time_kind != "physical":
            return 1.0
        return UNITS[self.trajectory.time_unit].si_factor

    def require_physical_time(self, purpose: str) -> None:
        """Refuse a file whose time counts load steps.

        Raises
        ------
        TaskError
            When time is pseudo: there are no dynamics, so there is no memory to measure.
        """
        if self.time_kind == "physical":
            return
        raise TaskError(
            f"time is {self.time_kind}: the frames are load steps of a quasi-static analysis",
            expected=f"physical time, because {purpose} depends on how the body remembers",
            fix="use the file for static comparisons, or simulate the body dynamically",
            file=self.path,
            key="/time_series/time",
        )

    # --- states --------------------------------------------------------------------------

    def positions(self, nodes: Sequence[int] | None = None) -> NDArray[np.float64]:
        """Return node positions, (T, n, D) in the unit of the file.

        Raises
        ------
        MissingData
            When the file has no positions, or when samples are missing and `missing` says so.
        TaskError
            When a node number is out of range or named twice.
        """
        # The whole array is read and then selected: HDF5 reads scattered nodes far slower.
        values = np.asarray(self.trajectory.positions(), dtype=np.float64)
        chosen = self.check_ids(nodes, self.n_nodes, what="node")
        return self._treated(values[:, chosen], [f"node {i}" for i in chosen], "nodes/positions")

    def velocities(self, nodes: Sequence[int] | None = None) -> NDArray[np.float64]:
        """Return node velocities, (T, n, D) in the unit of the file; raises as `positions`."""
        values = np.asarray(self.trajectory.velocities(), dtype=np.float64)
        chosen = self.check_ids(nodes, self.n_nodes, what="node")
        return self._treated(values[:, chosen], [f"node {i}" for i in chosen], "nodes/velocities")

    def displacements(
        self, nodes: Sequence[int] | None = None, *, origin: Origin = "auto"
    ) -> NDArray[np.float64]:
        """Return positions less those of the undeformed body, (T, n, D) in the unit of the file.

        Parameters
        ----------
        origin : {"auto", "rest", "first"}
            ``rest`` takes /topology/nodes/rest, ``first`` the first frame; ``auto`` takes the
            rest positions where the file has them and the first frame otherwise.

        Raises
        ------
        MissingData
            As `positions`; with ``rest`` when the file has no rest positions; with ``first``
            when a node was not measured in the first frame.
        """
        positions = self.positions(nodes)
        chosen = self.check_ids(nodes, self.n_nodes, what="node")
        if self.resolve_origin(origin) == "rest":
            return positions - np.asarray(self.trajectory.node("rest"), dtype=np.float64)[chosen]
        if np.isnan(positions[0]).any():
            raise MissingData(
                "the first frame has nodes that were not measured, so displacements have no origin",
                expected="rest positions, or a complete first frame",
                fix="leave those nodes out with node_ids, or use NodePositions",
                file=self.path,
                key="/time_series/nodes/positions",
            )
        return positions - positions[0]

    def resolve_origin(self, origin: Origin) -> Literal["rest", "first"]:
        """Return what ``origin="auto"`` stands for in this file."""
        if origin == "auto":
            return "rest" if self.trajectory.has("/topology/nodes/rest") else "first"
        return origin

    def bar_lengths(self, bars: Sequence[int] | None = None) -> NDArray[np.float64]:
        """Return bar lengths, (T, n) in the unit of the file.

        The stored series is used where there is one; otherwise the distance between the end
        nodes, which is the same number.

        Raises
        ------
        MissingData
            When the file has no bars.
        """
        chosen = self.check_ids(bars, self.n_bars, what="bar")
        labels = [f"bar {i}" for i in chosen]
        if "length" in self.trajectory.element_series("bars"):
            values = np.asarray(self.trajectory.element("bars", "length"), dtype=np.float64)
            return self._treated(values[:, chosen], labels, "elements/bars/length")
        ends = np.asarray(self.trajectory.indices("bars"))[chosen]
        nodes, column = np.unique(ends, return_inverse=True)
        positions = self.positions(nodes.tolist())
        a, b = column.reshape(ends.shape).T
        return np.linalg.norm(positions[:, b] - positions[:, a], axis=2)

    def bar_extensions(
        self, bars: Sequence[int] | None = None, *, origin: Origin = "auto"
    ) -> NDArray[np.float64]:
        """Return bar lengths less the rest lengths, (T, n) in the unit of the file.

        With ``rest``, and with ``auto`` where the file stores rest lengths, these are
        subtracted; otherwise the lengths of the first frame.

        Raises
        ------
        MissingData
            As `bar_lengths`; with ``rest`` when the file stores no rest lengths.
        """
        chosen = self.check_ids(bars, self.n_bars, what="bar")
        lengths = self.bar_lengths(chosen)
        if self.resolve_bar_origin(origin) == "rest":
            rest = np.asarray(
                self.trajectory.element_static("bars", "rest_length"), dtype=np.float64
            )
            return lengths - rest[chosen]
        if np.isnan(lengths[0]).any():
            raise MissingData(
                "the first frame has bars that were not measured, so extensions have no origin",
                expected="rest lengths, or a complete first frame",
                fix="leave those bars out with bar_ids, or use BarLengths",
                file=self.path,
                key="/time_series/elements/bars/length",
            )
        return lengths - lengths[0]

    def resolve_bar_origin(self, origin: Origin) -> Literal["rest", "first"]:
        """Return what ``origin="auto"`` stands for in this file's bars."""
        if origin == "auto":
            return "rest" if self.trajectory.has("/topology/bars/rest_length") else "first"
        return origin

    @property
    def n_bars(self) -> int:
        """Number of bars.

        Raises
        ------
        MissingData
            When the file has no bars.
        """
        if "bars" not in self.trajectory.element_kinds:
            raise MissingData(
                "the file has no bars",
                expected="/topology/bars/indices",
                fix="use node or channel features",
                file=self.path,
                key="/topology/bars",
            )
        return len(self.trajectory.indices("bars"))

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the sensor channels."""
        return tuple(self.trajectory.channels)

    def channel(self, name: str) -> NDArray[np.float64]:
        """Return one channel, (T, C) in the unit of the file."""
        values = np.asarray(self.trajectory.channel(name), dtype=np.float64)
        labels = [f"column {c}" for c in self.trajectory.channel_columns(name)]
        return self._treated(values, labels, f"channels/{name}")

    def _treated(
        self, values: NDArray[np.float64], labels: list[str], key: str
    ) -> NDArray[np.float64]:
        return apply_policy(
            values,
            self.missing,
            time=self.time,
            labels=labels,
            file=str(self.path),
            key=f"/time_series/{key}",
        )

    def check_ids(
        self, ids: Sequence[int] | None, count: int, *, what: str, key: str | None = None
    ) -> list[int]:
        """Return `ids` as a list of plain integers, or all of them for ``None``.

        Raises
        ------
        TaskError
            When one is not a whole number in [0, count), or is named twice.
        """
        if ids is None:
            return list(range(count))
        key = key or f"{what}_ids"
        chosen = list(np.atleast_1d(np.asarray(ids)).tolist())
        wrong = [
            i for i in chosen if isinstance(i, bool) or not isinstance(i, int) or not 0 <= i < count
        ]
        if wrong or len(set(chosen)) != len(chosen) or not chosen:
            reason = f"of which {wrong} do not exist" if wrong else "empty or with repetitions"
            raise TaskError(
                f"{key} is {chosen}, {reason}",
                expected=f"different {what} numbers from 0 to {count - 1}",
                fix=f"correct {key}",
                file=self.path,
                key=key,
            )
        return chosen

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
