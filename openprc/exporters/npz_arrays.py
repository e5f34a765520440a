"""simulation.h5 to one .npz file that `numpy.load` opens."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.exporters.rows import Rows

if TYPE_CHECKING:
    from openprc.schema import Trajectory

#: Reads some frames of one quantity.
Reader = Callable[[slice], NDArray[Any]]
_NODE_CONSTANTS = ("rest", "mass", "fixed", "id", "label")


class NpzExporter:
    """Everything of a trajectory as plain arrays, with units and names beside them.

    ========================== ========================================================
    ``time``                   (T,)
    ``positions``              (T, N, D), and ``velocities``, ``observed`` where there are
    ``nodes/mass``             (N,), likewise ``rest``, ``fixed``, ``id``, ``label``
    ``bars/indices``           (E, 2), the constants and series of any kind of element
    ``channels/NAME``          (T, C)
    ``system/NAME``            (T,)
    ``inputs/NAME``            (T, C), and ``inputs/NAME/sequence``, (K, C)
    ``extensions/PLUGIN/NAME`` (T, ...), the series that plugins keep of their own
    ``metadata``               JSON text: units, columns, where the file came from
    ========================== ========================================================

    Nothing in it is pickled, so ``numpy.load(path)`` opens it as it is. Frames are copied in
    blocks; what is held in memory does not grow with the length of the run.
    """

    def export(
        self, trajectory: Trajectory, path: Path, *, options: Mapping[str, Any]
    ) -> list[Path]:
        """Write every ``options["stride"]``-th frame of `trajectory` to `path`.

        Raises
        ------
        ConfigError
            When the stride is not at least 1.
        """
        frames = Rows(trajectory.n_frames, options)
        method = zipfile.ZIP_DEFLATED if options.get("compress") else zipfile.ZIP_STORED
        with zipfile.ZipFile(path, "x", compression=method) as archive:
            for name, array in _constants(trajectory):
                _put(archive, name, array.shape, array.dtype, iter((array,)))
            for name, read in _series(trajectory):
                first = read(slice(0, 1))
                shape = (len(frames), *first.shape[1:])
                _put(archive, name, shape, first.dtype, (read(rows) for rows in frames.blocks()))
            text = np.array(json.dumps(_metadata(trajectory, frames), sort_keys=True))
            _put(archive, "metadata", text.shape, text.dtype, iter((text,)))
        return [path]


def _put(
    archive: zipfile.ZipFile,
    name: str,
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    blocks: Iterator[NDArray[Any]],
) -> None:
    """Write one array in the .npy format, block by block."""
    # A fixed date: the same run gives the same bytes.
    entry = zipfile.ZipInfo(f"{name}.npy")
    entry.compress_type = archive.compression
    header = {
        "descr": np.lib.format.dtype_to_descr(dtype),
        "fortran_order": False,
        "shape": shape,
    }
    with archive.open(entry, "w", force_zip64=True) as stream:
        np.lib.format.write_array_header_2_0(stream, header)
        for block in blocks:
            stream.write(np.ascontiguousarray(block, dtype=dtype).tobytes())


def _constants(trajectory: Trajectory) -> Iterator[tuple[str, NDArray[Any]]]:
    for name in _NODE_CONSTANTS:
        if trajectory.has(f"/topology/nodes/{name}"):
            yield f"nodes/{name}", _plain(trajectory.node(name))
    for kind in trajectory.element_kinds:
        yield f"{kind}/indices", trajectory.indices(kind)
        for name in trajectory.element_constants(kind):
            yield f"{kind}/{name}", _plain(trajectory.element_static(kind, name))
    for name in trajectory.inputs:
        sequence = trajectory.input(name).sequence
        if sequence is not None:
            yield f"inputs/{name}/sequence", sequence


def _plain(array: NDArray[Any]) -> NDArray[Any]:
    """Return text as fixed-width Unicode, which needs no pickle."""
    return array.astype(str) if array.dtype.kind == "O" else array


def _series(trajectory: Trajectory) -> Iterator[tuple[str, Reader]]:
    yield "time", lambda rows: trajectory.time[rows]
    if trajectory.dims:
        yield "positions", trajectory.positions
        if trajectory.has("/time_series/nodes/velocities"):
            yield "velocities", trajectory.velocities
        if trajectory.has("/time_series/nodes/observed"):
            yield "observed", trajectory.observed
    for kind in trajectory.element_kinds:
        for quantity in trajectory.element_series(kind):
            yield f"{kind}/{quantity}", _element(trajectory, kind, quantity)
    for name in trajectory.channels:
        yield f"channels/{name}", _channel(trajectory, name)
    for name in trajectory.systems:
        yield f"system/{name}", _rows_of(trajectory.system(name))
    for name in trajectory.inputs:
        yield f"inputs/{name}", _rows_of(trajectory.input(name).value)
    for plugin in trajectory.extensions:
        for name in trajectory.extension_series(plugin):
            yield f"extensions/{plugin}/{name}", _extension(trajectory, plugin, name)


def _extension(trajectory: Trajectory, plugin: str, name: str) -> Reader:
    return lambda rows: trajectory.extension(plugin, name, frames=rows)


def _element(trajectory: Trajectory, kind: str, quantity: str) -> Reader:
    return lambda rows: trajectory.element(kind, quantity, frames=rows)


def _channel(trajectory: Trajectory, name: str) -> Reader:
    return lambda rows: trajectory.channel(name, frames=rows)


def _rows_of(values: NDArray[Any]) -> Reader:
    return lambda rows: values[rows]


def _metadata(trajectory: Trajectory, frames: Rows) -> dict[str, Any]:
    units = {"time": trajectory.time_unit}
    if trajectory.dims:
        units["positions"] = trajectory.position_unit
        if trajectory.has("/time_series/nodes/velocities"):
            units["velocities"] = trajectory.unit("/time_series/nodes/velocities")
    paths = {"nodes/rest": "/topology/nodes/rest", "nodes/mass": "/topology/nodes/mass"}
    for kind in trajectory.element_kinds:
        for quantity in trajectory.element_series(kind):
            paths[f"{kind}/{quantity}"] = f"/time_series/elements/{kind}/{quantity}"
        for name in trajectory.element_constants(kind):
            paths[f"{kind}/{name}"] = f"/topology/{kind}/{name}"
    for plugin in trajectory.extensions:
        for name in trajectory.extension_series(plugin):
            paths[f"extensions/{plugin}/{name}"] = f"/extensions/{plugin}/{name}"
    for name in trajectory.systems:
        paths[f"system/{name}"] = f"/time_series/system/{name}"
    for name in trajectory.channels:
        paths[f"channels/{name}"] = f"/time_series/channels/{name}"
    units.update(
        (name, trajectory.unit(path)) for name, path in paths.items() if trajectory.has_unit(path)
    )
    signals = {name: trajectory.input(name) for name in trajectory.inputs}
    units.update((f"inputs/{name}", signal.unit) for name, signal in signals.items())
    return {
        "run_id": trajectory.run_id,
        "time_kind": trajectory.time_kind,
        "stride": frames.stride,
        "units": units,
        "columns": {
            **{f"channels/{n}": list(trajectory.channel_columns(n)) for n in trajectory.channels},
            **{f"inputs/{name}": list(signal.columns) for name, signal in signals.items()},
        },
        "inputs": {
            name: {"quantity": s.quantity, "targets": list(s.targets), "hold": s.hold,
                   "start": s.start}
            for name, s in signals.items()
        },
        "producer": trajectory.provenance.get("producer"),
    }  # fmt: skip
