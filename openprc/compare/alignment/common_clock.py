"""The instants at which two files are compared, and where each file has them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import ConfigError, SchemaError
from openprc.schema.timebase import UNIFORM_TOLERANCE, max_deviation

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from openprc.compare.alignment.clocks import ClockPair
    from openprc.compare.alignment.settings import Onto

    Reals = NDArray[np.float64]

#: Frames belong to one instant where they are this close, in units of the shorter step.
AGREE = 1e-6


@dataclass(frozen=True)
class Sampling:
    """Where one file has the P instants of the comparison.

    Parameters
    ----------
    clock : (T,)
        Of the file.
    frames : (P,) int or None
        The frames themselves; None where the instants fall between frames.
    instants : (P,) or None
        On `clock`, then.
    """

    clock: Reals
    frames: NDArray[np.int64] | None = None
    instants: Reals | None = None

    @property
    def exact(self) -> bool:
        """Whether frames are taken as they are."""
        return self.frames is not None

    def below(self) -> NDArray[np.int64]:
        """Return the last frame at or before each instant."""
        if self.frames is not None:
            return self.frames
        found = np.searchsorted(self.clock, self.instants, side="right") - 1
        return np.clip(found, 0, len(self.clock) - 1).astype(np.int64)

    def part(self, chosen: slice) -> Sampling:
        """Return the sampling of some of the instants."""
        return replace(
            self,
            frames=None if self.frames is None else self.frames[chosen],
            instants=None if self.instants is None else self.instants[chosen],
        )


@dataclass(frozen=True)
class CommonClock:
    """The instants of a comparison.

    Parameters
    ----------
    times : (P,)
        On the clock of the reference.
    step : float or None
        Between instants, where they are evenly spaced.
    reference, other : Sampling
    resampled : str
        "" where frames agree, else "reference" or "other".
    """

    times: Reals
    step: float | None
    reference: Sampling
    other: Sampling
    resampled: str = ""

    def __len__(self) -> int:
        return len(self.times)


def common_clock(
    clocks: ClockPair,
    *,
    shift: float = 0.0,
    onto: Onto = "coarser",
    start: float | None = None,
    stop: float | None = None,
    files: tuple[Path, Path],
) -> CommonClock:
    """Find the instants that two files have in common.

    Frames that agree within 1e-6 of a step are taken as they are, those of a coarser clock
    among those of a finer one, too. Otherwise one file is interpolated at the instants of the
    other; by default at those of the file with fewer of them, so that less is made up.

    Parameters
    ----------
    clocks : ClockPair
    shift : float
        What is added to the clock of the other file.
    onto : {"coarser", "reference", "other"}
    start, stop : float, optional
    files : (Path, Path)
        For messages.

    Raises
    ------
    SchemaError
        When the clocks do not overlap.
    """
    first, second = clocks.reference, clocks.other + shift if shift else clocks.other
    steps = [float(np.median(np.diff(c))) for c in (first, second) if len(c) > 1]
    slack = AGREE * min(steps, default=0.0)
    low, high = max(first[0], second[0]), min(first[-1], second[-1])
    bounds = [b if b is None else clocks.sign * b for b in (start, stop)]
    if clocks.sign < 0:
        bounds.reverse()
    window = (
        low if bounds[0] is None else max(low, bounds[0]),
        high if bounds[1] is None else min(high, bounds[1]),
    )
    kept = [_inside(c, window[0] - slack, window[1] + slack) for c in (first, second)]
    if low > high + slack or max(stop - start for start, stop in kept) == 0:
        raise _no_overlap(clocks, (first, second), files, (start, stop))
    if clocks.kind in ("step", "index"):
        return _shared(clocks, (first, second), kept, slack, files)
    counts = [stop - start for start, stop in kept]
    coarser = 0 if counts[0] <= counts[1] else 1
    target = coarser if onto == "coarser" else ("reference", "other").index(onto)
    if counts[target] == 0:
        target = 1 - target
    source = 1 - target
    instants = (first, second)[target][kept[target][0] : kept[target][1]]
    frames = np.arange(*kept[target])
    found = _nearest((first, second)[source], instants)
    if np.abs((first, second)[source][found] - instants).max() <= slack:
        pair = [None, None]
        pair[target] = Sampling((first, second)[target], frames=frames)
        pair[source] = Sampling((first, second)[source], frames=found)
        return _made(clocks, pair[0], pair[1], "")
    pair = [None, None]
    pair[target] = Sampling((first, second)[target], frames=frames)
    clock = (first, second)[source]
    pair[source] = Sampling(clock, instants=np.clip(instants, clock[0], clock[-1]))
    return _made(clocks, pair[0], pair[1], ("reference", "other")[source])


def _made(
    clocks: ClockPair, reference: Sampling | None, other: Sampling | None, resampled: str
) -> CommonClock:
    assert reference is not None  # noqa: S101 - both were filled in
    assert other is not None  # noqa: S101
    times = (
        reference.clock[reference.frames] if reference.frames is not None else reference.instants
    )
    assert times is not None  # noqa: S101
    return CommonClock(clocks.sign * times, _even_step(times), reference, other, resampled)


def _shared(
    clocks: ClockPair,
    values: tuple[Reals, Reals],
    kept: list[tuple[int, int]],
    slack: float,
    files: tuple[Path, Path],
) -> CommonClock:
    """Match numbers that both have; nothing is interpolated between load steps."""
    inside = [np.arange(*bounds) for bounds in kept]
    few, many = (0, 1) if len(inside[0]) <= len(inside[1]) else (1, 0)
    found = _nearest(values[many], values[few][inside[few]])
    same = np.abs(values[many][found] - values[few][inside[few]]) <= slack
    if not same.any():
        raise _no_overlap(clocks, values, files, (None, None))
    frames = [None, None]
    frames[few], frames[many] = inside[few][same], found[same]
    return _made(
        clocks, Sampling(values[0], frames=frames[0]), Sampling(values[1], frames=frames[1]), ""
    )


def _inside(clock: Reals, low: float, high: float) -> tuple[int, int]:
    return int(np.searchsorted(clock, low)), int(np.searchsorted(clock, high, side="right"))


def _nearest(clock: Reals, instants: Reals) -> NDArray[np.int64]:
    right = np.clip(np.searchsorted(clock, instants), 0, len(clock) - 1)
    left = np.maximum(right - 1, 0)
    closer = np.abs(clock[left] - instants) < np.abs(clock[right] - instants)
    return np.where(closer, left, right).astype(np.int64)


def _even_step(times: Reals) -> float | None:
    if len(times) < 2:
        return None
    step = float((times[-1] - times[0]) / (len(times) - 1))
    return step if max_deviation(times, float(times[0]), step) <= UNIFORM_TOLERANCE else None


def _no_overlap(
    clocks: ClockPair,
    values: tuple[Reals, Reals],
    files: tuple[Path, Path],
    bounds: tuple[float | None, float | None],
) -> SchemaError | ConfigError:
    spans = [" to ".join(f"{clocks.sign * end:g}" for end in (v[0], v[-1])) for v in values]
    unit = "" if clocks.unit == "1" else f" {clocks.unit}"
    if bounds != (None, None):
        return ConfigError(
            f"no frames of both files lie between {bounds[0]} and {bounds[1]}: they cover"
            f" {spans[0]}{unit} and {spans[1]}{unit}",
            expected="start and stop within what both files cover",
            fix="correct start and stop",
            file=files[1],
            key="start",
        )
    return SchemaError(
        f"it covers {clocks.text} from {spans[1]}{unit}, and {files[0].name} from"
        f" {spans[0]}{unit}: they have nothing in common",
        expected="clocks that overlap",
        fix="give the time between their starts as time_shift, or choose another clock",
        file=files[1],
        key="/time_series/time",
    )


__all__ = ["AGREE", "CommonClock", "Sampling", "common_clock"]
