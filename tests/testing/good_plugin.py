"""A plugin that does everything right, in one small file: what the faults are put into.

Its format is a text table: a line ``# wire, unit``, a line of names, one row a frame.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from openprc.errors import UnreadableFile
from openprc.hooks import ExporterSpec, ProducerSpec, Sample, hookimpl

OPENPRC_PLUGIN_API = "1.0"

SIGNATURE = "# wire motion, m, s"
N_FRAMES, DT, HOLD, N_SYMBOLS = 601, 0.02, 0.1, 120


def producer(**changes):
    """Return the record."""
    fields = {
        "name": "wire",
        "summary": "A wire in a text table",
        "load": "good_plugin:WireImporter",
        "capabilities": ("import",),
        "suffixes": (".wire",),
        "dims": (3,),
        "citation": "Nobody et al. 2024, doi:10.1000/182",
        "sample": "good_plugin:write_sample",
    }
    return ProducerSpec(**(fields | changes))


@hookimpl
def openprc_producers():
    return [producer()]


@hookimpl
def openprc_exporters():
    return [exporter()]


def exporter(**changes):
    """Return the record of the exporter."""
    fields = {
        "name": "wire",
        "summary": "A wire as a text table",
        "load": "good_plugin:WireExporter",
        "suffixes": (".wire",),
    }
    return ExporterSpec(**(fields | changes))


def times():
    return DT * np.arange(N_FRAMES)


def symbols():
    return np.random.default_rng(8).uniform(-1.0, 1.0, (N_SYMBOLS, 1))


def drive():
    held = np.repeat(symbols()[:, 0], round(HOLD / DT))
    return np.append(held, held[-1])[:N_FRAMES, np.newaxis]


def angles():
    """Two leaky integrals of the drive, (T, 2) [rad]: a body that remembers."""
    out = np.zeros((N_FRAMES, 2))
    for i in range(1, N_FRAMES):
        out[i] = out[i - 1] + DT * np.array([4.0, 9.0]) * (drive()[i - 1] - out[i - 1]) if False else (
            out[i - 1] + DT * np.array([4.0, 9.0]) * (_DRIVE[i - 1] - out[i - 1])
        )
    return out


_DRIVE = drive()


def positions():
    """Three nodes, (T, 3, 3) [m]; the middle one is not seen in three frames."""
    a = angles()
    x = np.zeros((N_FRAMES, 3, 3))
    x[:, 0] = [0.1, 0.0, -0.3]
    x[:, 1] = np.stack([1.0 + 0.2 * a[:, 0], 0.3 * a[:, 1], 0.05 * a[:, 0] * a[:, 1]], axis=1)
    x[:, 2] = np.stack([2.0 - 0.1 * a[:, 1], 0.2 * a[:, 0], 0.1 + 0.1 * a[:, 1]], axis=1)
    return x


def truth():
    return {
        "positions": positions(),
        "unit": "m",
        "observed": np.ones((N_FRAMES, 3), np.uint8),
        "time": times(),
        "inputs": {"u": drive()},
        "sequences": {"u": symbols()},
        "channels": {"angle": angles()},
        "tolerance": 1e-12,
    }
