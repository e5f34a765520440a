"""The NARMA benchmark: an error, and what the input alone would have achieved."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.benchmarks.base import Benchmark, Evaluated, Score
from openprc.analysis.benchmarks.baseline import (
    baseline_readout,
    evaluate_baseline,
    input_cubic,
    shift_register,
    tap_count,
)
from openprc.analysis.tasks.imitation import NARMA_task, narma_system
from openprc.reservoir.features.base import is_constant
from openprc.reservoir.training.result import TrainingResult
from openprc.reservoir.training.scores import NMSE_DEFINITION, NRMSE_DEFINITION
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
    Metrics of order n: ``narma<n>_nrmse`` and ``narma<n>_nmse`` of the body;
    ``baseline_nrmse`` of a linear readout of the last ``n_taps`` inputs on the same rows with
    the same penalty; ``cubic_nrmse`` of a cubic of the present input; and
    ``skill = 1 - nrmse / baseline_nrmse``, which is above 0 when the body computes something
    that a tapped delay line does not.
    """

    def __init__(self, group_name: str = "narma_benchmark") -> None:
        super().__init__(group_name)

    def run(self, trainer: Trainer, u_input: ArrayLike, *, order: int = 2) -> Score:
        """Train, score, and score the baselines.

        Parameters
        ----------
        u_input : (n,)
            Within [0, 0.5]; see `Benchmark.run` for its clock.
        order : int
            2 to 10, 20 or 30.

        Raises
        ------
        TaskError
            When the recursion diverges, the input is out of range or fits no clock, or the
            file is too short or holds load steps.
        """
        return super().run(trainer, u_input, order=order)

    def _evaluate(self, trainer: Trainer, u: NDArray[np.float64], *, order: int = 2) -> Evaluated:
        system = narma_system(order)
        target = NARMA_task(u, order, horizon=1)
        trained = trainer.train(target, task_name=f"narma{order}")
        n_taps = tap_count(order)
        register = evaluate_baseline(trainer, shift_register(u, n_taps), target)
        cubic = evaluate_baseline(trainer, input_cubic(u), target)
        metrics = {
            f"narma{order}_nrmse": trained.nrmse,
            f"narma{order}_nmse": trained.nmse,
            "baseline_nrmse": register.mean_nrmse,
            "baseline_nmse": register.mean_nmse,
            "cubic_nrmse": cubic.mean_nrmse,
            "skill": 1.0 - trained.nrmse / register.mean_nrmse,
        }
        metadata: dict[str, Any] = {
            "narma_order": order,
            "formula": system.formula,
            "source": system.source,
            "alignment": "the state at the end of symbol t is paired with y(t+1)",
            "NRMSE_definition": NRMSE_DEFINITION,
            "NMSE_definition": NMSE_DEFINITION,
            "n_states": len(trained.feature_names),
            "n_train": len(trained.evaluation.train_rows),
            "n_test": len(trained.evaluation.test_rows),
            "row_step": trainer.rows.step,
            "baseline": "linear ridge on the last n_taps inputs and an intercept",
            "n_taps": n_taps,
            "baseline_regularization": baseline_readout(trainer.readout).regularization,
            "readout": repr(trainer.readout),
        }
        warnings = [
            *trained.warnings,
            *_remarks(
                trainer,
                u,
                trained,
                register_nrmse=register.mean_nrmse,
                cubic_nrmse=cubic.mean_nrmse,
            ),
        ]
        if warnings:
            metadata["warnings"] = warnings
        return Evaluated(metrics, metadata, (trained,))


def _remarks(
    trainer: Trainer,
    u: NDArray[np.float64],
    trained: TrainingResult,
    *,
    register_nrmse: float,
    cubic_nrmse: float,
) -> Iterator[str]:
    """Yield remarks on a task that needs no body, and on states that are the input itself."""
    if cubic_nrmse <= register_nrmse:
        yield (
            f"a cubic of the present input alone has an NRMSE of {cubic_nrmse:.3g}, less than the "
            "shift register: on this input the task needs no memory, and the skill shows none"
        )
    elif cubic_nrmse <= trained.nrmse:
        yield f"a cubic of the present input alone does better: its NRMSE is {cubic_nrmse:.3g}"
    copies = input_copies(trainer, u)
    if copies:
        listed = ", ".join(copies[:3]) + (", ..." if len(copies) > 3 else "")
        yield f"{len(copies)} of {len(trained.feature_names)} states follow the input: {listed}"


def input_copies(trainer: Trainer, u: NDArray[np.float64]) -> list[str]:
    """Return the names of the states that are the input (R,) up to scale and offset.

    They are those of driven nodes: measured, and legitimate, but computed by nothing.
    """
    states = trainer.states
    rows, _ = trainer.split.masks(states.usable)
    x = states.values[rows] - states.values[rows].mean(axis=0)
    v = u[rows] - u[rows].mean()
    power = np.einsum("ij,ij->j", x, x) * (v @ v)
    # 1 - r^2 of a copy in single precision is about 1e-13; of the best echo, far above 1e-6.
    copies = (x.T @ v) ** 2 >= (1.0 - 1e-6) * power
    copies &= ~is_constant(states.values[rows])
    return [name for name, flag in zip(states.names, copies, strict=True) if flag]
