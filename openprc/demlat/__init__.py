"""The native engine: bodies of nodes, bars and hinges, integrated in time.

The public names are resolved on first use, so importing this package costs nothing and
building an experiment does not wait for a compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from openprc.demlat import meshing, signals, statics
    from openprc.demlat.engine import Engine
    from openprc.demlat.ensemble import EnsembleResult, run_ensemble
    from openprc.demlat.models.barhinge.model import BarHingeModel
    from openprc.demlat.planning.plan import make_plan
    from openprc.demlat.scaling import SimulationScaler
    from openprc.demlat.sensors import Sensors
    from openprc.demlat.setup import SimulationSetup
    from openprc.demlat.simulation import Simulation
    from openprc.demlat.stepping import SteppedExperiment

_LAZY = {
    "BarHingeModel": "openprc.demlat.models.barhinge.model",
    "Engine": "openprc.demlat.engine",
    "Simulation": "openprc.demlat.simulation",
    "EnsembleResult": "openprc.demlat.ensemble",
    "SimulationScaler": "openprc.demlat.scaling",
    "SimulationSetup": "openprc.demlat.setup",
    "Sensors": "openprc.demlat.sensors",
    "SteppedExperiment": "openprc.demlat.stepping",
    "make_plan": "openprc.demlat.planning.plan",
    "run_ensemble": "openprc.demlat.ensemble",
}

_MODULES = ("meshing", "signals", "statics")

__all__ = [
    "BarHingeModel",
    "Engine",
    "EnsembleResult",
    "Sensors",
    "Simulation",
    "SimulationScaler",
    "SimulationSetup",
    "SteppedExperiment",
    "make_plan",
    "meshing",
    "run_ensemble",
    "signals",
    "statics",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"openprc.demlat.{name}")
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
