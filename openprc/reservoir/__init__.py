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
    "BarStrains": "openprc.reservoir.features.bar_features",
    "Channels": "openprc.reservoir.features.channel_features",
    "DelayTaps": "openprc.reservoir.features.delay_taps",
    "drive_whiteness": "openprc.reservoir.io.whiteness",
    "EchoStateNetwork": "openprc.reservoir.networks.echo_state",
    "ElementSeries": "openprc.reservoir.features.element_features",
    "Feedback": "openprc.reservoir.training.teacher_forcing",
    "fit_generator": "openprc.reservoir.training.teacher_forcing",
    "force_train": "openprc.reservoir.training.force",
    "HingeAngles": "openprc.reservoir.features.element_features",
    "Inputs": "openprc.reservoir.features.input_features",
    "LeastSquares": "openprc.reservoir.readout.least_squares",
    "NodeDisplacements": "openprc.reservoir.features.node_features",
    "NodePositions": "openprc.reservoir.features.node_features",
    "NodeVelocities": "openprc.reservoir.features.node_features",
    "PolynomialExpansion": "openprc.reservoir.features.polynomial_expansion",
    "Readout": "openprc.reservoir.readout.saved",
    "Ridge": "openprc.reservoir.readout.ridge",
    "RLS": "openprc.reservoir.readout.rls",
    "run_closed_loop": "openprc.reservoir.training.closed_loop",
    "Split": "openprc.reservoir.training.split",
    "Stacked": "openprc.reservoir.features.base",
    "StateLoader": "openprc.reservoir.io.state_loader",
    "SymbolClock": "openprc.reservoir.io.symbol_clock",
    "TemporalRidgeCV": "openprc.reservoir.readout.temporal_ridge",
    "train_streamed": "openprc.reservoir.training.streamed",
    "Trainer": "openprc.reservoir.training.trainer",
}

__all__ = sorted(_LAZY)


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
