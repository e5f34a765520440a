"""Pictures of what is compared besides places: spectra, and energy over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from openprc.analysis.visualization.figure import new_figure
from openprc.compare.page.pictures import run_colours

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from openprc.compare.report import Report

_SIZE = (8.0, 4.0)
#: Densities below this share of the largest are rounding, and would flatten the rest.
_FLOOR = 1e-14


def spectrum_curves(report: Report) -> Figure | None:
    """Draw the power spectra of the reference and of every run."""
    pairs = {name: report.pair(name) for name in report.files}
    spectra = {
        name: pair.spectra
        for name, pair in pairs.items()
        if pair is not None and pair.spectra is not None
    }
    if not spectra:
        return None
    colours = run_colours(report)
    figure = new_figure(_SIZE)
    axes = figure.add_subplot()
    first = next(iter(spectra.values()))
    curves = {report.reference: (first.frequencies, first.reference)} | {
        name: (one.frequencies, one.other) for name, one in spectra.items()
    }
    top = max(float(density[1:].max(initial=0.0)) for _, density in curves.values())
    if not top > 0.0:
        return None
    for name, (frequencies, density) in curves.items():
        reference = name == report.reference
        shown = np.where(density[1:] > _FLOOR * top, density[1:], np.nan)
        axes.semilogy(
            frequencies[1:], shown, color=colours[name], label=name,
            lw=2.2 if reference else 1.1, alpha=0.45 if reference else 1.0,
        )  # fmt: skip
    axes.set(xlabel="frequency [Hz]", ylabel="power density [m$^2$/Hz]")
    if frequencies[-1] / frequencies[1] > 100.0:
        axes.set_xscale("log")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


def energy_curves(report: Report) -> Figure | None:
    """Draw the total energy that every run recorded, less what it began with."""
    if not report.energies:
        return None
    colours = run_colours(report)
    figure = new_figure(_SIZE)
    axes = figure.add_subplot()
    for name, (times, energy) in report.energies.items():
        reference = name == report.reference
        axes.plot(
            times, energy, color=colours[name], label=name,
            lw=2.2 if reference else 1.1, alpha=0.45 if reference else 1.0,
        )  # fmt: skip
    axes.set(xlabel="time [s]", ylabel="total energy, less that of the first frame [J]")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


__all__ = ["energy_curves", "spectrum_curves"]
