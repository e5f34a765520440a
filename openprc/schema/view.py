"""What the checks look at: an open file with its datasets sorted by rule, and cached statistics."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.schema.layout import TIME_AXIS, DatasetRule, match

#: Content is looked at in pieces of this many bytes, so that memory stays small.
PIECE_BYTES = 16 << 20

TIME = "/time_series/time"
POSITIONS = "/time_series/nodes/positions"
OBSERVED = "/time_series/nodes/observed"


@dataclass
class Statistics:
    """Of one numeric dataset over axis 0: finite extremes, and where it is not finite."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    n_nan: int = 0
    first_nan: tuple[int, ...] | None = None
    first_inf: tuple[int, ...] | None = None


@dataclass
class View:
    """An open trajectory file under inspection."""

    file: h5py.File
    path: Path
    _statistics: dict[str, Statistics] = field(default_factory=dict)

    @cached_property
    def objects(self) -> dict[str, Any]:
        """Every group and dataset by absolute path."""
        found: dict[str, Any] = {}
        self.file.visititems(lambda name, item: found.update({f"/{name}": item}))
        return found

    @cached_property
    def datasets(self) -> dict[str, h5py.Dataset]:
        """Every dataset by absolute path."""
        return {k: v for k, v in self.objects.items() if isinstance(v, h5py.Dataset)}

    @cached_property
    def ruled(self) -> dict[str, tuple[DatasetRule, dict[str, str]]]:
        """The datasets that the contract knows, with their rule and the placeholders."""
        pairs = {path: match(path) for path in self.datasets}
        return {path: pair for path, pair in pairs.items() if pair is not None}

    def dataset(self, path: str) -> h5py.Dataset | None:
        """Return a dataset or None."""
        return self.datasets.get(path)

    def attribute(self, path: str, name: str) -> Any:
        """Return an attribute as a plain value, an array as a tuple, or None."""
        owner = self.file if path == "/" else self.objects.get(path)
        value = None if owner is None else owner.attrs.get(name)
        if isinstance(value, h5py.Empty):
            return None
        return _plain(value)

    def children(self, path: str) -> tuple[str, ...]:
        """Names in a group; none when it is absent or a dataset."""
        group = self.objects.get(path)
        return tuple(group) if isinstance(group, h5py.Group) else ()

    @cached_property
    def n_frames(self) -> int:
        """Length of the time axis; 0 when there is none."""
        item = self.dataset(TIME)
        return len(item) if item is not None and item.ndim == 1 else 0

    @cached_property
    def time(self) -> NDArray[np.float64]:
        """All instants, empty when there are none to read."""
        item = self.dataset(TIME)
        if item is None or item.ndim != 1 or item.dtype.kind not in "fiu":
            return np.empty(0)
        return np.asarray(item[()], dtype="f8")

    @cached_property
    def n_nodes(self) -> int:
        """Number of nodes: of the positions, or of what the topology says about nodes."""
        item = self.dataset(POSITIONS)
        if item is not None and item.ndim == 3:
            return int(item.shape[1])
        for name in ("rest", "mass", "fixed", "id", "label"):
            item = self.dataset(f"/topology/nodes/{name}")
            if item is not None and item.ndim:
                return int(item.shape[0])
        return 0

    def is_series(self, path: str) -> bool:
        """Whether a dataset has time along axis 0 and numbers in it."""
        rule = self.ruled.get(path)
        item = self.datasets[path]
        if path.startswith("/extensions/"):
            return self.attribute(path, TIME_AXIS) == 0 and item.dtype.kind in "fiu"
        return (
            rule is not None
            and bool(rule[0].shape)
            and rule[0].shape[0] == "T"
            and item.dtype.kind in "fiu"
            and item.ndim >= 1
        )

    def pieces(self, path: str) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield (first frame, rows) over a dataset."""
        item = self.datasets[path]
        row = max(1, int(np.prod(item.shape[1:], dtype=np.int64)) * item.dtype.itemsize)
        step = max(1, PIECE_BYTES // row)
        for start in range(0, item.shape[0], step):
            yield start, item[start : start + step]

    def statistics(self, path: str) -> Statistics:
        """Return statistics of a numeric dataset, computed once."""
        if path not in self._statistics:
            self._statistics[path] = self._measure(path)
        return self._statistics[path]

    def _measure(self, path: str) -> Statistics:
        tail = self.datasets[path].shape[1:]
        found = Statistics(np.full(tail, np.inf), np.full(tail, -np.inf))
        for start, rows in self.pieces(path):
            low, high = rows.min(axis=0), rows.max(axis=0)
            # A sum of extremes is finite only if all of them are: no full scan is needed.
            if not (np.isfinite(low).all() and np.isfinite(high).all()):
                self._note_gaps(found, start, rows)
                finite = np.where(np.isfinite(rows), rows, np.nan)
                low = np.fmin.reduce(finite, axis=0)
                high = np.fmax.reduce(finite, axis=0)
            found.low = np.fmin(found.low, low)
            found.high = np.fmax(found.high, high)
        return found

    @staticmethod
    def _note_gaps(found: Statistics, start: int, rows: NDArray[Any]) -> None:
        nan, inf = np.isnan(rows), np.isinf(rows)
        found.n_nan += int(nan.sum())
        if found.first_nan is None and nan.any():
            first = np.argwhere(nan)[0]
            found.first_nan = (start + int(first[0]), *(int(i) for i in first[1:]))
        if found.first_inf is None and inf.any():
            first = np.argwhere(inf)[0]
            found.first_inf = (start + int(first[0]), *(int(i) for i in first[1:]))


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, np.ndarray):
        return tuple(str(_plain(item)) if value.dtype == object else _plain(item) for item in value)
    return value.item() if isinstance(value, np.generic) else value
