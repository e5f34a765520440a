"""How good a generated limit cycle is: period, amplitude and shape, whatever its phase."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError

# Mean squared distance between the movement and itself some time later, over that of unrelated
# instants: below the first it has come back, above the second it has been away.
_RETURNED, _AWAY = 0.1, 0.5


@dataclass(frozen=True, eq=False)
class CycleComparison:
    """A generated movement beside its teacher.

    ``period`` and ``reference_period`` [unit of dt]; ``period_error`` is relative;
    ``amplitude_error`` (O,) is the relative error of the peak-to-peak range of each
    coordinate; ``distance`` is that of `orbit_distance`.
    """

    period: float
    reference_period: float
    period_error: float
    amplitude_error: NDArray[np.float64]
    distance: float


def compare_cycles(generated: ArrayLike, reference: ArrayLike, *, dt: float) -> CycleComparison:
    """Compare a generated movement with its teacher; neither phase nor length need agree.

    Parameters
    ----------
    generated, reference : (n, O) and (m, O)
        At least two periods each.
    dt : float
        Time between samples of both.

    Raises
    ------
    TaskError
        When one of them does not repeat itself.
    """
    x, r = _movement(generated, "generated"), _movement(reference, "reference")
    _same_columns(x, r)
    period, reference_period = cycle_period(x, dt=dt), cycle_period(r, dt=dt)
    return CycleComparison(
        period=period,
        reference_period=reference_period,
        period_error=period / reference_period - 1.0,
        amplitude_error=np.ptp(x, axis=0) / np.ptp(r, axis=0) - 1.0,
        distance=orbit_distance(x, r),
    )


def cycle_period(movement: ArrayLike, *, dt: float) -> float:
    """Return the time after which a movement repeats itself.

    It is the first delay after which all coordinates together are back, refined on as many
    periods as fit into half of the record, with a parabola through the samples around it.

    Parameters
    ----------
    movement : (n, O)
        At least two periods.
    dt : float

    Raises
    ------
    TaskError
        When nothing moves, or the movement does not come back within half of the record.
    """
    x = _movement(movement, "movement")
    apart = _return_distance(x)
    away = np.flatnonzero(apart > _AWAY)
    start = int(away[0]) if away.size else len(apart)
    back = np.flatnonzero(apart[start:] < _RETURNED)
    if not back.size:
        least = float(apart[start:].min()) if start < len(apart) else float("nan")
        raise TaskError(
            "the movement does not repeat itself within half of the record: the least distance "
            f"from itself is {least:.3g} of that between unrelated instants",
            expected=f"less than {_RETURNED:g}",
            fix="record at least two periods; a movement that died or drifts has none",
            key="movement",
        )
    first = start + int(back[0])
    above = np.flatnonzero(apart[first:] >= _RETURNED)
    stop = first + int(above[0]) if above.size else len(apart)
    lag = _vertex(apart, first + int(np.argmin(apart[first:stop])))
    period = lag
    for count in range(2, int(len(apart) / lag) + 1):
        reach = max(1, int(0.1 * period))
        near = round(count * period)
        low, high = max(near - reach, 1), min(near + reach + 1, len(apart))
        if high - low < 3:
            break
        best = low + int(np.argmin(apart[low:high]))
        if apart[best] >= _RETURNED or best in (low, high - 1):
            break
        period = _vertex(apart, best) / count
    return float(period * dt)


def orbit_distance(generated: ArrayLike, reference: ArrayLike) -> float:
    """Return how far two closed curves are apart, whatever their phase and speed.

    The mean distance from the samples of one to the polygon of the other, the larger of both
    ways, over the root mean square distance of the reference from its centre. 0 is the same
    curve, and about 1 is one that has shrunk to the centre.

    Parameters
    ----------
    generated, reference : (n, O) and (m, O)
        At least one period each.
    """
    x, r = _movement(generated, "generated", still=True), _movement(reference, "reference")
    _same_columns(x, r)
    radius = float(np.sqrt(((r - r.mean(axis=0)) ** 2).sum(axis=1).mean()))
    return max(float(_to_polygon(x, r).mean()), float(_to_polygon(r, x).mean())) / radius


def _return_distance(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return mean |x(t+s) - x(t)|^2 over twice the variance, for s up to half of the record."""
    n = len(x)
    centred = x - x.mean(axis=0)
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(centred, size, axis=0)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)[: n // 2 + 1].sum(axis=1)
    power = np.concatenate([[0.0], np.cumsum((centred**2).sum(axis=1))])
    shifts = np.arange(n // 2 + 1)
    squares = (power[n] - power[shifts]) + power[n - shifts]
    return (squares - 2.0 * products) / (n - shifts) / (2.0 * power[n] / n)


def _vertex(values: NDArray[np.float64], index: int) -> float:
    """Return the abscissa of the parabola through three samples."""
    if not 0 < index < len(values) - 1:
        return float(index)
    left, middle, right = values[index - 1 : index + 2]
    bend = left - 2.0 * middle + right
    return index + (0.5 * (left - right) / bend if bend > 0.0 else 0.0)


def _to_polygon(points: NDArray[np.float64], curve: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of each point to the segments beside its nearest vertex, (n,)."""
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(curve).query(points)
    for neighbour in (-1, 1):
        other = np.clip(nearest + neighbour, 0, len(curve) - 1)
        edge = curve[other] - curve[nearest]
        to_point = points - curve[nearest]
        length = (edge**2).sum(axis=1)
        along = (to_point * edge).sum(axis=1) / np.where(length > 0.0, length, 1.0)
        foot = np.clip(along, 0.0, 1.0)[:, None] * edge
        distance = np.minimum(distance, np.sqrt(((to_point - foot) ** 2).sum(axis=1)))
    return np.asarray(distance)


def _movement(values: ArrayLike, key: str, *, still: bool = False) -> NDArray[np.float64]:
    x = np.asarray(values, dtype=np.float64)
    x = x[:, None] if x.ndim == 1 else x
    if x.ndim != 2 or len(x) < 8 or not np.isfinite(x).all():
        raise TaskError(
            f"the movement has shape {x.shape} or holds NaN or infinite values",
            expected="(n, O) finite numbers, n at least 8",
            fix="record longer; a closed loop that diverged has no cycle",
            key=key,
        )
    flat = np.ptp(x, axis=0) <= 1e-12 * np.abs(x).max(axis=0)
    if not still and flat.any():
        raise TaskError(
            f"coordinate {int(np.flatnonzero(flat)[0])} does not move",
            expected="a movement",
            fix="the closed loop may have come to rest: check its feedback",
            key=key,
        )
    return x


def _same_columns(x: NDArray[np.float64], r: NDArray[np.float64]) -> None:
    if x.shape[1] != r.shape[1]:
        raise TaskError(
            f"{x.shape[1]} coordinates beside {r.shape[1]}",
            expected="the same coordinates",
            fix="compare all outputs",
            key="reference",
        )
