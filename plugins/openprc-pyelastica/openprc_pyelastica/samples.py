"""A small recorded run, shipped with the package, for the demo and the tests."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from openprc.hooks import Sample

RECORDED = Path(__file__).parent / "data" / "driven_cantilever.npz"

#: Duration of one symbol of the shipped run [s].
HOLD = 0.2


def write_sample(folder: Path) -> Sample:
    """Copy the shipped run into `folder`.

    It is a clamped, hanging rod of 10 elements, pushed sideways at its middle by 600 random
    symbols; ``record_sample.py`` beside the package made it with PyElastica 1.0.0. Symbol k acts
    during [k hold, (k + 1) hold), and frame k is one simulation step (0.5 ms) before the end of
    that. There is no frame at t = 0.

    Returns
    -------
    Sample
        ``inputs["u"]["sequence"]`` has shape (600, 1). The file also holds the symbol beside
        each sample; the importer is told to leave that one alone, and that nothing moves along
        y.
    """
    path = Path(folder) / RECORDED.name
    shutil.copyfile(RECORDED, path)
    with np.load(RECORDED, allow_pickle=False) as arrays:
        symbols = arrays["u"][:, np.newaxis]
    drive = {
        "sequence": symbols,
        "hold": HOLD,
        "start": 0.0,
        "unit": "1",
        "quantity": "force",
    }
    return Sample(path, options={"input": "none", "plane": "xz"}, inputs={"u": drive})
