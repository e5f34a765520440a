"""XDMF time series: one mesh for all steps, or a mesh for each."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, UnreadableFile
from openprc_meshio import xdmf_topology
from openprc_meshio.frames import Array, Cells, Series
from openprc_meshio.xdmf_document import Document, grids, kind_of

_GEOMETRIES = {"XYZ": 3, "XY": 2, "X_Y_Z": 3, "X_Y": 2}


def open_series(path: Path, *, stack: ExitStack, collection: str | None = None) -> Series:
    """Return the time series of an XDMF file.

    Parameters
    ----------
    path : Path
    stack : ExitStack
        Closes the heavy files.
    collection : str, optional
        Name of the temporal collection to take where there are several.

    Raises
    ------
    UnreadableFile, UnsafeFile
        When it is damaged, or leads elsewhere.
    NotATrajectory
        When it holds a mesh at one instant.
    """
    document = Document(path, stack)
    chosen = document.collections(collection)
    times = [document.times(grid) for grid in chosen]
    steps = [list(grids(grid)) for grid in chosen]
    for name, other, clock in zip(chosen[1:], steps[1:], times[1:], strict=True):
        if len(other) != len(steps[0]) or not _same(clock, times[0]):
            raise ConfigError(
                f"the collections {chosen[0].get('Name')!r} and {name.get('Name')!r} are not at "
                "the same instants",
                expected="one clock",
                fix="choose one with the option collection",
                file=path,
                key="collection",
            )
    frames = [_Frame(document, list(step)) for step in zip(*steps, strict=True)]
    remarks = document.remarks()
    dims = remarks.get("openprc.dims", "")
    return Series(
        path,
        frames,
        times[0],
        time_unit=remarks.get("openprc.time.unit", ""),
        time_kind=remarks.get("openprc.time.kind", ""),
        dims=int(dims) if dims in ("2", "3") else None,
        units={
            key.removeprefix("openprc.unit."): value
            for key, value in remarks.items()
            if key.startswith("openprc.unit.")
        },
        sources=document.items.sources,
        notes=["read by this plugin itself, as XDMF"],
    )


def _same(a: NDArray[np.float64] | None, b: NDArray[np.float64] | None) -> bool:
    return (a is None) == (b is None) and (a is None or b is None or np.array_equal(a, b))


class _Part:
    """One uniform grid: topology, geometry and attributes."""

    def __init__(self, document: Document, step: list[Element]) -> None:
        topology: Element | None = None
        geometry: Element | None = None
        self.attributes: dict[tuple[str, str], Element] = {}
        for grid in step:
            for child in document.children(grid):
                if child.tag == "Topology":
                    topology = self._only(document, topology, child)
                elif child.tag == "Geometry":
                    geometry = self._only(document, geometry, child)
                elif child.tag == "Attribute":
                    if child.get("ItemType") == "FiniteElementFunction":
                        raise UnreadableFile(
                            f"{child.get('Name')!r} is stored as a finite element function, by its "
                            "degrees of freedom",
                            expected="values at the points",
                            fix="write it with XDMFFile.write(u, t) instead of write_checkpoint",
                            file=document.path,
                            key="Attribute",
                        )
                    centre = (child.get("Center") or "Node").lower()
                    name = child.get("Name") or "unnamed"
                    if (centre, name) in self.attributes:
                        name = f"{grid.get('Name') or 'grid'}/{name}"
                    self.attributes[centre, name] = child
        if topology is None or geometry is None:
            lacking = "topology" if topology is None else "geometry"
            raise document.wrong(f"a step has no {lacking}", "points and cells in every step")
        self.topology, self.geometry = topology, geometry

    @staticmethod
    def _only(document: Document, known: Element | None, other: Element) -> Element:
        if known is not None and document.key(known) != document.key(other):
            raise ConfigError(
                f"collections of one step name different arrays as their {other.tag}",
                expected="one mesh",
                fix="choose a collection with the option collection",
                file=document.path,
                key="collection",
            )
        return other

    def names(self, centre: str) -> list[str]:
        return [name for place, name in self.attributes if place == centre]


class _Frame:
    """One step; each of its grids is a part, and all parts share their points."""

    time = None

    def __init__(self, document: Document, step: list[Element]) -> None:
        self._document = document
        nested = [grids(grid) for grid in step if kind_of(grid) == "collection"]
        if nested and len(step) > 1:
            raise document.wrong(
                "several temporal collections whose steps are collections themselves",
                "one of them; choose it with the option collection",
            )
        if any(kind_of(grid) not in ("uniform", "collection") for grid in step) or any(
            kind_of(part) != "uniform" for parts in nested for part in parts
        ):
            raise document.wrong("a step that is a tree of grids", "grids side by side")
        groups = [[part] for part in nested[0]] if nested else [step]
        self._parts = [_Part(document, group) for group in groups]
        self.point_names = tuple(dict.fromkeys(n for p in self._parts for n in p.names("node")))
        self.cell_names = tuple(dict.fromkeys(n for p in self._parts for n in p.names("cell")))
        keys = {document.key(part.geometry) for part in self._parts}
        if len(keys) > 1:
            raise document.wrong(
                "the grids of a step have points of their own", "one list of points for all"
            )
        self.same_points: object = keys.pop()
        self.same_cells: tuple[object, ...] = tuple(
            document.key(part.topology) for part in self._parts
        )

    def points(self) -> Array:
        geometry = self._parts[0].geometry
        kind = (geometry.get("GeometryType") or geometry.get("Type") or "XYZ").upper()
        items = geometry.findall("DataItem")
        dims = _GEOMETRIES.get(kind)
        if dims is None or len(items) != (1 if "_" not in kind else dims):
            raise self._document.wrong(
                f"a geometry of type {kind!r} with {len(items)} items",
                "XYZ, XY, X_Y_Z or X_Y: places listed point by point",
            )
        columns = [self._document.items.read(item) for item in items]
        if (
            any(column.size % (dims if len(columns) == 1 else 1) for column in columns)
            or len({column.size for column in columns}) > 1
        ):
            raise self._document.wrong(
                f"{' and '.join(str(c.size) for c in columns)} numbers for places {kind}",
                "as many for every point",
            )
        places = (
            columns[0].reshape(-1, dims)
            if len(columns) == 1
            else np.stack([column.reshape(-1) for column in columns], axis=1)
        )
        self._document.n_points = {self.same_points: len(places)}
        return places

    def _n_points(self) -> int:
        known = self._document.n_points.get(self.same_points)
        return len(self.points()) if known is None else known

    def cells(self) -> list[Cells]:
        return [block for blocks in self._parted() for block in blocks]

    def point_field(self, name: str) -> Array:
        part = next(part for part in self._parts if ("node", name) in part.attributes)
        return self._values(part, "node", name, self._n_points())

    def cell_field(self, name: str) -> list[Array | None]:
        found: list[Array | None] = []
        for part, blocks in zip(self._parts, self._parted(), strict=True):
            if ("cell", name) not in part.attributes:
                found += [None] * len(blocks)
                continue
            sizes = [len(block) for block in blocks]
            values = self._values(part, "cell", name, sum(sizes))
            found += np.split(values, np.cumsum(sizes)[:-1])
        return found

    def _parted(self) -> list[tuple[Cells, ...]]:
        known = self._document.cells
        if any(key not in known for key in self.same_cells):
            # One mesh is kept: series of thousands of meshes must not fill the memory.
            known.clear()
            for key, part in zip(self.same_cells, self._parts, strict=True):
                known[key] = self._cells_of(part)
        return [known[key] for key in self.same_cells]

    def _cells_of(self, part: _Part) -> tuple[Cells, ...]:
        topology = part.topology
        name = topology.get("TopologyType") or topology.get("Type") or ""
        item = topology.find("DataItem")
        text = topology.get("NodesPerElement")
        width = int(text) if text and text.isdigit() else None
        if item is None and name.lower() == "polyvertex":
            numbers = np.arange(self._n_points())
        elif item is None:
            raise self._document.wrong(f"a topology {name!r} without numbers", "a data item in it")
        else:
            numbers = self._document.items.read(item)
        base = topology.get("BaseOffset", "0")
        if numbers.dtype.kind not in "iu" or not base.isdigit():
            raise self._document.wrong(
                f"a topology of type {numbers.dtype} with BaseOffset {base!r}", "whole numbers"
            )
        shifted = numbers.astype(np.int64) - int(base)
        return xdmf_topology.blocks(name, shifted, width=width, path=self._document.path)

    def _values(self, part: _Part, centre: str, name: str, count: int) -> Array:
        item = part.attributes[centre, name].find("DataItem")
        if item is None:
            raise self._document.wrong(f"the attribute {name!r} holds nothing", "a data item in it")
        values = self._document.items.read(item)
        if count == 0 or values.size % count or values.size == 0:
            raise self._document.wrong(
                f"the attribute {name!r} has {values.size} numbers for {count} {centre}s",
                "as many for each",
            )
        values = values.reshape(count, -1)
        return values[:, 0] if values.shape[1] == 1 else values
