"""XDMF time series: one mesh for all steps, or a mesh for each."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, NotATrajectory, UnreadableFile
from openprc_meshio import safe_xml, xdmf_topology
from openprc_meshio.frames import Array, Cells, Series
from openprc_meshio.xdmf_items import DataItems
from openprc_meshio.xdmf_paths import pointer_path, select

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
    document = _Document(path, stack)
    chosen = document.collections(collection)
    times = [document.times(grid) for grid in chosen]
    steps = [list(_grids(grid)) for grid in chosen]
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
    frames = [_Frame(document, list(grids)) for grids in zip(*steps, strict=True)]
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


def _grids(grid: Element) -> list[Element]:
    return [child for child in grid if child.tag == "Grid"]


def _kind(grid: Element) -> str:
    return (grid.get("GridType") or "Uniform").lower()


class _Document:
    """The parsed file, and what its elements point at."""

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self.path = path
        self.root = safe_xml.parse(path)
        self.items = DataItems(path, resolve=self.resolve, stack=stack)
        self._pointed: dict[str, list[Element]] = {}
        #: Of the mesh read last: number of points, cells of every topology.
        self.n_points: dict[object, int] = {}
        self.cells: dict[object, tuple[Cells, ...]] = {}
        if self.root.tag != "Xdmf":
            raise self.wrong(f"the root element is {self.root.tag!r}", "Xdmf")
        domain = self.root.find("Domain")
        if domain is None:
            raise self.wrong("there is no Domain", "a Domain with a time series")
        self.domain = domain
        for item in domain.findall("DataItem"):
            if name := item.get("Name"):
                self._pointed[f'/Xdmf/Domain/DataItem[@Name="{name}"]'] = [item]

    def wrong(self, found: str, expected: str) -> UnreadableFile:
        return UnreadableFile(
            found, expected=expected, fix="export it again", file=self.path, key="Xdmf"
        )

    def remarks(self) -> dict[str, str]:
        return {
            item.get("Name", ""): item.get("Value") or (item.text or "").strip()
            for item in self.domain.findall("Information")
        }

    def collections(self, name: str | None) -> list[Element]:
        """Return the temporal collections that are asked for."""
        found = [
            grid
            for grid in _grids(self.domain)
            if _kind(grid) == "collection"
            and (grid.get("CollectionType") or "Spatial").lower() == "temporal"
            and _grids(grid)
        ]
        if not found:
            raise NotATrajectory(
                f"{len(_grids(self.domain))} grids and no temporal collection: a mesh at one "
                "instant",
                expected="a time series",
                fix="write every step into one file with a temporal collection, or name the "
                "first of numbered files",
                file=self.path,
                key="CollectionType",
            )
        if name is None:
            return found
        names = [grid.get("Name", "") for grid in found]
        if name not in names:
            raise ConfigError(
                f"there is no temporal collection {name!r}",
                expected="one of " + ", ".join(map(repr, names)),
                fix="correct the option collection",
                file=self.path,
                key="collection",
            )
        return [found[names.index(name)]]

    # --- what points elsewhere --------------------------------------------------------------

    def pointed(self, text: str) -> list[Element]:
        path = pointer_path(text)
        if path not in self._pointed:
            try:
                self._pointed[path] = select(self.root, path)
            except ValueError:
                raise self.wrong(
                    f"a reference {text.strip()!r}", "a path of names, numbers and attributes"
                ) from None
        if not self._pointed[path]:
            raise self.wrong(f"the reference {text.strip()!r} leads nowhere", "an element there")
        return self._pointed[path]

    def resolve(self, element: Element) -> Element:
        """Return the element itself, or what its attribute Reference means."""
        seen = 0
        while (reference := element.get("Reference")) is not None:
            text = (element.text or "") if reference.upper() == "XML" else reference
            element = self.pointed(text)[0]
            seen += 1
            if seen > 8:
                raise self.wrong("references that lead to each other", "an end of them")
        return element

    def children(self, grid: Element) -> list[Element]:
        """Return the children of a grid, inclusions replaced by what they include."""
        found: list[Element] = []
        for child in grid:
            if child.tag != "include":
                found.append(self.resolve(child))
            elif child.get("href"):
                raise self.wrong(
                    f"it includes the file {child.get('href')!r}", "everything in one XDMF file"
                )
            else:
                found += [self.resolve(item) for item in self.pointed(child.get("xpointer", ""))]
        return found

    def key(self, element: Element) -> object:
        """Return what two geometries, or two topologies, of the same numbers have in common."""
        kind = element.get(f"{element.tag}Type") or element.get("Type")
        return kind, tuple(self.items.key(item) for item in element.findall("DataItem"))

    # --- time ----------------------------------------------------------------------------------

    def times(self, collection: Element) -> NDArray[np.float64] | None:
        """Return the time of every step, (T,), or None where there is none."""
        steps = _grids(collection)
        given = [self._time(step) for step in steps]
        if all(time is not None for time in given):
            return np.array(given, dtype=np.float64)
        if any(time is not None for time in given):
            missing = next(i for i, time in enumerate(given) if time is None)
            raise self.wrong(f"step {missing} has no time and others have", "a Time in every step")
        own = collection.find("Time")
        if own is None:
            return None
        kind = (own.get("TimeType") or own.get("Type") or "Single").lower()
        item = own.find("DataItem")
        numbers = [] if item is None else self.items.read(item).astype("f8").reshape(-1).tolist()
        if kind == "hyperslab" and len(numbers) == 3:
            return np.asarray(numbers[0] + numbers[1] * np.arange(len(steps)), dtype=np.float64)
        if kind == "list" and len(numbers) == len(steps):
            return np.array(numbers)
        raise self.wrong(
            f"time of type {kind!r} with {len(numbers)} numbers for {len(steps)} steps",
            "a list of times, or start, stride and count",
        )

    def _time(self, step: Element) -> float | None:
        own = step.find("Time")
        if own is None:
            parts = [part.find("Time") for part in _grids(step)]
            own = next((part for part in parts if part is not None), None)
        if own is None:
            return None
        text = own.get("Value")
        if text is None:
            item = own.find("DataItem")
            numbers = [] if item is None else self.items.read(item).reshape(-1).tolist()
            text = str(numbers[0]) if len(numbers) == 1 else ""
        try:
            return float(text)
        except ValueError:
            raise self.wrong(f"the time {text!r}", "a number") from None


class _Part:
    """One uniform grid: topology, geometry and attributes."""

    def __init__(self, document: _Document, grids: list[Element]) -> None:
        topology: Element | None = None
        geometry: Element | None = None
        self.attributes: dict[tuple[str, str], Element] = {}
        for grid in grids:
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
    def _only(document: _Document, known: Element | None, other: Element) -> Element:
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

    def __init__(self, document: _Document, grids: list[Element]) -> None:
        self._document = document
        nested = [_grids(grid) for grid in grids if _kind(grid) == "collection"]
        if nested and len(grids) > 1:
            raise document.wrong(
                "several temporal collections whose steps are collections themselves",
                "one of them; choose it with the option collection",
            )
        if any(_kind(grid) not in ("uniform", "collection") for grid in grids) or any(
            _kind(part) != "uniform" for parts in nested for part in parts
        ):
            raise document.wrong("a step that is a tree of grids", "grids side by side")
        groups = [[part] for part in nested[0]] if nested else [grids]
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
