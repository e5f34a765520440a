"""What moves, what does not, and what moves because the camera does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData
from openprc.vision.trajectories.runs import where_present

MotionModel = Literal["translation", "rigid", "similarity"]

#: Rounds in which the shape of the still points and the motion of the camera are improved ...
_ROUNDS = 20
#: ... and fewer while it is not known yet which points are still.
_SEARCH_ROUNDS = 3
#: Still points are looked for among this fraction, the ones that move least.
_CALM = 0.25
#: A point is still if it departs by no more than this many times what the calm ones do.
_STILL = 3.0


@dataclass(frozen=True)
class CameraMotion:
    """Trajectories without the motion of the camera.

    Attributes
    ----------
    positions : (T, N, D)
        NaN in frames in which too few still points were seen.
    static : (S,)
        The points that were taken for still.
    residual : float
        Rms distance of the still points from where they ought to stay, afterwards.
    removed : float
        Rms motion of the still points that was taken off.
    n_unknown : int
        Frames in which too few still points were seen.
    """

    positions: NDArray[np.float64]
    static: NDArray[np.intp]
    residual: float
    removed: float
    n_unknown: int


def motion_snr(
    positions: NDArray[np.float64], sigma: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Return how far each point moves, in units of how well that is known, (N,).

    Parameters
    ----------
    positions, sigma : (T, N, D)

    Returns
    -------
    snr : (N,)
        Rms distance of the positions from their mean over the rms of their one-sigma, both over
        all axes: 1 for a point at rest with white noise of that sigma. NaN for a point with
        fewer than two positions of known sigma.

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
    known = (where_present(positions) & np.isfinite(sigma).all(axis=2))[..., np.newaxis]
    count = known.sum(axis=0)
    values = np.where(known, positions, 0.0)
    mean = values.sum(axis=0) / np.maximum(count, 1)
    spread = np.where(known, values - mean, 0.0)
    noise = np.where(known, np.asarray(sigma, dtype=np.float64), 0.0)
    ratio = np.full(positions.shape[1], np.nan)
    enough = (count[:, 0] > 1) & (noise.max(axis=(0, 2), initial=0.0) > 0)
    # The mean takes one degree of freedom, which matters for short records.
    free = (count[:, 0] - 1) / np.maximum(count[:, 0], 1)
    total = (spread**2).sum(axis=(0, 2)), (noise**2).sum(axis=(0, 2)) * free
    ratio[enough] = np.sqrt(total[0][enough] / total[1][enough])
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
        NaN where a point is missing.
    static : (S,) indices, optional
        Points of the background. Left out, `find_static` looks for them.
    model : {"translation", "rigid", "similarity"}
        Shift; shift and rotation; and a change of scale as well, of a camera that comes nearer.

    Returns
    -------
    CameraMotion
        In the position of the camera at the first frame in which still points are seen. The fit
        adds an error of about ``residual / sqrt(S)`` that all points of a frame share.

    Raises
    ------
    ConfigError
        When the model is not known, or there are too few still points for it.
    MissingData
        When no frame shows enough of them.

    References
    ----------
    Least-squares fit of two sets of points: S. Umeyama, IEEE PAMI 13, 376 (1991),
    doi:10.1109/34.88573
    """
    if model not in get_args(MotionModel):
        raise ConfigError(
            f"unknown model {model!r}",
            expected="one of " + ", ".join(get_args(MotionModel)),
            fix="rigid fits a camera on a shaky stand",
            key="model",
        )
    index = find_static(positions, model=model) if static is None else np.asarray(static)
    need = 1 if model == "translation" else positions.shape[2]
    if len(index) < need:
        raise ConfigError(
            f"{len(index)} still points",
            expected=f"at least {need} for a {model} motion in {positions.shape[2]} dimensions",
            fix="name more points of the background",
            key="static",
        )
    still = positions[:, index]
    enough = where_present(still).sum(axis=1) >= need
    if not enough.any():
        raise MissingData(
            f"no frame shows {need} of the {len(index)} still points",
            expected="one frame at least",
            fix="name other points of the background",
            key="static",
        )
    scale, turn, shift = _common_motion(still[enough], model)
    out = np.full_like(positions, np.nan)
    out[enough] = _undo(positions[enough], scale, turn, shift)
    left, before = out[:, index], positions[:, index]
    return CameraMotion(out, index, _scatter(left), _scatter(before - left), int((~enough).sum()))


