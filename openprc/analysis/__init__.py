"""Characterisation: tasks, benchmarks with their baselines, and plots.

Nothing heavy is imported until a name is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_LAZY = {
    "NARMABenchmark": "openprc.analysis.benchmarks.narma_benchmark",
    "NARMA_task": "openprc.analysis.tasks.imitation",
    "TimeSeriesComparison": "openprc.analysis.visualization.time_series",
    "score_file": "openprc.analysis.benchmarks.report",
}

__all__ = ["NARMABenchmark", "NARMA_task", "TimeSeriesComparison", "score_file"]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
