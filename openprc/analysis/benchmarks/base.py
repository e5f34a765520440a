"""What benchmarks share: an input brought to the clock of the rows, and a score to keep."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc import __version__
from openprc.errors import TaskError
from openprc.reservoir.training.result import TrainingResult
from openprc.reservoir.training.trainer import Trainer
from openprc.schema import Provenance, results


@dataclass(frozen=True)
class Evaluated:
    """What the logic of a benchmark returns: numbers, remarks, and the readouts it trained."""

    metrics: Mapping[str, Any]
    metadata: Mapping[str, Any]
    trained: tuple[TrainingResult, ...] = ()


@dataclass(frozen=True)
class Score:
    """The outcome of a benchmark.

    Parameters
    ----------
    group_name : str
        Group of metrics.h5.
    metrics : mapping
        Name to number or array.
    metadata : mapping
        How they were come by: plain values and lists of text.
    trained : tuple of TrainingResult
    trainer : Trainer
    """

    group_name: str
    metrics: Mapping[str, Any]
    metadata: Mapping[str, Any]
    trained: tuple[TrainingResult, ...]
    trainer: Trainer

    @property
    def readout_path(self) -> Path:
        """Where `save` puts the (first) readout.

        Raises
        ------
        TaskError
            When the benchmark trained none, or the trainer has no experiment folder.
        """
        if not self.trained:
            raise TaskError(
                f"the benchmark {self.group_name!r} trained no readout",
                expected="a benchmark that trains one",
                fix="read the numbers from metrics",
                key="readout_path",
            )
        return self.trained[0].readout_path

    @property
    def metrics_path(self) -> Path:
        """Where `save` puts the numbers: ``<experiment_dir>/metrics/metrics.h5``.

        Raises
        ------
        TaskError
            When the trainer has no experiment folder.
        """
        if self.trainer.experiment_dir is None:
            raise TaskError(
                "the trainer has no experiment_dir, so there is no place to write to",
                expected="a folder",
                fix="pass experiment_dir to Trainer",
                key="experiment_dir",
            )
        return self.trainer.experiment_dir / "metrics" / "metrics.h5"

    def save(self) -> Path:
        """Write readouts and numbers, and return the path of metrics.h5.

        An earlier group of the same name is replaced; other groups stay.
        """
        path = self.metrics_path
        for result in self.trained:
            result.save()
        loader = self.trainer.loader
        return results.add_group(
            path,
            self.group_name,
            attrs={"source_run_id": loader.run_id, **self.metadata},
            arrays=self.metrics,
            provenance=Provenance(
                "openprc.analysis",
                producer_version=__version__,
                plugin_version=__version__,
                config=self.trainer.settings(),
                parents=(loader.run_id,),
            ),
        )


class Benchmark(ABC):
    """A named measurement on a trainer and the input of its body.

    Parameters
    ----------
    group_name : str
        Group of metrics.h5 that the score is written to.
    """

    #: Whether the measurement is about memory, and so needs physical time.
    needs_dynamics = True
    #: Whether the input is used at all, and may have several columns.
    needs_input = True
    multi_input = False

    def __init__(self, group_name: str) -> None:
        if not group_name or "/" in group_name or group_name.startswith("."):
            raise TaskError(
                f"the group name is {group_name!r}",
                expected="a name without '/'",
                fix="choose such a name",
                key="group_name",
            )
        self.group_name = group_name

    def run(self, trainer: Trainer, u_input: ArrayLike | None = None, **parameters: Any) -> Score:
        """Measure and return the score; nothing is written before `Score.save`.

        Parameters
        ----------
        u_input : (n,), or (n, C) where several columns make sense
            One row per row of the trainer's clock, or per frame. On a clock of symbols an
            input given per frame is read once per symbol, and the metadata say so.

        Raises
        ------
        TaskError
            When the input fits neither clock, or the file holds load steps.
        """
        if self.needs_dynamics:
            trainer.loader.require_physical_time(self.group_name)
        u, note = self._input(trainer, u_input)
        if u.ndim > 1 and not self.multi_input:
            raise TaskError(
                f"the input has shape {u.shape}",
                expected="one value per row, (n,)",
                fix="choose one column",
                key="u_input",
            )
        evaluated = self._evaluate(trainer, u, **parameters)
        metadata = {"clock": trainer.rows.kind, **evaluated.metadata}
        if note:
            metadata["input_note"] = note
        return Score(self.group_name, evaluated.metrics, metadata, evaluated.trained, trainer)

    def _input(self, trainer: Trainer, u_input: ArrayLike | None) -> tuple[NDArray[Any], str]:
        if not self.needs_input:
            return np.empty(0), ""
        if u_input is None:
            raise TaskError(
                f"{self.group_name}: no input was given",
                expected="what drove the body, one row per row of the clock",
                fix="pass trainer.loader.get_actuation_signal(0, dof)",
                key="u_input",
            )
        return trainer.align_input(u_input)

    @abstractmethod
    def _evaluate(self, trainer: Trainer, u: NDArray[Any], **parameters: Any) -> Evaluated:
        """Measure on an input (R,) that is on the clock of the rows."""
