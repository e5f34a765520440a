"""Signals as differentiable functions of their samples, in `jax.numpy`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from openprc.demlat.signal_table import SAMPLE_SLACK

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

Array = Any
#: Coefficients of a cubic that was integrated.
HIGHEST = 5


class Track(NamedTuple):
    """One signal in one use: what does not change while its samples are differentiated.

    Attributes
    ----------
    name : str
    dt : float [s]
    interpolation : str
    integrated : bool
        A prescribed velocity is a prescribed position: the integral from 0.
    first : int
        Its first component among those of all tracks.
    """

    name: str
    dt: float
    interpolation: str
    integrated: bool
    first: int


class Components(NamedTuple):
    """Where the polynomials of each component of each track are.

    Attributes
    ----------
    dt : (C,) [s]
    first, count : (C,) int
        Rows of the table.
    """

    dt: np.ndarray
    first: np.ndarray
    count: np.ndarray


class Rows(NamedTuple):
    """Which coordinates the tracks drive, one entry a coordinate.

    Attributes
    ----------
    node, axis : (P,) int
    component : (P,) int
        Among those of all tracks.
    from_start : (P,) bool
        Whether the coordinate's start is added (prescribed velocities).
    held : (P,) bool
        Whether the value jumps from sample to sample.
    """

    node: np.ndarray
    axis: np.ndarray
    component: np.ndarray
    from_start: np.ndarray
    held: np.ndarray


def components_of(experiment: Experiment, tracks: tuple[Track, ...]) -> Components:
    """Return where the components of the tracks are in the table of `table_of`."""
    shapes = [(track, experiment.signals[track.name].values.shape) for track in tracks]
    dt = [track.dt for track, (_, width) in shapes for _ in range(width)]
    count = np.array([length for _, (length, width) in shapes for _ in range(width)], dtype=int)
    return Components(np.array(dt), np.cumsum(count) - count, count)


def tracks_of(experiment: Experiment) -> tuple[tuple[Track, ...], Rows, Rows]:
    """Return tracks, the coordinates whose motion they prescribe, and those that they push."""
    tracks: dict[tuple[str, str], Track] = {}
    motion: list[tuple[int, int, int, bool, bool]] = []
    pushes: list[tuple[int, int, int, bool, bool]] = []
    width = 0
    for actuator in experiment.actuators:
        signal = experiment.signals[actuator.signal]
        speed = actuator.type == "velocity"
        n_components = signal.values.shape[1]
        key = actuator.signal, actuator.type
        if key not in tracks:
            tracks[key] = Track(signal.name, signal.dt, signal.interpolation, speed, width)
            width += n_components
        held = signal.interpolation == "hold" and not speed
        rows = pushes if actuator.type == "force" else motion
        for axis in np.flatnonzero(actuator.axes):
            component = tracks[key].first + (int(axis) if n_components == 3 else 0)
            rows.append((actuator.node, int(axis), component, speed, held))
    return tuple(tracks.values()), _rows(motion), _rows(pushes)


def _rows(entries: list[tuple[int, int, int, bool, bool]]) -> Rows:
    columns = zip(*entries, strict=True) if entries else [()] * 5
    kinds = (int, int, int, bool, bool)
    return Rows(*(np.array(c, dtype=k) for c, k in zip(columns, kinds, strict=True)))


def polynomials(track: Track, values: Array) -> Array:
    """Return coefficients of powers of the time since a sample, in samples: (T, n, d)."""
    last = jnp.zeros_like(values[:1])
    rises = jnp.concatenate([jnp.diff(values, axis=0), last])
    if track.interpolation == "hold":
        columns = [values]
    elif track.interpolation == "linear":
        columns = [values, rises]
    else:
        bends = spline_bends(values)
        ahead = jnp.concatenate([bends[1:], last])
        live = (jnp.arange(len(values)) < len(values) - 1)[:, None]
        columns = [
            values,
            jnp.where(live, rises - (2.0 * bends + ahead) / 6.0, 0.0),
            jnp.where(live, bends / 2.0, 0.0),
            jnp.where(live, (ahead - bends) / 6.0, 0.0),
        ]
    rows = jnp.stack(columns, axis=1)
    if not track.integrated:
        return rows
    areas = track.dt * rows / jnp.arange(1, rows.shape[1] + 1)[:, None]
    until = jnp.concatenate([last, jnp.cumsum(areas[:-1].sum(axis=1), axis=0)])
    return jnp.concatenate([until[:, None], areas], axis=1)


def spline_bends(values: Array) -> Array:
    """Return the second differences of the not-a-knot spline at its knots: (T, d).

    With knots one apart the condition at the second knot, ``M0 - 2 M1 + M2 = 0``, turns its
    equation ``M0 + 4 M1 + M2 = 6 D1`` into ``M1 = D1``, D being second differences of the
    samples; likewise at the other end. What is left is tridiagonal
    (de Boor, A Practical Guide to Splines, ch. IV).
    """
    n = len(values)
    if n < 3:
        return jnp.zeros_like(values)
    inner = values[:-2] - 2.0 * values[1:-1] + values[2:]
    if n == 3:
        return jnp.repeat(inner, 3, axis=0)
    if n > 4:
        edge = np.zeros(n - 2, dtype=bool)
        edge[[0, -1]] = True
        beside = np.where(edge, 0.0, 1.0)
        # The rows next to the ends have known neighbours; a row of the identity says so.
        inner = jax.lax.linalg.tridiagonal_solve(
            jnp.asarray(np.where(np.arange(n - 2) == 0, 0.0, beside)),
            jnp.asarray(np.where(edge, 1.0, 4.0)),
            jnp.asarray(np.where(np.arange(n - 2) == n - 3, 0.0, beside)),
            jnp.where(edge[:, None], inner, 6.0 * inner),
        )
    first, last = 2.0 * inner[0] - inner[1], 2.0 * inner[-1] - inner[-2]
    return jnp.concatenate([first[None], inner, last[None]])


def table_of(tracks: tuple[Track, ...], samples: Mapping[str, Array]) -> Array:
    """Return the polynomials of all components of all tracks, one below the other: (R, n)."""
    blocks = []
    for track in tracks:
        rows = polynomials(track, samples[track.name])
        rows = jnp.pad(rows, ((0, 0), (0, HIGHEST - rows.shape[1]), (0, 0)))
        blocks.append(jnp.swapaxes(rows, 0, 1).reshape(HIGHEST, -1, order="F").T)
    return jnp.concatenate(blocks)


def look_up(
    components: Components, table: Array, t: Array, t_from: Array, t_to: Array
) -> tuple[Array, Array]:
    """Return values and rates of all components for a step from `t_from` to `t_to`: (C,), (C,).

    A sample at the end of a step belongs to the segment before it, one at its beginning to the
    segment after it.
    """
    dt = components.dt
    segment = jnp.maximum(jnp.floor(t / dt), jnp.floor(t_from / dt + SAMPLE_SLACK))
    segment = jnp.minimum(segment, jnp.maximum(jnp.ceil(t_to / dt - SAMPLE_SLACK) - 1.0, 0.0))
    segment = jnp.clip(segment, 0.0, components.count - 1.0)
    s = t / dt - segment
    rows = table[components.first + segment.astype(int)]
    value, rate = rows[:, -1], jnp.zeros_like(s)
    for power in range(HIGHEST - 2, -1, -1):
        rate = rate * s + value
        value = value * s + rows[:, power]
    return value, rate / dt
