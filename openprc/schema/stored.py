"""Access to stored datasets by path: units converted, what is absent named."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, SchemaError
from openprc.schema import units
from openprc.schema.damage import damage_named

Frames = slice
ALL = slice(None)


@dataclass(frozen=True)
class InputSignal:
    """What drove the body.

    ``value`` is (T, C) on the clock of the file; ``sequence`` is (K, C), the symbols before
    they were held, symbol k from ``start + k hold`` on, or None.
    """

    name: str
    value: NDArray[np.float64]
    columns: tuple[str, ...]
    unit: str
    quantity: str
    targets: tuple[str, ...]
    sequence: NDArray[np.float64] | None
    hold: float | None
    start: float


@dataclass(frozen=True)
class Series:
    """A dataset with time along axis 0, found once and read in ranges.

    Finding a dataset takes as long as reading a small block of it, so that whoever reads many
    blocks holds on to it. `StoredData.series` makes one; it lasts as long as the file is open.

    Parameters
    ----------
    file : Path
    key : str
        Path of the dataset in the file.
    n_frames : int
        Frames that are committed; later rows are never read.
    """

    file: Path
    key: str
    n_frames: int
    _item: h5py.Dataset

    def read(self, frames: Frames = ALL) -> NDArray[Any]:
        """Return frames as they are stored, (T', ...).

        Raises
        ------
        MissingData
            When `frames` runs backwards.
        UnreadableFile
            When the file is damaged there.
        """
        start, stop, step = frames.indices(self.n_frames)
        if step < 1:
            raise MissingData(
                f"a step of {step} frames",
                expected="a step of 1 or more",
                fix="reverse the array afterwards",
                file=self.file,
                key=self.key,
            )
        with damage_named(self.file, self.key):
            data: NDArray[Any] = self._item[start:stop:step]
        return data


class StoredData:
    """The reading half of `Trajectory`: no meaning, only paths."""

    path: Path
    n_frames: int
    _file: h5py.File

    def _names(self, group: str) -> tuple[str, ...]:
        with damage_named(self.path, group):
            found = self._file.get(group)
            return tuple(found) if isinstance(found, h5py.Group) else ()

    def _get(self, path: str) -> h5py.Dataset:
        with damage_named(self.path, path):
            item = self._file.get(path)
        if not isinstance(item, h5py.Dataset):
            owner = path.rpartition("/")[0]
            there = self._names(owner)
            raise self._missing(
                path,
                "one of " + ", ".join(there) if there else f"nothing is under {owner}",
                "choose another, or record it with the producer",
            )
        return item

    def series(self, path: str) -> Series:
        """Return a dataset over time, named by its path in the file, to be read in ranges.

        Raises
        ------
        MissingData
            When it is not in the file.
        SchemaError
            When it has fewer rows than the file has frames.
        """
        item = self._get(path)
        if item.ndim == 0 or len(item) < self.n_frames:
            raise self._broken(path, f"shape {item.shape}", f"{self.n_frames} rows, one a frame")
        return Series(self.path, path, self.n_frames, item)

    def _series(self, path: str, frames: Frames) -> NDArray[Any]:
        return self.series(path).read(frames)

    def _static(self, path: str, unit: str | None) -> NDArray[Any]:
        item = self._get(path)
        if h5py.check_string_dtype(item.dtype) is not None:
            text: NDArray[Any] = np.asarray(self._read(path, item.asstr(), ()))
            return text
        data: NDArray[Any] = self._read(path, item, ())
        return data if unit is None else self._convert(path, data, unit)

    def _broken(self, path: str, found: str, expected: str) -> SchemaError:
        return SchemaError(
            found,
            expected=expected,
            fix="see all that is wrong with `openprc validate`, and write the file again",
            file=self.path,
            key=path,
        )

    def _read(self, path: str, item: Any, selection: Any) -> Any:
        with damage_named(self.path, path):
            return item[selection]

    def _convert(self, path: str, data: NDArray[Any], unit: str | None) -> NDArray[np.float64]:
        values: NDArray[np.float64] = data.astype("f8", copy=False)
        if unit is None:
            return values
        stored = str(self._attr(path, "unit"))
        factor = units.conversion_factor(stored, unit, file=str(self.path), key=path)
        return values if factor == 1.0 else values * factor

    def _attr(self, path: str, name: str) -> Any:
        item = self._get(path)
        with damage_named(self.path, f"{path}@{name}"):
            if name in item.attrs:
                return item.attrs[name]
        raise self._missing(f"{path}@{name}", "every such dataset has it", "write it again")

    def _strings(self, path: str, name: str) -> tuple[str, ...]:
        owner = self._get(path)
        with damage_named(self.path, f"{path}@{name}"):
            values = np.atleast_1d(owner.attrs.get(name, ()))
        return tuple(v.decode() if isinstance(v, bytes) else str(v) for v in values)

    def _missing(
        self, key: str, expected: str, fix: str, *, found: str = "it is not in the file"
    ) -> MissingData:
        return MissingData(found, expected=expected, fix=fix, file=self.path, key=key)
