"""A small run whose every number is known in closed form."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.hooks import Sample

N_BEADS = 6
N_SYMBOLS = 240
FRAMES_PER_SYMBOL = 5
DT = 0.02  # s
SPACING = 1.5e6  # nm
REACH = 2.0e5  # nm


def symbols() -> NDArray[np.float64]:
    """Return the drive, (K, 1), uniform in [-1, 1]."""
    return np.random.default_rng(11).uniform(-1.0, 1.0, (N_SYMBOLS, 1))


def times() -> NDArray[np.float64]:
    """Return the frame times, (T,) [s]."""
    return DT * np.arange(N_SYMBOLS * FRAMES_PER_SYMBOL + 1, dtype=np.float64)


def sideways() -> NDArray[np.float64]:
    """Return how far each bead is displaced, (T, N), in units of `REACH`.

    Bead n is a low pass, ``x' = (u - x) / tau_n``. While the symbol u is held,
    ``x(t) = u + (x(0) - u) exp(-t / tau_n)`` is exact.
    """
    tau = np.geomspace(0.04, 0.5, N_BEADS)
    keep = np.exp(-DT / tau)
    held = np.repeat(symbols()[:, 0], FRAMES_PER_SYMBOL)
    found = np.zeros((len(held) + 1, N_BEADS))
    for row, symbol in enumerate(held):
        found[row + 1] = symbol + (found[row] - symbol) * keep
    return found


def positions() -> NDArray[np.float64]:
    """Return the positions, (T, N, 3) [nm]: a row along x, on a parabola across it."""
    across = sideways()
    found = np.zeros((len(times()), N_BEADS, 3))
    found[:, :, 0] = SPACING * np.arange(N_BEADS)
    found[:, :, 1] = REACH * across**2
    found[:, :, 2] = REACH * across
    return found


def write_sample(folder: Path) -> Sample:
    """Write the run as H5MD into `folder`; the drive has no place there and comes beside."""
    path = Path(folder) / "beads.h5md"
    with h5py.File(path, "w") as file:
        head = file.create_group("h5md")
        head.attrs["version"] = np.array([1, 1], dtype="i4")
        group = file.create_group("particles/beads")
        group.create_group("box").attrs.update(
            {"dimension": np.int32(3), "boundary": np.array([b"none"] * 3)}
        )
        place = group.create_group("position")
        place["step"] = np.int64(1)
        place["time"] = DT
        place["time"].attrs["unit"] = "s"
        place["value"] = positions()
        place["value"].attrs["unit"] = "nm"
        bonds = file.create_dataset(
            "connectivity/bonds", data=np.stack([np.arange(N_BEADS - 1), np.arange(1, N_BEADS)], 1)
        )
        bonds.attrs["particles_group"] = group.ref
    drive = {
        "sequence": symbols(), "hold": DT * FRAMES_PER_SYMBOL, "start": 0.0, "unit": "1",
        "quantity": "drive",
    }  # fmt: skip
    return Sample(path=path, inputs={"u": drive})
