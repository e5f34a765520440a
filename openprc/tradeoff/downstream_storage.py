"""What rounding in a file costs: the same states as they come back from it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import process_time
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from openprc.errors import TaskError
from openprc.reservoir.io.elements import in_single_precision
from openprc.reservoir.readout.least_squares import LeastSquares
from openprc.tradeoff.point import Point

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.tradeoff.downstream_rows import DownstreamRows

    Reals = NDArray[np.float64]

Precision = Literal["float64", "float32"]


@dataclass(frozen=True, kw_only=True)
class StoredSeries:
    """A series of a file, about an origin.

    Parameters
    ----------
    whole, moved : str
        What it is called as it is, and without its origin.
    values : (T, F) [unit of the file]
    origin : (F,)
        Rest lengths, or rest positions.
    """

    whole: str
    moved: str
    values: Reals
    origin: Reals

    def variants(self) -> Iterator[tuple[str, Precision, Reals]]:
        """Yield what is stored, in which format, and what comes back, (T, F)."""
        yield self.whole, "float64", self.values
        yield self.whole, "float32", rounded(self.values)
        yield self.moved, "float32", rounded(self.values - self.origin)


def rounded(values: Reals) -> Reals:
    """Return values rounded to float32 and back.

    The rounding error of a value in [2^e, 2^(e+1)) is uniform within half a unit in its last
    place, 2^(e-23), so its standard deviation is 2^(e-23) / sqrt(12).
    """
    return values.astype(np.float32).astype(np.float64)


def storage_points(rows: DownstreamRows) -> Iterator[Point]:
    """Yield a point for every way of storing the states that the file allows to judge."""
    found = False
    for series in stored_series(rows):
        found = True
        truth: dict[str, float] = {}
        for stored, precision, values in series.variants():
            begin = process_time()
            try:
                scores = _scores(rows, values)
            except TaskError as problem:  # nothing of the motion is left
                yield _point(stored, precision, status="failed", note=problem.found)
                continue
            seconds = process_time() - begin
            truth = truth or scores
            errors = {k: abs(v - truth[k]) for k, v in scores.items() if k in truth}
            yield _point(
                stored,
                precision,
                scores=scores,
                score_errors=errors,
                cpu_seconds=seconds,
                file_size=series_size(values.shape, precision),
                note=f"errors against {series.whole} in float64",
            )
    if not found:
        yield _point(
            "the run",
            "float64",
            status="refused",
            note="the run is stored in float32 itself, so that nothing is left to compare with",
        )


def stored_series(rows: DownstreamRows) -> Iterator[StoredSeries]:
    """Yield the series of a run that are in double precision."""
    loader, trajectory = rows.loader, rows.loader.trajectory
    if "bars" in trajectory.element_kinds:
        lengths = loader.bar_lengths()
        if not in_single_precision(lengths):
            rest = lengths[0] - loader.bar_extensions()[0]
            yield StoredSeries(whole="lengths", moved="extensions", values=lengths, origin=rest)
    if loader.n_nodes:
        positions = loader.positions().reshape(loader.n_frames, -1)
        if not in_single_precision(positions):
            rest = positions[0] - loader.displacements()[0].ravel()
            yield StoredSeries(
                whole="positions", moved="displacements", values=positions, origin=rest
            )


def series_size(shape: tuple[int, ...], precision: Precision) -> int:
    """Return the bytes of a series (T, F) and of its times."""
    frames, columns = shape
    return frames * (columns * np.dtype(precision).itemsize + 8)


def _scores(rows: DownstreamRows, values: Reals) -> dict[str, float]:
    states = rows.on_rows(values)
    scores = rows.errors(LeastSquares(), states)
    try:
        return scores | rows.capacities(states)
    except TaskError:
        return scores  # of an input that is not white; the estimator's group says so


def _point(stored: str, precision: Precision, **found: Any) -> Point:
    return Point(
        group="storage",
        label=f"{precision} {stored}",
        setting={"stored": stored, "storage": precision},
        **found,
    )
