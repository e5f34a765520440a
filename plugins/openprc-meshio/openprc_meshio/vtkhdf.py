"""Temporal VTKHDF files: polygonal data and unstructured grids.

https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html
"""

from __future__ import annotations

from contextlib import ExitStack
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import NotATrajectory, UnreadableFile
from openprc.schema import safety
from openprc.schema.damage import damage_named
from openprc_meshio import vtk_shapes
from openprc_meshio.frames import Array, Cells, Series
from openprc_meshio.vtk_shapes import POLYDATA

Ints = NDArray[np.int64]

_POLYDATA = dict(zip(("Vertices", "Lines", "Polygons", "Strips"), POLYDATA.values(), strict=True))


def open_series(path: Path, *, stack: ExitStack) -> Series:
    """Return the time series of a VTKHDF file.

    Raises
    ------
    UnreadableFile, UnsafeFile
        When it is damaged, or of a type that has no listed points.
    NotATrajectory
        When it has no steps.
    """
    file = stack.enter_context(safety.open_hdf5(path, allow_soft_links=True))
    with damage_named(path, "/VTKHDF"):
        root = file.get("VTKHDF")
        kind = root.attrs.get("Type", b"") if isinstance(root, h5py.Group) else b""
        kind = kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)
        if kind not in ("PolyData", "UnstructuredGrid"):
            raise UnreadableFile(
                f"VTKHDF of type {kind!r}" if kind else "there is no group /VTKHDF with a type",
                expected="PolyData or UnstructuredGrid",
                fix="export the mesh as one of these",
                file=path,
                key="/VTKHDF",
            )
        steps = root.get("Steps")
        count = int(steps.attrs.get("NSteps", 0)) if isinstance(steps, h5py.Group) else 0
        if count < 2:
            raise NotATrajectory(
                f"{count or 'no'} steps: a mesh at one instant",
                expected="a group Steps with several",
                fix="write all steps into the file",
                file=path,
                key="/VTKHDF/Steps",
            )
        source = _Source(path, root, steps, count, polydata=kind == "PolyData")
        remarks = {k: str(v) for k, v in root.attrs.items() if k.startswith("openprc.")}
        times = source.steps("Values").astype(np.float64)
    dims = remarks.get("openprc.dims", "")
    return Series(
        path,
        [_Frame(source, index) for index in range(count)],
        times,
        time_unit=remarks.get("openprc.time.unit", ""),
        time_kind=remarks.get("openprc.time.kind", ""),
        dims=int(dims) if dims in ("2", "3") else None,
        units={
            key.removeprefix("openprc.unit."): value
            for key, value in remarks.items()
            if key.startswith("openprc.unit.")
        },
        notes=["read by this plugin itself, as VTKHDF"],
    )


class _Source:
    """The open file, and where every step begins in its arrays."""

    def __init__(
        self, path: Path, root: h5py.Group, steps: h5py.Group, count: int, *, polydata: bool
    ) -> None:
        self.path = path
        self.root = root
        self.count = count
        self._steps = steps
        self.polydata = polydata
        self.kinds = tuple(_POLYDATA) if polydata else ("",)
        self.part = self.steps("PartOffsets", missing=0)
        if (self.steps("NumberOfParts", missing=1) != 1).any():
            raise self.wrong("/VTKHDF/Steps/NumberOfParts", "steps of several parts", "one part")
        self.point = self.steps("PointOffsets")
        width = len(self.kinds)
        self.cell = self.steps("CellOffsets").reshape(count, -1)
        self.ids = self.steps("ConnectivityIdOffsets").reshape(count, -1)
        if self.cell.shape != (count, width) or self.ids.shape != (count, width):
            raise self.wrong(
                "/VTKHDF/Steps/CellOffsets", f"shape {self.cell.shape}", f"({count}, {width})"
            )
        self.cells: dict[object, tuple[tuple[Cells, Ints], ...]] = {}

    def wrong(self, key: str, found: str, expected: str) -> UnreadableFile:
        return UnreadableFile(
            found, expected=expected, fix="export it again", file=self.path, key=key
        )

    def steps(self, name: str, *, missing: int | None = None) -> Array:
        item = self._steps.get(name)
        if item is None and missing is not None:
            return np.full(self.count, missing)
        if not isinstance(item, h5py.Dataset) or len(item) < self.count:
            raise self.wrong(f"/VTKHDF/Steps/{name}", "nothing for every step", "an entry a step")
        with damage_named(self.path, item.name):
            return np.asarray(item[: self.count])

    def offset(self, group: str, name: str, index: int, *, length: int, usual: int) -> int:
        """Return where a field of a step begins; one that does not change begins at 0."""
        item = self._steps.get(f"{group}Offsets/{name}")
        if isinstance(item, h5py.Dataset):
            return int(item[index])
        return 0 if len(self.root[group][name]) == length else usual

    def rows(self, name: str, start: int, count: int) -> Array:
        item = self.root.get(name)
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu":
            raise self.wrong(f"/VTKHDF/{name}", "no numbers", "a dataset of numbers")
        if start < 0 or count < 0 or start + count > len(item):
            raise self.wrong(
                f"/VTKHDF/{name}", f"{len(item)} rows", f"rows {start} to {start + count}"
            )
        with damage_named(self.path, item.name):
            return np.asarray(item[start : start + count])

    def names(self, group: str) -> tuple[str, ...]:
        found = self.root.get(group)
        return tuple(found) if isinstance(found, h5py.Group) else ()


