"""Exporters with one mistake each."""

from __future__ import annotations

import numpy as np
from wire_code import WireExporter
from wire_plugin import exporter, producer

from openprc.hooks import Registry
from openprc.testing.lookup import RecordEntry

TABLE = [
    ("Choosy", "gaps give ValueError", "EXPORT-1"),
    ("Rounding", "numbers are written with four digits", "EXPORT-2"),
    ("Filling", "gaps are filled with zeros", "EXPORT-2"),
    ("Littering", "a file is written and not reported", "EXPORT-3"),
    ("Chatting", "the exporter prints", "EXPORT-3"),
]


def registry_with(spec):
    """Return a registry with the importer and an exporter."""
    entries = [
        RecordEntry(producer(), "openprc_producers"), RecordEntry(spec, "openprc_exporters")
    ]  # fmt: skip
    for number, entry in enumerate(entries):
        entry.name = f"wire{number}"
        entry.dist.name = f"wire-{number}"
    return Registry(entries, wanted="wire0,wire1")


class Choosy(WireExporter):
    def places(self, trajectory):
        x = super().places(trajectory)
        if np.isnan(x).any():
            raise ValueError("NaN")
        return x


class Rounding(WireExporter):
    def places(self, trajectory):
        return np.round(super().places(trajectory), 4)


class Filling(WireExporter):
    def places(self, trajectory):
        return np.nan_to_num(super().places(trajectory))


class Littering(WireExporter):
    def export(self, trajectory, path, *, options):
        path.with_suffix(".tmp").write_text("scratch")
        return super().export(trajectory, path, options=options)


class Chatting(WireExporter):
    def export(self, trajectory, path, *, options):
        print(f"writing {path}")
        return super().export(trajectory, path, options=options)


__all__ = ["TABLE", "exporter", "registry_with"]
