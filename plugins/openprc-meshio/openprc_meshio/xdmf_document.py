"""The elements of an XDMF file, and what they point at inside of it."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, NotATrajectory, UnreadableFile
from openprc_meshio import safe_xml
from openprc_meshio.frames import Cells
from openprc_meshio.xdmf_items import DataItems
from openprc_meshio.xdmf_paths import pointer_path, select


def grids(grid: Element) -> list[Element]:
    """Return the grids inside a grid or a domain."""
    return [child for child in grid if child.tag == "Grid"]


def kind_of(grid: Element) -> str:
    """Return ``uniform``, ``collection``, ``tree`` or ``subset``."""
    return (grid.get("GridType") or "Uniform").lower()


class Document:
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
        """Return the error for something in the file."""
        return UnreadableFile(
            found, expected=expected, fix="export it again", file=self.path, key="Xdmf"
        )

    def remarks(self) -> dict[str, str]:
        """Return what the Information elements say, by name."""
        return {
            item.get("Name", ""): item.get("Value") or (item.text or "").strip()
            for item in self.domain.findall("Information")
        }

    def collections(self, name: str | None) -> list[Element]:
        """Return the temporal collection named `name`, or all of them."""
        found = [
            grid
            for grid in grids(self.domain)
            if kind_of(grid) == "collection"
            and (grid.get("CollectionType") or "Spatial").lower() == "temporal"
            and grids(grid)
        ]
        if not found:
            raise NotATrajectory(
                f"{len(grids(self.domain))} grids and no temporal collection: a mesh at one "
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
        """Return the elements that a reference means.

        Raises
        ------
        UnreadableFile
            When it is of a form that is not known, or leads nowhere.
        """
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
        steps = grids(collection)
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
            parts = [part.find("Time") for part in grids(step)]
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
