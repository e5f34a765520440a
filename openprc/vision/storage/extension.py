"""What the tracker keeps below ``/extensions/openprc-vision``, one row a frame, and its check."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.schema import Finding
from openprc.schema.findings import Level
from openprc.vision.tracking.status import Status

if TYPE_CHECKING:
    from openprc.schema import Trajectory, TrajectoryWriter

NAME = "openprc-vision"
VERSION = "1.0"
_LOST = (Status.LOST, Status.OOB, Status.DRIFT)
#: Frames that are looked at at a time.
_BLOCK = 4096
_MEANING = {
    "quality": "zero-normalised cross-correlation with the template; NaN where not known",
    "sigma": "one-sigma of the position along every axis; NaN where not known",
    "status": "0 tracked, 1 lost, 2 out of bounds, 3 drift, 4 interpolated, 5 reference",
    "template": "how many times the template of the point had been renewed",
}


def declare_tracking(
    writer: TrajectoryWriter,
    n_points: int,
    n_dims: int,
    *,
    unit: str,
    names: tuple[str, ...] = tuple(_MEANING),
) -> None:
    """Declare the series of a tracking run, before the first frame is appended.

    Parameters
    ----------
    writer : TrajectoryWriter
    n_points, n_dims : int
        N and D of the positions.
    unit : str
        Of the positions, and so of sigma.
    names : tuple of str
        Which of ``quality`` (N,), ``sigma`` (N, D), ``status`` (N,) and ``template`` (N,) will
        be given.
    """
    writer.declare_extension(NAME, VERSION)
    for name in names:
        row = (n_points, n_dims) if name == "sigma" else (n_points,)
        writer.declare_extension_series(
            NAME, name, row,
            unit=unit if name == "sigma" else "1",
            dtype={"status": "u1", "template": "i4"}.get(name, "f4"),
            comment=_MEANING[name],
        )  # fmt: skip


def tracking_rows(arrays: Mapping[str, Any]) -> dict[tuple[str, str], Any]:
    """Return what `TrajectoryWriter.append` takes as ``extensions``, from arrays by name."""
    return {(NAME, name): array for name, array in arrays.items()}


def check(trajectory: Trajectory) -> Iterator[Finding]:
    """Yield findings about status codes that do not exist, or that the mask contradicts."""
    if "status" not in trajectory.extension_names(NAME):
        return
    masked = trajectory.has("/time_series/nodes/observed")
    for start in range(0, trajectory.n_frames, _BLOCK):
        frames = slice(start, start + _BLOCK)
        status = trajectory.extension(NAME, "status", frames=frames)
        unknown = np.argwhere(status > max(Status))
        if len(unknown):
            frame, point = (int(i) for i in unknown[0])
            yield _finding(
                "VISION-01", "error", f"a status of {int(status[frame, point])} at frame "
                f"{start + frame}, point {point}", f"0 to {int(max(Status))}",
            )  # fmt: skip
            return
        observed = trajectory.observed(frames) if masked else None
        if observed is None or observed.shape != status.shape:
            continue
        wrong = np.argwhere(np.isin(status, _LOST) & (observed > 0))
        if len(wrong):
            frame, point = (int(i) for i in wrong[0])
            yield _finding(
                "VISION-02", "warning",
                f"point {point} is lost in frame {start + frame} and has a position",
                "no position where a point is lost",
            )  # fmt: skip
            return


def _finding(code: str, level: Level, found: str, expected: str) -> Finding:
    path = f"/extensions/{NAME}/status"
    return Finding(code, level, path, found, expected, "track the video again")
