"""Target and prediction over time, drawn from a readout.h5."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from openprc.analysis.visualization.figure import Plot, new_figure
from openprc.errors import TaskError
from openprc.schema import results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from openprc.reservoir.training.result import TrainingResult


def plot_prediction(
    trained: TrainingResult, *, start_row: int = 0, end_row: int | None = None, output: int = 0
) -> Plot:
    """Draw target and prediction of a training that need not be saved, over its test rows.

    Parameters
    ----------
    trained : TrainingResult
    start_row, end_row : int
        Rows within the test span, the second one excluded.
    output : int
        Column of the target.

    Raises
    ------
    MissingDependency
        When matplotlib is not installed.
    """
    evaluation = trained.evaluation
    rows = evaluation.test_rows[start_row:end_row]
    figure = _draw(
        trained.clock.time[rows],
        trained.target[rows, output],
        evaluation.prediction[start_row:end_row, output],
        title=f"{trained.task_name}, validation: NRMSE {trained.nrmse:.3g}",
        x_label="time [s]" if trained.clock.unit == "s" else "load step",
    )
    return Plot(figure, Path(f"{trained.task_name}_validation.png"))


class TimeSeriesComparison:
    """Plot what was to be imitated against what the readout made of it."""

    def plot(
        self,
        readout_path: str | Path,
        start_frame: int = 0,
        end_frame: int | None = None,
        *,
        span: Literal["validation", "training"] = "validation",
        output: int = 0,
    ) -> Plot:
        """Draw rows `start_frame` to `end_frame` of one span.

        Parameters
        ----------
        readout_path : path-like
            A readout.h5.
        start_frame, end_frame : int
            Rows within the span, the second one excluded; ends beyond the last row are cut.
        span : {"validation", "training"}
        output : int
            Column of the target.

        Raises
        ------
        TaskError
            When there is nothing in that range, or no such span or output.
        MissingDependency
            When matplotlib is not installed.
        UnreadableFile, SchemaError
            When it is no readout file.
        """
        path = Path(readout_path)
        stored = results.read_result(path)
        if f"{span}/target" not in stored.arrays:
            raise TaskError(
                f"the file has no span {span!r}",
                expected="training or validation of a readout.h5",
                fix="name a readout file and one of its spans",
                file=path,
                key="span",
            )
        time, target, prediction = (
            stored.array(f"{span}/{name}") for name in ("time", "target", "prediction")
        )
        if not 0 <= output < target.shape[1]:
            raise TaskError(
                f"output is {output}",
                expected=f"0 to {target.shape[1] - 1}",
                fix="choose a column of the target",
                file=path,
                key="output",
            )
        rows = slice(start_frame, end_frame)
        if start_frame < 0 or not len(time[rows]):
            raise TaskError(
                f"rows {start_frame} to {end_frame} are empty",
                expected=f"a range within the {len(time)} rows of {span}",
                fix="correct start_frame and end_frame",
                file=path,
                key="start_frame",
            )
        unit = str(stored.attrs.get("time_unit", "s"))
        figure = _draw(
            time[rows],
            target[rows, output],
            prediction[rows, output],
            title=f"{stored.attrs.get('task_name', path.stem)}, {span}: "
            f"NRMSE {float(np.sqrt(stored.array(f'{span}/NMSE')[output])):.3g}",
            x_label="time [s]" if unit == "s" else "load step",
        )
        return Plot(figure, path.with_name(f"{path.stem}_{span}.png"))


def _draw(
    time: np.ndarray, target: np.ndarray, prediction: np.ndarray, *, title: str, x_label: str
) -> Figure:
    figure = new_figure((8.0, 3.2))
    axes = figure.add_subplot()
    axes.plot(time, target, color="0.2", linewidth=1.4, label="target")
    axes.plot(time, prediction, color="tab:red", linewidth=1.0, linestyle="--", label="prediction")
    axes.set_xlabel(x_label)
    axes.set_ylabel("output of the task")
    axes.set_title(title, fontsize="medium", loc="left")
    # Above the axes, where it hides no part of the curves.
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False)
    axes.margins(x=0)
    return figure
