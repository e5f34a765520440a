"""From one file to one score, with every choice made and told."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.benchmarks.narma_benchmark import NARMABenchmark
from openprc.errors import MissingData, TaskError
from openprc.reservoir.features.base import Feature, is_constant
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.features.node_features import NodeDisplacements
from openprc.reservoir.io.missing import MissingPolicy
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.row_clock import ClockChoice, RowClock, row_clock
from openprc.reservoir.training.trainer import Trainer

#: Fractions of the rows: washout, and training out of what is left.
_WASHOUT, _TRAIN = 0.1, 2.0 / 3.0
_FEW_TEST_ROWS = 100


@dataclass(frozen=True)
class ScoreReport:
    """A NARMA score of one file.

    ``nrmse`` and ``nmse`` are those of the body on the test rows; ``baseline_nrmse`` is that
    of a shift register of ``n_taps`` inputs, ``cubic_nrmse`` that of a cubic of the present
    input, and ``skill`` is ``1 - nrmse / baseline_nrmse``. ``row_step`` is in seconds. The
    paths are None when nothing was written.
    """

    file: str
    run_id: str
    producer: str
    order: int
    nrmse: float
    nmse: float
    baseline_nrmse: float
    cubic_nrmse: float
    skill: float
    n_taps: int
    n_states: int
    n_train: int
    n_test: int
    clock: str
    row_step: float
    input_name: str
    input_column: str
    features: str
    formula: str
    warnings: tuple[str, ...]
    readout_path: Path | None
    metrics_path: Path | None

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, for JSON output."""
        values = asdict(self)
        for name in ("readout_path", "metrics_path"):
            values[name] = None if values[name] is None else str(values[name])
        values["warnings"] = list(self.warnings)
        return values


def score_file(
    path: str | Path,
    *,
    order: int = 2,
    features: Any = None,
    readout: Any = None,
    input_name: str | None = None,
    input_column: str | int | None = None,
    clock: ClockChoice = "auto",
    samples_per_symbol: int = 1,
    washout: float | None = None,
    train_duration: float | None = None,
    test_duration: float | None = None,
    missing: MissingPolicy = "error",
    experiment_dir: str | Path | None = None,
) -> ScoreReport:
    """Run the NARMA benchmark on a trajectory file.

    The input is rescaled to [0, 0.5] by its least and largest value over the rows.

    Parameters
    ----------
    path : path-like
        A simulation.h5.
    order : int
        Order of the NARMA system.
    features : feature or sequence of features, optional
        By default the displacements of the nodes that move, in the coordinates in which any
        node moves; in a file without positions, or where no node moves, all channels.
    readout : estimator, optional
        By default ``Ridge()``.
    input_name : str, optional
        By default the first input that stores its symbols, else the first input.
    input_column : str or int, optional
        By default the first column that varies.
    clock : {"auto", "symbols", "frames"}
    samples_per_symbol : int
        Frames per symbol that serve as virtual nodes.
    washout, train_duration, test_duration : float [s], optional
        By default a tenth of the rows, and two thirds and one third of the rest.
    missing : {"error", "drop", "interpolate"}
    experiment_dir : path-like, optional
        Where readout.h5 and metrics.h5 go; without it nothing is written.

    Raises
    ------
    MissingInputError
        When the file does not say what drove the body.
    TaskError
        When the file holds load steps, is too short, or does not move, and as
        `NARMABenchmark.run`.
    MissingData
        When states are missing, or there are none.
    """
    with StateLoader(path, missing=missing) as loader:
        loader.require_physical_time(f"NARMA{order}")
        loader.input_name(input_name or 0)
        rows = row_clock(
            loader, clock=clock, input_name=input_name, samples_per_symbol=samples_per_symbol
        )
        name = rows.symbols.name if rows.symbols else loader.input_name(input_name or 0)
        u, column = _choose_input(loader, rows, name, input_column)
        chosen = default_features(loader) if features is None else features
        spans = _spans(
            rows, washout=washout, train_duration=train_duration, test_duration=test_duration
        )
        trainer = Trainer(
            chosen,
            Ridge() if readout is None else readout,
            loader=loader,
            experiment_dir=experiment_dir,
            clock=clock,
            input_name=input_name,
            samples_per_symbol=samples_per_symbol,
            **spans,
        )
        score = NARMABenchmark(f"narma{order}").run(trainer, u, order=order)
        if experiment_dir is not None:
            score.save()
        producer = str(loader.trajectory.provenance.get("producer", "unknown"))
        run_id = loader.run_id
    metadata = score.metadata
    warnings = list(metadata.get("warnings", ()))
    if metadata["n_test"] < _FEW_TEST_ROWS:
        warnings.append(f"only {metadata['n_test']} test rows: the error is uncertain")
    return ScoreReport(
        file=Path(path).name,
        run_id=run_id,
        producer=producer,
        order=order,
        nrmse=score.metrics[f"narma{order}_nrmse"],
        nmse=score.metrics[f"narma{order}_nmse"],
        baseline_nrmse=score.metrics["baseline_nrmse"],
        cubic_nrmse=score.metrics["cubic_nrmse"],
        skill=score.metrics["skill"],
        n_taps=metadata["n_taps"],
        n_states=metadata["n_states"],
        n_train=metadata["n_train"],
        n_test=metadata["n_test"],
        clock=metadata["clock"],
        row_step=metadata["row_step"],
        input_name=name,
        input_column=column,
        features=repr(chosen),
        formula=metadata["formula"],
        warnings=tuple(warnings),
        readout_path=None if experiment_dir is None else score.readout_path,
        metrics_path=None if experiment_dir is None else score.metrics_path,
    )


