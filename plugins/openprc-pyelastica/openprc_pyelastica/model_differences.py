"""What a rod has and a chain of bars and bends has not."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from openprc.hooks.protocols import Modelled
from openprc_pyelastica.chains import sort_chains
from openprc_pyelastica.held_parts import held_parts
from openprc_pyelastica.rod_material import RodMaterial, checked_options, material_of
from openprc_pyelastica.runner_scope import findings

if TYPE_CHECKING:
    from openprc.schema import Experiment


def modelled(experiment: Experiment) -> Modelled:
    """Return what is added with the default options; nothing of a chain is left out."""
    if any(finding.level == "error" for finding in findings(experiment)):
        return Modelled(adds=tuple(_law()))
    options = checked_options({})
    chains = sort_chains(experiment.geometry).chains
    rods = [material_of(chain, experiment, options=options) for chain in chains]
    clamped = any(
        held_parts(chain, experiment, clamp=options["clamp"]).carried.any() for chain in chains
    )
    return Modelled(adds=(*_numbers(rods), *_law(), *(_clamp() if clamped else ())))


def _numbers(rods: list[RodMaterial]) -> Iterator[str]:
    largest = max(rod.shear_share for rod in rods)
    yield (
        "shear: an end load deflects a cantilever of that length by"
        f" {largest:.2g} of its bending more (option shear_scale)"
        if math.isfinite(largest)
        else "shear of elements that nothing resists the bending of (option shear_scale)"
    )
    radius = max(rod.radius for rod in rods)
    yield f"rotary inertia of elements with the radius {radius:.3g} m (option radius)"


def _law() -> Iterator[str]:
    yield (
        "a section that thins as it is drawn out: the tension at the strain e is EA e / (1 + e)"
        " (option section=constant)"
    )


def _clamp() -> Iterator[str]:
    yield (
        "a clamp of a node and an element, whose shear moves the second fixed node a little"
        " (option clamp=nodes)"
    )
