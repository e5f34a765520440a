"""The plugin contract: hooks, the records they return, and the registry that collects them.

The registry and what acts on it are imported on first use, so that a plugin's entry module,
which needs only the markers and the records, stays light.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from openprc.hooks.hookspecs import GROUP, PLUGIN_API, RECORDS, hookimpl
from openprc.hooks.protocols import Sample
from openprc.hooks.specs import (
    BenchmarkSpec,
    CodeSpec,
    DetectorSpec,
    ExporterSpec,
    ExtensionSpec,
    FeatureSpec,
    OptionSpec,
    ProducerSpec,
    ReadoutSpec,
    TaskSpec,
)

_LAZY = {
    "Registry": "openprc.hooks.registry",
    "default_registry": "openprc.hooks.registry",
    "export_file": "openprc.hooks.exporting",
    "import_file": "openprc.hooks.importing",
    "record_run": "openprc.hooks.recording",
    "run_experiment": "openprc.hooks.running",
}

__all__ = [
    "GROUP",
    "PLUGIN_API",
    "RECORDS",
    "BenchmarkSpec",
    "CodeSpec",
    "DetectorSpec",
    "ExporterSpec",
    "ExtensionSpec",
    "FeatureSpec",
    "OptionSpec",
    "ProducerSpec",
    "ReadoutSpec",
    "Registry",
    "Sample",
    "TaskSpec",
    "default_registry",
    "export_file",
    "hookimpl",
    "import_file",
    "record_run",
    "run_experiment",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
