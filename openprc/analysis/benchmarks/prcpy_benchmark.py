"""PRCpy's own figures as a benchmark, for those who compare with earlier papers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.benchmarks.base import Benchmark, Evaluated
from openprc.analysis.benchmarks.prcpy_metrics import prcpy_scores
from openprc.errors import TaskError
from openprc.reservoir.training.trainer import Trainer


class PRCpyBenchmark(Benchmark):
    """What PRCpy 0.1.14 reports for these states: no washout, no scaling, its own formulas.

    Its capacity divides by the variance of all rows where the covariance is that of the test
    rows, so that a perfect copy may score 3.9 or 0.01; the figures named ``..._corrected`` divide
    by the right one. Use `MemoryBenchmark` for anything but a comparison.

    Parameters
    ----------
    group_name : str
        Group of metrics.h5.
    """

    needs_dynamics = False

    def __init__(self, group_name: str = "prcpy") -> None:
        super().__init__(group_name)

    def _evaluate(
        self,
        trainer: Trainer,
        u: NDArray[np.float64],
        *,
        target: ArrayLike | None = None,
        tau: int | None = None,
        **choices: Any,
    ) -> Evaluated:
        """Measure; the target is the input `tau` rows ahead (1 by default) unless one is given."""
        if not trainer.states.usable.all():
            raise TaskError(
                f"{int(np.count_nonzero(~trainer.states.usable))} rows have missing samples",
                expected="complete rows, since PRCpy has no notion of others",
                fix="interpolate them, or leave the nodes out",
                file=trainer.loader.path,
                key="missing",
            )
        ahead = (1 if target is None else 0) if tau is None else tau
        scores = prcpy_scores(
            trainer.states.values,
            u,
            target=u if target is None else target,
            tau=ahead,
            **choices,
        )
        remarks = scores.pop("remarks")
        metadata: dict[str, Any] = {
            "formulas": "PRCpy 0.1.14 (MIT), computed anew",
            "target": "the input" if target is None else "given",
            "tau": ahead,
            **choices,
        }
        if remarks:
            metadata["warnings"] = list(remarks)
        return Evaluated(scores, metadata)
