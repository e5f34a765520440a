"""Estimators of capacity on fewer and fewer rows: what they are off by, and what they cost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from time import process_time
from typing import TYPE_CHECKING, Any

from openprc.analysis.benchmarks.standard_suite import delays_for
from openprc.compare.task_scores import FEWEST, capacities
from openprc.errors import TaskError
from openprc.reservoir.training.row_split import RowSplit
from openprc.tradeoff.point import Point

if TYPE_CHECKING:
    from openprc.analysis.capacity.capacities import Capacities
    from openprc.tradeoff.downstream_rows import DownstreamRows

FRACTIONS = (1.0, 0.5, 0.25, 0.125)


def estimator_points(rows: DownstreamRows) -> Iterator[Point]:
    """Yield points of the same targets, from all rows to an eighth of them."""
    delays = delays_for(rows.split)
    truth: dict[str, float] = {}
    for fraction in FRACTIONS:
        split = shortened(rows.split, fraction)
        for estimator in ("insample", "heldout"):
            setting: dict[str, Any] = {"estimator": estimator, "fraction": fraction}
            point = Point(group="estimator", label=estimator, setting=setting)
            begin = process_time()
            try:
                found = capacities(
                    rows.states,
                    rows.u,
                    split=split,
                    usable=rows.usable,
                    delays=delays,
                    estimator=estimator,
                    excess="report",
                )
            except TaskError as problem:
                yield replace(point, status="refused", note=problem.found)
                if not truth:
                    return  # what all rows do not admit, fewer do not either
                continue
            seconds = process_time() - begin
            for sums, scores in _sums(found):
                truth = truth or scores
                yield replace(
                    point,
                    label=f"{estimator}, {sums}",
                    setting=setting | {"sum": sums, "rows": found.n_rows},
                    scores=scores,
                    score_errors={k: abs(v - truth[k]) for k, v in scores.items()},
                    cpu_seconds=seconds,
                    note=f"rank {found.rank}, {len(found.terms)} targets",
                )


def shortened(split: RowSplit, fraction: float) -> RowSplit:
    """Return a split with the same washout and a fraction of the rows, at least `FEWEST`."""
    train, test = (max(FEWEST, round(fraction * n)) for n in (split.train, split.test))
    return RowSplit(washout=split.washout, train=train, test=test, gap=split.gap)


def _sums(found: Capacities) -> Iterator[tuple[str, dict[str, float]]]:
    sums = found.sums()
    for name, ending in (("above threshold", ""), ("as measured", "_raw"),
                         ("without chance", "_corrected")):  # fmt: skip
        yield (
            name,
            {"memory_capacity": sums[f"mc_jaeger{ending}"], "ipc": sums[f"ipc_total{ending}"]},
        )
        if found.estimator == "heldout":
            return
