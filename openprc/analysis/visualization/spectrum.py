"""The spectrum of the states: how many directions carry the motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from openprc.analysis.dimension.spectra import state_spectrum
from openprc.analysis.visualization.figure import Plot, new_figure


def plot_spectrum(states: ArrayLike, *, title: str = "", standardize: bool = True) -> Plot:
    """Draw singular values and cumulative explained variance of the states.

    Parameters
    ----------
    states : (T, F)
    title : str
    standardize : bool
        Divide every column by its standard deviation first.

    Raises
    ------
    TaskError
        When there is nothing to decompose.
    MissingDependency
        When matplotlib is not installed.
    """
    spectrum = state_spectrum(states, standardize=standardize)
    figure = new_figure((8.0, 3.4))
    left, right = figure.subplots(1, 2)
    values = spectrum.singular_values / spectrum.singular_values[0]
    count = np.arange(1, len(values) + 1)
    floor = spectrum.tolerance / spectrum.singular_values[0]
    # A singular value of rounding size has no meaning of its own: it is drawn on the floor.
    left.semilogy(count, np.maximum(values, floor), ".-", color="tab:blue", linewidth=1.0)
    left.axhline(floor, color="0.5", linestyle=":", linewidth=1.0)
    left.annotate(
        "rounding", (0.0, floor), xycoords=("axes fraction", "data"), xytext=(4, 3),
        textcoords="offset points", ha="left", color="0.4", fontsize="small",
    )  # fmt: skip
    left.set_xlabel("direction")
    left.set_ylabel("singular value / largest")
    effective = spectrum.effective_rank()
    left.set_title(
        f"rank {spectrum.numerical_rank()} of {spectrum.n_changing}, effective {effective:.1f}",
        fontsize="medium",
        loc="left",
    )
    cumulative = 100.0 * spectrum.explained_variance.cumulative
    right.semilogx(
        np.arange(1, len(cumulative) + 1), cumulative, ".-", color="tab:blue", linewidth=1.0
    )
    for share in (95.0, 99.0):
        needed = int(np.searchsorted(cumulative, share - 1e-10)) + 1
        right.axhline(share, color="0.7", linewidth=0.8, zorder=0)
        right.annotate(
            f"{share:g} %: {needed}", (1.0, share), xycoords=("axes fraction", "data"),
            xytext=(-4, -3), textcoords="offset points", ha="right", va="top", color="0.3",
            fontsize="small",
        )  # fmt: skip
    right.set_xlabel("principal components")
    right.set_ylabel("explained variance [%]")
    right.set_ylim(top=101.5)
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize="medium")
    return Plot(figure, Path("spectrum.png"))
