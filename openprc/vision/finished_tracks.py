"""Tracks that have come to their end: which points are kept, what is done to them, in blocks.

Nothing here holds all frames of all points: what works along time takes a few points at a time,
what works across points a few frames.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData
from openprc.vision.import_settings import ImportSettings
from openprc.vision.tracking.result import TrackingResult
from openprc.vision.tracking.status import Status
from openprc.vision.tracks_spool import BLOCK, slices
from openprc.vision.trajectories.motion import motion_snr
from openprc.vision.trajectories.resampling import even_clock
from openprc.vision.trajectories.trajectory_set import TrajectorySet

if TYPE_CHECKING:
    from collections.abc import Sequence

#: Bytes that the operations along time need for one point in one frame.
_PER_SAMPLE = 600
_SEEN = (Status.TRACKED, Status.REFERENCE)
SERIES = ("positions", "observed", "status", "quality", "sigma", "template")


@dataclass(frozen=True)
class PointFigures:
    """What is known of every point over the whole run.

    Attributes
    ----------
    seen : (N,)
        Fraction of the frames in which the point was found.
    snr : (N,)
        Rms motion over one-sigma; NaN where sigma is not known.
    recovered : (N,)
        How often the point was found again after it had been missing.
    updates : (N,)
        How often its template was renewed.
    """

    seen: NDArray[np.float64]
    snr: NDArray[np.float64]
    recovered: NDArray[np.intp]
    updates: NDArray[np.intp]

    @classmethod
    def of(cls, result: TrackingResult) -> PointFigures:
        """Measure a run, a few points at a time."""
        n_points = result.n_features
        seen, snr = np.zeros(n_points), np.full(n_points, np.nan)
        recovered, updates = np.zeros(n_points, np.intp), np.zeros(n_points, np.intp)
        for part in slices(n_points, points_at_once(result.n_frames)):
            found = np.isin(result.status[:, part], _SEEN)
            seen[part] = found.mean(axis=0)
            came = found[1:] & ~found[:-1]
            # A first appearance, after frames before the reference, is none of these.
            recovered[part] = (came & np.logical_or.accumulate(found, axis=0)[:-1]).sum(axis=0)
            updates[part] = np.where(found, result.template[:, part], 0).max(axis=0)
            sigma = np.asarray(result.sigma[:, part], dtype=np.float64)
            if np.isfinite(sigma).any():
                places = np.where(found[..., np.newaxis], result.positions[:, part], np.nan)
                snr[part] = motion_snr(places, sigma)
        return cls(seen, snr, recovered, updates)


def points_at_once(n_frames: int) -> int:
    """Return how many points over all frames make a block."""
    return max(1, BLOCK // (_PER_SAMPLE * max(1, n_frames)))


def chosen_points(
    figures: PointFigures, settings: ImportSettings, *, always: Sequence[int], file: Path
) -> tuple[NDArray[np.intp], list[str]]:
    """Return the points that become nodes, (n,), and why others do not.

    Parameters
    ----------
    always : sequence of int
        Points that are kept whatever is known of them: the ends of bars.

    Raises
    ------
    MissingData
        When nothing is left.
    """
    n_points = len(figures.seen)
    keep = np.ones(n_points, dtype=bool)
    notes = []
    held = np.zeros(n_points, dtype=bool)
    held[list(always)] = True
    rare = (figures.seen < settings.min_ratio) & ~held
    if rare.any():
        keep &= ~rare
        notes.append(
            f"{int(rare.sum())} of {n_points} points were found in less than "
            f"{100 * settings.min_ratio:g} % of the frames and left out (min_ratio): {_named(rare)}"
        )
    if settings.moving:
        still = keep & ~(figures.snr > settings.moving) & ~held
        keep &= ~still
        if still.any():
            notes.append(
                f"{int(still.sum())} of {n_points} points move by no more than {settings.moving:g} "
                f"times their sigma and were left out (moving): {_named(still)}"
            )
    if not keep.any():
        raise MissingData(
            f"of {n_points} points none is left: the best was found in "
            f"{100 * figures.seen.max():.3g} % of the frames, the largest motion is "
            f"{np.nanmax(figures.snr, initial=0.0):.3g} times its sigma",
            expected="points that are found and move",
            fix="lower min_ratio or moving",
            file=file,
            key="min_ratio" if settings.min_ratio else "moving",
        )
    return np.flatnonzero(keep), notes


def _named(mask: NDArray[np.bool_]) -> str:
    numbers = np.flatnonzero(mask)
    more = f" and {len(numbers) - 20} more" if len(numbers) > 20 else ""
    return ", ".join(map(str, numbers[:20])) + more


class FinishedTracks:
    """Trajectories of a run in blocks of frames, calibrated and worked on as was asked.

    Parameters
    ----------
    result : TrackingResult
        Its arrays may be mapped from a file.
    settings : ImportSettings
    calibration : object or None
    points : (n,) int
        Which points.
    folder : path
        Where temporary files without a name go.

    Attributes
    ----------
    times : (S,) [s]
    unit, axes, frame : str
        Of the positions.
    notes : tuple of str
    """

    def __init__(
        self,
        result: TrackingResult,
        settings: ImportSettings,
        calibration: Any,
        points: NDArray[np.intp],
        *,
        folder: Path,
    ) -> None:
        self._result = result
        self._calibration = calibration
        self.points = points
        self.times = result.timestamps
        sample = self._set(slice(0, 1), points[:1])
        self.unit, self.axes, self.frame = sample.units, sample.axes, sample.frame
        self.notes: tuple[str, ...] = ()
        self._store = self._processed(settings, folder) if settings.processed else None

    def _set(self, frames: slice, points: Any) -> TrajectorySet:
        r = self._result
        part = TrackingResult(
            positions=np.array(r.positions[frames, points]),
            status=np.array(r.status[frames, points]),
            timestamps=r.timestamps[frames],
            quality=np.array(r.quality[frames, points]),
            sigma=np.array(r.sigma[frames, points]),
            template=np.array(r.template[frames, points]),
        )
        return TrajectorySet.from_tracking_result(part, calibration=self._calibration)

    def _processed(self, settings: ImportSettings, folder: Path) -> NDArray[Any]:
        """Work on a few points at a time over all frames, and keep the outcome in a file."""
        # Of all points at once: what they have in common is what the camera does.
        size = len(self.points) if settings.stabilise else points_at_once(len(self.times))
        gaps = left = short = 0
        frames = slice(0, len(self._result.timestamps))
        if settings.rate:
            self.times = even_clock(self.times, settings.rate)
        store = _mapped(folder, len(self.times), len(self.points), len(self.axes))
        for part in slices(len(self.points), size):
            tracks = self._set(frames, self.points[part])
            if settings.stabilise:
                steadied = tracks.remove_camera_motion()
                self.notes += tuple(note for note in steadied.notes if note not in tracks.notes)
                tracks = steadied
            if settings.max_gap:
                tracks = tracks.fill_gaps("linear", max_gap=settings.max_gap)
                done = tracks.operations[-1]
                gaps, left = gaps + done["gaps"], left + done["left"]
            if settings.smooth:
                before = len(tracks.notes)
                tracks = tracks.smooth(settings.smooth, "savgol")
                short += len(tracks.notes) > before
            if settings.rate:
                tracks = tracks.resample(times=self.times)
            for name in SERIES:
                store[name][:, part] = getattr(tracks, name)
        self.notes += tuple(_told(settings, gaps, left, short))
        return store

    def blocks(self, points: NDArray[np.intp] | None = None) -> Iterator[Any]:
        """Yield blocks of frames with ``times`` and the arrays of `SERIES`, in order.

        Parameters
        ----------
        points : (m,) int, optional
            Which of the chosen points.
        """
        index = np.arange(len(self.points)) if points is None else points
        size = max(1, BLOCK // (200 * max(1, len(self.points))))
        for rows in slices(len(self.times), size):
            if self._store is None:
                block = self._set(rows, self.points[index])
                arrays = {name: getattr(block, name) for name in SERIES}
            else:
                arrays = {name: np.array(self._store[name][rows, index]) for name in SERIES}
            yield SimpleNamespace(times=self.times[rows], **arrays)

    def path_of(self, point: int) -> NDArray[np.float64]:
        """Return the positions of one of the chosen points over all frames, (S, D) [unit]."""
        parts = [block.positions[:, 0] for block in self.blocks(np.array([point]))]
        joined: NDArray[np.float64] = np.concatenate(parts)
        return joined


def _mapped(folder: Path, n_frames: int, n_points: int, n_dims: int) -> NDArray[Any]:
    dtype = np.dtype(
        [
            ("positions", "f8", (n_points, n_dims)),
            ("sigma", "f4", (n_points, n_dims)),
            ("quality", "f4", (n_points,)),
            ("template", "i4", (n_points,)),
            ("observed", "u1", (n_points,)),
            ("status", "u1", (n_points,)),
        ],
        align=True,
    )
    with tempfile.TemporaryFile(dir=folder) as file:
        file.truncate(dtype.itemsize * n_frames)
        # The mapping outlives the handle, and the file the mapping only.
        return np.memmap(file, dtype, mode="r+", shape=(n_frames,))


def _told(settings: ImportSettings, gaps: int, left: int, short: int) -> Iterator[str]:
    if settings.max_gap:
        yield (
            f"{gaps} gaps of up to {settings.max_gap} frames were filled by straight lines "
            f"(observed 2); {left} longer ones stay open (max_gap)"
        )
    if settings.smooth:
        yield (
            f"smoothed by polynomials of order 2 over {settings.smooth} frames, inside runs "
            "without gaps (smooth)" + ("; shorter runs got a shorter window" if short else "")
        )
    if settings.rate:
        yield f"resampled to {settings.rate:g} Hz by cubic splines inside runs without gaps (rate)"
