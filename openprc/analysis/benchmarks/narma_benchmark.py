"""The NARMA benchmark: an error, and what the input alone would have achieved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.benchmarks.base import Benchmark, Evaluated, Score
from openprc.analysis.benchmarks.baseline import NETWORK_SEEDS
from openprc.analysis.benchmarks.task_benchmark import evaluate_task
from openprc.analysis.tasks.narma import NarmaTask
from openprc.reservoir.training.trainer import Trainer


class NARMABenchmark(Benchmark):
    """Train on a NARMA system driven by the input of the body.

    The state at the end of symbol t, which has seen u(t), is paired with y(t+1), the value
    that the recursion computes from u(t).

    Parameters
    ----------
    group_name : str
        Group of metrics.h5 that the score is written to.

    Notes
    -----
    Metrics of order n: ``narma<n>_nrmse`` and ``narma<n>_nmse`` of the body, and on the same
    rows with the same penalty ``baseline_nrmse`` of a linear readout of as many past inputs as
    the body has states, ``raw_input_nrmse`` of the present input, ``cubic_nrmse`` of a cubic of
    it, and ``esn_nrmse`` of echo state networks with as many nodes.
    ``skill = 1 - nrmse / baseline_nrmse`` is above 0 when the body computes something that a
    tapped delay line does not; ``skill_over_esn`` compares with the networks.
    """

    def __init__(self, group_name: str = "narma_benchmark") -> None:
        super().__init__(group_name)

    def run(
        self,
        trainer: Trainer,
        u_input: ArrayLike,
        *,
        order: int = 2,
        n_networks: int = NETWORK_SEEDS,
    ) -> Score:
        """Train, score, and score the baselines.

        Parameters
        ----------
        u_input : (n,)
            Within [0, 0.5]; see `Benchmark.run` for its clock.
        order : int
            2 to 10, 20 or 30.
        n_networks : int
            Seeds of the echo state network of equal size; 0 leaves it out.

        Raises
        ------
        TaskError
            When the recursion diverges, the input is out of range or fits no clock, or the
            file is too short or holds load steps.
        """
        return super().run(trainer, u_input, order=order, n_networks=n_networks)

    def _evaluate(
        self,
        trainer: Trainer,
        u: NDArray[np.float64],
        *,
        order: int = 2,
        n_networks: int = NETWORK_SEEDS,
    ) -> Evaluated:
        told = evaluate_task(NarmaTask(order), trainer, u, n_networks=n_networks)
        return replace(told, metadata={"narma_order": order, **told.metadata})
