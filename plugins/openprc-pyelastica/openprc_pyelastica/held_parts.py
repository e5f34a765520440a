"""What of a rod is held: nodes, and elements that cannot turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema import Experiment
    from openprc_pyelastica.chains import Chain


@dataclass(frozen=True, eq=False)
class Held:
    """Held parts of one rod.

    Parameters
    ----------
    nodes : (n + 1,) bool
        Nodes that stay where they are.
    elements : (n,) bool
        Elements whose directors stay what they are.
    carried : (n + 1,) bool
        Nodes that the experiment fixes and that a clamped element carries: they move with its
        shear and stretch.
    """

    nodes: NDArray[np.bool_]
    elements: NDArray[np.bool_]
    carried: NDArray[np.bool_]


def held_parts(chain: Chain, experiment: Experiment, *, clamp: str) -> Held:
    """Return what is held of the rod of a chain.

    Two neighbouring fixed nodes hold the element between them. With ``clamp="element"`` two or
    more fixed nodes at an end of the chain hold all but the innermost one of them, as PyElastica's
    ``OneEndFixedBC`` does with node 0 and element 0.
    """
    fixed = experiment.geometry.fixed[chain.nodes]
    nodes = fixed.copy()
    elements = fixed[:-1] & fixed[1:]
    carried = np.zeros_like(fixed)
    if clamp == "element" and not fixed.all():
        for order in (slice(None), slice(None, None, -1)):
            run = int(np.argmin(fixed[order]))  # fixed nodes at this end
            if run >= 2:
                carried[order][run - 1] = True
    nodes &= ~carried
    return Held(nodes, elements, carried)
