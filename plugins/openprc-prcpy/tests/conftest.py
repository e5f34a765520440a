"""Fixtures of this plugin's tests: folders in PRCpy's convention, and one import."""

from __future__ import annotations

import numpy as np
import pytest
from openprc_prcpy import openprc_producers
from openprc_prcpy.importer import Importer

from openprc.schema import Provenance, Trajectory, TrajectoryWriter


def default_options(**given):
    options = {o.name: o.default for o in openprc_producers()[0].options}
    assert set(given) <= set(options)
    return {**options, **given}


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "experiment"
    path.mkdir()
    return path


@pytest.fixture
def write(folder):
    """Write one file: columns by name, and what separates them."""

    def write(name, *, delimiter=",", quoted=False, **columns):
        head = [f'"{key}"' if quoted else key for key in columns]
        rows = zip(*(np.asarray(v, dtype=float).tolist() for v in columns.values()), strict=True)
        lines = [delimiter.join(head), *(delimiter.join(map(repr, row)) for row in rows)]
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
        return folder / name

    return write


@pytest.fixture
def scans(write):
    """Write scans of a Gaussian line that moves; return axis (S,) and spectra (T, S)."""

    def scans(n=6, *, values=True, n_samples=40, delimiter=",", quoted=False):
        f = 1.0 + 0.1 * np.arange(n_samples)
        centre = 2.0 + 0.3 * np.sin(1.0 + np.arange(n))
        spectra = np.exp(-(((f - centre[:, np.newaxis]) / 0.5) ** 2)) - 2.0
        for k, row in enumerate(spectra):
            name = f"scan_{k + 1}_{60 + k}_{k}25mT.txt" if values else f"scan_{k + 1}.txt"
            write(name, delimiter=delimiter, quoted=quoted, Field=0 * f, Frequency=f, Spectra=row)
        return f, spectra

    return scans


@pytest.fixture
def run_import(tmp_path):
    """Import a folder and return the open Trajectory; the source must come out untouched."""
    opened = []

    def run(path, **given):
        before = {p.name: p.read_bytes() for p in path.iterdir() if p.is_file()}
        out = tmp_path / f"out{len(opened)}.h5"
        with TrajectoryWriter(out, provenance=Provenance("prcpy"), on_failure="discard") as writer:
            Importer().import_run(path, writer, options=default_options(**given))
        assert {p.name: p.read_bytes() for p in path.iterdir() if p.is_file()} == before
        opened.append(Trajectory(out))
        return opened[-1]

    yield run
    for trajectory in opened:
        trajectory.close()
