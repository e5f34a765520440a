"""`TrajectoryWriter`: the only way a simulation.h5 comes into being.

A producer declares what it has, appends frames, and never opens HDF5. The contract is enforced
while writing, so a file under its final name is complete and valid.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self
from weakref import WeakValueDictionary

import h5py
import numpy as np
from numpy.typing import ArrayLike

from openprc.errors import ResultExists, SchemaError, UnreadableFile
from openprc.schema import atomic
from openprc.schema.blocks import Block, BlockChecker
from openprc.schema.declarations import Declarations
from openprc.schema.layout import CHECKSUM, SCHEMA_VERSION
from openprc.schema.plain_text import storable
from openprc.schema.provenance import (
    Provenance,
    Source,
    new_run_id,
    now,
    write_provenance,
)
from openprc.schema.streams import StreamSet
from openprc.schema.timebase import describe_time

#: Partial files that this process is writing. HDF5 locks files against other processes only.
_WRITING: WeakValueDictionary[Path, TrajectoryWriter] = WeakValueDictionary()


class TrajectoryWriter(Declarations):
    """Stream a trajectory into ``PATH.partial`` and publish it as ``PATH`` when it is whole.

    Use it as a context manager: leaving it normally closes the file, an exception leaves
    status ``failed`` and Ctrl-C status ``interrupted`` in the partial file.

    Parameters
    ----------
    path : path-like
        Final name.
    provenance : Provenance
        Who makes the file.
    title, comment : str, optional
    overwrite : bool
        Replace a finished file of this name, once the new one is complete.
    on_failure : {"keep", "discard"}
        Whether an unfinished file with at least one frame is kept; without a frame it never is.
    verify : callable, optional
        Called with the path of the finished file before it gets its final name; what it raises
        keeps the name free.

    Raises
    ------
    ResultExists
        When `path` exists and `overwrite` is false, or when an unfinished file of that name
        is in the way.

    Examples
    --------
    >>> from openprc.schema import Provenance, TrajectoryWriter
    >>> with TrajectoryWriter("run.h5", provenance=Provenance("example")) as writer:
    ...     writer.declare_nodes(2, 3, unit="m")
    ...     for i in range(5):
    ...         writer.append(0.1 * i, positions=[[0.0, 0.0, 0.0], [1.0, 0.0, 0.1 * i]])
    """

    def __init__(
        self,
        path: str | Path,
        *,
        provenance: Provenance,
        title: str | None = None,
        comment: str | None = None,
        overwrite: bool = False,
        on_failure: Literal["keep", "discard"] = "keep",
        verify: Callable[[Path], None] | None = None,
    ) -> None:
        super().__init__(Path(path))
        self.provenance = provenance
        self.run_id = new_run_id()
        self._title = title
        self._comment = comment
        self._overwrite = overwrite
        self._on_failure = on_failure
        self._verify = verify
        self._sources: list[Source] = []
        self._notes: list[str] = []
        self._live: tuple[BlockChecker, StreamSet] | None = None
        self._closed = False
        self.partial = atomic.partial_path(self.path)
        self._file = self._open()

    # --- life cycle ----------------------------------------------------------------------

    def _open(self) -> h5py.File:
        if self.path.is_dir():
            raise UnreadableFile(
                "this is a directory", expected="a file name", fix="add one", file=self.path
            )
        if not self._overwrite:
            atomic.refuse_existing(self.path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.partial.exists():
            self._clear_leftover()
        try:
            # "x" fails if another writer was quicker; nothing is ever opened over.
            file = h5py.File(self.partial, "x")
        except FileExistsError:
            raise self._in_the_way() from None
        _WRITING[self.partial.resolve()] = self
        try:
            self._write_envelope(file)
        except BaseException:
            self._release(file)
            self.partial.unlink(missing_ok=True)
            raise
        return file

    def _release(self, file: h5py.File) -> None:
        file.close()
        _WRITING.pop(self.partial.resolve(), None)

    def _write_envelope(self, file: h5py.File) -> None:
        file.attrs.update(
            {
                "openprc_schema": SCHEMA_VERSION,
                "kind": "trajectory",
                "status": "running",
                "run_id": self.run_id,
                "created": now(),
                "dims": 0,
            }
        )
        for name, text in (("title", self._title), ("comment", self._comment)):
            if text:
                file.attrs[name] = storable(text, key=name, file=self.path)
        file.create_dataset("committed", data=np.int64(0))
        write_provenance(file, self.provenance, [], [])
        file.flush()

    def _clear_leftover(self) -> None:
        if not self._overwrite or _is_locked(self.partial):
            raise self._in_the_way()
        self.partial.unlink()

    def _in_the_way(self) -> ResultExists:
        return ResultExists(
            "an unfinished file of this name is in the way",
            expected="no file of this name",
            fix="if its run has ended, keep what it holds with `openprc repair`, or delete it",
            file=self.partial,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            try:
                self.close()
            except BaseException as problem:
                self._abandon(_status_after(type(problem)))
                raise
        else:
            self._abandon(_status_after(kind))

    def close(self) -> None:
        """Check the whole, mark it complete, and give it its final name.

        Raises
        ------
        SchemaError
            When nothing was appended or declared.
        ResultExists
            When a file of the final name has appeared meanwhile.
        """
        if self._closed:
            return
        if self._live is None or self.n_frames == 0:
            raise SchemaError(
                "no frame was appended",
                expected="at least one",
                fix="call append() before close()",
                file=self.path,
                key="/time_series/time",
            )
        self._live[1].commit(final=True)
        dataset = self._file["time_series/time"]
        dataset.attrs.update(describe_time(dataset[()]))
        for path, checksum in self._live[1].checksums.items():
            self._file[path].attrs[CHECKSUM] = np.int64(checksum)
        write_provenance(self._file, self.provenance, self._sources, self._notes)
        self._file.attrs["status"] = "complete"
        self._release(self._file)
        if self._verify is not None:
            self._verify(self.partial)
        if not self._overwrite:
            atomic.refuse_existing(self.path)
        atomic.publish(self.partial, self.path)
        self._closed = True

    def _abandon(self, status: str) -> None:
        if self._closed:
            return
        self._closed = True
        rows = self.n_frames
        if self._file:  # h5py files are false once closed
            if self._live is not None:
                # What made the run fail, a full disk say, may well fail here too.
                with suppress(OSError):
                    self._live[1].commit()
                rows = self._live[1].committed
            with suppress(OSError):
                self._file.attrs["status"] = status
                write_provenance(self._file, self.provenance, self._sources, self._notes)
            self._release(self._file)
        elif self.partial.exists():
            with h5py.File(self.partial, "r+") as file:
                file.attrs["status"] = status
        if self._on_failure == "discard" or rows == 0:
            self.partial.unlink(missing_ok=True)

    # --- what is said about the run ---------------------------------------------------------

    def add_source(self, path: str | Path, *, role: str = "source") -> None:
        """Hash a file (or folder) that was read and record it under its base name."""
        self._sources.append(Source.of(path, role=role))

    def note(self, text: str) -> None:
        """Keep a remark that a reader of the data should know."""
        words = " ".join(text.split())
        self._notes.append(storable(words, key="/provenance/notes", file=self.path))

    def keep(self) -> None:
        """Keep what was appended, even where failures are discarded: the run worked so far."""
        self._on_failure = "keep"

    @property
    def notes(self) -> tuple[str, ...]:
        """The remarks made so far."""
        return tuple(self._notes)

    @property
    def n_frames(self) -> int:
        """Frames appended so far."""
        return 0 if self._live is None else self._live[1].rows

    # --- frames ------------------------------------------------------------------------------

    def append(
        self,
        time: ArrayLike,
        *,
        positions: ArrayLike | None = None,
        velocities: ArrayLike | None = None,
        observed: ArrayLike | None = None,
        elements: Mapping[tuple[str, str], ArrayLike] | None = None,
        channels: Mapping[str, ArrayLike] | None = None,
        system: Mapping[str, ArrayLike] | None = None,
        inputs: Mapping[str, ArrayLike] | None = None,
        extensions: Mapping[tuple[str, str], ArrayLike] | None = None,
    ) -> None:
        """Append one frame (`time` a number) or a block of B frames (`time` of length B).

        Parameters
        ----------
        time : float or (B,)
            In the declared unit of time, later than every frame before.
        positions, velocities : (N, D) or (B, N, D)
        observed : (N,) or (B, N)
            0 missing, 1 measured, 2 filled in.
        elements : mapping of (kind, quantity) to (E,) or (B, E)
        channels, inputs : mapping of name to (C,) or (B, C)
        system : mapping of name to float or (B,)
        extensions : mapping of (distribution, name) to (...) or (B, ...)
            What `declare_extension_series` declared.

        Raises
        ------
        SchemaError
            When something declared is left out, something else is given, a shape differs,
            time does not increase, or a value is infinite, or NaN without being marked
            missing. Nothing of the block is kept then.
        """
        if not self._file:
            raise SchemaError(
                "append() after the file was closed",
                expected="frames before close()",
                fix="open another writer",
                file=self.path,
            )
        given: dict[str, Any] = {"/time_series/time": time}
        for name, value in (
            ("positions", positions),
            ("velocities", velocities),
            ("observed", observed),
        ):
            if value is not None:
                given[f"/time_series/nodes/{name}"] = value
        for (kind, quantity), value in (elements or {}).items():
            given[f"/time_series/elements/{kind}/{quantity}"] = value
        for group, values in (("channels", channels), ("system", system)):
            for name, value in (values or {}).items():
                given[f"/time_series/{group}/{name}"] = value
        for name, value in (inputs or {}).items():
            given[f"/inputs/{name}/value"] = value
        for (distribution, name), value in (extensions or {}).items():
            given[f"/extensions/{distribution}/{name}"] = value
        checker, streams = self._live or self._begin()
        block: Block = checker.check(given)
        streams.append(block.arrays, block.rows)

    def commit(self) -> None:
        """Make every frame so far safe against a crash of this process."""
        if self._live is not None and self._file:
            self._live[1].commit()

    def _begin(self) -> tuple[BlockChecker, StreamSet]:
        """Freeze the declarations and write everything that does not grow."""
        self.freeze()
        self._file.attrs["dims"] = self.dims
        for path, (data, attrs) in self.static.items():
            dataset = self._file.create_dataset(path, data=data, fletcher32=_checksummed(data))
            for key, value in attrs.items():
                dataset.attrs[key] = value
        for owner, attrs in self.group_attrs.items():
            self._file.require_group(owner).attrs.update(attrs)
        self._file.flush()
        self._live = (
            BlockChecker(self.path, self.streams),
            StreamSet(self._file, self.streams),
        )
        return self._live


def _checksummed(data: Any) -> bool | None:
    # Checksums need chunks, which scalars, empty arrays and text cannot have.
    if not isinstance(data, np.ndarray) or data.size == 0 or data.ndim == 0:
        return None
    return data.dtype.kind in "fiu" or None


def _status_after(error: type[BaseException]) -> str:
    return "interrupted" if issubclass(error, KeyboardInterrupt) else "failed"


def _is_locked(path: Path) -> bool:
    if path.resolve() in _WRITING:
        return True
    try:
        h5py.File(path, "r+").close()
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


__all__: Sequence[str] = ["TrajectoryWriter"]
