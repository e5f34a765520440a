"""What the scenes of folded sheets share: bars and hinges of a mesh, with stiffnesses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.schema.geometry import Bars, Hinges

if TYPE_CHECKING:
    from openprc.demlat.meshing import Mesh

#: Within these angles hinges are linear; beyond them they keep panels apart [rad].
LIMITS = np.radians([0.1, 359.9])


def sheet_elements(
    mesh: Mesh, *, modulus: float, fold: float, facet: float, damping: float = 0.0
) -> dict[str, Any]:
    """Return bars and hinges as MERLIN has them, as arguments of `Geometry`.

    Bars are Ogden's with the slope ``E A / L`` at rest, hinges linear between `LIMITS` with a
    stiffness that is proportional to their crease (Liu & Paulino 2017,
    doi:10.1098/rspa.2017.0348); facets rest flat, folds as they are in the mesh.

    Parameters
    ----------
    mesh : Mesh
    modulus : float [N]
        E A of all bars.
    fold, facet : float [N*m/rad per m]
    damping : float [N*s/m]
        Of all bars.
    """
    n_bars, n_hinges = len(mesh.bars), len(mesh.hinges)
    facets = mesh.hinge_kinds == "facet"
    return {
        "bars": Bars(
            indices=mesh.bars,
            stiffness=modulus / mesh.bar_lengths,
            rest_length=mesh.bar_lengths,
            damping=np.full(n_bars, damping),
            law=np.full(n_bars, "ogden"),
        ),
        "hinges": Hinges(
            indices=mesh.hinges,
            stiffness=np.where(facets, facet, fold) * mesh.crease_lengths,
            rest_angle=np.where(facets, np.pi, mesh.rest_angles),
            law=np.full(n_hinges, "enhanced-linear"),
            limit_low=np.full(n_hinges, LIMITS[0]),
            limit_high=np.full(n_hinges, LIMITS[1]),
        ),
        "faces": mesh.faces,
    }
