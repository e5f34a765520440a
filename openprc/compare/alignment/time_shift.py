"""The time by which one recording lags another, to a fraction of a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.compare.alignment.interpolants import sum_frames, weights_at
from openprc.errors import SchemaError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.frame_reading import FrameReader

    Reals = NDArray[np.float64]

#: Nodes and instants that a shift is estimated from.
NODES, INSTANTS = 16, 1 << 16
#: A second peak this close to the first one is mentioned.
RIVAL = 0.95
#: Recordings have to overlap by this share of the shorter one, unless told otherwise.
OVERLAP = 0.5


@dataclass(frozen=True)
class TimeShift:
    """What is added to the clock of the other file.

    Parameters
    ----------
    shift : float [unit of time of the reference]
    correlation : float or None
        Of both motions there; None where the shift was given.
    notes : tuple of str
    """

    shift: float
    correlation: float | None = None
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return {"shift": self.shift, "correlation": self.correlation}


def estimate_shift(
    clocks: tuple[Reals, Reals],
    readers: tuple[FrameReader, FrameReader],
    *,
    turning: bool,
    most: float | None,
) -> TimeShift:
    """Estimate a shift from the normalised cross-correlation of the motion.

    The best whole number of steps is refined by the least squares of the deviation with cubic
    interpolation.

    Parameters
    ----------
    clocks : ((T,), (S,))
        In one unit.
    readers : (FrameReader, FrameReader)
        Of the matched nodes.
    turning : bool
        Whether one body may lie turned: distances from the middle of the nodes stand for
        places then.
    most : float, optional
        Largest shift.

    Raises
    ------
    SchemaError
        When a motion is too short, or nothing moves.
    """
    if min(len(clock) for clock in clocks) < 8:
        raise _hopeless(readers[1], "there are fewer than 8 frames in one of the files")
    step = max(_step(clock) for clock in clocks)
    series = [
        _motion(clock, reader, step, turning=turning)
        for clock, reader in zip(clocks, readers, strict=True)
    ]
    if not all(float(np.abs(part).max(initial=0.0)) > 0 for part in series):
        raise _hopeless(readers[1], "nothing moves in one of the files")
    x, y = series
    lags, correlation = _correlation(x, y)
    offset = float(clocks[0][0] - clocks[1][0])
    shifts = offset + lags * step
    if most is None:
        overlap = np.minimum(len(x), len(y) + lags) - np.maximum(0, lags)
        allowed = overlap >= OVERLAP * min(len(x), len(y))
    else:
        allowed = np.abs(shifts) <= most
    if not allowed.any():
        raise _hopeless(readers[1], f"no shift of at most {most:g} lets the recordings overlap")
    correlation = np.where(allowed, correlation, -np.inf)
    best = int(np.argmax(correlation))
    fraction = _refined(x, y, int(lags[best]))
    notes = []
    rival = _rival(correlation, best)
    if rival is not None:
        notes.append(
            f"a time shift of {shifts[rival]:.4g} fits nearly as well as {shifts[best]:.4g}"
            f" (correlations {correlation[rival]:.3f} and {correlation[best]:.3f}), as in"
            " periodic motion: max_shift narrows the choice"
        )
    if correlation[best] < 0.5:
        notes.append(
            f"the motions hardly correlate at the best time shift ({correlation[best]:.2f})"
        )
    shift = float(shifts[best] + fraction * step)
    return TimeShift(shift, float(correlation[best]), tuple(notes))


def _step(clock: Reals) -> float:
    """Return the usual step; its mean where the clock is even, as the median is rounded more."""
    usual, mean = float(np.median(np.diff(clock))), float((clock[-1] - clock[0]) / (len(clock) - 1))
    return mean if abs(mean - usual) < 1e-3 * usual else usual


def _motion(clock: Reals, reader: FrameReader, step: float, *, turning: bool) -> Reals:
    """Return the motion of some nodes on an even clock, mean 0, gaps 0: (P, C)."""
    frames = int(np.searchsorted(clock, clock[0] + INSTANTS * step, side="right"))
    block = max(1, 16 * reader.chunk_rows)
    probes = np.unique(np.linspace(0, frames - 1, 32).round().astype(int))
    seen = np.stack([reader.single(int(k)) for k in probes])
    with np.errstate(invalid="ignore"):
        spread = np.nan_to_num(np.ptp(seen, axis=0)).sum(axis=1)
    nodes = np.sort(np.argsort(spread)[::-1][:NODES]) if not turning else slice(None)
    parts = [reader.rows(a, min(a + block, frames))[:, nodes] for a in range(0, frames, block)]
    if turning:
        parts = [_distances(part)[:, : NODES * 4] for part in parts]
    places = np.concatenate([part.reshape(len(part), -1) for part in parts])
    instants = clock[0] + step * np.arange(int((clock[frames - 1] - clock[0]) / step + 1e-6) + 1)
    columns = [np.interp(instants, clock[:frames], column) for column in places.T]
    even = np.stack(columns, axis=1)
    means = np.nanmean(np.where(np.isfinite(even), even, np.nan), axis=0, keepdims=True)
    moved = np.nan_to_num(even - means)
    # A mean is rounded: a body at rest would otherwise shiver.
    still = np.abs(moved).max(axis=0) <= 1e-12 * np.nan_to_num(np.abs(even)).max(axis=0)
    moved[:, still] = 0.0
    return moved


def _distances(places: Reals) -> Reals:
    middle = places.mean(axis=1, keepdims=True)
    return np.sqrt(((places - middle) ** 2).sum(axis=2))


def _correlation(x: Reals, y: Reals) -> tuple[NDArray[np.int64], Reals]:
    """Return lags, and for each the correlation of ``x[k + lag]`` with ``y[k]`` where both are."""
    from scipy.fft import irfft, next_fast_len, rfft

    n, m = len(x), len(y)
    size = next_fast_len(n + m, real=True)
    product = irfft((rfft(x, size, axis=0) * np.conj(rfft(y, size, axis=0))).sum(axis=1), size)
    lags = np.arange(-(m - 1), n)
    power = [np.concatenate([[0.0], np.cumsum((part**2).sum(axis=1))]) for part in (x, y)]
    low, high = np.maximum(0, lags), np.minimum(n, m + lags)
    norms = [power[0][high] - power[0][low], power[1][high - lags] - power[1][low - lags]]
    norm = np.sqrt(np.maximum(0.0, norms[0]) * np.maximum(0.0, norms[1]))
    least = 1e-9 * float(norm.max())
    return lags, np.where(norm > least, product[lags] / np.maximum(norm, least), 0.0)


def _refined(x: Reals, y: Reals, lag: int) -> float:
    """Return the part of a step that is to be added to a lag."""
    from scipy.optimize import minimize_scalar

    low, high = max(0, lag), min(len(x), len(y) + lag)
    if high - low < 8:
        return 0.0
    inner = np.arange(low + 2, high - 2)
    clock = np.arange(len(y), dtype="f8")
    target = x[inner]

    def deviation(part: float) -> float:
        weights = weights_at(clock, inner - lag - part, name="cubic")
        there = sum_frames(weights, y[:, :, np.newaxis])[:, :, 0]
        apart = there - target
        # The means were those of different parts of the motion.
        return float(((apart - apart.mean(axis=0)) ** 2).sum())

    found = minimize_scalar(
        deviation, bounds=(-1.0, 1.0), method="bounded", options={"xatol": 1e-7}
    )
    return float(found.x) if found.fun <= deviation(0.0) else 0.0


def _rival(correlation: Reals, best: int) -> int | None:
    """Return the largest other local maximum, where it is nearly as large."""
    inner = correlation[1:-1]
    tops = 1 + np.flatnonzero((inner > correlation[:-2]) & (inner >= correlation[2:]))
    tops = tops[np.abs(tops - best) > 1]
    if not len(tops):
        return None
    second = int(tops[np.argmax(correlation[tops])])
    return second if correlation[second] > RIVAL * correlation[best] else None


def _hopeless(reader: FrameReader, found: str) -> SchemaError:
    return SchemaError(
        f"no time shift can be estimated: {found}",
        expected="two recordings of one motion",
        fix="give the shift as a number",
        file=reader.trajectory.path,
        key="time_shift",
    )


__all__ = ["TimeShift", "estimate_shift"]
