"""From one file to one score, with every choice made and told."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from openprc.analysis.benchmarks.baseline import NETWORK_SEEDS
from openprc.analysis.benchmarks.choices import (
    Choices,
    choose_input,
    left_out_remark,
    open_trainer,
)
from openprc.analysis.benchmarks.task_benchmark import TaskBenchmark
from openprc.analysis.tasks.narma import NarmaTask
from openprc.analysis.tasks.series import TaskData
from openprc.analysis.tasks.task import Task

_FEW_TEST_ROWS = 100


@dataclass(frozen=True)
class ScoreReport:
    """The score of one file on one task.

    ``figure`` is what the task is judged by (``metric``), ``nrmse`` and ``nmse`` are given for
    every task, all on the test rows. ``baseline`` is the figure of a shift register of
    ``n_taps`` inputs, ``raw_input`` and ``cubic`` those of the present input and a cubic of it,
    ``esn`` that of echo state networks of equal size. ``skill`` is ``1 - e / e0`` of the errors
    of body and shift register, and None where the register is perfect. ``row_step`` is in
    seconds. The paths are None when nothing was written.
    """

    file: str
    run_id: str
    producer: str
    task: str
    metric: str
    figure: float
    nrmse: float
    nmse: float
    baseline: float
    raw_input: float
    cubic: float
    esn: float | None
    skill: float | None
    skill_over_esn: float | None
    n_taps: int
    n_states: int
    n_train: int
    n_test: int
    clock: str
    row_step: float
    input_name: str
    input_column: str
    features: str
    formula: str
    warnings: tuple[str, ...]
    readout_path: Path | None
    metrics_path: Path | None

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, for JSON output."""
        values = asdict(self)
        for name in ("readout_path", "metrics_path"):
            values[name] = None if values[name] is None else str(values[name])
        values["warnings"] = list(self.warnings)
        return values


def score_file(
    path: str | Path,
    choices: Choices | None = None,
    *,
    task: Task | None = None,
    seed: int | None = None,
    n_networks: int = NETWORK_SEEDS,
    experiment_dir: str | Path | None = None,
) -> ScoreReport:
    """Train on a task and score it, on a trajectory file.

    For a NARMA system the input is rescaled to [0, 0.5] by its least and largest value.

    Parameters
    ----------
    path : path-like
        A simulation.h5.
    choices : Choices, optional
        States, readout, clock, spans, input.
    task : Task, optional
        By default NARMA of order 2.
    seed : int, optional
        For a task that brings its own input: that with which the input of this body was made.
    n_networks : int
        Seeds of the echo state network that the body is compared with; 0 leaves it out.
    experiment_dir : path-like, optional
        Where readout.h5 and metrics.h5 go; without it nothing is written.

    Raises
    ------
    MissingInputError
        When the file does not say what drove the body.
    TaskError
        When the file holds load steps, is too short, or does not move, and as
        `TaskBenchmark.run`.
    MissingData
        When states are missing, or there are none.
    """
    choices = choices or Choices()
    task = task or NarmaTask(2)
    with open_trainer(path, choices, experiment_dir=experiment_dir) as trainer:
        loader = trainer.loader
        loader.require_physical_time(task.name)
        loader.input_name(choices.split.input_name or 0)
        chosen = choose_input(trainer, choices.input_column)
        score = TaskBenchmark(task).run(
            trainer,
            chosen.scaled if isinstance(task, NarmaTask) else chosen.values,
            data=_data(task, trainer.rows.symbols.n_total if trainer.rows.symbols else 0, seed),
            n_networks=n_networks,
        )
        if experiment_dir is not None:
            score.save()
        producer = str(loader.trajectory.provenance.get("producer", "unknown"))
        remark = left_out_remark(loader) if choices.features is None else ""
        run_id = loader.run_id
    metrics, metadata = score.metrics, score.metadata
    warnings = list(metadata.get("warnings", ()))
    if remark:
        warnings.append(remark)
    if metadata["n_test"] < _FEW_TEST_ROWS:
        warnings.append(f"only {metadata['n_test']} test rows: the error is uncertain")
    return ScoreReport(
        file=Path(path).name,
        run_id=run_id,
        producer=producer,
        task=task.name,
        metric=task.metric,
        figure=metrics[f"{task.name}_{task.metric}"],
        nrmse=metrics[f"{task.name}_nrmse"],
        nmse=metrics[f"{task.name}_nmse"],
        baseline=metrics[f"baseline_{task.metric}"],
        raw_input=metrics[f"raw_input_{task.metric}"],
        cubic=metrics[f"cubic_{task.metric}"],
        esn=metrics.get(f"esn_{task.metric}"),
        skill=metrics.get("skill"),
        skill_over_esn=metrics.get("skill_over_esn"),
        **{name: metadata[name] for name in ("n_taps", "n_states", "n_train", "n_test")},
        clock=metadata["clock"],
        row_step=metadata["row_step"],
        input_name=chosen.name,
        input_column=chosen.column,
        features=repr(trainer.features),
        formula=metadata["formula"],
        warnings=tuple(warnings),
        readout_path=None if experiment_dir is None else score.readout_path,
        metrics_path=None if experiment_dir is None else score.metrics_path,
    )


def _data(task: Task, n_symbols: int, seed: int | None) -> TaskData | None:
    """Make the data of a task again from its seed, where it is one that brings its own."""
    generate = getattr(task, "generate", None)
    if seed is None or generate is None or isinstance(task, NarmaTask) or not n_symbols:
        return None
    data: TaskData = generate(n_symbols, rng=seed)
    return data
