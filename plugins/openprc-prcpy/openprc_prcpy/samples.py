"""A small experiment whose every number is known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.hooks import Sample

N_SCANS = 300
INTERVAL = 2.0  # s, from one scan to the next
BACKGROUND = "BG_4K.txt"
_LEAKS = np.array([1.0, 0.8, 0.6, 0.45, 0.3, 0.2])
_RESONANCES = np.linspace(1.3, 3.8, len(_LEAKS))  # GHz, in zero field
_WIDTH = 0.12  # GHz


def fields() -> NDArray[np.float64]:
    """Return the field of every scan, (N_SCANS,) [mT], as the file names carry it."""
    drawn = np.random.default_rng(11).uniform(20.0, 80.0, N_SCANS)
    return np.round(drawn, 4)


def frequencies() -> NDArray[np.float64]:
    """Return the sweep axis, (S,) [GHz]."""
    return 1.0 + 0.0625 * np.arange(49)


def background() -> NDArray[np.float64]:
    """Return the spectrum without a magnet, (S,) [arbitrary]."""
    return -1.5 + 0.4 * np.cos(2.0 * np.pi * frequencies() / 0.35)


def spectra() -> NDArray[np.float64]:
    """Return the spectra without background, (N_SCANS, S) [arbitrary].

    Six modes each remember the field B with a leak a, m_k = (1 - a) m_(k-1) + a b_k where
    b = (B - 50 mT) / 30 mT, and shift their resonance f0 with it: mode i adds
    1 / (1 + ((f - f0_i - 0.1 GHz m_i) / w)^2).
    """
    b = (fields() - 50.0) / 30.0
    memory = np.zeros((N_SCANS, len(_LEAKS)))
    state = np.zeros(len(_LEAKS))
    for k, value in enumerate(b):
        state = (1.0 - _LEAKS) * state + _LEAKS * value
        memory[k] = state
    centre = _RESONANCES + 0.1 * memory
    off = (frequencies()[np.newaxis, :, np.newaxis] - centre[:, np.newaxis, :]) / _WIDTH
    return (1.0 / (1.0 + off**2)).sum(axis=2)


def write_sample(folder: Path) -> Sample:
    """Write the experiment in PRCpy's convention into ``folder/skyrmion``.

    Beside the scans the folder holds a background, notes, and a scan of an earlier day that is
    no part of the experiment.
    """
    target = Path(folder) / "skyrmion"
    target.mkdir()
    for k, (value, spectrum) in enumerate(zip(fields(), spectra() + background(), strict=True)):
        words = f"{value:.4f}".replace(".", "_")
        _write(target / f"scan_{k + 1}_{words}mT.txt", float(value), spectrum)
    _write(target / BACKGROUND, 450.0, background())
    _write(target / "old_scan_1_50_0mT.txt", 50.0, background())
    (target / "metadata.txt").write_text("sample: closed form\n", encoding="utf-8")
    return Sample(
        target,
        options={
            "prefix": "scan",
            "xs": "Frequency",
            "readouts": "Spectra",
            "remove_bg": True,
            "bg_fname": BACKGROUND,
            "interval": INTERVAL,
        },
    )


def _write(path: Path, field: float, spectrum: NDArray[np.float64]) -> None:
    rows = zip(frequencies().tolist(), spectrum.tolist(), strict=True)
    lines = [f"{field!r},{f!r},{s!r}" for f, s in rows]
    path.write_text("Field,Frequency,Spectra\n" + "\n".join(lines) + "\n", encoding="utf-8")
