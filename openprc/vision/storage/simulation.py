"""Trajectories as simulation.h5."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError
from openprc.schema import Provenance, TrajectoryWriter
from openprc.vision.storage.extension import declare_tracking, tracking_rows
from openprc.vision.storage.parts import plain

if TYPE_CHECKING:
    from openprc.vision.trajectories.trajectory_set import TrajectorySet

_SERIES = ("quality", "sigma", "status", "template")


def node_labels(feature_ids: NDArray[np.int64]) -> list[str]:
    """Return the names that points have as nodes: ``p12`` is feature 12."""
    return [f"p{int(number)}" for number in feature_ids]


def write_simulation(
    path: str | Path,
    tracks: TrajectorySet,
    *,
    bars: ArrayLike | None = None,
    velocities: bool = False,
    sources: Sequence[tuple[Path, str]] = (),
    notes: Sequence[str] = (),
    settings: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write trajectories as they are into a simulation.h5.

    Parameters
    ----------
    path : path-like
    tracks : TrajectorySet
    bars : (E, 2) int, optional
        Pairs of points; see `bar_series`.
    velocities : bool
        Also write the velocities of `TrajectorySet.velocities`.
    sources : sequence of (path, role)
        Files that were read, hashed into the provenance.
    notes : sequence of str
        Beside those of the set.
    settings : mapping, optional
        For the provenance, beside the operations of the set.
    """
    config = {"operations": list(tracks.operations), **(settings or {})}
    provenance = Provenance(
        "vision", plugin="openprc", deterministic=True, config=json.loads(json.dumps(plain(config)))
    )
    series = tuple(name for name in _SERIES if getattr(tracks, name) is not None)
    ids = tracks.feature_ids
    unique = len(np.unique(ids)) == len(ids)
    writer = TrajectoryWriter(
        path, provenance=provenance, overwrite=overwrite, on_failure="discard"
    )
    with writer:
        moving = velocities and tracks.n_frames > 1
        writer.declare_nodes(
            tracks.n_features, tracks.dims, unit=tracks.units, axes=",".join(tracks.axes),
            frame=tracks.frame, observed=True, velocities=moving,
            velocity_unit="1/s" if tracks.units == "1" else None,
            ids=[int(number) for number in ids] if unique else None,
            labels=node_labels(ids) if unique else None,
        )  # fmt: skip
        declare_tracking(writer, tracks.n_features, tracks.dims, unit=tracks.units, names=series)
        rows: dict[str, Any] = {"positions": tracks.positions, "observed": tracks.observed}
        if moving:
            rows["velocities"] = tracks.velocities()
        if bars is not None:
            rows["elements"] = _declare_bars(writer, tracks, bars)
        for source, role in sources:
            writer.add_source(source, role=role)
        for note in dict.fromkeys((*tracks.notes, *notes)):
            writer.note(note)
        if not unique:
            writer.note("several points have the same number, so that nodes have no names")
        extras = tracking_rows({name: getattr(tracks, name) for name in series})
        writer.append(tracks.timestamps, **rows, extensions=extras)
    return Path(path)


def _declare_bars(
    writer: TrajectoryWriter, tracks: TrajectorySet, bars: ArrayLike
) -> dict[tuple[str, str], NDArray[np.float64]]:
    pairs = np.asarray(bars)
    lengths, rest = bar_series(tracks.positions, pairs)
    writer.declare_elements(
        "bars", pairs, series={"length": tracks.units, "strain": "1"},
        static={"rest_length": (rest, tracks.units)},
    )  # fmt: skip
    writer.note(
        "bars join tracked points; their rest length is the length when both ends were first seen"
    )
    return {("bars", "length"): lengths, ("bars", "strain"): lengths / rest - 1.0}


def bar_series(
    positions: NDArray[np.float64], bars: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return lengths (T, E) and rest lengths (E,) of pairs of points [unit].

    A length is NaN where an end is missing. The rest length is the first one that was measured.

    Raises
    ------
    ConfigError
        When the pairs are no (E, 2) indices, or the ends of one were never seen together, or
        coincide.
    """
    if bars.ndim != 2 or bars.shape[1] != 2 or bars.dtype.kind not in "iu":
        raise _wrong(f"bars of shape {bars.shape} and type {bars.dtype}", "(E, 2) indices")
    n_points = positions.shape[1]
    if bars.size and not (bars.min() >= 0 and bars.max() < n_points):
        worst = bars.max() if bars.max() >= n_points else bars.min()
        raise _wrong(f"a bar ends at point {worst}", f"points 0 to {n_points - 1}")
    lengths = np.linalg.norm(positions[:, bars[:, 0]] - positions[:, bars[:, 1]], axis=2)
    known = np.isfinite(lengths)
    rest = lengths[known.argmax(axis=0), np.arange(len(bars))]
    bad = np.flatnonzero(~(rest > 0))
    if bad.size:
        pair = bars[bad[0]].tolist()
        raise _wrong(
            f"points {pair[0]} and {pair[1]} of bar {int(bad[0])} "
            + ("coincide" if rest[bad[0]] == 0 else "are never seen in the same frame"),
            "two different points that are seen together",
        )
    return lengths, rest


def _wrong(found: str, expected: str) -> ConfigError:
    return ConfigError(found, expected=expected, fix="correct the list of bars", key="bars")
