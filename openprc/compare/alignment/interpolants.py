"""Polynomials between frames, as weights of the frames around an instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Name = Literal["nearest", "linear", "cubic", "hermite"]
Reals = NDArray[np.float64]

#: Order of the error in the time between frames.
ORDERS = {"nearest": 1, "linear": 2, "cubic": 4, "hermite": 4}
#: Frames that the places are taken from.
WIDTHS = {"nearest": 1, "linear": 2, "cubic": 4, "hermite": 2}
TEXTS = {
    "nearest": "nearest frame",
    "linear": "straight line between two frames",
    "cubic": "cubic polynomial through the four frames around",
    "hermite": "cubic Hermite polynomial through places and velocities of two frames",
}


@dataclass(frozen=True)
class Weights:
    """A weighted sum of frames for each of P instants.

    Parameters
    ----------
    first : (P,) int
        First of the frames; the others follow it.
    places : (P, K)
    velocities : (P, K) or None [unit of time]
    """

    first: NDArray[np.int64]
    places: Reals
    velocities: Reals | None = None

    @property
    def width(self) -> int:
        """How many frames are summed."""
        return self.places.shape[1]


def weights_at(clock: Reals, instants: Reals, *, name: Name) -> Weights:
    """Return the weights of the frames at `clock` for each of `instants`.

    Near the ends the polynomial of the nearest frames is used. The cubic is Lagrange's (Berrut
    & Trefethen 2004, doi:10.1137/S0036144502417715, eq. 2.1), the Hermite polynomial the usual
    one on two points with derivatives.

    Parameters
    ----------
    clock : (T,)
        Strictly increasing; as many frames as the polynomial takes.
    instants : (P,)
        Inside the clock.
    """
    width = WIDTHS[name]
    below = np.clip(np.searchsorted(clock, instants, side="right") - 1, 0, max(len(clock) - 2, 0))
    if name == "nearest":
        if len(clock) > 1:
            below = below + (instants - clock[below] > clock[below + 1] - instants)
        return Weights(below.astype(np.int64), np.ones((len(instants), 1)))
    first = np.clip(below - (width // 2 - 1), 0, len(clock) - width).astype(np.int64)
    if name == "hermite":
        return _hermite(clock, instants, first)
    at = clock[first[:, np.newaxis] + np.arange(width)]
    weights = np.ones((len(instants), width))
    for k in range(width):
        for m in range(width):
            if m != k:
                weights[:, k] *= (instants - at[:, m]) / (at[:, k] - at[:, m])
    return Weights(first, weights)


def _hermite(clock: Reals, instants: Reals, first: NDArray[np.int64]) -> Weights:
    step = clock[first + 1] - clock[first]
    s = (instants - clock[first]) / step
    r = 1.0 - s
    places = np.stack([(1.0 + 2.0 * s) * r * r, s * s * (3.0 - 2.0 * s)], axis=1)
    velocities = np.stack([step * s * r * r, -step * s * s * r], axis=1)
    return Weights(first, places, velocities)


def error_profile(clock: Reals, instants: Reals, *, name: Name) -> Reals:
    """Return how the error of an interpolant at each instant compares with that midway: (P,).

    The leading term of the error is a polynomial with its zeros at the frames, twofold ones for
    Hermite's (Davis 1975, "Interpolation and Approximation", theorem 3.5.1).

    Parameters
    ----------
    clock : (T,)
    instants : (P,)
    """
    if len(clock) < 2:
        return np.ones(len(instants))
    below = np.clip(np.searchsorted(clock, instants, side="right") - 1, 0, len(clock) - 2)
    s = (instants - clock[below]) / (clock[below + 1] - clock[below])
    s = np.clip(s, 0.0, 1.0)
    if name == "nearest":
        return 2.0 * np.minimum(s, 1.0 - s)
    if name == "linear":
        return 4.0 * s * (1.0 - s)
    if name == "hermite":
        return (4.0 * s * (1.0 - s)) ** 2
    return s * (1.0 - s) * (1.0 + s) * (2.0 - s) * (16.0 / 9.0)


def sum_frames(
    weights: Weights, places: Reals, velocities: Reals | None = None, *, offset: int = 0
) -> Reals:
    """Return the weighted sums of frames: (P, n, d).

    Parameters
    ----------
    weights : Weights
    places, velocities : (R, n, d)
        Frames from number `offset` on.
    """
    from openprc.compare.deviations.compiled_sums import combine  # noqa: PLC0415 - numba, heavy

    shape = places.shape[1:]
    out = np.zeros((len(weights.first), int(np.prod(shape))))
    first = weights.first - offset
    combine(places.reshape(len(places), -1), first, weights.places, out)
    if weights.velocities is not None and velocities is not None:
        combine(velocities.reshape(len(velocities), -1), first, weights.velocities, out)
    return out.reshape(-1, *shape)


__all__ = [
    "ORDERS",
    "TEXTS",
    "WIDTHS",
    "Name",
    "Weights",
    "error_profile",
    "sum_frames",
    "weights_at",
]
