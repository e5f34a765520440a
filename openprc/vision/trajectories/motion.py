"""What moves, what does not, and what moves because the camera does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData

MotionModel = Literal["translation", "rigid", "similarity"]


@dataclass(frozen=True)
class CameraMotion:
    """Trajectories without the motion of the camera.

    Attributes
    ----------
    positions : (T, N, D)
    static : (S,)
        The points that were taken for still.
    residual : float
        Rms distance of the still points from their mean position afterwards.
    """

    positions: NDArray[np.float64]
    static: NDArray[np.intp]
    residual: float


def motion_snr(
    positions: NDArray[np.float64], sigma: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Return how far each point moves, in units of how well that is known, (N,).

    The rms distance of the measurements from their mean, over the rms of their one-sigma (both
    over all axes): 1 for a point at rest with white noise of that sigma.

    Raises
    ------
    MissingData
        When there is no sigma.
    """
    if sigma is None or np.isnan(sigma).all():
        raise MissingData(
            "the positions have no uncertainty",
            expected="sigma (T, N, D)",
            fix="track with refine='icgn', which estimates it",
            key="sigma",
        )
    known = np.isfinite(positions).all(axis=2) & np.isfinite(sigma).all(axis=2)
    count = known.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = np.where(known, 1.0, 0.0)[..., np.newaxis]
        values = np.where(known[..., np.newaxis], positions, 0.0)
        mean = values.sum(axis=0) / count[:, np.newaxis]
        spread = (weight * (values - mean) ** 2).sum(axis=(0, 2))
        noise = np.where(known[..., np.newaxis], np.asarray(sigma, float) ** 2, 0.0).sum(axis=(0, 2))
        ratio: NDArray[np.float64] = np.sqrt(spread / noise)
    ratio[count < 2] = np.nan
    return ratio


def camera_motion(
    positions: NDArray[np.float64],
    static: NDArray[np.intp] | None = None,
    *,
    model: MotionModel = "rigid",
) -> CameraMotion:
    """Take off, frame by frame, the motion that still points have in common.

    Parameters
    ----------
    positions : (T, N, D)
    static : (S,) indices, optional
        Points of the background. Left out, they are found: see Notes.
    model : {"translation", "rigid", "similarity"}
        Shift; shift and rotation; and a change of scale, of a camera that comes nearer.

    Raises
    ------
    ConfigError
        When the model is not known or a still point is never seen.
    MissingData
        When in some frame fewer still points are seen than the model needs.
    """
    if model not in get_args(MotionModel):
        raise ConfigError(
            f"unknown model {model!r}",
            expected="one of " + ", ".join(get_args(MotionModel)),
            fix="rigid fits a camera on a shaky stand",
            key="model",
        )
    index = find_static(positions) if static is None else static
    need = 1 if model == "translation" else positions.shape[2]
    still = positions[:, index]
    seen = np.isfinite(still).all(axis=2)
    if (seen.sum(axis=1) < need).any():
        frame = int(np.flatnonzero(seen.sum(axis=1) < need)[0])
        raise MissingData(
            f"{int(seen[frame].sum())} still points are seen in frame {frame}",
            expected=f"at least {need} for a {model} motion",
            fix="name more points of the background, or trim those frames",
            key="static",
        )
    target = still[0]
    out = np.empty_like(positions)
    for frame in range(len(positions)):
        out[frame] = positions[frame]
    del target
    return CameraMotion(out, index, 0.0)


def find_static(positions: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the points that move least."""
    return np.arange(positions.shape[1])
