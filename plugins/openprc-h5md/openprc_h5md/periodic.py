"""Positions in a periodic box: H5MD stores them wrapped, with the number of crossings beside."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc_h5md.reading import Element, read_element, wrong


def periodic_axes(group: h5py.Group) -> tuple[int, ...]:
    """Return the axes in which the box of a particles group repeats itself."""
    box = group.get("box")
    told = box.attrs.get("boundary", ()) if isinstance(box, h5py.Group) else ()
    words = [w.decode() if isinstance(w, bytes) else str(w) for w in np.atleast_1d(told)]
    return tuple(axis for axis, word in enumerate(words) if word == "periodic")


def refuse_wrapped(group: h5py.Group, path: Path) -> None:
    """Refuse a periodic box without the images, in which paths jump at the walls.

    Raises
    ------
    ConfigError
    """
    axes = periodic_axes(group)
    if axes:
        raise ConfigError(
            f"the box is periodic along {', '.join('xyz'[a] for a in axes)} and the file has no "
            "'image' that counts how often a particle crossed it",
            expected="unwrapped positions, or an element 'image'",
            fix="write the images, or say wrapped=true to keep the jumps",
            file=path,
            key=f"{group.name}/box",
        )


@dataclass(frozen=True)
class Unwrapping:
    """Adds the crossings back: ``r = position + image * edge`` on the periodic axes."""

    image: Element
    edges: h5py.Dataset
    axes: tuple[int, ...]

    @classmethod
    def of(cls, group: h5py.Group, place: Element, path: Path) -> Unwrapping | None:
        """Return how to unwrap, or None where nothing wraps or the images are not stored.

        Raises
        ------
        SchemaError
            When image or box do not fit the positions.
        """
        axes = periodic_axes(group)
        if not axes or "image" not in group:
            return None
        image = read_element(group["image"], path)
        if image.value.shape != place.value.shape:
            raise wrong(
                path, image.value.name, f"shape {image.value.shape}", f"{place.value.shape}"
            )
        edges = group.get("box/edges")
        table = edges if isinstance(edges, h5py.Dataset) else group.get("box/edges/value")
        n_axes = place.value.shape[2]
        shapes = ((n_axes,), (len(place.value), n_axes))
        if not isinstance(table, h5py.Dataset) or table.shape not in shapes:
            raise wrong(
                path, f"{group.name}/box/edges", "edges of a slanted box, or none",
                "the lengths of a box with right angles",
            )  # fmt: skip
        return cls(image, table, axes)

    def unwrap(self, values: NDArray[np.float64], rows: slice) -> NDArray[np.float64]:
        """Return the unwrapped positions of the frames `rows`, (B, N, D)."""
        edges = np.asarray(self.edges[()] if self.edges.ndim == 1 else self.edges[rows])
        lengths = np.broadcast_to(np.atleast_2d(edges), (len(values), values.shape[2]))
        crossings = self.image.value[rows].astype("f8")
        moved = np.array(values)
        for axis in self.axes:
            moved[:, :, axis] += crossings[:, :, axis] * lengths[:, np.newaxis, axis]
        return moved
