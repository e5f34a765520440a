"""How wrong an interpolant is on a file: frames that were left out are predicted from the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.compare.alignment.interpolants import (
    ORDERS,
    TEXTS,
    WIDTHS,
    Name,
    error_profile,
    sum_frames,
    weights_at,
)
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.common_clock import Sampling
    from openprc.compare.alignment.frame_reading import FrameReader

    Reals = NDArray[np.float64]

#: Stretches of the file that are looked at, and frames in each.
STRETCHES, STRETCH = 40, 33


@dataclass(frozen=True)
class InterpolationError:
    """What an interpolant adds to the deviation.

    Parameters
    ----------
    interpolant : {"nearest", "linear", "cubic", "hermite"}
    rms, largest : float or None [unit of the comparison]
        Estimates for the instants of the comparison, which may lie close to frames; None where
        there are too few frames to tell.
    order : float or None
        With which power of the step the error falls, as seen.
    halved_rms : float or None
        Of frames predicted from every second one.
    notes : tuple of str
    """

    interpolant: Name
    rms: float | None
    largest: float | None
    order: float | None
    halved_rms: float | None
    notes: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The interpolant in words."""
        return TEXTS[self.interpolant]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return {
            "interpolant": self.interpolant,
            "text": self.text,
            "rms": self.rms,
            "largest": self.largest,
            "order": self.order,
            "halved_rms": self.halved_rms,
        }


def choose_interpolant(
    sampling: Sampling, places: FrameReader, speeds: FrameReader | None, *, wanted: str
) -> InterpolationError:
    """Choose how a file is interpolated, and estimate the error of that.

    Every second frame of some stretches is predicted from the others. What this is wrong by
    falls with the step as the same with every fourth frame shows, though no faster than the
    order of the polynomial; and between frames as the polynomial's remainder does.

    Parameters
    ----------
    sampling : Sampling
        With instants between frames.
    places, speeds : FrameReader
        `speeds` is None where there are no velocities.
    wanted : {"auto", "nearest", "linear", "cubic", "hermite"}

    Raises
    ------
    ConfigError
        When the Hermite polynomial is asked for and there are no velocities, or there are too
        few frames.
    """
    path = places.trajectory.path
    if wanted == "hermite" and speeds is None:
        raise ConfigError(
            "the interpolant is hermite, and there are no velocities that belong to the clock",
            expected="velocities, in the unit of the places per unit of time",
            fix='choose "cubic", or store velocities',
            file=path,
            key="interpolant",
        )
    n = len(sampling.clock)
    if wanted != "auto" and n < WIDTHS[wanted]:
        raise ConfigError(
            f"the interpolant is {wanted}, and there are {n} frames",
            expected=f"at least {WIDTHS[wanted]}",
            fix='choose "linear" or "nearest"',
            file=path,
            key="interpolant",
        )
    if n == 1:
        return _estimate(sampling, [], "nearest")
    stretches = _stretches(places, speeds, n)
    if wanted == "auto":
        if n < WIDTHS["cubic"]:
            return _estimate(sampling, stretches, "linear" if speeds is None else "hermite")
        cubic = _estimate(sampling, stretches, "cubic")
        if speeds is None:
            return cubic
        hermite = _estimate(sampling, stretches, "hermite")
        if cubic.rms is None or hermite.rms is None or hermite.rms <= cubic.rms:
            return hermite
        note = (
            f"{path.name}: its velocities do not predict its places as well as these do themselves"
            f" (errors of about {hermite.rms:.2g} and {cubic.rms:.2g}), so they are not used to"
            " interpolate"
        )
        return InterpolationError(
            "cubic", cubic.rms, cubic.largest, cubic.order, cubic.halved_rms, (note,)
        )
    name: Name = wanted  # type: ignore[assignment]
    return _estimate(sampling, stretches, name)


Stretch = tuple[int, "Reals", "Reals | None"]


def _stretches(places: FrameReader, speeds: FrameReader | None, n: int) -> list[Stretch]:
    length = min(n, STRETCH)
    starts = np.unique(np.linspace(0, n - length, STRETCHES).round().astype(int))
    found: list[Stretch] = []
    for start in starts:
        stop = int(start) + length
        velocities = None if speeds is None else speeds.rows(int(start), stop)
        found.append((int(start), places.rows(int(start), stop), velocities))
    return found


def _estimate(sampling: Sampling, stretches: Sequence[Stretch], name: Name) -> InterpolationError:
    clock = sampling.clock
    half, quarter = (_left_out(clock, stretches, name, step) for step in (2, 4))
    if half is None or sampling.instants is None:
        return InterpolationError(name, None, None, None, None)
    order: float | None = None
    power = float(ORDERS[name])
    if quarter is not None and half[0] > 0 and quarter[0] > 0:
        order = float(np.log2(quarter[0] / half[0]))
        power = min(power, max(0.0, order))
    profile = error_profile(clock, sampling.instants, name=name)
    share = float(np.sqrt(np.mean(profile**2))) / 2**power, float(profile.max()) / 2**power
    return InterpolationError(name, half[0] * share[0], half[1] * share[1], order, half[0])


def _left_out(
    clock: Reals, stretches: Sequence[Stretch], name: Name, step: int
) -> tuple[float, float] | None:
    """Return rms and largest error of frames midway between every `step`-th one."""
    total, count, largest = 0.0, 0, 0.0
    for start, places, velocities in stretches:
        length = (len(places) - 1) // step * step + 1
        if length // step + 1 < max(2, WIDTHS[name]):
            continue
        at = clock[start : start + length]
        weights = weights_at(at[::step], at[step // 2 :: step], name=name)
        predicted = sum_frames(
            weights,
            np.ascontiguousarray(places[:length:step]),
            None if velocities is None else np.ascontiguousarray(velocities[:length:step]),
        )
        squares = ((predicted - places[step // 2 : length : step]) ** 2).sum(axis=2)
        if name == "cubic" and len(squares) > 2:
            # At its ends a stretch has frames on one side only, which the file seldom has.
            squares = squares[1:-1]
        squares = squares[np.isfinite(squares)]
        if squares.size:
            total += float(squares.sum())
            count += squares.size
            largest = max(largest, float(squares.max()))
    return ((total / count) ** 0.5, largest**0.5) if count else None


__all__ = ["InterpolationError", "choose_interpolant"]