def default_features(loader: StateLoader) -> Feature:
    """Choose the states of a file: displacements of what moves, else all channels.

    Nodes that never move, and coordinates in which no node moves, carry no information; they
    would only inflate the number of states.

    Raises
    ------
    MissingData
        When the file has neither moving nodes nor channels.
    """
    if loader.n_nodes:
        positions = loader.positions()
        flat = positions.reshape(len(positions), -1)
        moves = ~is_constant(flat).reshape(positions.shape[1:])
        if moves.any():
            return NodeDisplacements(
                node_ids=np.flatnonzero(moves.any(axis=1)).tolist(),
                dims=np.flatnonzero(moves.any(axis=0)).tolist(),
            )
    if loader.channels:
        return Channels()
    raise MissingData(
        "no node moves and there are no channels",
        expected="states that change over time",
        fix="check that the drive reached the body",
        file=loader.path,
        key="/time_series",
    )


def _choose_input(
    loader: StateLoader, rows: RowClock, name: str, column: str | int | None
) -> tuple[NDArray[np.float64], str]:
    """Return the input on the rows, rescaled to [0, 0.5], and the name of its column."""
    signal = loader.trajectory.input(name)
    columns = tuple(signal.columns)
    if rows.symbols is not None:
        values = rows.symbols.sequence
    else:
        values = np.asarray(signal.value, dtype=np.float64)
    if column is None:
        varying = np.flatnonzero(~is_constant(values))
        if not varying.size:
            raise TaskError(
                f"input {name!r} does not vary",
                expected="a drive",
                fix="name another input",
                file=loader.path,
                key=f"/inputs/{name}",
            )
        index = int(varying[0])
    else:
        index = loader.column_index(name, column)
    u = values[:, index]
    least, most = float(u.min()), float(u.max())
    if not most > least:
        raise TaskError(
            f"column {columns[index]!r} of input {name!r} does not vary",
            expected="a drive",
            fix="name another column",
            file=loader.path,
            key=f"/inputs/{name}",
        )
    return 0.5 * (u - least) / (most - least), columns[index]


def _spans(
    rows: RowClock,
    *,
    washout: float | None,
    train_duration: float | None,
    test_duration: float | None,
) -> dict[str, float]:
    """Fill in the durations that were not given, in whole rows."""
    if washout is None:
        washout = round(_WASHOUT * rows.n_rows) * rows.step
    rest = max(rows.n_rows - round(washout / rows.step), 0)
    if train_duration is None and test_duration is None:
        train_duration = round(_TRAIN * rest) * rows.step
    if train_duration is None:
        train_duration = max(rest - round((test_duration or 0.0) / rows.step), 0) * rows.step
    if test_duration is None:
        test_duration = max(rest - round(train_duration / rows.step), 0) * rows.step
    return {
        "washout": washout,
        "train_duration": train_duration,
        "test_duration": test_duration,
    }
