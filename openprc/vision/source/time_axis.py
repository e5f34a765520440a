"""When each frame was taken: from time stamps, as far as they make sense.

Containers lie: a declared rate says nothing about a recording with a variable one, stamps are
rounded (Matroska: whole milliseconds), missing (MPEG program streams) or jump where frames
are lost. What was believed, and why, is written into `TimeAxis.how` and `TimeAxis.notes`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError, VideoError
from openprc.vision.source.frame_rate import Grid, fit_grid, plausible_rate, resolution

#: A step longer than this many usual ones is a hole.
HOLE = 1.5


class Drop(NamedTuple):
    """Frames that are missing after frame `after` [frame index, count, s of the step]."""

    after: int
    missing: int
    seconds: float


@dataclass(frozen=True)
class TimeAxis:
    """The times of the frames of a recording.

    Attributes
    ----------
    times : (T,) float64 [s]
        From the first frame; strictly increasing.
    how : str
        How they were found.
    uniform : bool
        All steps are `dt`.
    dt : float [s] or None
        The step of a constant rate; where frames are dropped, the steps are multiples of it.
        None where the rate varies.
    dropped : tuple of Drop
        Holes: steps longer than 1.5 usual ones.
    duplicated : tuple of int
        Frames that equal the one before, pixel for pixel.
    notes : tuple of str
        What the user should know.
    """

    times: NDArray[np.float64]
    how: str
    uniform: bool
    dt: float | None
    dropped: tuple[Drop, ...] = ()
    duplicated: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def missing(self) -> int:
        """How many frames the holes amount to."""
        return sum(drop.missing for drop in self.dropped)

    @property
    def rate(self) -> float:
        """Mean number of frames per second [Hz], NaN for a single frame."""
        if self.dt is not None:
            return 1.0 / self.dt
        return float((len(self.times) - 1) / self.times[-1]) if len(self.times) > 1 else np.nan

    @classmethod
    def from_stamps(
        cls,
        stamps: ArrayLike,
        *,
        declared_fps: float,
        fps: float | None = None,
        duplicated: Sequence[int] = (),
        declared_frames: int | None = None,
        strict: bool = False,
    ) -> TimeAxis:
        """Find the times of frames that were decoded one after the other.

        Parameters
        ----------
        stamps : (T,) [s]
            As the container gives them, NaN where it says nothing.
        declared_fps : float [Hz]
            The rate that the container declares; may be 0 or NaN.
        fps : float [Hz], optional
            The rate of the camera where the user knows it; it wins over all else. Holes in
            regular stamps keep their length in frames.
        duplicated : sequence of int
            Frames that equal the one before.
        declared_frames : int, optional
            The number of frames that the container declares; 0 or less says nothing.
        strict : bool
            Raise where a note about damage would be written.

        Raises
        ------
        ConfigError
            The stamps do not increase and there is no rate to count with.
        VideoError
            No frame; or `strict` and the recording is damaged.
        """
        stamps = np.asarray(stamps, dtype=np.float64)
        if stamps.ndim != 1 or len(stamps) == 0:
            raise VideoError(
                "no frame was decoded",
                expected="at least one frame",
                fix="check the file; another codec or OpenCV version may be needed",
            )
        check_rate(fps)
        faults = []
        if declared_frames is not None:
            faults += count_fault(declared_frames, len(stamps))
        times, how, dt, more = _times(stamps, declared_fps, fps)
        faults += more
        dropped = _holes(times, dt)
        if dropped:
            missing = sum(drop.missing for drop in dropped)
            first = dropped[0]
            faults.append(
                f"{counted(len(dropped), 'hole')} in the time stamps, about "
                f"{counted(missing, 'frame')}; the first is {1e3 * first.seconds:.4g} ms "
                f"long, after frame {first.after}"
            )
        if len(duplicated):
            faults.append(
                f"{counted(len(duplicated), 'frame')} equal to the one before, pixel for pixel, "
                f"the first is frame {duplicated[0]}: repeated by the camera, the codec or a "
                "conversion of the rate, or nothing moved"
            )
        if strict and faults:
            raise VideoError(
                "; ".join(faults),
                expected="an undamaged recording, as strict=True asks",
                fix="record or copy it again, or leave strict out and read the notes",
            )
        uniform = dt is not None and not dropped
        return cls(times, how, uniform, dt, dropped, tuple(map(int, duplicated)), tuple(faults))


def check_rate(fps: float | None) -> None:
    """Raise ConfigError for a rate that is not a positive number."""
    if fps is not None and not (np.isfinite(fps) and fps > 0):
        raise ConfigError(
            f"fps is {fps}",
            expected="a positive number [Hz]",
            fix="give the rate of the camera, or leave it out",
            key="fps",
        )


def counted(number: int, noun: str) -> str:
    """Return a number of things in words: 1 frame, 2 frames."""
    return f"{number} {noun}{'s' * (number != 1)}"


def count_fault(declared: int, decoded: int) -> list[str]:
    """Return what is wrong with the number of frames, in words; nothing when they agree."""
    if declared <= 0 or declared == decoded:
        return []
    return [
        f"the container declares {declared} frames and delivered {decoded}; what was delivered "
        "is used"
    ]


def _times(
    stamps: NDArray[np.float64], declared_fps: float, fps: float | None
) -> tuple[NDArray[np.float64], str, float | None, list[str]]:
    """Return times [s], how they were found, the step [s] if constant, and faults."""
    index = np.arange(len(stamps), dtype=np.float64)
    declared = plausible_rate(declared_fps)
    given = np.isfinite(stamps)
    if len(stamps) == 1:
        rate = fps or declared
        return index, "a single frame", 1.0 / rate if rate else None, []
    faults: list[str] = []
    # A stamp of 0 behind others stands for "unknown"; so do stamps that are all the same.
    given &= ~((stamps == 0) & (np.fmax.accumulate(stamps) > 0))
    if given.any() and np.ptp(stamps[given]) == 0:
        given[1:] = False
    known = stamps[given]
    grid = fit_grid(known, declared) if len(known) >= 2 else None
    places = _places(grid, given) if grid is not None else None
    if fps is not None:
        how = f"index / {fps:g} Hz, the rate that was asked for"
        if places is not None:
            return places / fps, how, 1 / fps, faults
        if len(known) >= 2:
            how += "; the time stamps of the container are not regular and not used"
        return index / fps, how, 1 / fps, faults
    if grid is not None and places is not None:
        unknown = int((~given).sum())
        how = f"index / {grid.rate:.6g} Hz, the constant rate of the time stamps"
        if unknown:
            faults.append(f"{counted(unknown, 'frame')} without a time stamp; {how}")
        if grid.rounded:
            how += f", which are rounded to {1e3 * resolution(known):.3g} ms"
        return places * grid.dt, how, grid.dt, faults
    if given.all() and bool(np.all(np.diff(stamps) > 0)):
        return stamps - stamps[0], "the time stamps of the container (variable rate)", None, faults
    what = "there are no time stamps" if len(known) < 2 else "the time stamps do not increase"
    if declared is None:
        raise ConfigError(
            f"{what} and the declared rate is {declared_fps}",
            expected="the rate at which the camera recorded",
            fix="pass the option fps",
            key="fps",
        )
    how = f"index / {declared:g} Hz, the declared rate"
    if len(known) >= 2:
        faults.append(f"{what}; frame times are {how}")
    return index / declared, how, 1.0 / declared, faults


def _places(grid: Grid, given: NDArray[np.bool_]) -> NDArray[np.float64] | None:
    """Return the place of every frame on the grid; unknown ones are counted on.

    None where the known ones leave no room, or more than the unknown ones would fill.
    """
    places = np.empty(len(given))
    known = np.flatnonzero(given)
    places[known] = grid.places
    for i in np.flatnonzero(~given):
        places[i] = places[i - 1] + 1 if i else np.nan
    lead = known[0]
    places[:lead] = places[lead] - np.arange(lead, 0, -1)
    places -= places[0]
    return places if bool(np.all(np.diff(places) > 0)) else None


def _holes(times: NDArray[np.float64], dt: float | None) -> tuple[Drop, ...]:
    """Return the steps that are much longer than the usual one."""
    if len(times) < 3:
        return ()
    steps = np.diff(times)
    usual = dt if dt is not None else float(np.median(steps))
    limit = HOLE * usual
    if dt is None:
        # At a variable rate long steps are usual as well: a hole lies far out of the quartiles.
        low, high = np.quantile(steps, [0.25, 0.75])
        limit = max(limit, float(high + 3.0 * (high - low)))
    found = np.flatnonzero(steps > limit)
    return tuple(
        Drop(int(i), max(1, round(float(steps[i]) / usual) - 1), float(steps[i])) for i in found
    )
