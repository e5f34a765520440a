"""Meshes: lattices, origami, kirigami and slender bodies, generated or read from files.

Every generator returns a `Mesh`, which `Mesh.to_setup` adds to a `SimulationSetup`. Public
names are resolved on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from openprc.demlat.meshing.cones import k_cone
    from openprc.demlat.meshing.delaunay import delaunay_lattice
    from openprc.demlat.meshing.fold_file import read_fold
    from openprc.demlat.meshing.kirigami import kirigami_sheet
    from openprc.demlat.meshing.lattices import (
        hexagonal_lattice,
        square_lattice,
        triangular_lattice,
    )
    from openprc.demlat.meshing.mesh import Mesh
    from openprc.demlat.meshing.miura import miura_sheet
    from openprc.demlat.meshing.obj_file import read_obj
    from openprc.demlat.meshing.slab import bistable_slab
    from openprc.demlat.meshing.slender import chain, rod, rod_constants, tapered_spring
    from openprc.demlat.meshing.surface import surface_mesh
    from openprc.demlat.meshing.svg_file import read_svg
    from openprc.demlat.meshing.towers import kresling, kresling_second_state, yoshimura
    from openprc.demlat.meshing.waterbomb_sheet import waterbomb

_LAZY = {
    "Mesh": "mesh",
    "bistable_slab": "slab",
    "chain": "slender",
    "delaunay_lattice": "delaunay",
    "hexagonal_lattice": "lattices",
    "k_cone": "cones",
    "kirigami_sheet": "kirigami",
    "kresling": "towers",
    "kresling_second_state": "towers",
    "miura_sheet": "miura",
    "read_fold": "fold_file",
    "read_obj": "obj_file",
    "read_svg": "svg_file",
    "rod": "slender",
    "rod_constants": "slender",
    "square_lattice": "lattices",
    "surface_mesh": "surface",
    "tapered_spring": "slender",
    "triangular_lattice": "lattices",
    "waterbomb": "waterbomb_sheet",
    "yoshimura": "towers",
}

__all__ = [
    "Mesh",
    "bistable_slab",
    "chain",
    "delaunay_lattice",
    "hexagonal_lattice",
    "k_cone",
    "kirigami_sheet",
    "kresling",
    "kresling_second_state",
    "miura_sheet",
    "read_fold",
    "read_obj",
    "read_svg",
    "rod",
    "rod_constants",
    "square_lattice",
    "surface_mesh",
    "tapered_spring",
    "triangular_lattice",
    "waterbomb",
    "yoshimura",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