class _Frame:
    """One step."""

    time = None

    def __init__(self, source: _Source, index: int) -> None:
        self._source = source
        self._index = index
        self._start = int(source.point[index])

    @cached_property
    def _n_points(self) -> int:
        return int(self._source.rows("NumberOfPoints", int(self._source.part[self._index]), 1)[0])

    @property
    def same_points(self) -> object:
        return self._start, self._n_points

    @property
    def same_cells(self) -> object:
        source, index = self._source, self._index
        places = (*source.cell[index].tolist(), *source.ids[index].tolist())
        return (*places, int(source.part[index]))

    @property
    def point_names(self) -> tuple[str, ...]:
        return self._source.names("PointData")

    @property
    def cell_names(self) -> tuple[str, ...]:
        return self._source.names("CellData")

    def points(self) -> Array:
        return self._source.rows("Points", self._start, self._n_points)

    def cells(self) -> list[Cells]:
        return [block for block, _ in self._blocks()]

    def point_field(self, name: str) -> Array:
        start = self._source.offset(
            "PointData", name, self._index, length=self._n_points, usual=self._start
        )
        return _flat(self._source.rows(f"PointData/{name}", start, self._n_points))

    def cell_field(self, name: str) -> list[Array | None]:
        count = sum(len(rows) for _, rows in self._blocks())
        usual = int(self._source.cell[self._index].sum())
        start = self._source.offset("CellData", name, self._index, length=count, usual=usual)
        values = _flat(self._source.rows(f"CellData/{name}", start, count))
        return [values[rows] for _, rows in self._blocks()]

    def _blocks(self) -> tuple[tuple[Cells, Ints], ...]:
        known = self._source.cells
        if self.same_cells not in known:
            known.clear()
            known[self.same_cells] = tuple(self._read_blocks())
        return known[self.same_cells]

    def _read_blocks(self) -> list[tuple[Cells, Ints]]:
        source, index = self._source, self._index
        part = int(source.part[index])
        found: list[tuple[Cells, Ints]] = []
        before = 0
        for column, kind in enumerate(source.kinds):
            base = f"{kind}/" if kind else ""
            start, first = int(source.cell[index, column]), int(source.ids[index, column])
            count = int(source.rows(f"{base}NumberOfCells", part, 1)[0])
            ids = int(source.rows(f"{base}NumberOfConnectivityIds", part, 1)[0])
            # Every part has one offset more than cells.
            ends = source.rows(f"{base}Offsets", start + part, count + 1).astype(np.int64)
            nodes = source.rows(f"{base}Connectivity", first, ids).astype(np.int64)
            if count and not vtk_shapes.fits(ends, nodes):
                raise source.wrong(
                    f"/VTKHDF/{base}Offsets", "offsets that leave the cells", "0 ..."
                )
            types = self._types(kind, start, count)
            found += [
                (block, rows + before) for block, rows in vtk_shapes.split(types, ends, nodes)
            ]
            before += count
        return found

    def _types(self, kind: str, start: int, count: int) -> Ints:
        if kind:
            return np.full(count, _POLYDATA[kind])
        return self._source.rows("Types", start, count).astype(np.int64)


def _flat(values: Array) -> Array:
    values = values.reshape(len(values), -1)
    return values[:, 0] if values.shape[1] == 1 else values
