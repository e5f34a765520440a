"""Exporters with one mistake each."""

from __future__ import annotations

import numpy as np
from wire_code import WireExporter


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