def find_static(
    positions: NDArray[np.float64], *, model: MotionModel = "rigid"
) -> NDArray[np.intp]:
    """Return the points that move least, and all that move with them, (S,).

    From the quarter that moves least (rms distance from the mean), the common motion is taken
    off; a point is still if what is left of its motion is at most three times what is left of
    the calmest quarter's in the median. That is right where the camera moves less than the body;
    where it does not, say which points belong to the background.
    """
    need = 1 if model == "translation" else positions.shape[2]
    spread = _spreads(positions)
    known = np.flatnonzero(np.isfinite(spread))
    # The calmest ones of those that are seen throughout: a point seen twice looks calm, too.
    present = where_present(positions).mean(axis=0)
    known = known[present[known] >= 0.5 * present.max(initial=0.0)]
    count = min(len(known), max(need + 1, int(np.ceil(_CALM * len(known)))))
    chosen = known[np.argsort(spread[known], kind="stable")[:count]]
    for _ in range(_ROUNDS // 2):
        if len(chosen) < need:
            break
        still = positions[:, chosen]
        enough = where_present(still).sum(axis=1) >= need
        if not enough.any():
            break
        undone = _undo(positions[enough], *_common_motion(still[enough], model, _SEARCH_ROUNDS))
        left = _spreads(undone)
        calm = np.sort(left[known])[:count]
        bound = _STILL * float(np.median(calm))
        found = known[left[known] <= max(bound, np.finfo(float).tiny)]
        if np.array_equal(found, chosen):
            break
        chosen = found
    return chosen


def _spreads(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rms distance of each point from its mean, (N,); NaN where never seen."""
    seen = where_present(positions)[..., np.newaxis]
    count = seen.sum(axis=0)
    mean = np.where(seen, positions, 0.0).sum(axis=0) / np.maximum(count, 1)
    square = (np.where(seen, positions - mean, 0.0) ** 2).sum(axis=(0, 2))
    return np.where(count[:, 0] > 0, np.sqrt(square / np.maximum(count[:, 0], 1)), np.nan)


def _scatter(positions: NDArray[np.float64]) -> float:
    """Return the rms distance of all points from their own means."""
    seen = where_present(positions)
    count = seen.sum(axis=0)
    spread = np.nan_to_num(_spreads(positions))
    return float(np.sqrt((spread**2 * count).sum() / max(1, int(count.sum()))))


_Fit = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def _common_motion(still: NDArray[np.float64], model: MotionModel, rounds: int = _ROUNDS) -> _Fit:
    """Return scale (T,), turn (T, D, D) and shift (T, D): still = scale turn shape + shift.

    The shape of the background is not known beforehand, and no frame need show all of it: it is
    the mean of what the frames show, each brought back by its own motion, in turns.
    """
    shape = _first_seen(still)
    for _ in range(rounds):
        scale, turn, shift = _fit(shape, still, model)
        back = _undo(still, scale, turn, shift)
        seen = where_present(back)[..., np.newaxis]
        mean = np.where(seen, back, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
        mean = np.where(seen.any(axis=0), mean, np.nan)
        change = np.nanmax(np.abs(mean - shape), initial=0.0)
        shape = mean
        if change <= 1e-11 * max(1.0, float(np.nanmax(np.abs(shape), initial=0.0))):
            break
    scale, turn, shift = _fit(shape, still, model)
    # The first frame is where the camera stays.
    first_turn, first_shift, first_scale = turn[0].T, shift[0], scale[0]
    turn = turn @ first_turn
    scale = scale / first_scale
    shift = shift - scale[:, np.newaxis] * np.einsum("tij,j->ti", turn, first_shift)
    return scale, turn, shift


def _first_seen(still: NDArray[np.float64]) -> NDArray[np.float64]:
    seen = where_present(still)
    first: NDArray[np.float64] = still[seen.argmax(axis=0), np.arange(still.shape[1])]
    return first


def _fit(shape: NDArray[np.float64], still: NDArray[np.float64], model: MotionModel) -> _Fit:
    n_frames, n_axes = len(still), still.shape[2]
    seen = (where_present(still) & np.isfinite(shape).all(axis=1))[..., np.newaxis]
    count = np.maximum(seen.sum(axis=1), 1)
    there = np.where(seen, still, 0.0)
    model_points = np.where(seen, shape, 0.0)
    centre, origin = there.sum(axis=1) / count, model_points.sum(axis=1) / count
    turn = np.broadcast_to(np.eye(n_axes), (n_frames, n_axes, n_axes)).copy()
    scale = np.ones(n_frames)
    if model != "translation":
        a = np.where(seen, shape - origin[:, np.newaxis], 0.0)
        b = np.where(seen, still - centre[:, np.newaxis], 0.0)
        u, values, vt = np.linalg.svd(np.einsum("tni,tnj->tij", b, a))
        sign = np.ones((n_frames, n_axes))
        sign[:, -1] = np.sign(np.linalg.det(u @ vt))  # a turn, not a mirror
        turn = (u * sign[:, np.newaxis]) @ vt
        if model == "similarity":
            size = (a**2).sum(axis=(1, 2))
            scale = np.divide(
                (values * sign).sum(axis=1), size, out=np.ones(n_frames), where=size > 0
            )
    shift = centre - scale[:, np.newaxis] * np.einsum("tij,tj->ti", turn, origin)
    return scale, turn, shift


def _undo(
    positions: NDArray[np.float64],
    scale: NDArray[np.float64],
    turn: NDArray[np.float64],
    shift: NDArray[np.float64],
) -> NDArray[np.float64]:
    moved = positions - shift[:, np.newaxis]
    back: NDArray[np.float64] = np.einsum("tij,tni->tnj", turn, moved)
    return back / scale[:, np.newaxis, np.newaxis]
