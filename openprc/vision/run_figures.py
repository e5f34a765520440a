"""The figures that tell whether a tracking run can be trusted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.status import Status

if TYPE_CHECKING:
    from openprc.vision.finished_tracks import PointFigures
    from openprc.vision.tracking.result import TrackingResult

#: Samples that a median is taken of; more would not change its third digit.
_SAMPLES = 2_000_000


def run_figures(result: TrackingResult, figures: PointFigures) -> dict[str, Any]:
    """Return plain values: counts, medians, and what is known of the clock.

    Parameters
    ----------
    result : TrackingResult
        Its arrays may be mapped from a file; of long runs every so-manieth frame is looked at
        for the medians.
    figures : PointFigures
    """
    axis = result.time_axis
    last = np.isin(result.status[-1], (Status.TRACKED, Status.REFERENCE))
    some = sampled_frames(result)
    status = np.asarray(result.status[some])
    found = np.isin(status, (Status.TRACKED, Status.REFERENCE))
    tracked = status == Status.TRACKED
    known = figures.snr[np.isfinite(figures.snr)]
    told: dict[str, Any] = {
        "frames": result.n_frames,
        "points": result.n_features,
        "duration_s": float(result.timestamps[-1] - result.timestamps[0]),
        "found_fraction": float(figures.seen.mean()),
        "alive_at_end": int(last.sum()),
        "complete": int((figures.seen == 1.0).sum()),
        "recovered": int((figures.recovered > 0).sum()),
        "recoveries": int(figures.recovered.sum()),
        "fraction_by_status": {
            code.name.lower(): float((status == code).mean()) for code in Status
        },
        "median_sigma_px": median(np.asarray(result.sigma[some])[tracked].max(axis=-1)),
        "median_quality": median(np.asarray(result.quality[some])[tracked]),
        "median_motion_snr": median(known),
        "moving": int((known > 3.0).sum()),
        "template_updates": int(figures.updates.sum()),
        "noise_grey_levels": float(result.noise) if np.isfinite(result.noise) else None,
        "reference_frame": result.reference_frame,
        "found_fraction_where_seen_least": float(found.mean(axis=1).min()),
    }
    if axis is not None:
        told |= {
            "time": axis.how,
            "uniform": axis.uniform,
            "frame_rate_hz": float(axis.rate) if np.isfinite(axis.rate) else None,
            "dropped_frames": axis.missing,
            "duplicated_frames": len(axis.duplicated),
        }
    return told


def sampled_frames(result: TrackingResult) -> slice:
    """Return the frames that a figure of a long run is taken from."""
    stride = -(-result.n_frames * result.n_features // _SAMPLES)
    return slice(None, None, max(1, stride))


def median(values: NDArray[np.floating[Any]]) -> float | None:
    """Return the median of what is finite, None where nothing is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else None
