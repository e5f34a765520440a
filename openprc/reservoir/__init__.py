"""The learning layer: trajectory to states, states to a trained linear readout.

Nothing heavy is imported until a name is used::

    from openprc.reservoir import NodeDisplacements, Ridge, StateLoader, Trainer
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_LAZY = {
    "BarExtensions": "openprc.reservoir.features.bar_features",
    "BarLengths": "openprc.reservoir.features.bar_features",
    "Channels": "openprc.reservoir.features.channel_features",
    "NodeDisplacements": "openprc.reservoir.features.node_features",
    "NodePositions": "openprc.reservoir.features.node_features",
    "Readout": "openprc.reservoir.readout.saved",
    "Ridge": "openprc.reservoir.readout.ridge",
    "Split": "openprc.reservoir.training.split",
    "StateLoader": "openprc.reservoir.io.state_loader",
    "SymbolClock": "openprc.reservoir.io.symbol_clock",
    "Trainer": "openprc.reservoir.training.trainer",
}

__all__ = [
    "BarExtensions",
    "BarLengths",
    "Channels",
    "NodeDisplacements",
    "NodePositions",
    "Readout",
    "Ridge",
    "Split",
    "StateLoader",
    "SymbolClock",
    "Trainer",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
