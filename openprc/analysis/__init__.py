"""Characterisation: tasks, benchmarks with their baselines, and plots.

Nothing heavy is imported until a name is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_LAZY = {
    "CustomBenchmark": "openprc.analysis.benchmarks.custom_benchmark",
    "MemoryBenchmark": "openprc.analysis.benchmarks.memory_benchmark",
    "NARMA_task": "openprc.analysis.tasks.imitation",
    "NARMABenchmark": "openprc.analysis.benchmarks.narma_benchmark",
    "score_file": "openprc.analysis.benchmarks.report",
    "StandardSuite": "openprc.analysis.benchmarks.standard_suite",
    "TaskBenchmark": "openprc.analysis.benchmarks.task_benchmark",
    "TimeSeriesComparison": "openprc.analysis.visualization.time_series",
}

__all__ = sorted(_LAZY)


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
