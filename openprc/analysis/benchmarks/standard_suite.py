"""Everything that is measured on one body, in one go."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.benchmarks.base import Benchmark, Score
from openprc.analysis.benchmarks.baseline import NETWORK_SEEDS
from openprc.analysis.benchmarks.diagnosis import (
    DimensionBenchmark,
    InputCorrelation,
    KernelQualityBenchmark,
)
from openprc.analysis.benchmarks.memory_benchmark import MemoryBenchmark
from openprc.analysis.benchmarks.narma_benchmark import NARMABenchmark
from openprc.analysis.benchmarks.prcpy_benchmark import PRCpyBenchmark
from openprc.analysis.benchmarks.task_benchmark import TaskBenchmark
from openprc.analysis.tasks.recall import ParityTask
from openprc.analysis.tasks.volterra import VolterraTask
from openprc.errors import OpenPRCError, TaskError
from openprc.reservoir.training.row_split import RowSplit
from openprc.reservoir.training.trainer import Trainer

NARMA_ORDERS = (2, 5, 10, 20)
#: What is told while the suite runs: the share done, and what comes next.
Report = Callable[[float, str], None]


@dataclass(frozen=True)
class Item:
    """One benchmark of a suite, with the parameters of its run.

    ``scaled``: the input is brought to [0, 0.5] for it, as NARMA systems need.
    """

    benchmark: Benchmark
    scaled: bool = False
    parameters: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class SuiteScore:
    """What a suite found.

    Parameters
    ----------
    scores : mapping
        Group name to score, in the order of the suite.
    skipped : mapping
        Group name to the reason why it was not measured.
    trainer : Trainer
    u : (R,) float64, optional
        The input on the rows of the trainer.
    """

    scores: Mapping[str, Score]
    skipped: Mapping[str, str]
    trainer: Trainer
    u: NDArray[np.float64] | None = None

    def tasks(self) -> Iterator[tuple[str, str, Score]]:
        """Yield name, figure and score of every task."""
        for score in self.scores.values():
            if "task" in score.metadata:
                yield str(score.metadata["task"]), str(score.metadata["metric"]), score

    def warnings(self) -> dict[str, list[str]]:
        """Return each warning once, with the names of the groups that gave it."""
        found: dict[str, list[str]] = {}
        for name, score in self.scores.items():
            for text in score.metadata.get("warnings", ()):
                found.setdefault(text, []).append(name)
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return all numbers and how they were come by, as plain values."""
        return {
            "groups": {
                name: {
                    "metrics": {key: _plain(value) for key, value in score.metrics.items()},
                    "metadata": {key: _plain(value) for key, value in score.metadata.items()},
                }
                for name, score in self.scores.items()
            },
            "skipped": dict(self.skipped),
        }

    def save(self) -> Path:
        """Write the readouts and one metrics.h5 with a group a benchmark; return its path.

        Raises
        ------
        TaskError
            When the trainer has no experiment folder, or nothing was measured.
        """
        path = None
        for score in self.scores.values():
            path = score.save()
        if path is None:
            raise TaskError(
                "nothing was measured",
                expected="at least one benchmark that ran",
                fix="see why each was skipped: " + "; ".join(self.skipped.values()),
                key="scores",
            )
        return path


class StandardSuite:
    """Run every benchmark that a body admits.

    Dimension of the states, correlation with the input, memory and information processing
    capacity, echo and kernel rank, NARMA 2, 5, 10 and 20, a Volterra system, and XOR where the
    input is binary. What cannot be measured (NARMA10 may diverge; load steps have no memory; a
    file may not say what drove the body) is left out with its reason.

    Parameters
    ----------
    items : sequence of Item, optional
        The benchmarks; by default `standard_items`.
    n_networks : int
        Seeds of the echo state networks that tasks are compared with.
    prcpy : bool
        Add the figures of PRCpy, by its own formulas.
    """

    def __init__(
        self,
        items: Sequence[Item] | None = None,
        *,
        n_networks: int = NETWORK_SEEDS,
        prcpy: bool = False,
    ) -> None:
        self.items = items
        self.n_networks = n_networks
        self.prcpy = prcpy

    def run(
        self, trainer: Trainer, u_input: ArrayLike | None = None, *, progress: Report | None = None
    ) -> SuiteScore:
        """Measure everything; nothing is written before `SuiteScore.save`.

        Parameters
        ----------
        u_input : (n,), optional
            The input, on the rows of the trainer, per symbol, or per frame; without it only
            what needs none is measured.
        progress : callable, optional
            ``progress(share, what)``.

        Raises
        ------
        MissingData, TaskError
            When the states cannot be read, the file is too short, or the input fits no clock.
        """
        _ = trainer.states
        u = None if u_input is None else trainer.align_input(u_input)[0]
        items = self.items
        if items is None:
            items = standard_items(trainer, u, n_networks=self.n_networks)
        if self.prcpy:
            items = [*items, Item(PRCpyBenchmark())]
        scores: dict[str, Score] = {}
        skipped: dict[str, str] = {}
        for done, item in enumerate(items):
            name = item.benchmark.group_name
            if progress is not None:
                progress(done / len(items), name)
            if u is None and item.benchmark.needs_input:
                skipped[name] = "the file does not say what drove the body"
                continue
            given = scale_to_narma(u) if item.scaled and u is not None else u
            try:
                scores[name] = item.benchmark.run(trainer, given, **item.parameters)
            except OpenPRCError as error:
                skipped[name] = error.found
        return SuiteScore(scores, skipped, trainer, u)


def standard_items(
    trainer: Trainer, u: NDArray[np.float64] | None, *, n_networks: int = NETWORK_SEEDS
) -> list[Item]:
    """Return the benchmarks of the suite for a body and its input."""
    networks = {"n_networks": n_networks}
    items = [
        Item(DimensionBenchmark()),
        Item(InputCorrelation()),
        Item(MemoryBenchmark("memory"), parameters={"delays": delay_budget(trainer)}),
        Item(KernelQualityBenchmark()),
    ]
    items += [
        Item(NARMABenchmark(f"narma{n}"), scaled=True, parameters={"order": n, **networks})
        for n in NARMA_ORDERS
    ]
    items.append(Item(TaskBenchmark(volterra_task(trainer.rows.step)), parameters=networks))
    if u is not None and len(np.unique(u)) == 2:
        items.append(Item(TaskBenchmark(ParityTask(2)), parameters=networks))
    return items


def delay_budget(trainer: Trainer) -> dict[int, int]:
    """Return the largest delay for each degree of a trainer; see `delays_for`."""
    return delays_for(trainer.split)


def delays_for(split: RowSplit) -> dict[int, int]:
    """Return the largest delay for each degree, from how many rows there are.

    Thresholds grow with the number of targets, and delays beyond the washout would need input
    from before the first row; both are bounded by the length of the recording.
    """
    rows = split.train + split.test
    longest = max(min(60, rows // 10), 1)
    return {1: longest, 2: max(min(20, longest // 2), 1), 3: max(min(6, longest // 6), 1)}


def volterra_task(step: float) -> VolterraTask:
    """Return Hauser's Volterra system, or one of the same shape over few long symbols.

    Its window, 0.1 s wide and as far back, has to be several rows long.
    """
    if step <= 0.05:
        return VolterraTask(dt=step)
    return VolterraTask(dt=step, mean=2 * step, width=step, support=4 * step)


def scale_to_narma(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the input brought to [0, 0.5] by its least and largest value."""
    least, most = u.min(), u.max()
    return 0.5 * (u - least) / (most - least) if most > least else u


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return list(value) if isinstance(value, tuple) else value
