"""Trajectories for a reservoir: a simulation.h5 with as few missing positions as can be had."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError, MissingData
from openprc.vision.storage.simulation import write_simulation

if TYPE_CHECKING:
    from openprc.vision.trajectories.gaps import GapMethod
    from openprc.vision.trajectories.trajectory_set import TrajectorySet


def to_simulation(
    tracks: TrajectorySet,
    path: str | Path,
    *,
    min_ratio: float = 0.0,
    max_gap: int = 0,
    method: GapMethod = "linear",
    bars: ArrayLike | None = None,
    velocities: bool = False,
    overwrite: bool = False,
) -> Path:
    """Write trajectories for a readout, which cannot take NaN.

    Points that were seen in less than `min_ratio` of the frames are left out and named in the
    notes. Gaps of at most `max_gap` frames are filled and marked (``observed`` 2). Whatever is
    still missing stays NaN with mask 0: the readout then says which nodes to leave out, and
    nothing was made up.

    Parameters
    ----------
    tracks : TrajectorySet
    path : path-like
    min_ratio : float
        0 keeps every point, 1 only those that were seen in every frame.
    max_gap : int
        0 fills nothing.
    method : {"linear", "pchip", "cubic"}
    bars : (E, 2) int, optional
        Pairs of points, numbered as in `tracks`: their lengths and strains become series of
        bars. Strains count from the length when both ends were first seen.
    velocities : bool
        Also write velocities.
    overwrite : bool

    Raises
    ------
    ConfigError
        When a setting makes no sense, or a bar ends at a point that is left out.
    MissingData
        When no point is seen often enough.
    """
    if not 0.0 <= min_ratio <= 1.0:
        raise ConfigError(
            f"min_ratio is {min_ratio}",
            expected="a fraction of the frames, 0 to 1",
            fix="0.9 keeps what was nearly always seen",
            key="min_ratio",
        )
    ratios = tracks.track_ratios()
    kept = np.flatnonzero(ratios >= min_ratio)
    if not len(kept):
        raise MissingData(
            f"the best of {len(ratios)} points is seen in {ratios.max():.1%} of the frames",
            expected=f"at least one in {min_ratio:.1%}",
            fix="lower min_ratio, or track again",
            key="min_ratio",
        )
    notes: list[str] = []
    pairs = None if bars is None else _renumbered(np.asarray(bars), kept, ratios)
    if len(kept) < len(ratios):
        gone = np.setdiff1d(np.arange(len(ratios)), kept)
        names = ", ".join(str(int(tracks.feature_ids[i])) for i in gone[:20])
        more = f" and {len(gone) - 20} more" if len(gone) > 20 else ""
        notes.append(
            f"{len(gone)} of {len(ratios)} points were seen in less than {min_ratio:.0%} of the "
            f"frames and left out: {names}{more}"
        )
        tracks = tracks.select_features(kept)
    if max_gap != 0:
        tracks = tracks.fill_gaps(method, max_gap=max_gap)
    missing = int((tracks.observed == 0).sum())
    if missing:
        points = int((tracks.observed == 0).any(axis=0).sum())
        notes.append(f"{missing} positions of {points} points are still missing (NaN, observed 0)")
    if pairs is not None and _is_distorted(tracks):
        warnings.warn(
            "x and y have different scales, so that lengths and strains of bars are distorted; "
            "calibrate, or take NormalizedCalibration(isotropic=True)",
            stacklevel=2,
        )
    return write_simulation(
        path, tracks, bars=pairs, velocities=velocities, notes=notes, overwrite=overwrite
    )


def _renumbered(
    bars: NDArray[np.intp], kept: NDArray[np.intp], ratios: NDArray[np.float64]
) -> NDArray[np.intp]:
    if bars.ndim != 2 or bars.shape[1] != 2 or bars.dtype.kind not in "iu":
        raise ConfigError(
            f"bars of shape {bars.shape} and type {bars.dtype}",
            expected="(E, 2) indices of points",
            fix="correct the list of bars",
            key="bars",
        )
    number = np.full(len(ratios), -1, dtype=np.intp)
    number[kept] = np.arange(len(kept))
    for index, pair in enumerate(bars):
        for end in pair:
            if not 0 <= end < len(ratios):
                raise ConfigError(
                    f"bar {index} ends at point {int(end)}",
                    expected=f"points 0 to {len(ratios) - 1}",
                    fix="correct the list of bars",
                    key="bars",
                )
            if number[end] < 0:
                raise ConfigError(
                    f"bar {index} ends at point {int(end)}, seen in {ratios[end]:.1%} of the "
                    "frames and left out",
                    expected="bars between points that are kept",
                    fix="leave the bar out, or lower min_ratio",
                    key="bars",
                )
    return number[bars]


def _is_distorted(tracks: TrajectorySet) -> bool:
    calibration = tracks.calibration
    shape = getattr(calibration, "frame_shape", None)
    return (
        getattr(calibration, "kind", "") == "normalized"
        and not getattr(calibration, "isotropic", False)
        and shape is not None
        and shape[0] != shape[1]
    )
