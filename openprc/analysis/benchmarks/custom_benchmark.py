"""A benchmark of the user's own: any function of a trainer and an input."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.benchmarks.base import Benchmark, Evaluated
from openprc.errors import TaskError
from openprc.reservoir.training.trainer import Trainer

#: ``logic(benchmark, trainer, u_input, **parameters) -> (metrics, metadata)``.
BenchmarkLogic = Callable[..., tuple[Mapping[str, Any], Mapping[str, Any]]]


class CustomBenchmark(Benchmark):
    """Run a function, keep what it returns beside the scores of the other benchmarks.

    Parameters
    ----------
    group_name : str
        Group of metrics.h5.
    benchmark_logic : callable
        ``logic(benchmark, trainer, u_input, **parameters) -> (metrics, metadata)``: metrics are
        numbers or arrays by name, metadata plain values. `u_input` is on the clock of the
        trainer's rows.
    needs_dynamics : bool
        Refuse files of load steps.
    """

    def __init__(
        self, group_name: str, benchmark_logic: BenchmarkLogic, *, needs_dynamics: bool = True
    ) -> None:
        super().__init__(group_name)
        if not callable(benchmark_logic):
            raise TaskError(
                f"benchmark_logic is a {type(benchmark_logic).__name__}",
                expected="a function of (benchmark, trainer, u_input, **parameters)",
                fix="pass the function itself, without calling it",
                key="benchmark_logic",
            )
        self.benchmark_logic = benchmark_logic
        self.needs_dynamics = needs_dynamics

    def _evaluate(self, trainer: Trainer, u: NDArray[Any], **parameters: Any) -> Evaluated:
        returned = self.benchmark_logic(self, trainer, u, **parameters)
        if (
            not isinstance(returned, tuple)
            or len(returned) != 2
            or not all(isinstance(part, Mapping) for part in returned)
        ):
            raise self._wrong(f"the function returned a {type(returned).__name__}")
        metrics, metadata = returned
        for name, value in metrics.items():
            try:
                finite = np.isfinite(np.asarray(value, dtype=np.float64))
            except (TypeError, ValueError):
                raise self._wrong(f"metric {name!r} is {value!r}") from None
            if not finite.all():
                raise self._wrong(f"metric {name!r} is {value!r}")
        return Evaluated(dict(metrics), {**parameters_told(parameters), **metadata})

    def _wrong(self, found: str) -> TaskError:
        return TaskError(
            found,
            expected="(metrics, metadata): finite numbers or arrays by name, and plain values",
            fix="correct what benchmark_logic returns",
            key=f"{self.group_name}/benchmark_logic",
        )


def parameters_told(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return those parameters that can be stored as they are."""
    plain = (bool, int, float, str)
    return {name: value for name, value in parameters.items() if isinstance(value, plain)}
