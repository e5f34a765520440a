"""New files from finished ones: an input added, data compressed, a cut run saved.

A finished file is never changed. What is made here names its parents.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError, IncompleteFile, SchemaError
from openprc.schema import units
from openprc.schema.atomic import PARTIAL, atomic_file
from openprc.schema.damage import damage_named
from openprc.schema.digest import checksum
from openprc.schema.layout import CHECKSUM, TIME_AXIS, match
from openprc.schema.provenance import (
    Provenance,
    Source,
    new_run_id,
    now,
    write_provenance,
)
from openprc.schema.streams import write_attribute
from openprc.schema.timebase import describe_time
from openprc.schema.trajectory import Trajectory

#: Rounding slack, in symbols, when a frame falls on the border between two symbols.
_SLACK = 1e-6


def sample_held(
    sequence: NDArray[np.float64], time: NDArray[np.float64], *, hold: float, start: float
) -> NDArray[np.float64]:
    """Return the symbol in force at each instant.

    Parameters
    ----------
    sequence : (K, C)
        Symbol k acts from ``start + k hold`` (included) to ``start + (k + 1) hold``.
    time : (T,)
    hold, start : float
        In the unit of `time`.

    Returns
    -------
    value : (T, C)
        At the very end of the last symbol, that symbol.

    Raises
    ------
    ConfigError
        When an instant lies outside the sequence: nothing is extrapolated.
    """
    phase = (time - start) / hold
    count = len(sequence)
    if phase.min() < -_SLACK or phase.max() > count + _SLACK:
        end = start + count * hold
        raise ConfigError(
            f"the signal covers {start:g} to {end:g}, the frames {time[0]:g} to {time[-1]:g}",
            expected="a signal that covers every frame",
            fix="correct --hold and --start, or give the whole signal",
            key="hold",
        )
    index = np.clip(np.floor(phase + _SLACK).astype(np.intp), 0, count - 1)
    return sequence[index]


def attach_input(
    source: str | Path,
    target: str | Path,
    *,
    name: str,
    signal: ArrayLike,
    unit: str,
    quantity: str,
    hold: float | None = None,
    start: float | None = None,
    columns: Sequence[str] = (),
    targets: Sequence[str] = (),
    signal_file: str | Path | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a copy of a trajectory with what drove it.

    Parameters
    ----------
    source, target : path-like
    name : str
        Of the input.
    signal : (K,) or (K, C)
        With `hold`, the symbols; without it, one value a frame.
    unit, quantity : str
    hold : float, optional
        Duration of one symbol, in the file's unit of time.
    start : float, optional
        When symbol 0 begins; the time of the first frame by default.
    signal_file : path-like, optional
        Where the signal was read from, for the list of sources.

    Raises
    ------
    ConfigError
        When the signal is not finite, has another length than the clock, or does not cover it.
    ResultExists
        When `target` exists and `overwrite` is false.
    """
    source, target = Path(source), Path(target)
    symbol = units.unit(unit, key=name)
    data = np.asarray(signal, dtype="f8")
    data = data[:, np.newaxis] if data.ndim == 1 else data
    if data.ndim != 2 or not data.size or not np.isfinite(data).all():
        raise ConfigError(
            f"the signal has shape {np.shape(signal)} or holds NaN",
            expected="(K,) or (K, C) finite numbers",
            fix="correct the signal",
            file=signal_file,
            key=name,
        )
    names = tuple(columns) or tuple(f"{name}{i}" if data.shape[1] > 1 else name
                                    for i in range(data.shape[1]))  # fmt: skip
    _check_names(name, names, data.shape[1])
    with Trajectory(source) as trajectory:
        time = trajectory.time
        if name in trajectory.inputs:
            raise ConfigError(
                f"there is an input {name!r} already",
                expected="a new name",
                fix="choose another --name",
                file=source,
                key=f"/inputs/{name}",
            )
    begin = float(time[0]) if start is None else float(start)
    if not np.isfinite(begin):
        raise ConfigError(
            f"start is {begin}", expected="a finite time", fix="correct it", key="start"
        )
    if hold is None:
        if len(data) != len(time):
            raise ConfigError(
                f"the signal has {len(data)} values, the file {len(time)} frames",
                expected="one value a frame, or --hold with the duration of a symbol",
                fix="say --hold, or resample the signal to the frames",
                file=signal_file or source,
                key=name,
            )
        value = data
    elif not 0 < hold < np.inf:
        raise ConfigError(
            f"hold is {hold}", expected="a time above 0", fix="correct it", key="hold"
        )
    else:
        value = sample_held(data, time, hold=hold, start=begin)
    attrs: dict[str, Any] = {
        "unit": unit, "si_factor": symbol.si_factor, "columns": names,
        "quantity": quantity, "targets": tuple(targets),
    }  # fmt: skip

    def change(file: h5py.File) -> None:
        dataset = file.create_dataset(f"inputs/{name}/value", data=value, fletcher32=True)
        for key, item in attrs.items():
            write_attribute(dataset, key, item)
        if hold is not None:
            held = file.create_dataset(f"inputs/{name}/sequence", data=data, fletcher32=True)
            held.attrs.update({"hold": float(hold), "start": begin})

    extra = [] if signal_file is None else [Source.of(signal_file, role="signal")]
    return _derive(source, target, change, sources=extra, overwrite=overwrite)


