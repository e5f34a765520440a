"""The Miura sheet."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.meshing.lattices import grid_sets, quads_of
from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.parameters import between, check_size, count, length
from openprc.demlat.meshing.surface import split_quads, surface_mesh

if TYPE_CHECKING:
    from numpy.typing import NDArray


def miura_sheet(
    columns: int,
    rows: int,
    *,
    a: float,
    b: float,
    sector_angle: float,
    tilt: float,
) -> Mesh:
    """Return a Miura sheet of cells of four equal parallelograms.

    Closed form of Schenk & Guest 2013 (doi:10.1073/pnas.1217998110): with height
    ``h = a sin(sector) sin(tilt)``, ``q = sqrt(1 + cos(tilt)^2 tan(sector)^2)``, half width
    ``s = b cos(tilt) tan(sector) / q``, half length ``l = a sqrt(1 - sin(tilt)^2
    sin(sector)^2)`` and shift ``v = b / q``, node (i, j) is at ``(s i, l j + v (i odd),
    h (j odd))``. The folds along x are bent by ``2 tilt``, those along y by
    ``2 atan(cos(sector) tan(tilt))``.

    Nodes are numbered along y first: panels of one column have their short diagonal in one
    direction.

    Parameters
    ----------
    columns, rows : int
        Cells along x and y; the sheet is ``2 s columns`` wide and ``2 l rows + v`` long.
    a, b : float [m]
        Edges of a panel: a along y, b along the zigzags across it.
    sector_angle : float [rad]
        The acute angle of a panel.
    tilt : float [rad]
        Of the panels against the plane of the sheet: 0 is flat, pi/2 folded shut.

    Examples
    --------
    >>> import math
    >>> from openprc.demlat.meshing import miura_sheet
    >>> mesh = miura_sheet(4, 8, a=0.03, b=0.03, sector_angle=math.pi / 3, tilt=math.pi / 4)
    >>> mesh.n_nodes, len(mesh.bars), len(mesh.hinges)
    (153, 408, 360)
    """
    nx, ny = 2 * count(columns, "columns") + 1, 2 * count(rows, "rows") + 1
    check_size(nx * ny, "columns")
    a, b = length(a, "a"), length(b, "b")
    sector = between(sector_angle, "sector_angle", low=0.0, high=math.pi / 2)
    tilt = between(tilt, "tilt", low=0.0, high=math.pi / 2 * (1 - 1e-12), closed=True)
    number = np.arange(nx * ny).reshape(nx, ny).T
    positions = _positions(nx, ny, a, b, sector, tilt)
    # Which folds are valleys is seen in a folded sheet, and is the same in the flat one.
    folded = _positions(nx, ny, a, b, sector, math.pi / 4)
    triangles, diagonals = split_quads(folded, quads_of(number))
    mesh = surface_mesh(folded, triangles, facets=diagonals)
    return Mesh(
        positions=positions,
        bars=mesh.bars,
        bar_kinds=mesh.bar_kinds,
        hinges=mesh.hinges,
        hinge_kinds=mesh.hinge_kinds,
        senses=mesh.senses,
        faces=triangles,
        node_sets=grid_sets(number),
    )


def _positions(
    nx: int, ny: int, a: float, b: float, sector: float, tilt: float
) -> NDArray[np.float64]:
    i, j = np.divmod(np.arange(nx * ny), ny)
    q = math.sqrt(1.0 + (math.cos(tilt) * math.tan(sector)) ** 2)
    s = b * math.cos(tilt) * math.tan(sector) / q
    l = a * math.sqrt(1.0 - (math.sin(tilt) * math.sin(sector)) ** 2)  # noqa: E741
    v, h = b / q, a * math.sin(sector) * math.sin(tilt)
    return np.stack([s * i, l * j + v * (i % 2), h * (j % 2)], axis=1)
