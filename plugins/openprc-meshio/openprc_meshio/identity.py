"""Whether node 7 of one frame is node 7 of the next."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, SchemaError
from openprc_meshio.frames import Array, Frame, by_shape, shape_of

Ints = NDArray[np.int64]


class NodeIdentity:
    """Compares every frame with the first, and puts its nodes and cells into the same order.

    Without ids the lists must agree as they are: as many points, and cells that join the same
    ones. With an array of ids in every frame, points and cells may be listed in any order.

    Parameters
    ----------
    first : Frame
    n_nodes : int
    ids : str or None
        Name of a field of the points with a whole number for each.
    path : Path
        For messages.

    Raises
    ------
    MissingData
        When there is no such field.
    SchemaError
        When its numbers are no ids.
    """

    def __init__(self, first: Frame, *, n_nodes: int, ids: str | None, path: Path) -> None:
        self._path = path
        self._name = ids
        self._n_nodes = n_nodes
        self._first = first
        self.tables = by_shape(first.cells())
        self.ids = None if ids is None else self._ids(ids, first, 0)

    def order(self, frame: Frame, index: int) -> tuple[Ints | None, dict[str, Ints]]:
        """Return how to pick nodes, and cells of each shape; nothing where they are in order.

        Raises
        ------
        SchemaError
            When the frame has other nodes or other cells: the mesh was made anew.
        """
        if self._name is None or self.ids is None:
            known = frame.same_cells is not None and frame.same_cells == self._first.same_cells
            if not known and not _equal(by_shape(frame.cells()), self.tables):
                raise self._other(index, frame, "its cells join other points")
            return None, {}
        ids = self._ids(self._name, frame, index)
        if np.array_equal(ids, self.ids):
            nodes = None
            place = np.arange(len(ids))
        else:
            if not np.array_equal(np.sort(ids), np.sort(self.ids)):
                raise self._other(index, frame, f"its {self._name!r} are other numbers")
            nodes = np.argsort(ids, kind="stable")[_ranks(self.ids)]
            place = np.empty(len(ids), dtype=np.int64)
            place[nodes] = np.arange(len(ids))
        tables = {shape: place[table] for shape, table in by_shape(frame.cells()).items()}
        if _equal(tables, self.tables):
            return nodes, {}
        cells: dict[str, Ints] = {}
        for shape, table in self.tables.items():
            other = tables.pop(shape, None)
            mine = _sorted_rows(table)
            if other is None or other.shape != table.shape:
                raise self._other(index, frame, f"it has other cells of shape {shape}")
            theirs = _sorted_rows(other)
            if not np.array_equal(np.sort(table, axis=1)[mine], np.sort(other, axis=1)[theirs]):
                raise self._other(index, frame, "its cells join other nodes")
            cells[shape] = np.empty(len(table), dtype=np.int64)
            cells[shape][mine] = theirs
        if tables:
            raise self._other(index, frame, f"it has cells of shape {next(iter(tables))}")
        return nodes, cells

    def check_count(self, frame: Frame, index: int, count: int) -> None:
        """Refuse a frame of another number of points.

        Raises
        ------
        SchemaError
        """
        if count != self._n_nodes:
            raise self._other(index, frame, f"it has {count} points, the first has {self._n_nodes}")

    def _ids(self, name: str, frame: Frame, index: int) -> Ints:
        if name not in frame.point_names:
            raise MissingData(
                f"frame {index} has no point field {name!r}",
                expected="one of " + (", ".join(frame.point_names) or "none: there are no fields"),
                fix="correct the option ids",
                file=self._path,
                key="ids",
            )
        values = frame.point_field(name)
        whole = values.ndim == 1 and np.isfinite(values).all() and (values == np.rint(values)).all()
        if not whole or len(np.unique(values)) != len(values):
            raise SchemaError(
                f"{name!r} of frame {index} is not a different whole number for every point",
                expected="ids",
                fix="name another field, or leave the option out if points are always listed alike",
                file=self._path,
                key="ids",
            )
        self.check_count(frame, index, len(values))
        return values.astype(np.int64)

    def _other(self, index: int, frame: Frame, what: str) -> SchemaError:
        hint = ""
        if self._name is None:
            names = [name for name in frame.point_names if _may_be_ids(frame.point_field(name))]
            hint = f"ids={names[0]}, say, or " if names else ""
        return SchemaError(
            f"frame {index} is not of the same mesh: {what}",
            expected="the same nodes in every frame; what was remeshed has no trajectories",
            fix=f"name the field that numbers the points with the option ids ({hint}export with "
            "one), or end the series where the mesh changes",
            file=self._path,
            key="ids",
        )


def cell_values(frame: Frame, name: str) -> dict[str, Array]:
    """Return a field of the cells by shape."""
    found: dict[str, list[Array]] = {}
    for block, values in zip(frame.cells(), frame.cell_field(name), strict=True):
        if values is not None:
            found.setdefault(shape_of(block), []).append(values)
    return {shape: np.concatenate(parts) for shape, parts in found.items()}


def _may_be_ids(values: Array) -> bool:
    return values.ndim == 1 and values.dtype.kind in "iu" and len(np.unique(values)) == len(values)


def _ranks(ids: Ints) -> Ints:
    ranks = np.empty(len(ids), dtype=np.int64)
    ranks[np.argsort(ids, kind="stable")] = np.arange(len(ids))
    return ranks


def _sorted_rows(table: Ints) -> Ints:
    rows = np.sort(table, axis=1)
    return np.lexsort(rows.T[::-1]).astype(np.int64)


def _equal(a: dict[str, Ints], b: dict[str, Ints]) -> bool:
    return a.keys() == b.keys() and all(
        np.array_equal(table, b[shape]) for shape, table in a.items()
    )
