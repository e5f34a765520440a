"""Cell types of VTK, as its files number them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from openprc_meshio.frames import Cells

Ints = NDArray[np.int64]

#: Cell types to shapes; strips, pixels and voxels are handled apart.
SHAPES = {
    1: "vertex", 2: "vertex", 3: "line", 4: "polyline", 5: "triangle", 7: "polygon", 9: "quad",
    10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid", 21: "line3", 22: "triangle6",
    23: "quad8", 24: "tetra10", 25: "hexahedron20", 28: "quad9", 29: "hexahedron27",
}  # fmt: skip
#: The four kinds of cells of polygonal data, in the order in which VTK counts them.
POLYDATA = {"Verts": 2, "Lines": 4, "Polys": 7, "Strips": 6}
_SHORT = {("polyline", 2): "line", ("polygon", 3): "triangle", ("polygon", 4): "quad"}


def split(types: Ints, ends: Ints, nodes: Ints) -> Iterator[tuple[Cells, Ints]]:
    """Yield blocks of cells of one shape, and the rows of the file that they are.

    Parameters
    ----------
    types : (E,) int
    ends : (E + 1,) int
        Where every cell begins in `nodes`, and where the last one ends.
    nodes : (n,) int
    """
    widths = np.diff(ends)
    for code, width in sorted({*zip(types.tolist(), widths.tolist(), strict=True)}):
        rows = np.flatnonzero((types == code) & (widths == width))
        yield _block(code, nodes[ends[rows][:, np.newaxis] + np.arange(width)]), rows


def fits(ends: Ints, nodes: Ints) -> bool:
    """Tell whether offsets cut the list of nodes into cells."""
    whole = len(ends) > 0 and ends[0] == 0 and ends[-1] == len(nodes)
    return bool(whole and (np.diff(ends) > 0).all())


def _block(code: int, table: Ints) -> Cells:
    # Pixels and voxels count their corners by rows.
    if code == 8:
        return Cells("quad", table[:, [0, 1, 3, 2]])
    if code == 11:
        return Cells("hexahedron", table[:, [0, 1, 3, 2, 4, 5, 7, 6]])
    shape = SHAPES.get(code, f"vtk{code}x")
    return Cells(_SHORT.get((shape, table.shape[1]), shape), table)
