"""Statics of bars and hinges: equilibria, their stability, natural modes, and stable states.

The public names are resolved on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from openprc.demlat.statics.assembly import StaticProblem
    from openprc.demlat.statics.equilibrium import Equilibrium, equilibrated, find_equilibrium
    from openprc.demlat.statics.inertia import Stability, stability
    from openprc.demlat.statics.modes import Modes, natural_modes
    from openprc.demlat.statics.search import StableState, StableStates, find_stable_states

_LAZY = {
    "Equilibrium": "openprc.demlat.statics.equilibrium",
    "Modes": "openprc.demlat.statics.modes",
    "Stability": "openprc.demlat.statics.inertia",
    "StableState": "openprc.demlat.statics.search",
    "StableStates": "openprc.demlat.statics.search",
    "StaticProblem": "openprc.demlat.statics.assembly",
    "equilibrated": "openprc.demlat.statics.equilibrium",
    "find_equilibrium": "openprc.demlat.statics.equilibrium",
    "find_stable_states": "openprc.demlat.statics.search",
    "natural_modes": "openprc.demlat.statics.modes",
    "stability": "openprc.demlat.statics.inertia",
}

__all__ = [
    "StaticProblem",
    "Equilibrium",
    "find_equilibrium",
    "equilibrated",
    "Stability",
    "stability",
    "Modes",
    "natural_modes",
    "StableState",
    "StableStates",
    "find_stable_states",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
