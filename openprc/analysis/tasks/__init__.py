"""Tasks: targets computed from input, inputs with their targets, and movements to generate.

Nothing heavy is imported until a name is used::

    from openprc.analysis.tasks import DelayRecallTask, NarmaTask, ParityTask
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_ROOM = "openprc.analysis.tasks."
_LAZY = {
    "NARMA_task": "imitation",
    "narma_system": "imitation",
    "NarmaTask": "narma",
    "bounded_input": "narma",
    "DelayRecallTask": "recall",
    "ParityTask": "recall",
    "VolterraTask": "volterra",
    "ArrayTask": "own_target",
    "FunctionTask": "own_target",
    "array_task": "own_target",
    "ChannelEqualizationTask": "equalization",
    "PredictionTask": "prediction",
    "mackey_glass_task": "prediction",
    "lorenz_task": "prediction",
    "henon_task": "prediction",
    "load_series": "series_file",
    "MackeyGlass": "chaotic_series",
    "Lorenz": "chaotic_series",
    "Henon": "chaotic_series",
    "SineSquareTask": "waveforms",
    "InverseArmTask": "arm",
    "TwoLinkArm": "arm",
    "VanDerPolTask": "limit_cycles",
    "QuadraticLimitCycleTask": "limit_cycles",
    "LissajousTask": "limit_cycles",
    "compare_cycles": "cycle_measures",
    "cycle_period": "cycle_measures",
    "orbit_distance": "cycle_measures",
    "Task": "task",
    "ImitationTask": "task",
    "SourcedTask": "task",
    "GenerationTask": "task",
    "TargetSeries": "series",
    "TaskData": "series",
    "METRICS": "scoring",
    "score": "scoring",
}

__all__ = list(_LAZY)


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_ROOM + _LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
