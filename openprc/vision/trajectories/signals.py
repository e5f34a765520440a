"""Signals for a readout: components, displacements, path lengths, velocities."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc.vision.trajectories.runs import run_reach, where_present

Component = Literal["x", "y", "z", "magnitude", "path"]
_AXES = {"x": 0, "y": 1, "z": 2}


def component(
    positions: NDArray[np.float64],
    name: str,
    *,
    reference: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return one number a point and frame, (T, N) [unit].

    Parameters
    ----------
    positions : (T, N, D)
        NaN where a point is missing, and the result is NaN there.
    name : {"x", "y", "z", "magnitude", "path"}
        A coordinate; the distance from `reference`; or the length of the path so far. After a
        gap the length of the path is not known any more, and is NaN from there on. ``distance``
        is an older name of ``path``.
    reference : (N, D), optional
        By default where each point was first seen.

    Raises
    ------
    ConfigError
        When the component is not known, or the positions have no such axis.
    """
    n_axes = positions.shape[2]
    if name in _AXES and _AXES[name] < n_axes:
        return positions[:, :, _AXES[name]].copy()
    if name == "magnitude":
        start = first_positions(positions) if reference is None else np.asarray(reference, float)
        if start.shape != positions.shape[1:]:
            raise ConfigError(
                f"reference positions of shape {start.shape}",
                expected=f"{positions.shape[1:]}, one position for each point",
                fix="leave it out to count from where each point was first seen",
                key="reference",
            )
        distance: NDArray[np.float64] = np.linalg.norm(positions - start, axis=2)
        return distance
    if name in ("path", "distance"):
        return path_lengths(positions)
    known = [*"xyz"[:n_axes], "magnitude", "path"]
    raise ConfigError(
        f"there is no component {name!r} of positions in {n_axes} dimensions",
        expected="one of " + ", ".join(known),
        fix="choose one of them",
        key="component",
    )


def first_positions(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where each point was first seen, (N, D); NaN for one that never was."""
    present = where_present(positions)
    start: NDArray[np.float64] = positions[present.argmax(axis=0), np.arange(positions.shape[1])]
    return start


def path_lengths(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the length of the way since each point was first seen, (T, N) [unit].

    NaN before that, and from the first gap on: what the way was meanwhile, nobody saw. Noise
    adds to it in every frame, so that the length of a point at rest grows, too.
    """
    present = where_present(positions)
    steps = np.zeros(present.shape)
    steps[1:] = np.linalg.norm(np.diff(positions, axis=0), axis=2)
    # Before the first sighting there is no way, and no gap either.
    begun = np.logical_or.accumulate(present, axis=0)
    first = begun & ~np.vstack([np.zeros((1, present.shape[1]), dtype=bool), begun[:-1]])
    steps[first | ~begun] = 0.0
    length = np.cumsum(steps, axis=0)
    length[~begun] = np.nan
    return length


def velocities(positions: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return velocities, (T, N, D) [unit/s], of second order in the step between frames.

    The derivative of the parabola through three consecutive measurements: in the middle one
    inside a gap-free run, in the first or last one at its ends. A run of two measurements has
    one slope, of first order; a single one has no velocity and is NaN, as is a missing point.
    """
    out = np.full(positions.shape, np.nan)
    if len(times) < 2:
        return out
    present = where_present(positions)
    before, after = run_reach(present)
    steps = np.diff(times)
    slope = np.diff(positions, axis=0) / steps[:, np.newaxis, np.newaxis]
    frame, node = np.nonzero(present & (before + after == 1))
    out[frame, node] = slope[frame - before[frame, node], node]
    for where, shift in (
        ((before >= 1) & (after >= 1), -1),  # the first of the three relative to the frame
        ((before == 0) & (after >= 2), 0),
        ((after == 0) & (before >= 2), -2),
    ):
        frame, node = np.nonzero(where)
        first = frame + shift
        h1, h2 = steps[first][:, np.newaxis], steps[first + 1][:, np.newaxis]
        s1, s2 = slope[first, node], slope[first + 1, node]
        bend = (s2 - s1) / (h1 + h2)
        # Newton's form x0 + s1 (t - t0) + bend (t - t0)(t - t1), differentiated at the frame.
        out[frame, node] = s1 + bend * {0: -h1, -1: h1, -2: h1 + 2 * h2}[shift]
    return out
