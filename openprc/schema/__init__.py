"""The file contract: one table, one writer, one reader.

`TrajectoryWriter` makes a ``simulation.h5``, `Trajectory` reads it, `validate_file` says what is
wrong with one. Needs numpy and h5py only; the configuration models load pydantic on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from openprc.schema.findings import Finding
from openprc.schema.layout import SCHEMA_VERSION
from openprc.schema.units import UNITS

_LAZY = {
    "Experiment": "openprc.schema.experiment",
    "InputSignal": "openprc.schema.trajectory",
    "Provenance": "openprc.schema.provenance",
    "Report": "openprc.schema.validate",
    "Trajectory": "openprc.schema.trajectory",
    "TrajectoryWriter": "openprc.schema.writer",
    "load_experiment": "openprc.schema.experiment",
    "save_experiment": "openprc.schema.experiment",
    "validate_file": "openprc.schema.validate",
}

__all__ = [
    "SCHEMA_VERSION",
    "UNITS",
    "Experiment",
    "Finding",
    "InputSignal",
    "Provenance",
    "Report",
    "Trajectory",
    "TrajectoryWriter",
    "load_experiment",
    "save_experiment",
    "validate_file",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
