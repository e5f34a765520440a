"""In which parts of the image a calibration has seen anything."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.vision.calibration.mapping import Array

#: The image is divided into this many parts each way.
CELLS = 6


def covered_cells(pixels: Array, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Return which parts of an image of a height and width [px] hold points, (CELLS, CELLS)."""
    x, y = pixels.T
    seen = np.zeros((CELLS, CELLS), np.bool_)
    column = np.clip((x + 0.5) / shape[1] * CELLS, 0, CELLS - 1).astype(int)
    row = np.clip((y + 0.5) / shape[0] * CELLS, 0, CELLS - 1).astype(int)
    seen[row, column] = True
    return seen
