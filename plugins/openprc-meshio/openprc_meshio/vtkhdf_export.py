"""simulation.h5 to a temporal VTKHDF file of polygonal data.

The layout is that of the VTK file format "VTKHDF", version 2.2: group ``/VTKHDF`` of type
PolyData with points, four kinds of cells (vertices, lines, polygons, strips), and a group
``Steps`` with the offset of every step into the arrays that grow. Cells do not change, so all
steps share one part of the topology.
https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.schema import safety
from openprc_meshio.export_fields import Field, Outline, outline

if TYPE_CHECKING:
    from openprc.schema import Trajectory

VERSION = (2, 2)
#: Order in which VTK counts the cells of polygonal data.
CELL_KINDS = ("Vertices", "Lines", "Polygons", "Strips")
#: Bytes of one block of frames that is held in memory.
_BLOCK_BYTES = 8 << 20


class VtkhdfExporter:
    """Copies places and fields into arrays that VTK reads step by step.

    Places in a plane get z = 0, since VTK knows three dimensions only. The cell data of a kind
    of element that does not have a quantity are NaN there. Frames are copied in blocks: memory
    does not grow with the length of the run.
    """

    def export(
        self, trajectory: Trajectory, path: Path, *, options: Mapping[str, Any]
    ) -> list[Path]:
        """Write every ``options["stride"]``-th frame of `trajectory` to `path`.

        Raises
        ------
        MissingData
            When there are no positions, or a field that is asked for is not there.
        ConfigError
            When the stride is below 1.
        """
        given = outline(trajectory, options)
        with safety.open_hdf5(trajectory.path) as source, h5py.File(path, "x") as file:
            root = file.create_group("VTKHDF")
            root.attrs["Version"] = np.array(VERSION, dtype="i8")
            # The reader insists on text of fixed length.
            root.attrs.create("Type", b"PolyData", dtype=h5py.string_dtype("ascii", 8))
            for key, value in given.remarks.items():
                root.attrs[key] = value
            for name, kinds in _cell_fields(given).items():
                for kind, field in kinds.items():
                    root.attrs[f"openprc.unit.{kind}.{name}"] = field.unit
            _write_cells(root, trajectory, given)
            _write_steps(root, trajectory.time, given)
            _copy(root, source, given)
        return [path]


def _write_cells(root: h5py.Group, trajectory: Trajectory, given: Outline) -> None:
    tables: dict[str, NDArray[np.int64]] = {}
    for name, kind, width in (("Lines", "bars", 2), ("Polygons", "faces", 3)):
        if given.elements.get(kind):
            tables[name] = trajectory.indices(kind).astype("i8").reshape(-1, width)
    if not tables:
        tables["Vertices"] = np.arange(given.n_nodes, dtype="i8").reshape(-1, 1)
    for name in CELL_KINDS:
        table = tables.get(name, np.empty((0, 1), dtype="i8"))
        group = root.create_group(name)
        group["Connectivity"] = table.reshape(-1)
        group["Offsets"] = np.arange(len(table) + 1, dtype="i8") * table.shape[1]
        group["NumberOfCells"] = np.array([len(table)], dtype="i8")
        group["NumberOfConnectivityIds"] = np.array([table.size], dtype="i8")
    root["NumberOfPoints"] = np.array([given.n_nodes], dtype="i8")


def _write_steps(root: h5py.Group, time: NDArray[np.float64], given: Outline) -> None:
    steps = root.create_group("Steps")
    count = len(given.frames)
    steps.attrs["NSteps"] = np.int64(count)
    steps["Values"] = time[given.frames.start : given.frames.stop : given.frames.step]
    shared = np.zeros(count, dtype="i8")
    steps["PartOffsets"] = shared
    steps["NumberOfParts"] = np.ones(count, dtype="i8")
    steps["PointOffsets"] = np.arange(count, dtype="i8") * given.n_nodes
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        steps[name] = np.zeros((count, len(CELL_KINDS)), dtype="i8")
    nodal, cell = steps.create_group("PointDataOffsets"), steps.create_group("CellDataOffsets")
    for field in given.nodal:
        nodal[field.name] = np.arange(count, dtype="i8") * given.n_nodes
    for name in _cell_fields(given):
        cell[name] = np.arange(count, dtype="i8") * sum(given.elements.values())


def _cell_fields(given: Outline) -> dict[str, dict[str, Field]]:
    """Return name to kind to field: VTK has one array for the cells of all kinds."""
    found: dict[str, dict[str, Field]] = {}
    for kind, fields in given.cell.items():
        for field in fields:
            name = field.name
            others = found.get(name, {})
            if any(other.shape[2:] != field.shape[2:] for other in others.values()):
                name = f"{kind}_{name}"  # a name for two shapes cannot be one array
            found.setdefault(name, {})[kind] = field
    return found


@dataclass(frozen=True)
class _Column:
    """A dataset of the export, `rows` of it for a frame, and where its numbers come from."""

    dataset: h5py.Dataset
    rows: int
    parts: tuple[tuple[Field, int], ...]  # field, row of a frame at which it begins
    empty: float


def _columns(root: h5py.Group, given: Outline) -> Iterator[_Column]:
    frames, places = len(given.frames), given.positions
    # VTK knows three dimensions only: a plane lies at z = 0.
    table = _table(root, "Points", frames, given.n_nodes, (3,), places.dtype)
    yield _Column(table, given.n_nodes, ((places, 0),), 0.0)
    nodal, cell = root.create_group("PointData"), root.create_group("CellData")
    for field in given.nodal:
        tail = (3,) if len(field.shape) == 3 else ()
        table = _table(nodal, field.name, frames, given.n_nodes, tail, field.dtype)
        yield _Column(table, given.n_nodes, ((field, 0),), 0.0)
    n_cells = sum(given.elements.values())
    begin = {"bars": 0, "faces": given.elements.get("bars", 0)}
    for name, kinds in _cell_fields(given).items():
        parts = tuple((field, begin[kind]) for kind, field in kinds.items())
        table = _table(cell, name, frames, n_cells, parts[0][0].shape[2:], "f8")
        yield _Column(table, n_cells, parts, np.nan)


def _copy(root: h5py.Group, source: h5py.File, given: Outline) -> None:
    """Copy places and fields, block by block."""
    for column in _columns(root, given):
        tail, rows = column.dataset.shape[1:], column.rows
        for start, taken in _blocks(given, rows * math.prod(tail)):
            count = len(range(*taken.indices(given.frames.stop)))
            field = column.parts[0][0]
            if field.shape[1:] == (rows, *tail):
                values = source[field.path][taken]
                column.dataset[start * rows : (start + count) * rows] = values.reshape(-1, *tail)
                continue
            block = np.full((count, rows, *tail), column.empty, dtype=column.dataset.dtype)
            for field, begin in column.parts:
                values = source[field.path][taken]
                window = block[:, begin : begin + values.shape[1]]
                window[(..., slice(values.shape[2])) if values.ndim == 3 else ...] = values
            column.dataset[start * rows : (start + count) * rows] = block.reshape(-1, *tail)


def _table(
    group: h5py.Group, name: str, frames: int, rows: int, tail: tuple[int, ...], dtype: str
) -> h5py.Dataset:
    # In one piece, and not filled with zeros first: every row is written, once.
    shape = (frames * rows, *tail)
    return group.create_dataset(name, shape=shape, dtype=dtype, fill_time="never")


def _blocks(given: Outline, numbers: int) -> Iterator[tuple[int, slice]]:
    """Yield (first exported frame, rows of the trajectory)."""
    frames = given.frames
    count = max(1, _BLOCK_BYTES // (8 * max(1, numbers)))
    for start in range(0, len(frames), count):
        part = frames[start : start + count]
        yield start, slice(part.start, part.stop, part.step)
