"""``openprc benchmark``."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import click

from openprc.cli.blame import reading
from openprc.cli.console import console, json_option, print_json, spinner, table
from openprc.cli.options import parse_pairs
from openprc.cli.score_options import choices_of, score_options


@click.command("benchmark")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--task", default="narma", show_default=True, help="A task; see `openprc plugins`.")
@click.option("--order", type=int, help="Order of the NARMA task. Default: 2.")
@click.option(
    "--option", "-o", "parameters", multiple=True, metavar="KEY=VALUE", help="Of the task."
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Of a task that brings its own input: the one that the body was driven with.",
)
@score_options
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for readout/ and metrics/. Without it nothing is written.",
)
@json_option
def command(
    path: Path,
    task: str,
    order: int | None,
    parameters: tuple[str, ...],
    seed: int | None,
    out: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Train a readout on a task driven by the input of PATH, and score it.

    The figure stands beside those of a shift register with as many taps as the body has states,
    which remembers the input perfectly and computes nothing, of the present input alone, and of
    echo state networks of equal size: a body is worth something where it does better.
    """
    # scikit-learn takes seconds to import; the help of this command need not wait for it.
    from openprc.analysis.benchmarks.report import score_file  # noqa: PLC0415
    from openprc.analysis.tasks.registered import registered_task  # noqa: PLC0415

    given = {key: _value(text) for key, text in parse_pairs(parameters).items()}
    if order is not None:
        given["order"] = order
    with spinner(f"scoring {path.name}", hidden=as_json), reading(path):
        report = score_file(
            path,
            choices_of(**options),
            task=registered_task(task, **given),
            seed=seed,
            experiment_dir=out,
        )
    if as_json:
        print_json(report.as_dict())
        return
    show = console()
    show.print(
        table(
            ["task", "figure", "body", "NMSE", "shift register", "raw input", "cubic of u", "ESN",
             "skill", "states", "train", "test", "clock"],
            [[report.task, report.metric, report.figure, report.nmse, report.baseline,
              report.raw_input, report.cubic, report.esn, report.skill, report.n_states,
              report.n_train, report.n_test, report.clock]],
        )
    )  # fmt: skip
    show.print(
        f"input {report.input_name}/{report.input_column}, features: {report.features}; "
        f"shift register of {report.n_taps} taps; NRMSE is over the standard deviation and NMSE "
        "over the variance of the target",
        markup=False,
    )
    for text in report.warnings:
        show.print(f"warning: {text}", markup=False)
    for written in (report.readout_path, report.metrics_path):
        if written is not None:
            show.print(f"written: {written}", markup=False)


def _value(text: Any) -> Any:
    """Return the number, list or truth value that a text stands for, or the text."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError):
        return text
