"""Whether the arrays of a `TrajectorySet` fit together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError
from openprc.schema.units import unit
from openprc.vision.tracking.status import Status

if TYPE_CHECKING:
    from openprc.vision.trajectories.trajectory_set import TrajectorySet

_LOST = (Status.LOST, Status.OOB, Status.DRIFT)


def settle(tracks: TrajectorySet) -> dict[str, Any]:
    """Return the attributes of a set as checked arrays, what was left out filled in.

    Raises
    ------
    ConfigError
        When shapes differ, times do not increase, or marks and NaN disagree.
    """
    positions = np.asarray(tracks.positions, dtype=np.float64)
    if positions.ndim != 3 or positions.shape[2] not in (2, 3):
        raise _wrong("positions", f"shape {positions.shape}", "(T, N, 2) or (T, N, 3)")
    n_frames, n_points, n_axes = positions.shape
    if np.isinf(positions).any():
        raise _wrong("positions", "an infinite position", "finite numbers, NaN where missing")
    times = np.asarray(tracks.timestamps, dtype=np.float64)
    if times.shape != (n_frames,) or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise _wrong(
            "timestamps", f"times of shape {times.shape}", f"({n_frames},) increasing seconds"
        )
    missing = np.isnan(positions)
    gone = missing.any(axis=2)
    if (missing.all(axis=2) != gone).any():
        raise _wrong("positions", "NaN in some axes of a point", "NaN in all of them or in none")
    observed = _marks(tracks.observed, gone)
    status = tracks.status
    if status is None:
        codes = np.array([Status.LOST, Status.TRACKED, Status.INTERPOLATED], dtype=np.uint8)
        status = codes[observed]
    found: dict[str, Any] = {
        "positions": positions,
        "timestamps": times,
        "observed": observed,
        "status": _shaped("status", status, (n_frames, n_points), np.uint8),
        "units": unit(tracks.units, key="units").symbol,
        "axes": tuple(tracks.axes) or tuple("xyz"[:n_axes]),
        "operations": tuple(tracks.operations),
        "notes": tuple(tracks.notes),
    }
    if len(found["axes"]) != n_axes:
        raise _wrong("axes", f"axes {found['axes']}", f"{n_axes} names")
    ids = np.arange(n_points) if tracks.feature_ids is None else tracks.feature_ids
    found["feature_ids"] = _shaped("feature_ids", ids, (n_points,), np.int64)
    for name, tail, kind in (
        ("quality", (), np.float32),
        ("sigma", (n_axes,), np.float64),
        ("template", (), np.int32),
        ("positions_px", (2,), np.float64),
    ):
        value = getattr(tracks, name)
        if value is not None:
            found[name] = _shaped(name, value, (n_frames, n_points, *tail), kind)
    return found


def _marks(observed: Any, gone: NDArray[np.bool_]) -> NDArray[np.uint8]:
    if observed is None:
        return np.where(gone, 0, 1).astype(np.uint8)
    marks = _shaped("observed", observed, gone.shape, np.uint8)
    if marks.size and marks.max() > 2:
        raise _wrong("observed", f"a mark of {marks.max()}", "0, 1 or 2")
    if ((marks == 0) != gone).any():
        raise _wrong("observed", "marks and NaN disagree", "0 exactly where positions are NaN")
    return marks


def _shaped(key: str, value: Any, shape: tuple[int, ...], kind: Any) -> NDArray[Any]:
    array = np.asarray(value)
    if array.shape != shape:
        raise _wrong(key, f"shape {array.shape}", f"{shape}")
    return array.astype(kind, copy=False)


def point_mask(mask: ArrayLike, n_points: int) -> NDArray[np.intp]:
    """Return the indices that a mask (N,) or a list of indices means.

    Raises
    ------
    ConfigError
        When it does not fit, or means no point.
    """
    given = np.asarray(mask)
    if given.dtype == np.bool_ and given.shape == (n_points,):
        index = np.flatnonzero(given)
    elif given.dtype.kind in "iu" and given.ndim == 1:
        index = given.astype(np.intp)
        if len(index) and not (index.min() >= 0 and index.max() < n_points):
            raise _wrong("mask", f"point {index.max()} of {n_points}", f"0 to {n_points - 1}")
    else:
        raise _wrong(
            "mask", f"{given.dtype} of shape {given.shape}", f"bool ({n_points},), or indices"
        )
    if not len(index):
        raise ConfigError(
            f"none of the {n_points} points is left",
            expected="at least one",
            fix="lower the bound, or track more points",
            key="mask",
        )
    return index


def _wrong(key: str, found: str, expected: str) -> ConfigError:
    return ConfigError(found, expected=expected, fix="correct the call", key=key)
