"""Elements of an H5MD file: a value with its step and time, both stored in one of two ways."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import SchemaError


@dataclass(frozen=True)
class Element:
    """A quantity over time.

    Parameters
    ----------
    value : h5py.Dataset
        (T, ...).
    step : (T,) int
    time : (T,), or None when the file gives steps only
    time_unit : str, or None
    unit : str, or None
        Of the value.
    """

    value: h5py.Dataset
    step: NDArray[np.int64]
    time: NDArray[np.float64] | None
    time_unit: str | None
    unit: str | None


def wrong(path: Path, key: str, found: str, expected: str) -> SchemaError:
    """Return the error of a file that does not keep H5MD."""
    return SchemaError(
        found,
        expected=expected,
        fix="write the file as H5MD 1.0 or 1.1 says (doi:10.1016/j.cpc.2014.01.018)",
        file=path,
        key=key,
    )


def read_element(group: Any, path: Path) -> Element:
    """Read a time-dependent element.

    Raises
    ------
    SchemaError
        When value, step or time is missing or does not fit.
    """
    if not isinstance(group, h5py.Group) or not isinstance(group.get("value"), h5py.Dataset):
        key = getattr(group, "name", "/")
        raise wrong(path, str(key), "no value that changes with time", "value, step and time")
    value = group["value"]
    if value.ndim == 0:
        raise wrong(path, value.name, "a value without an axis of time", "(T, ...)")
    count = len(value)
    step = _clock(group, "step", count, path)
    if step is None:
        raise wrong(path, f"{group.name}/step", "no steps", "a dataset 'step'")
    time = _clock(group, "time", count, path)
    return Element(
        value=value,
        step=step.astype("i8"),
        time=time,
        time_unit=_unit(group.get("time")),
        unit=_unit(value),
    )


def _clock(group: h5py.Group, name: str, count: int, path: Path) -> NDArray[np.float64] | None:
    """Return a clock of `count` entries: stored one by one, or as an increment and an offset."""
    item = group.get(name)
    if item is None:
        return None
    key = f"{group.name}/{name}"
    if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu":
        raise wrong(path, key, "no numbers", "numbers, one a frame, or one increment")
    if item.ndim == 0:
        offset = float(np.asarray(item.attrs.get("offset", 0.0)).reshape(-1)[0])
        return offset + float(item[()]) * np.arange(count, dtype=np.float64)
    if item.shape[0] < count or item.ndim != 1:
        raise wrong(path, key, f"shape {item.shape} beside {count} values", f"({count},)")
    entries: NDArray[np.float64] = item[:count].astype("f8")
    return entries


def _unit(item: Any) -> str | None:
    if not isinstance(item, h5py.Dataset) or "unit" not in item.attrs:
        return None
    text = item.attrs["unit"]
    return text.decode("utf-8", errors="replace") if isinstance(text, bytes) else str(text)


def choose_group(file: h5py.File, wanted: str | None, path: Path) -> h5py.Group:
    """Return the particles group to import: the one named, or the only one with positions.

    Raises
    ------
    SchemaError
        When there is none, or several and none was named.
    """
    home = file.get("particles")
    names = [
        name
        for name in (home if isinstance(home, h5py.Group) else ())
        if isinstance(home[name], h5py.Group) and "position" in home[name]
    ]
    if wanted is not None and wanted not in names:
        raise wrong(
            path, "/particles", f"no particles group {wanted!r} with positions",
            "one of " + (", ".join(names) or "none: nothing in it moves"),
        )  # fmt: skip
    if wanted is None and len(names) != 1:
        found = f"{len(names)} particles groups with positions: {', '.join(names) or 'none'}"
        raise SchemaError(
            found,
            expected="one, or the name of one",
            fix="name it with the option group" if names else "this file holds no trajectory",
            file=path,
            key="/particles",
        )
    return home[wanted or names[0]]
