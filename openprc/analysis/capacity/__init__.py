"""Memory capacity and information processing capacity.

Nothing heavy is imported until a name is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_LAZY = {
    "Capacities": "openprc.analysis.capacity.capacities",
    "CapacityWarning": "openprc.analysis.capacity.drive",
    "Terms": "openprc.analysis.capacity.terms",
    "information_processing_capacity": "openprc.analysis.capacity.processing",
    "information_processing_capacity_streamed": "openprc.analysis.capacity.streamed",
    "linear_network_memory": "openprc.analysis.capacity.linear_memory",
    "memory_capacity": "openprc.analysis.capacity.processing",
    "polynomial_rows": "openprc.analysis.capacity.polynomials",
}

__all__ = sorted(_LAZY)


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
