"""The schemes, one module each; this page is what there is to choose from.

Nothing is compiled and no compiler is imported before a scheme is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from openprc.errors import ConfigError


class Settings(NamedTuple):
    """What a scheme may need to know besides the body; times in units of the engine.

    Attributes
    ----------
    h : float
        Fixed step, or the first one of a scheme that chooses its step.
    frame_time : float
    tolerance : float
        Relative error per step of schemes that choose it.
    constraint_tolerance : float
        Relative violation of rigid elements.
    ledger : bool
        Whether powers are kept.
    limit : float
        Coordinates beyond it mean that the run has diverged.
    """

    h: float
    frame_time: float
    tolerance: float = 1e-6
    constraint_tolerance: float = 1e-13
    ledger: bool = True
    limit: float = float("inf")


@dataclass(frozen=True)
class Integrator:
    """A scheme.

    Parameters
    ----------
    name : str
        What stands in ``simulation.integrator``.
    order : int
        Of convergence, for smooth drives.
    path : str
        ``module:class`` of its work arrays, which have ``for_body(body, settings)``; for
        "legacy" the function that yields the frames.
    stages : int
        Evaluations of all forces in a step.
    step : {"fixed", "adaptive", "legacy"}
        "legacy" is a program of its own, which shares nothing with the others.
    rigid : {"no", "exact", "projected"}
        What it does with rigid bars and hinges: refuse them, solve for them to tolerance, or
        project the state after each step, which costs order.
    stability : {"rk4", "verlet", "pefrl", "none"}
        Whose limit on the step applies; see `openprc.demlat.planning.stability`.
    use : str
        When to choose it.
    stops : bool
        Whether hinges may have hard stops.
    vectors : bool
        Whether it can step many elements, or scenes, at once.
    """

    name: str
    order: int
    path: str
    stages: int
    use: str
    step: Literal["fixed", "adaptive", "legacy"] = "fixed"
    rigid: Literal["no", "exact", "projected"] = "no"
    stability: Literal["rk4", "verlet", "pefrl", "none"] = "none"
    stops: bool = False
    vectors: bool = True

    def load(self) -> Any:
        """Return the class of the scheme's work arrays."""
        module, _, name = self.path.partition(":")
        return getattr(import_module(module), name)


_HERE = "openprc.demlat.integrators"
INTEGRATORS: Mapping[str, Integrator] = MappingProxyType(
    {
        scheme.name: scheme
        for scheme in (
            Integrator(
                name="rk4",
                order=4,
                path=f"{_HERE}.rk4:RK4",
                stages=4,
                stability="rk4",
                use="damped bodies at a fixed step; the default",
            ),
            Integrator(
                name="verlet",
                order=2,
                path=f"{_HERE}.verlet:Verlet",
                stages=1,
                stability="verlet",
                use="long undamped runs and coarse answers: one evaluation a step",
            ),
            Integrator(
                name="pefrl",
                order=4,
                path=f"{_HERE}.pefrl:PEFRL",
                stages=4,
                stability="pefrl",
                use="long undamped runs, accurately; with damping a step takes 16 evaluations",
            ),
            Integrator(
                name="respa",
                order=2,
                path=f"{_HERE}.respa:RESPA",
                stages=1,
                use="stiff bars, soft hinges: dt is the step of the hinges, bars take shorter ones",
            ),
            Integrator(
                name="rattle",
                order=2,
                path=f"{_HERE}.rattle:Rattle",
                stages=1,
                rigid="exact",
                stability="verlet",
                use="rigid bars and hinges; long runs keep their energy",
            ),
            Integrator(
                name="rk4-dae",
                order=4,
                path=f"{_HERE}.rk4_dae:ConstrainedRK4",
                stages=4,
                rigid="exact",
                stability="rk4",
                use="rigid bars and hinges, accurately",
            ),
            Integrator(
                name="rk4-projection",
                order=2,
                path=f"{_HERE}.rk4_projection:ProjectedRK4",
                stages=4,
                rigid="projected",
                stops=True,
                stability="rk4",
                use="rigid bars and hinges, and hinges with hard stops: the paper's hybrid",
            ),
            Integrator(
                name="midpoint",
                order=2,
                path=f"{_HERE}.midpoint:Midpoint",
                stages=4,
                vectors=False,
                use="very stiff bodies and slow loads: stable at any step",
            ),
            Integrator(
                name="rk45",
                order=5,
                path=f"{_HERE}.rk45:RK45",
                stages=6,
                step="adaptive",
                use="smooth motion to a tolerance of 1e-3 to 1e-5",
            ),
            Integrator(
                name="dop853",
                order=8,
                path=f"{_HERE}.dop853:DOP853",
                stages=12,
                step="adaptive",
                use="smooth motion to a tolerance of 1e-5 and less; the most exact one",
            ),
            Integrator(
                name="legacy",
                order=1,
                path="openprc.demlat.legacy.run:legacy_blocks",
                stages=4,
                step="legacy",
                use="reproducing runs that openprc up to 0.1.1 stored, and nothing else",
            ),
        )
    }
)


def find_integrator(name: str) -> Integrator:
    """Return the scheme of that name.

    Raises
    ------
    ConfigError
        When there is none.
    """
    if name not in INTEGRATORS:
        raise ConfigError(
            f"the integrator {name!r}",
            expected="one of " + ", ".join(INTEGRATORS),
            key="simulation.integrator",
        )
    return INTEGRATORS[name]
