"""Tracks of two cameras joined to trajectories in space."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import CalibrationError
from openprc.vision.calibration.mapping import Array, finite
from openprc.vision.calibration.stereo_clock import on_clock
from openprc.vision.tracking.status import Status
from openprc.vision.trajectories.trajectory_set import TrajectorySet

if TYPE_CHECKING:
    from openprc.vision.calibration.stereo import StereoRig

_SEEN = (Status.TRACKED, Status.REFERENCE, Status.INTERPOLATED)


def join(
    rig: StereoRig, left: Any, right: Any, *, time_offset: float = 0.0, max_error: float = 5.0
) -> TrajectorySet:
    """Triangulate the points of two recordings, frame by frame of the left one.

    Where the clocks differ, the right camera's tracks are interpolated to the left camera's times
    first; nothing is extrapolated. A point that either camera does not see at a time is missing
    then.

    Parameters
    ----------
    rig : StereoRig
    left, right : TrackingResult or TrajectorySet
        The same points in the same order, in pixels (a calibrated set has kept them).
    time_offset : float [s]
        Added to the right camera's times.
    max_error : float [px]
        Points whose reprojection error is larger become missing, with the status DRIFT: one of
        the two tracks is not on the point.

    Raises
    ------
    CalibrationError
        When the recordings have different points, or no time in common.
    """
    offset = finite(time_offset, key="time_offset")
    gate = finite(max_error, key="max_error", above=0.0)
    seen = [_pixels(item, side) for item, side in ((left, "left"), (right, "right"))]
    if seen[0][0].shape[1] != seen[1][0].shape[1]:
        raise CalibrationError(
            f"the left recording has {seen[0][0].shape[1]} points, the right one "
            f"{seen[1][0].shape[1]}",
            expected="the same points in the same order",
            fix="track in the right recording what `correspondences` found there, and select the "
            "same points from both",
            key="right",
        )
    clock = np.asarray(left.timestamps, np.float64)
    others = np.asarray(right.timestamps, np.float64) + offset
    notes = [*getattr(left, "notes", ()), *getattr(right, "notes", ())]
    (pixels, sigma), (right_pixels, right_sigma) = seen
    step = np.median(np.diff(clock)) if len(clock) > 1 else 1.0
    same = len(clock) == len(others) and np.abs(clock - others).max(initial=0.0) <= 1e-3 * step
    if not same:
        both = np.concatenate([right_pixels, right_sigma], axis=-1)
        moved = on_clock(others, both, clock)
        right_pixels, right_sigma = moved[..., :2], moved[..., 2:]
        inside = (clock >= others.min(initial=np.inf)) & (clock <= others.max(initial=-np.inf))
        if not inside.any():
            raise CalibrationError(
                f"the right recording ends before the left one begins, or the other way round, "
                f"with time_offset = {offset:g} s",
                expected="recordings that overlap in time",
                fix="check time_offset: it is added to the right camera's times",
                key="time_offset",
            )
        notes.append(
            f"the right camera's tracks were interpolated to the left camera's {len(clock)} times"
            f" (time offset {offset:g} s); {int((~inside).sum())} frames have no right partner"
        )
    shape = pixels.shape[:2]
    found = rig.triangulate_points(
        pixels.reshape(-1, 2),
        right_pixels.reshape(-1, 2),
        sigma_left=sigma.reshape(-1, 2),
        sigma_right=right_sigma.reshape(-1, 2),
    )
    points = found.points.reshape(*shape, 3)
    error = found.error.reshape(shape)
    spread = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)).reshape(*shape, 3)
    drifted = error > gate
    points[drifted] = np.nan
    status = _status(left, right if same else None, np.isfinite(points).all(axis=2), drifted)
    if drifted.any():
        notes.append(
            f"{int(drifted.sum())} positions have a reprojection error above {gate:g} px and are "
            "missing (status DRIFT)"
        )
    good = np.isfinite(points).all(axis=2)
    return TrajectorySet(
        points,
        clock,
        status=status,
        observed=good.astype(np.uint8),
        quality=np.where(good, error, np.nan).astype(np.float32),
        sigma=np.where(good[..., np.newaxis], spread, np.nan),
        positions_px=pixels,
        units=rig.units,
        axes=("x", "y", "z"),
        frame=rig.frame,
        feature_ids=np.asarray(left.feature_ids),
        calibration=rig,
        operations=({"operation": "triangulate", "units": rig.units, "time_offset_s": offset,
                     "max_error_px": gate, "quality": "reprojection error [px]"},),
        notes=tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def _pixels(item: Any, side: str) -> tuple[Array, Array]:
    """Positions [px] with NaN where not seen, and their one-sigma [px], both (T, N, 2)."""
    units = getattr(item, "units", "px")
    positions = item.positions if units == "px" else getattr(item, "positions_px", None)
    if positions is None:
        raise CalibrationError(
            f"the {side} trajectories are in {units} and have no pixels any more",
            expected="a TrackingResult, or a TrajectorySet in px",
            fix="join the cameras before resampling and calibrating",
            key=side,
        )
    seen = np.isin(item.status, _SEEN)[..., np.newaxis]
    pixels = np.where(seen, np.asarray(positions, np.float64), np.nan)
    sigma = getattr(item, "sigma", None)
    if sigma is None or units != "px":
        return pixels, np.full(pixels.shape, np.nan)
    return pixels, np.where(seen, np.asarray(sigma, np.float64), np.nan)


def _status(
    left: Any, right: Any, good: NDArray[np.bool_], drifted: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """Why a position is missing: the left camera's reason, else the right one's."""
    status = np.array(left.status, np.uint8)
    lost = ~good & np.isin(status, _SEEN)
    reason = np.full(status.shape, Status.LOST, np.uint8)
    if right is not None:
        other = np.asarray(right.status, np.uint8)
        reason = np.where(np.isin(other, _SEEN), Status.LOST, other).astype(np.uint8)
    status[lost] = reason[lost]
    status[drifted] = Status.DRIFT
    return status
