"""XDMF topologies to blocks of cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc_meshio.frames import Cells

#: Name in XDMF, lower case without underscores, to shape and number of nodes.
SHAPES = {
    "polyvertex": ("vertex", 1),
    "polyline": ("line", 2),
    "polygon": ("polygon", 0),
    "triangle": ("triangle", 3),
    "quadrilateral": ("quad", 4),
    "tetrahedron": ("tetra", 4),
    "pyramid": ("pyramid", 5),
    "wedge": ("wedge", 6),
    "hexahedron": ("hexahedron", 8),
    "edge3": ("line3", 3),
    "triangle6": ("triangle6", 6),
    "tri6": ("triangle6", 6),
    "quadrilateral8": ("quad8", 8),
    "quad8": ("quad8", 8),
    "quadrilateral9": ("quad9", 9),
    "quad9": ("quad9", 9),
    "tetrahedron10": ("tetra10", 10),
    "tet10": ("tetra10", 10),
    "hexahedron20": ("hexahedron20", 20),
    "hex20": ("hexahedron20", 20),
    "hexahedron27": ("hexahedron27", 27),
    "hex27": ("hexahedron27", 27),
}
#: Code in a mixed topology to shape and number of nodes; 0: the number comes next.
CODES = {
    1: ("vertex", 0),
    2: ("line", 0),
    3: ("polygon", 0),
    4: ("triangle", 3),
    5: ("quad", 4),
    6: ("tetra", 4),
    7: ("pyramid", 5),
    8: ("wedge", 6),
    9: ("hexahedron", 8),
    34: ("line3", 3),
    35: ("quad9", 9),
    36: ("triangle6", 6),
    37: ("quad8", 8),
    38: ("tetra10", 10),
    48: ("hexahedron20", 20),
    50: ("hexahedron27", 27),
}


def blocks(
    name: str, numbers: NDArray[np.int64], *, width: int | None, path: Path
) -> tuple[Cells, ...]:
    """Return the cells of a topology of type `name`.

    Parameters
    ----------
    name : str
        TopologyType.
    numbers : int array
        What its data item holds.
    width : int, optional
        NodesPerElement.
    path : Path
        For messages.

    Raises
    ------
    UnreadableFile
        When the type is not one of cells between listed nodes, or the numbers do not fit it.
    """
    key = name.lower().replace("_", "")
    if key == "mixed":
        return _mixed(numbers.reshape(-1), path)
    if key not in SHAPES:
        raise UnreadableFile(
            f"a topology of type {name!r}",
            expected="cells that list their nodes: Polyline, Triangle, Quadrilateral, Mixed, ...",
            fix="export an unstructured mesh; grids without listed nodes have no bars",
            file=path,
            key="Topology",
        )
    shape, usual = SHAPES[key]
    if key in ("polyvertex", "polyline", "polygon"):
        stored = numbers.shape[1] if numbers.ndim == 2 else 0
        usual = width or stored or usual
    if usual < 1 or numbers.size % usual:
        raise _damaged(path, f"{numbers.size} numbers for cells of {usual} nodes")
    table = numbers.reshape(-1, usual)
    return (Cells(_named(shape, usual), table),)


def _named(shape: str, width: int) -> str:
    return "polyline" if shape == "line" and width != 2 else shape


def _mixed(numbers: NDArray[np.int64], path: Path) -> tuple[Cells, ...]:
    runs: list[tuple[str, int, list[NDArray[np.int64]]]] = []
    place = 0
    while place < len(numbers):
        shape, width = CODES.get(int(numbers[place]), ("", 0))
        if not shape:
            raise _damaged(path, f"code {int(numbers[place])} at place {place}")
        place += 1
        if not width:
            width = int(numbers[place]) if place < len(numbers) else 0
            place += 1
        if width < 1 or place + width > len(numbers):
            raise _damaged(path, f"a {shape} that ends behind the last number")
        if not runs or runs[-1][:2] != (shape, width):
            runs.append((shape, width, []))
        runs[-1][2].append(numbers[place : place + width])
        place += width
    return tuple(Cells(_named(shape, width), np.array(rows)) for shape, width, rows in runs)


def _damaged(path: Path, found: str) -> UnreadableFile:
    return UnreadableFile(
        f"the topology holds {found}",
        expected="a code and its nodes for every cell of a mixed topology, rows of nodes otherwise",
        fix="export it again",
        file=path,
        key="Topology",
    )
