"""A sheet with staggered slits, which opens when it is pulled."""

from __future__ import annotations

import numpy as np

from openprc.demlat.meshing.cutting import cut_along
from openprc.demlat.meshing.lattices import grid, grid_positions, grid_sets, quads_of
from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.parameters import count, length
from openprc.demlat.meshing.surface import split_quads, surface_mesh
from openprc.errors import ConfigError


def kirigami_sheet(
    columns: int,
    rows: int,
    *,
    spacing: float,
    slit: int,
    bridge: int,
    slit_rows: int = 1,
) -> Mesh:
    """Return a flat sheet with rows of parallel slits along x, shifted from row to row.

    Pulled along y, such a sheet first stretches in its plane and then buckles out of it, and
    becomes soft (Isobe & Okumura 2016, doi:10.1038/srep24758). All hinges are facets: the
    sheet has cuts and no folds.

    Parameters
    ----------
    columns, rows : int
        Square cells along x and y, each of two triangles.
    spacing : float [m]
        Side of a cell.
    slit, bridge : int
        Cells that a slit is long (at least 2, so that it can open), and cells between two
        slits of a row; their sum is even, and every second row is shifted by half of it.
    slit_rows : int
        Cells between two rows of slits.

    Raises
    ------
    ConfigError
        When the sum of slit and bridge is odd, or no slit lies in the sheet.
    """
    across, up = count(columns, "columns"), count(rows, "rows")
    cut, gap, apart = (
        count(slit, "slit", least=2),
        count(bridge, "bridge"),
        count(slit_rows, "slit_rows"),
    )
    if (cut + gap) % 2:
        raise ConfigError(
            f"slits of {cut} cells and bridges of {gap}",
            expected="an even sum, since every second row is shifted by half of it",
            key="bridge",
        )
    number = grid(across + 1, up + 1)
    positions = grid_positions(across + 1, up + 1) * length(spacing, "spacing")
    triangles, _ = split_quads(positions, quads_of(number), short=False)
    cuts = [
        (number[row, column], number[row, column + 1])
        for turn, row in enumerate(range(apart, up, apart))
        for column in range(across)
        if (column + (turn % 2) * (cut + gap) // 2) % (cut + gap) < cut
    ]
    if not cuts:
        raise ConfigError(
            f"no slit in {up} rows of cells",
            expected="rows above slit_rows, so that there is a line inside the sheet",
            key="slit_rows",
        )
    torn, origin = cut_along(number.size, triangles, cuts)
    sets = {
        name: np.flatnonzero(np.isin(origin, nodes))
        for name, nodes in grid_sets(number).items()
        if name != "boundary"
    }
    bars = torn[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return surface_mesh(positions[origin], torn, facets=bars, node_sets=sets)
