"""PRCpy's own example data and the numbers that PRCpy 0.1.14 gives for them.

The data are not part of this repository. Get ``examples/data_100`` of PRCpy and name the folder in
``OPENPRC_PRCPY_DATA``; ``mackey_glass_t17.npy`` may lie anywhere below it.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from openprc_prcpy import read_prcpy

from openprc.analysis.benchmarks.prcpy_metrics import non_linearity, prcpy_scores

BESIDE = Path(__file__).resolve().parents[3] / "../shared/data/prcpy"
DATA = Path(os.environ.get("OPENPRC_PRCPY_DATA", BESIDE))
pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="PRCpy's example data are not here (OPENPRC_PRCPY_DATA names them)"
)

DEVICES = {"Xs": "t", "Readouts": "Voltage", "delimiter": "\t", "transpose": True}
SPECTRA = {"Xs": "Frequency", "Readouts": "Spectra", "delimiter": ","}
FILTERED = {
    **SPECTRA, "remove_bg": True, "smooth": True, "smooth_win": 51, "smooth_rank": 4,
    "normalize_global": True, "sample": True, "sample_rate": 16,
}  # fmt: skip

#: Folder, parameters, tau, shape; train MSE, test MSE, nonlinearity, memory without and with the
#: memory of the input. Ridge with alpha 0.1, test_size 0.3, k_max 12.
CASES = {
    "diode": ("mg_mapping/diode", DEVICES, 10, (1000, 100),
              (6.2439e-2, 6.1741e-2, 0.0595, 1.9759, 7.0304)),
    "capacitor_diode": ("mg_mapping/capacitor_diode", DEVICES, 10, (1000, 100),
                        (6.0367e-3, 7.0506e-3, 0.1508, 5.2008, 10.2553)),
    "skyrmion": ("mg_mapping/Cu2OSeO3/skyrmion", FILTERED, 10, (100, 101),
                 (1.7545e-2, 1.0950e-1, 0.8663, -0.3000, 2.1992)),
    "conical": ("mg_mapping/Cu2OSeO3/conical", FILTERED, 10, (100, 101),
                (3.7605e-2, 1.5085e-1, 0.7097, -1.5420, 0.9572)),
    "square": ("sine_mapping/Cu2OSeO3/skyrmion", SPECTRA, 0, (100, 1601),
               (1.0906e-5, 1.0898e-4, 0.4317, 6.9208, 10.8612)),
}  # fmt: skip


def target_of(name, n_rows):
    if name == "square":
        return np.tile(np.repeat([1.0, 0.0], 5), 10)
    found = sorted(DATA.rglob("mackey_glass_t17.npy"))
    if not found:
        pytest.skip("mackey_glass_t17.npy is not among the data")
    series = np.load(found[0])
    return ((series - series.min()) / np.ptp(series))[:n_rows]


@pytest.mark.parametrize("name", CASES)
def test_the_numbers_of_the_other_package(name):
    place, params, tau, shape, expected = CASES[name]
    folder = DATA / place
    if not folder.is_dir():
        pytest.skip(f"{place} is not among the data")
    if params.get("remove_bg"):
        background = next(p.name for p in sorted(folder.iterdir()) if p.name.startswith("BG"))
        params = {**params, "bg_fname": background}
    data = read_prcpy(folder, "scan", params)
    assert data.states.shape == shape
    target = target_of(name, shape[0])
    scores = prcpy_scores(
        data.states, target, target=target, tau=tau, test_size=0.3, alpha=0.1, k_max=12, n_lags=12
    )
    keys = ("train_mse", "test_mse", "linear_memory_capacity_without_input",
            "linear_memory_capacity")  # fmt: skip
    assert [scores[key] for key in keys[:2]] == pytest.approx(expected[:2], rel=1e-4, abs=0.0)
    assert [scores[key] for key in keys[2:]] == pytest.approx(expected[3:], rel=0.0, abs=1e-4)
    # The number of lags behind the nonlinearity was not written down: 12, or PRCpy's default.
    either = [scores["non_linearity"], non_linearity(target, data.states, n_lags=25)]
    assert min(abs(value - expected[2]) for value in either) < 1e-4
