"""Tracks in pixels put into the units of a calibration."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import CalibrationError
from openprc.vision.tracking.status import Status

if TYPE_CHECKING:
    from openprc.vision.tracking.result import TrackingResult

_SEEN = (Status.TRACKED, Status.REFERENCE, Status.INTERPOLATED)


def calibrated(result: TrackingResult, calibration: Any) -> dict[str, Any]:
    """Return the attributes of a `TrajectorySet`, in px without a calibration.

    A position counts where the status says that the point was found and it is finite. One-sigma
    goes through the derivative of the calibration; quality and status stay.
    """
    notes = list(result.notes)
    if calibration is not None:
        calibration = _fitting(calibration, result, notes)
    seen = np.isin(result.status, _SEEN) & np.isfinite(result.positions).all(axis=2)
    pixels = np.where(seen[..., np.newaxis], result.positions, np.nan).astype(np.float64)
    sigma = np.where(seen[..., np.newaxis], result.sigma, np.nan).astype(np.float64)
    status = np.array(result.status, dtype=np.uint8)
    found: dict[str, Any] = {
        "positions": pixels, "sigma": sigma, "timestamps": result.timestamps,
        "quality": result.quality, "template": result.template, "positions_px": pixels,
        "feature_ids": result.feature_ids,
    }  # fmt: skip
    if calibration is not None:
        points = pixels[seen]
        placed = np.asarray(calibration.to_physical(points), dtype=np.float64)
        spread = np.asarray(calibration.sigma_to_physical(points, sigma[seen]), dtype=np.float64)
        good = np.isfinite(placed).all(axis=1)
        n_axes = placed.shape[-1]
        for name, values in (("positions", placed), ("sigma", spread)):
            array = np.full((*seen.shape, n_axes), np.nan)
            array[seen] = np.where(good[:, np.newaxis], values, np.nan)
            found[name] = array
        if not good.all():
            notes.append(f"{int((~good).sum())} positions have no place in the calibration")
            status[seen] = np.where(good, status[seen], Status.LOST)
            seen[seen] = good
        names = tuple(name.strip() for name in str(getattr(calibration, "axes", "")).split(","))
        found.update(
            calibration=calibration, units=calibration.units, frame=frame_of(calibration),
            axes=names if len(names) == n_axes else (),
            operations=({"operation": "calibrate", "units": calibration.units},),
        )  # fmt: skip
    observed = seen.astype(np.uint8)
    observed[seen & (status == Status.INTERPOLATED)] = 2
    return {**found, "status": status, "observed": observed, "notes": tuple(dict.fromkeys(notes))}


def frame_of(calibration: Any) -> str:
    """Return the name of the frame of reference that a calibration puts positions into."""
    stated = getattr(calibration, "frame", None)
    if isinstance(stated, str):
        return stated
    if getattr(calibration, "kind", "") == "plane":
        return "plane"
    return "image, y up" if getattr(calibration, "y_up", False) else "image"


def _fitting(calibration: Any, result: TrackingResult, notes: list[str]) -> Any:
    """Return the calibration for images of this size; say what it cannot do."""
    if not hasattr(calibration, "to_physical"):
        raise CalibrationError(
            f"the calibration is a {type(calibration).__name__}",
            expected="one camera's calibration, which places a point of one image",
            fix="of two cameras, triangulate both results: StereoRig.triangulate(left, right)",
            key="calibration",
        )
    if result.frame_shape is not None and hasattr(calibration, "check_frame"):
        checked = calibration.check_frame(result.frame_shape)
        calibration = checked.calibration
        notes += checked.notes
        if checked.warning:
            warnings.warn(checked.warning, stacklevel=4)
            notes.append(checked.warning)
    notes += getattr(calibration, "notes", ())
    return calibration
