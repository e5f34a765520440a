"""What decides which schemes a scene admits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from openprc.demlat.contact.findings import can_touch

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment


def is_smooth(experiment: Experiment) -> bool:
    """Say whether a scheme that chooses its steps can run it: no constraints, no impacts."""
    return not (has_constraints(experiment) or can_touch(experiment))


def has_constraints(experiment: Experiment) -> bool:
    """Say whether elements are rigid, or have hard stops."""
    geometry = experiment.geometry
    rigid = geometry.bars.rigid.any() or geometry.hinges.rigid.any()
    return bool(rigid) or has_stops(experiment)


def has_stops(experiment: Experiment) -> bool:
    """Say whether hinges have hard stops."""
    hinges = experiment.geometry.hinges
    return bool((hinges.limited & (hinges.law == "linear")).any())
