"""The pictures of a suite, one file each."""

from __future__ import annotations

from pathlib import Path

from openprc.analysis.benchmarks.diagnosis import REDUNDANT, measured_rows, measured_states
from openprc.analysis.benchmarks.standard_suite import SuiteScore
from openprc.analysis.visualization.figure import Plot

#: More channels than this cannot be told apart in a matrix or a tree.
_MOST_CHANNELS = 400


def save_pictures(suite: SuiteScore, folder: Path) -> list[Path]:
    """Draw what was measured and return the paths of the pictures.

    Target and prediction of every task, memory profile and capacities by delay and degree,
    spectrum and redundancy of the states, and their correlation with the input.

    Raises
    ------
    MissingDependency
        When matplotlib is not installed.
    """
    drawn = {**_task_pictures(suite), **_capacity_pictures(suite), **_state_pictures(suite)}
    folder.mkdir(parents=True, exist_ok=True)
    return [plot.save(folder / f"{name}.png") for name, plot in drawn.items()]


def _task_pictures(suite: SuiteScore) -> dict[str, Plot]:
    from openprc.analysis.visualization.time_series import (  # noqa: PLC0415 - with matplotlib
        plot_prediction,
    )

    return {
        f"prediction_{name}": plot_prediction(score.trained[0], end_row=300)
        for name, _, score in suite.tasks()
    }


def _capacity_pictures(suite: SuiteScore) -> dict[str, Plot]:
    from openprc.analysis.visualization.capacity_plots import (  # noqa: PLC0415 - with matplotlib
        CapacityPlots,
    )

    if "memory" not in suite.scores:
        return {}
    plots = CapacityPlots.of(suite.scores["memory"])
    return {
        "memory_profile": plots.memory_profile(),
        "capacity_by_delay_and_degree": plots.heat_map(),
        "capacity_by_degree": plots.by_degree(),
    }


def _state_pictures(suite: SuiteScore) -> dict[str, Plot]:
    from openprc.analysis.correlation import Linear, Redundancy  # noqa: PLC0415 - with matplotlib
    from openprc.analysis.visualization.spectrum import plot_spectrum  # noqa: PLC0415

    drawn: dict[str, Plot] = {}
    states, names = measured_states(suite.trainer)
    if "dimension" in suite.scores:
        drawn["spectrum"] = plot_spectrum(states)
        if suite.scores["dimension"].metrics["n_changing"] >= 2 and len(names) <= _MOST_CHANNELS:
            redundancy = Redundancy(states, names=names)
            drawn["redundancy"] = redundancy.dendrogram(threshold=REDUNDANT)
            drawn["correlation_of_states"] = redundancy.correlation.plot()
    if suite.u is not None and "input_correlation" in suite.scores:
        linear = Linear(suite.u[measured_rows(suite.trainer)], states, names=names)
        drawn["correlation_with_input"] = linear.pearson.plot()
        drawn["lags_behind_input"] = linear.ccf.plot(kind="lag_profile")
    return drawn
