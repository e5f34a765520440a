# ruff: noqa: TID253, ANN001, ANN201 - compiled: types are those of the caller.
"""A sum of Gaussian blobs, evaluated at any place."""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def evaluate_blobs(x, y, blobs, cell, reach, spread, value, slope_x, slope_y):
    """Sum blobs [x, y, amplitude, sigma] of the cells within `reach` around every place.

    `blobs` is a periodic table (rows, columns, 4), positions relative to the cell in units of
    the cell; `spread` is added to every sigma in squares, as a Gaussian blur does.
    """
    rows, columns = blobs.shape[:2]
    for n in range(x.size):
        column, row = math.floor(x[n] / cell), math.floor(y[n] / cell)
        total = total_x = total_y = 0.0
        for j in range(row - reach, row + reach + 1):
            for i in range(column - reach, column + reach + 1):
                blob = blobs[j % rows, i % columns]
                dx = x[n] - (i + blob[0]) * cell
                dy = y[n] - (j + blob[1]) * cell
                variance = blob[3] * blob[3] + spread * spread
                exponent = 0.5 * (dx * dx + dy * dy) / variance
                if exponent < 18.0:
                    # A blur keeps the volume below a blob, not its height.
                    part = blob[2] * blob[3] * blob[3] / variance * np.exp(-exponent)
                    total += part
                    total_x -= part * dx / variance
                    total_y -= part * dy / variance
        value[n] = total
        slope_x[n] = total_x
        slope_y[n] = total_y
