"""`Trajectory`: a lazy, read-only view of a simulation.h5."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import (
    IncompleteFile,
    MissingInputError,
    SchemaError,
)
from openprc.schema.clock import Clock
from openprc.schema.damage import damage_named
from openprc.schema.digest import content_digest
from openprc.schema.extensions import Extensions
from openprc.schema.provenance import read_provenance
from openprc.schema.safety import open_hdf5
from openprc.schema.stored import ALL, Frames, InputSignal
from openprc.schema.version import check_version

POSITIONS = "/time_series/nodes/positions"


class Trajectory(Clock, Extensions):
    """Open a trajectory for reading. Arrays are read when asked for; nothing is made up.

    Parameters
    ----------
    path : path-like
    allow_incomplete : bool
        Also open what an unfinished run has committed.

    Raises
    ------
    UnreadableFile, UnsafeFile
        See `openprc.schema.safety.open_hdf5`.
    SchemaError, SchemaTooNew, SchemaTooOld
        When it is not a trajectory of a version that is understood.
    IncompleteFile
        When the run did not finish and `allow_incomplete` is false.

    Examples
    --------
    >>> from openprc.schema import Trajectory
    >>> with Trajectory("run.h5") as trajectory:
    ...     trajectory.positions(nodes=[0]).shape
    (5, 1, 3)
    """

    def __init__(self, path: str | Path, *, allow_incomplete: bool = False) -> None:
        self.path = Path(path)
        self._file = open_hdf5(self.path, unfinished=allow_incomplete)
        try:
            with damage_named(self.path):
                self._begin(allow_incomplete=allow_incomplete)
        except BaseException:
            self._file.close()
            raise

    def _begin(self, *, allow_incomplete: bool) -> None:
        check_version(self._file, self.path)
        attrs = self._file.attrs
        self.kind = str(attrs.get("kind", ""))
        if self.kind != "trajectory":
            raise SchemaError(
                f"this file holds kind {self.kind!r}",
                expected="a trajectory",
                fix="see what it is with `openprc info`",
                file=self.path,
                key="kind",
            )
        self.status = str(self._root("status"))
        self.run_id = str(self._root("run_id"))
        self.created = str(self._root("created"))
        self.dims = int(self._root("dims"))
        time, committed = self._file.get("time_series/time"), self._file.get("committed")
        if not isinstance(time, h5py.Dataset) or not isinstance(committed, h5py.Dataset):
            # A run that was killed before its first block has no clock yet.
            if self.status in ("running", "failed", "interrupted"):
                raise IncompleteFile(
                    f"the run is {self.status} and holds no frame",
                    expected="a finished run",
                    fix="run it again",
                    file=self.path,
                    key="/time_series/time",
                )
            key = "/time_series/time" if committed is not None else "/committed"
            raise self._missing(key, "a trajectory has one", "write it with TrajectoryWriter")
        self.n_frames = max(0, min(int(committed[()]), len(time)))
        finished = self.status == "complete" or (
            # `openprc repair` leaves a whole file whose run was interrupted.
            self.status == "interrupted" and self.n_frames == len(time) and "uniform" in time.attrs
        )
        if not finished and not allow_incomplete:
            raise IncompleteFile(
                f"status is {self.status!r}: {self.n_frames} frames are safe to read",
                expected="a finished run",
                fix="keep those frames with `openprc repair`, or open it with "
                "allow_incomplete=True",
                file=self.path,
                key="status",
            )

    def _root(self, name: str) -> Any:
        if name not in self._file.attrs:
            raise self._missing(name, "every file of the contract has it", "write it again")
        return self._file.attrs[name]

    # --- life cycle ----------------------------------------------------------------------

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return (
            f"<Trajectory {self.path.name}: {self.n_frames} frames, {self.n_nodes} nodes, "
            f"{self.dims} dimensions>"
        )

    # --- nodes ---------------------------------------------------------------------------

    @property
    def n_nodes(self) -> int:
        """Number of nodes; 0 when there are no positions."""
        item = self._file.get(POSITIONS)
        return int(item.shape[1]) if isinstance(item, h5py.Dataset) else 0

    @property
    def position_unit(self) -> str:
        """Unit of the stored positions."""
        return str(self._attr(POSITIONS, "unit"))

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes of the positions, (D,); none where the file does not name them.

        Raises
        ------
        MissingData
            When there are no positions.
        """
        return self._strings(POSITIONS, "axes")

    @property
    def frame(self) -> str:
        """Name of the frame of reference of the positions.

        Raises
        ------
        MissingData
            When there are no positions, or they do not say.
        """
        return str(self._attr(POSITIONS, "frame"))

    def positions(
        self, frames: Frames = ALL, nodes: Any = None, *, unit: str | None = None
    ) -> NDArray[np.float64]:
        """Return positions, (T', N', D), float64, in the stored unit or in `unit`.

        Missing points are NaN. `nodes` is a sequence of indices in any order.

        Raises
        ------
        MissingData
            When the file has no positions, or a node is out of range.
        UnitError
            When `unit` does not measure the same thing.
        """
        return self._nodal("positions", frames, nodes, unit)

    def velocities(
        self, frames: Frames = ALL, nodes: Any = None, *, unit: str | None = None
    ) -> NDArray[np.float64]:
        """Return velocities, (T', N', D); see `positions`."""
        return self._nodal("velocities", frames, nodes, unit)

    def observed(self, frames: Frames = ALL) -> NDArray[np.uint8]:
        """Return the mask, (T', N): 0 missing, 1 measured, 2 filled in."""
        data: NDArray[np.uint8] = self._series("/time_series/nodes/observed", frames)
        return data

    def node(self, name: str) -> NDArray[Any]:
        """Return a constant of the nodes: rest, mass, fixed, id or label, (N, ...)."""
        return self._static(f"/topology/nodes/{name}", None)

    def _nodal(
        self, name: str, frames: Frames, nodes: Any, unit: str | None
    ) -> NDArray[np.float64]:
        path = f"/time_series/nodes/{name}"
        data = self._series(path, frames)
        if nodes is not None:
            chosen = np.asarray(nodes).reshape(-1)
            if chosen.size and chosen.dtype.kind not in "iu":
                # A mask or a fraction would quietly become other indices.
                raise self._missing(
                    path, "indices of nodes", "numpy.flatnonzero turns a mask into indices",
                    found=f"nodes of type {chosen.dtype}",
                )  # fmt: skip
            chosen = chosen.astype(np.intp)
            wrong = chosen[(chosen < 0) | (chosen >= data.shape[1])]
            if wrong.size:
                raise self._missing(
                    path, f"nodes 0 to {data.shape[1] - 1}", "check the indices",
                    found=f"there is no node {int(wrong[0])}",
                )  # fmt: skip
            # Whole rows are read first: HDF5 selections of scattered nodes are far slower.
            data = data[:, chosen]
        return self._convert(path, data, unit)

    # --- elements, channels, whole body ------------------------------------------------------

    @property
    def element_kinds(self) -> tuple[str, ...]:
        """Kinds of elements between nodes."""
        return tuple(name for name in self._names("topology") if name != "nodes")

    def indices(self, kind: str) -> NDArray[np.int32]:
        """Return the nodes of every element, (E, k)."""
        data: NDArray[np.int32] = self._static(f"/topology/{kind}/indices", None)
        return data

    def element_series(self, kind: str) -> tuple[str, ...]:
        """Return the names of the recorded quantities of a kind."""
        return self._names(f"time_series/elements/{kind}")

    def element_constants(self, kind: str) -> tuple[str, ...]:
        """Return the names of the constants of a kind, `indices` apart."""
        return tuple(name for name in self._names(f"topology/{kind}") if name != "indices")

    def element(
        self, kind: str, quantity: str, *, frames: Frames = ALL, unit: str | None = None
    ) -> NDArray[np.float64]:
        """Return a quantity of every element, (T', E) or (T', E, k)."""
        path = f"/time_series/elements/{kind}/{quantity}"
        return self._convert(path, self._series(path, frames), unit)

    def element_static(self, kind: str, name: str, *, unit: str | None = None) -> NDArray[Any]:
        """Return a constant of every element, (E,)."""
        return self._static(f"/topology/{kind}/{name}", unit)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        return self._names("time_series/channels")

    def channel(
        self, name: str, *, frames: Frames = ALL, unit: str | None = None
    ) -> NDArray[np.float64]:
        """Return a channel, (T', C)."""
        path = f"/time_series/channels/{name}"
        return self._convert(path, self._series(path, frames), unit)

    def channel_columns(self, name: str) -> tuple[str, ...]:
        """Return the column names of a channel."""
        return self._strings(f"/time_series/channels/{name}", "columns")

    @property
    def systems(self) -> tuple[str, ...]:
        """Names of the whole-body quantities."""
        return self._names("time_series/system")

    def system(self, name: str, *, unit: str | None = None) -> NDArray[np.float64]:
        """Return a whole-body quantity, (T,)."""
        path = f"/time_series/system/{name}"
        return self._convert(path, self._series(path, ALL), unit)

    # --- inputs ----------------------------------------------------------------------------

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self._names("inputs")

    def input(self, name: str | None = None) -> InputSignal:
        """Return an input; without a name, the only one.

        Raises
        ------
        MissingInputError
            When there is none of that name, or several and none was named.
        """
        names = self.inputs
        if not names:
            raise MissingInputError(
                "the file does not say what drove the body",
                expected="at least one input",
                fix="add it with `openprc attach-input FILE --signal SIGNAL --out NEW`",
                file=self.path,
                key="/inputs",
            )
        if name is None and len(names) == 1:
            name = names[0]
        if name not in names:
            raise MissingInputError(
                "several inputs and none was named" if name is None else f"no input {name!r}",
                expected="one of " + ", ".join(names),
                fix="name one of them",
                file=self.path,
                key="/inputs",
            )
        base = f"/inputs/{name}"
        held = "sequence" in self._names(base)
        return InputSignal(
            name=name,
            value=self._series(base + "/value", ALL).astype("f8", copy=False),
            columns=self._strings(base + "/value", "columns"),
            unit=str(self._attr(base + "/value", "unit")),
            quantity=str(self._attr(base + "/value", "quantity")),
            targets=self._strings(base + "/value", "targets"),
            sequence=self._static(base + "/sequence", None) if held else None,
            hold=float(self._attr(base + "/sequence", "hold")) if held else None,
            start=float(self._attr(base + "/sequence", "start")) if held else 0.0,
        )

    # --- the rest ----------------------------------------------------------------------------

    @property
    def provenance(self) -> dict[str, Any]:
        """Where the file came from, as plain values."""
        with damage_named(self.path, "/provenance"):
            return read_provenance(self._file)

    def unit(self, path: str) -> str:
        """Return the unit of a dataset, named by its path in the file.

        Raises
        ------
        MissingData
            When the dataset is not there or has no unit.
        """
        return str(self._attr(path, "unit"))

    def has(self, path: str) -> bool:
        """Tell whether an object is in the file."""
        return path in self._file

    def has_unit(self, path: str) -> bool:
        """Tell whether a dataset is in the file and has a unit; codes and names have none."""
        return path in self._file and "unit" in self._file[path].attrs

    def content_digest(self) -> str:
        """Return a SHA-256 of all data; see `openprc.schema.digest.content_digest`."""
        with damage_named(self.path):
            return content_digest(self._file)


__all__ = ["InputSignal", "Trajectory"]
