"""Networks whose properties are known: references that a body is compared with.

Nothing heavy is imported until a name is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_LAZY = {
    "DelayLine": "openprc.reservoir.networks.linear",
    "EchoStateNetwork": "openprc.reservoir.networks.echo_state",
    "LinearNetwork": "openprc.reservoir.networks.linear",
    "reference_network": "openprc.reservoir.networks.baseline",
    "write_network_run": "openprc.reservoir.networks.recording",
}

__all__ = [
    "DelayLine",
    "EchoStateNetwork",
    "LinearNetwork",
    "reference_network",
    "write_network_run",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
