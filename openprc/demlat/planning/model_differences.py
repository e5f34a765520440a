"""What the engine's schemes do to a motion besides following it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.stability import step_limit
from openprc.hooks.protocols import Modelled

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment


def modelled(experiment: Experiment) -> Modelled:
    """Return what a run leaves out (nothing: it is refused instead), and what it adds."""
    return Modelled(adds=tuple(_added(experiment)))


def _added(experiment: Experiment) -> Iterator[str]:
    scheme = INTEGRATORS.get(experiment.integrator)
    if scheme is None:
        return
    if scheme.step == "legacy":
        yield "energy, by a scheme of first order that old runs were made with"
        return
    limit = step_limit(experiment)
    if limit.verdict(experiment.dt) == "dissipative":
        yield (
            f"damping by {scheme.name} itself, which takes {limit.loss(experiment.dt):.2g} of the"
            " energy of the fastest mode in a period"
        )