def _check_names(name: str, columns: tuple[str, ...], count: int) -> None:
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.\- ]*", name):
        raise ConfigError(
            f"the name {name!r}",
            expected="letters, digits, '_', '-', '.', ' '",
            fix="choose another --name",
            key="name",
        )
    if len(columns) != count or len(set(columns)) != count:
        raise ConfigError(
            f"columns {list(columns)} for a signal of {count}",
            expected="one name a column, each once",
            fix="correct the columns",
            key="columns",
        )


def pack(source: str | Path, target: str | Path, *, overwrite: bool = False) -> Path:
    """Write a compressed copy and verify that it holds the same numbers.

    Raises
    ------
    SchemaError
        When the copy differs; it is not kept then.
    """
    source, target = Path(source), Path(target)
    with Trajectory(source) as trajectory:
        wanted = trajectory.content_digest()

    def compress(file: h5py.File) -> None:
        paths: list[str] = []
        file.visititems(
            lambda path, item: (
                paths.append(path)
                if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu" and item.size > 64
                else None
            )
        )
        for path in paths:
            old = file[path]
            attrs, data = dict(old.attrs), old[()]
            del file[path]
            new = file.create_dataset(
                path, data=data, compression="gzip", compression_opts=4,
                shuffle=True, fletcher32=True,
            )  # fmt: skip
            new.attrs.update(attrs)

    def verify(temporary: Path) -> None:
        with Trajectory(temporary) as trajectory:
            if trajectory.content_digest() != wanted:
                raise SchemaError(
                    "the packed copy differs from the original",
                    expected="the same numbers",
                    fix="the original is untouched; report this",
                    file=target,
                )

    return _derive(source, target, compress, overwrite=overwrite, verify=verify, repack=True)


