"""``openprc benchmark``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from openprc.cli.blame import reading
from openprc.cli.console import console, json_option, print_json, spinner, table
from openprc.cli.options import FINITE, NOT_NEGATIVE


@click.command("benchmark")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--order", type=int, default=2, show_default=True, help="Order of the NARMA task.")
@click.option("--features", "feature_name", help="A feature; see `openprc plugins`.")
@click.option("--input", "input_name", help="The input, when there are several.")
@click.option("--column", "input_column", help="Column of the input.")
@click.option(
    "--clock",
    type=click.Choice(["auto", "symbols", "frames"]),
    default="auto",
    show_default=True,
    help="One row of states a symbol, or a frame.",
)
@click.option(
    "--samples-per-symbol",
    type=int,
    default=1,
    show_default=True,
    help="Frames of each symbol that serve as virtual nodes.",
)
@click.option("--washout", type=FINITE, help="Seconds left out at the start. Default: a tenth.")
@click.option("--train", type=FINITE, help="Seconds of training. Default: two thirds of the rest.")
@click.option("--test", type=FINITE, help="Seconds of testing. Default: what is left.")
@click.option("--ridge", type=NOT_NEGATIVE, default=1e-6, show_default=True, help="Regularisation.")
@click.option(
    "--missing",
    type=click.Choice(["error", "drop", "interpolate"]),
    default="error",
    show_default=True,
    help="What to do about missing points.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for readout/ and metrics/. Without it nothing is written.",
)
@json_option
def command(
    path: Path,
    order: int,
    feature_name: str | None,
    input_name: str | None,
    input_column: str | None,
    clock: Any,
    samples_per_symbol: int,
    washout: float | None,
    train: float | None,
    test: float | None,
    ridge: float,
    missing: Any,
    out: Path | None,
    as_json: bool,
) -> None:
    """Train a readout on a NARMA task driven by the input of PATH, and score it.

    The error stands beside that of a shift register, which remembers the input perfectly and
    computes nothing: a body is worth something where it does better.
    """
    # scikit-learn takes seconds to import; the help of this command need not wait for it.
    from openprc.analysis.benchmarks.report import score_file  # noqa: PLC0415
    from openprc.reservoir.readout.ridge import Ridge  # noqa: PLC0415

    features = None
    if feature_name is not None:
        from openprc.hooks.faults import owned_by  # noqa: PLC0415
        from openprc.hooks.registry import default_registry  # noqa: PLC0415

        registry = default_registry()
        item = registry.find("openprc_features", feature_name)
        with owned_by(item.qualified_name, "being set up"):
            features = registry.load(item)()
    with spinner(f"scoring {path.name}", hidden=as_json), reading(path):
        report = score_file(
            path,
            order=order,
            features=features,
            readout=Ridge(ridge),
            input_name=input_name,
            input_column=input_column,
            clock=clock,
            samples_per_symbol=samples_per_symbol,
            washout=washout,
            train_duration=train,
            test_duration=test,
            missing=missing,
            experiment_dir=out,
        )
    if as_json:
        print_json(report.as_dict())
        return
    show = console()
    show.print(
        table(
            ["task", "NRMSE", "NMSE", "shift register", "cubic of u", "skill", "states", "train",
             "test", "clock"],
            [[f"NARMA{report.order}", report.nrmse, report.nmse,
              report.baseline_nrmse, report.cubic_nrmse, report.skill, report.n_states,
              report.n_train, report.n_test, report.clock]],
        )
    )  # fmt: skip
    show.print(
        f"input {report.input_name}/{report.input_column}, features: {report.features}; "
        f"shift register of {report.n_taps} taps; errors are normalised by the standard "
        "deviation (NRMSE) or variance (NMSE) of the target",
        markup=False,
    )
    for text in report.warnings:
        show.print(f"warning: {text}", markup=False)
    for written in (report.readout_path, report.metrics_path):
        if written is not None:
            show.print(f"written: {written}", markup=False)
