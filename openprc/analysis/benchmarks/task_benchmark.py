"""Any task as a benchmark: its figure, beside what the input alone would have achieved."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.benchmarks.base import Benchmark, Evaluated, Score
from openprc.analysis.benchmarks.baseline import NETWORK_SEEDS, compute_baselines, copy_remark
from openprc.analysis.tasks.scoring import METRICS
from openprc.analysis.tasks.series import TargetSeries, TaskData
from openprc.analysis.tasks.task import Task
from openprc.errors import TaskError
from openprc.reservoir.training.evaluation import Evaluation
from openprc.reservoir.training.scores import NMSE_DEFINITION, NRMSE_DEFINITION
from openprc.reservoir.training.trainer import Trainer

_ERRORS = ("nrmse", "ser")


class TaskBenchmark(Benchmark):
    """Train on a task, and score shift register, raw input and networks of equal size on it.

    Parameters
    ----------
    task : Task
        An imitation task computes its target from the input of the body. A task that brings an
        input of its own needs the `data` that the body was driven with.
    group_name : str, optional
        Group of metrics.h5; by default the name of the task.

    Notes
    -----
    Metrics of a task called ``name`` with the figure ``metric``: ``<name>_<metric>`` of the body,
    ``<name>_nrmse`` and ``<name>_nmse`` whatever the figure is, and ``baseline_<metric>``
    (shift register with as many taps as the body has states), ``raw_input_<metric>``,
    ``cubic_<metric>``, ``esn_<metric>``, ``skill`` and ``skill_over_esn`` of the same rows and
    penalty. With several outputs a figure is the mean over them.
    """

    multi_input = True

    def __init__(self, task: Task, group_name: str | None = None) -> None:
        if not isinstance(task, Task):
            raise TaskError(
                f"the task is a {type(task).__name__}",
                expected="a task such as NarmaTask(10)",
                fix="see openprc.analysis.tasks, or ArrayTask for a target of your own",
                key="task",
            )
        super().__init__(group_name or task.name)
        self.task = task

    def run(
        self,
        trainer: Trainer,
        u_input: ArrayLike,
        *,
        data: TaskData | None = None,
        n_networks: int = NETWORK_SEEDS,
    ) -> Score:
        """Train, score, and score the baselines.

        Parameters
        ----------
        u_input : (n,) or (n, C)
            One row per row of the trainer's clock, per symbol of the file, or per frame.
        data : TaskData, optional
            Input and target of a task that brings its own. The input of the file has to be that
            input, scaled and shifted at most.
        n_networks : int
            Seeds of the echo state network of equal size; 0 leaves it out.

        Raises
        ------
        TaskError
            When the task is not defined on this input, or the body was driven by another one.
        """
        return super().run(trainer, u_input, data=data, n_networks=n_networks)

    def _evaluate(
        self,
        trainer: Trainer,
        u: NDArray[np.float64],
        *,
        data: TaskData | None = None,
        n_networks: int = NETWORK_SEEDS,
    ) -> Evaluated:
        return evaluate_task(self.task, trainer, u, data=data, n_networks=n_networks)


def evaluate_task(
    task: Task,
    trainer: Trainer,
    u: NDArray[np.float64],
    *,
    data: TaskData | None = None,
    n_networks: int = NETWORK_SEEDS,
) -> Evaluated:
    """Train on a task and score the baselines; see `TaskBenchmark`.

    Parameters
    ----------
    u : (R,) or (R, C)
        On the rows of the trainer.
    """
    series = _target(task, trainer, u, data)
    usable = series.usable
    target = series.for_rows(usable)
    trained = trainer.train(target, task_name=task.name, usable=usable)
    baselines = compute_baselines(trainer, u, target, usable=usable, n_networks=n_networks)

    def figure(evaluation: Evaluation) -> float:
        truth = target[evaluation.test_rows]
        return float(np.mean(task.score(truth, evaluation.prediction)))

    body = figure(trained.evaluation)
    metrics: dict[str, Any] = {
        f"{task.name}_nrmse": trained.nrmse,
        f"{task.name}_nmse": trained.nmse,
        f"{task.name}_{task.metric}": body,
        **baselines.figures(figure, body=body, name=task.metric, error=task.metric in _ERRORS),
    }
    if target.shape[1] > 1:
        metrics["per_output"] = task.score(
            target[trained.evaluation.test_rows], trained.evaluation.prediction
        )
    metadata: dict[str, Any] = {
        **({} if data is None else dict(data.metadata)),
        **task.metadata(),
        "metric_definition": METRICS[task.metric],
        "NRMSE_definition": NRMSE_DEFINITION,
        "NMSE_definition": NMSE_DEFINITION,
        "outputs": list(series.names),
        "n_states": len(trained.feature_names),
        "n_train": len(trained.evaluation.train_rows),
        "n_test": len(trained.evaluation.test_rows),
        "row_step": trainer.rows.step,
        "readout": repr(trainer.readout),
        **baselines.metadata(trainer.readout),
    }
    warnings = [
        *trained.warnings,
        *_rows_remark(trainer, usable),
        *baselines.task_remarks(trained.nrmse),
    ]
    if u.ndim == 1:
        warnings += copy_remark(trainer, u)
    if warnings:
        metadata["warnings"] = warnings
    return Evaluated(metrics, metadata, (trained,))


def _rows_remark(trainer: Trainer, usable: NDArray[np.bool_]) -> Iterator[str]:
    split = trainer.split
    used = np.zeros(len(usable), dtype=bool)
    used[split.train_rows] = used[split.test_rows] = True
    missing = int(np.count_nonzero(used & ~usable))
    if missing:
        yield f"{missing} rows of training or test have no target and were left out"


def _target(
    task: Task, trainer: Trainer, u: NDArray[np.float64], data: TaskData | None
) -> TargetSeries:
    if data is None:
        # Some tasks that bring their own input can be read off the stored symbols as well.
        target = getattr(task, "target", None)
        if target is not None:
            series: TargetSeries = target(u)
            return series
        raise TaskError(
            f"{task.name} brings an input of its own",
            expected="the data that the body was driven with",
            fix="data = task.generate(n, rng=seed), drive the body with data.input, and pass "
            "data=data here (--seed on the command line)"
            if task.kind == "own-input"
            else "close the loop: see openprc.reservoir.training.closed_loop",
            key="data",
        )
    first, n_rows = 0, trainer.rows.n_rows
    if trainer.rows.symbols is not None and len(data.input) != n_rows:
        first = trainer.rows.symbols.first
    covered = slice(first, first + n_rows)
    series = data.target
    tail = max(series.n_tail - (len(series) - covered.stop), 0)
    part = TargetSeries(
        series.values[covered],
        n_warmup=max(series.n_warmup - first, 0),
        n_tail=tail,
        names=series.names,
    )
    return replace(data, input=data.input[covered], target=part).target_for(u)