def repair(
    source: str | Path, target: str | Path | None = None, *, overwrite: bool = False
) -> Path:
    """Save what an unfinished run committed, as a file of status ``interrupted``.

    Parameters
    ----------
    source : path-like
        Usually ``NAME.partial``; it is left as it is.
    target : path-like, optional
        NAME by default.

    Raises
    ------
    IncompleteFile
        When nothing was committed, or the file is complete already.
    """
    source = Path(source)
    if target is None:
        stem = source.name.removesuffix(PARTIAL)
        target = source.with_name(stem if stem != source.name else f"repaired-{stem}")
    with Trajectory(source, allow_incomplete=True) as trajectory:
        rows, status = trajectory.n_frames, trajectory.status
    published = source.name.endswith(PARTIAL)
    if status == "complete" and not published:
        raise IncompleteFile(
            "this file is complete", expected="an unfinished one", fix="use it as it is",
            file=source,
        )  # fmt: skip
    if not rows:
        raise IncompleteFile(
            "no frame was committed", expected="at least one", fix="run it again", file=source
        )

    def truncate(file: h5py.File) -> None:
        paths: list[str] = []
        file.visititems(
            lambda path, item: paths.append(path) if isinstance(item, h5py.Dataset) else None
        )
        for path in paths:
            if not _grows(path, file[path]):
                continue
            file[path].attrs[CHECKSUM] = np.int64(checksum(file[path][()]))
        file["committed"][()] = rows
        file["time_series/time"].attrs.update(describe_time(file["time_series/time"][()]))
        if status != "complete":  # else it was killed between the last frame and the rename
            file.attrs["status"] = "interrupted"

    return _derive(source, Path(target), truncate, overwrite=overwrite, rows=rows)


def _derive(
    source: Path,
    target: Path,
    change: Callable[[h5py.File], None],
    *,
    sources: Sequence[Source] = (),
    overwrite: bool,
    verify: Callable[[Path], None] | None = None,
    repack: bool = False,
    rows: int | None = None,
) -> Path:
    with Trajectory(source, allow_incomplete=True) as trajectory:
        old = trajectory.provenance
        parent = trajectory.run_id
        with atomic_file(target, overwrite=overwrite) as temporary:
            raw = temporary.with_name(temporary.name + ".raw") if repack else temporary
            try:
                with h5py.File(raw, "w") as file:
                    _copy(trajectory, file, rows)
                    change(file)
                    file.attrs.update({"run_id": new_run_id(), "created": now()})
                    listed = [Source(**row) for row in old.get("inputs", [])]
                    write_provenance(
                        file, _inherited(old, parent), [*listed, *sources], old.get("notes", [])
                    )
                if repack:
                    # HDF5 does not give back the room of deleted datasets; a copy does.
                    with h5py.File(raw, "r") as loose, h5py.File(temporary, "w") as tight:
                        _copy_all(loose, tight)
            finally:
                if repack:
                    raw.unlink(missing_ok=True)
            if verify is not None:
                verify(temporary)
    return target


def _copy(trajectory: Trajectory, file: h5py.File, rows: int | None) -> None:
    # The reader has walked and trusts its file; nothing else may be copied from.
    if rows is None:
        _copy_all(trajectory._file, file)
        return

    def copy(path: str, item: h5py.HLObject) -> None:
        if isinstance(item, h5py.Group):
            made = file.require_group(path)
        elif _grows(path, item):
            # What lies beyond the committed rows may be damaged, and is not touched.
            made = file.create_dataset(path, data=item[:rows])
        else:
            trajectory._file.copy(path, file, path)
            return
        made.attrs.update(dict(item.attrs))

    with damage_named(trajectory.path):
        trajectory._file.visititems(copy)
    file.attrs.update(dict(trajectory._file.attrs))


def _grows(path: str, item: h5py.Dataset) -> bool:
    if path.startswith("extensions/"):
        return TIME_AXIS in item.attrs
    rule = match(f"/{path}")
    return rule is not None and rule[0].shape[:1] == ("T",)


def _copy_all(source: h5py.File, target: h5py.File) -> None:
    for name in source:
        source.copy(name, target)
    target.attrs.update(dict(source.attrs))


def _inherited(old: dict[str, Any], parent: str) -> Provenance:
    deterministic = old.get("deterministic")
    return Provenance(
        str(old.get("producer", "unknown")),
        producer_version=str(old.get("producer_version", "unknown")),
        plugin=str(old.get("plugin", "unknown")),
        plugin_version=str(old.get("plugin_version", "unknown")),
        command=old.get("command"),
        seed=old.get("seed"),
        deterministic=None if deterministic is None else bool(deterministic),
        config=old.get("config"),
        parents=(parent, *old.get("parents", [])),
    )
