"""``openprc characterise``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from openprc.cli.blame import reading
from openprc.cli.console import console, json_option, print_json, progress_bar, table
from openprc.cli.score_options import choices_of, score_options

if TYPE_CHECKING:
    from openprc.analysis.benchmarks.standard_suite import SuiteScore

_WIDTH = 100


@click.command("characterise")
@click.argument("path", type=click.Path(path_type=Path))
@score_options
@click.option(
    "--networks",
    type=click.IntRange(min=0),
    default=3,
    show_default=True,
    help="Echo state networks of equal size that tasks are compared with.",
)
@click.option(
    "--metrics",
    type=click.Choice(["standard", "prcpy"]),
    default="standard",
    show_default=True,
    help="prcpy adds the figures of PRCpy 0.1.14, by its own formulas.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for readout/, metrics/ and pictures/. Without it nothing is written.",
)
@json_option
def command(
    path: Path, networks: int, metrics: str, out: Path | None, as_json: bool, **options: Any
) -> None:
    """Measure everything that PATH admits: dimension, memory, capacities, tasks, redundancy.

    Every task stands beside a shift register with as many taps as the body has states, the
    present input alone, and echo state networks of equal size.
    """
    # scikit-learn takes seconds to import; the help of this command need not wait for it.
    from openprc.analysis.benchmarks.choices import (  # noqa: PLC0415
        choose_input,
        left_out_remark,
        open_trainer,
    )
    from openprc.analysis.benchmarks.standard_suite import StandardSuite  # noqa: PLC0415

    written: list[Path] = []
    with reading(path), open_trainer(path, choices_of(**options), experiment_dir=out) as trainer:
        driven = bool(trainer.loader.inputs)
        chosen = choose_input(trainer, options["input_column"]) if driven else None
        with progress_bar(path.name, hidden=as_json) as progress:
            suite = StandardSuite(n_networks=networks, prcpy=metrics == "prcpy").run(
                trainer, None if chosen is None else chosen.values, progress=progress
            )
        if out is not None:
            from openprc.analysis.benchmarks.pictures import save_pictures  # noqa: PLC0415

            written = [suite.save(), *save_pictures(suite, out / "pictures")]
        told = {
            "file": path.name,
            "run_id": trainer.loader.run_id,
            "clock": trainer.rows.kind,
            "n_rows": trainer.rows.n_rows,
            "row_step": trainer.rows.step,
            "input": None if chosen is None else f"{chosen.name}/{chosen.column}",
            "features": repr(trainer.features),
            "left_out": "" if options["features"] else left_out_remark(trainer.loader),
        }
    if as_json:
        print_json({**told, **suite.as_dict(), "written": [str(one) for one in written]})
        return
    _show(told, suite, written)


def _show(told: dict[str, Any], suite: SuiteScore, written: list[Path]) -> None:
    out = console()
    out.print(
        f"{told['file']}: {told['n_rows']} rows ({told['clock']}, {told['row_step']:g} apart), "
        f"input {told['input'] or 'unknown'}, features: {_short(told['features'])}",
        markup=False,
    )
    if told["left_out"]:
        out.print(f"note: {told['left_out']}", markup=False)
    if "dimension" in suite.scores:
        m = suite.scores["dimension"].metrics
        out.print(
            table(
                ["states", "change", "rank", "effective rank", "of singular values",
                 "participation", "95 % variance", "condition"],
                [[m["n_states"], m["n_changing"], m["numerical_rank"], m["effective_rank"],
                  m["effective_rank_singular"], m["participation_ratio"], m["n_components_95"],
                  f"{m['condition_number']:.3g}"]],
                title="dimension of the states",
            )
        )  # fmt: skip
    if "memory" in suite.scores:
        m = suite.scores["memory"].metrics
        rows = [
            ["memory (degree 1, delays from 1)", m["mc_jaeger"], m["mc_jaeger_corrected"]],
            ["linear (degree 1)", m["mc_linear"], m["mc_linear_corrected"]],
            ["nonlinear", m["mc_nonlinear"], m["mc_nonlinear_corrected"]],
            ["total", m["ipc_total"], m["ipc_total_corrected"]],
        ]
        title = f"capacities; their sum is at most the rank, {m['rank']:g}"
        out.print(table(["capacity", "above threshold", "without bias"], rows, title=title))
    if "kernel_quality" in suite.scores:
        m = suite.scores["kernel_quality"].metrics
        out.print(
            f"an echo falls to 1/e after {m['echo_decay']:.3g} rows and is above chance up to "
            f"{m['echo_last_delay']:g}; {m['kernel_rank']} of {m['n_streams']} input streams are "
            "told apart (kernel rank)",
            markup=False,
        )
    tasks = [
        [name, metric, *(score.metrics.get(key) for key in _columns(name, metric))]
        for name, metric, score in suite.tasks()
    ]
    if tasks:
        columns = ["task", "figure", "body", "shift register", "raw input", "ESN", "skill",
                   "over ESN"]  # fmt: skip
        out.print(table(columns, tasks, title="tasks"))
    if "input_correlation" in suite.scores:
        m = suite.scores["input_correlation"].metrics
        out.print(
            f"{m['n_correlated']} states follow the input linearly (largest |r| "
            f"{m['largest_r']:.3f}), {m['n_nonlinear_only']} only nonlinearly; multiple "
            f"correlation of all with the input {m['multiple_r']:.3f}",
            markup=False,
        )
    if "prcpy" in suite.scores:
        rows = [[k, v] for k, v in suite.scores["prcpy"].metrics.items() if np.ndim(v) == 0]
        out.print(table(["figure", "value"], rows, title="by the formulas of PRCpy 0.1.14"))
    reasons: dict[str, list[str]] = {}
    for name, reason in suite.skipped.items():
        reasons.setdefault(reason, []).append(name)
    for reason, names in reasons.items():
        out.print(f"not measured: {', '.join(names)}: {reason}", markup=False)
    for text, groups in suite.warnings().items():
        out.print(f"warning: {', '.join(groups)}: {text}", markup=False)
    for one in written:
        out.print(f"written: {one}", markup=False)


def _short(text: str) -> str:
    """Return a text that fits on a line; JSON has all of it."""
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}..."


def _columns(name: str, metric: str) -> list[str]:
    return [f"{name}_{metric}", f"baseline_{metric}", f"raw_input_{metric}", f"esn_{metric}",
            "skill", "skill_over_esn"]  # fmt: skip
