"""A small run whose every number is known in closed form: a strip that follows its drive."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.hooks import Sample

N_COLUMNS = 6
N_SYMBOLS = 240
DT = 0.02  # s, time between two steps
STEPS_PER_SYMBOL = 5
HOLD = 0.1  # s
SPACING = 10.0  # mm
AMPLITUDE = 2.0  # mm


def symbols() -> NDArray[np.float64]:
    """Return the drive, (K, 1), uniform in [-1, 1]."""
    return np.random.default_rng(2026).uniform(-1.0, 1.0, (N_SYMBOLS, 1))


def times() -> NDArray[np.float64]:
    """Return the time of every step, (T,) [s]."""
    return DT * np.arange(N_SYMBOLS * STEPS_PER_SYMBOL + 1, dtype=np.float64)


def rest() -> NDArray[np.float64]:
    """Return the points of the flat strip, (N, 3) [mm]: two rows of `N_COLUMNS`."""
    x, y = np.meshgrid(np.arange(N_COLUMNS) * SPACING, [0.0, SPACING])
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def triangles() -> NDArray[np.int64]:
    """Return the cells, (F, 3)."""
    cells = []
    for k in range(N_COLUMNS - 1):
        a, b, c, d = k, k + 1, k + N_COLUMNS, k + 1 + N_COLUMNS
        cells += [[a, b, d], [a, d, c]]
    return np.array(cells, dtype=np.int64)


def deflection() -> NDArray[np.float64]:
    """Return the height of every column of points, (T, C) [mm].

    Column c follows the symbol u held at the time as z' = w_c (A u - z), with a rate w_c that
    falls along the strip; while u is constant z(t) = A u + (z0 - A u) exp(-w_c t), so going
    from step to step with it is exact.
    """
    rate = np.geomspace(40.0, 2.0, N_COLUMNS)
    decay = np.exp(-rate * DT)
    drive = np.append(np.repeat(symbols()[:, 0], STEPS_PER_SYMBOL), symbols()[-1, 0])
    z = np.zeros((len(times()), N_COLUMNS))
    for i in range(1, len(z)):
        target = AMPLITUDE * drive[i - 1]
        z[i] = target + (z[i - 1] - target) * decay
    return z


def positions() -> NDArray[np.float64]:
    """Return the places of the points, (T, N, 3) [mm]."""
    return rest() + displacements()


def displacements() -> NDArray[np.float64]:
    """Return what the file holds, (T, N, 3) [mm]."""
    lifted = np.zeros((len(times()), 2 * N_COLUMNS, 3))
    lifted[:, :, 2] = np.tile(deflection(), (1, 2))
    return lifted


def write_sample(folder: Path) -> Sample:
    """Write the run as finite-element programs do: one mesh, a field ``u`` for every step."""
    path = Path(folder) / "strip.xdmf"
    points, cells, moved = rest(), triangles(), displacements()
    with h5py.File(path.with_suffix(".h5"), "w") as heavy:
        heavy["mesh/points"], heavy["mesh/cells"] = points, cells
        for index, values in enumerate(moved):
            heavy[f"u/{index}"] = values
    mesh = (
        f'<Topology TopologyType="Triangle" NumberOfElements="{len(cells)}">'
        f"{_item(cells.shape, 'mesh/cells', 'Int')}</Topology>"
        f'<Geometry GeometryType="XYZ">{_item(points.shape, "mesh/points", "Float")}</Geometry>'
    )
    pointer = quoteattr("xpointer(/Xdmf/Domain/Grid[1]/*[self::Topology or self::Geometry])")
    steps = "".join(
        f'<Grid Name="step"><include xmlns="http://www.w3.org/2001/XInclude" xpointer={pointer}/>'
        f'<Time Value="{time!r}"/><Attribute Name="u" AttributeType="Vector" Center="Node">'
        f"{_item(points.shape, f'u/{index}', 'Float')}</Attribute></Grid>\n"
        for index, time in enumerate(times().tolist())
    )
    path.write_text(
        f'<?xml version="1.0"?>\n<Xdmf Version="3.0"><Domain>\n<Grid Name="mesh">{mesh}</Grid>\n'
        '<Grid Name="steps" GridType="Collection" CollectionType="Temporal">\n'
        f"{steps}</Grid></Domain></Xdmf>\n",
        encoding="utf-8",
    )
    drive = {"sequence": symbols(), "hold": HOLD, "start": 0.0, "unit": "1", "quantity": "drive"}
    return Sample(path=path, options={"unit": "mm"}, inputs={"u": drive})


def _item(shape: tuple[int, ...], inner: str, number: str) -> str:
    size = " ".join(map(str, shape))
    return (
        f'<DataItem Format="HDF" NumberType="{number}" Precision="8" Dimensions="{size}">'
        f"strip.h5:/{inner}</DataItem>"
    )
