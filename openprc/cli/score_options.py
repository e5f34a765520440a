"""The options that commands share which train on a file, and what they choose."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from openprc.cli.options import FINITE, NOT_NEGATIVE

if TYPE_CHECKING:
    from openprc.analysis.benchmarks.choices import Choices

_OPTIONS = (
    click.option("--features", help="A feature; see `openprc plugins`."),
    click.option("--input", "input_name", help="The input, when there are several."),
    click.option("--column", "input_column", help="Column of the input."),
    click.option(
        "--clock",
        type=click.Choice(["auto", "symbols", "frames"]),
        default="auto",
        show_default=True,
        help="One row of states a symbol, or a frame.",
    ),
    click.option(
        "--samples-per-symbol",
        type=int,
        default=1,
        show_default=True,
        help="Frames of each symbol that serve as virtual nodes.",
    ),
    click.option(
        "--frames-per-row",
        type=int,
        default=1,
        show_default=True,
        help="On the clock of frames, every how many frames there is a row.",
    ),
    click.option("--washout", type=FINITE, help="Left out at the start. Default: a tenth."),
    click.option("--train", type=FINITE, help="Training. Default: two thirds of the rest."),
    click.option("--test", type=FINITE, help="Testing. Default: what is left."),
    click.option(
        "--gap", type=FINITE, default=0.0, show_default=True, help="Between training and test."
    ),
    click.option(
        "--unit",
        type=click.Choice(["s", "frames", "rows", "symbols"]),
        default="s",
        show_default=True,
        help="What these four count.",
    ),
    click.option(
        "--ridge", type=NOT_NEGATIVE, default=1e-6, show_default=True, help="Regularisation."
    ),
    click.option(
        "--missing",
        type=click.Choice(["error", "drop", "interpolate"]),
        default="error",
        show_default=True,
        help="What to do about missing points.",
    ),
)


def score_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options that `choices_of` takes."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def choices_of(
    *,
    features: str | None,
    input_name: str | None,
    input_column: str | None,
    clock: Any,
    samples_per_symbol: int,
    frames_per_row: int,
    washout: float | None,
    train: float | None,
    test: float | None,
    gap: float,
    unit: Any,
    ridge: float,
    missing: Any,
) -> Choices:
    """Return the choices that the options stand for.

    Raises
    ------
    TaskError
        When a duration makes no sense.
    """
    # scikit-learn takes seconds to import; the help of a command need not wait for it.
    from openprc.analysis.benchmarks.choices import Choices  # noqa: PLC0415
    from openprc.reservoir.readout.ridge import Ridge  # noqa: PLC0415
    from openprc.reservoir.training.split import Split  # noqa: PLC0415

    return Choices(
        features=None if features is None else _feature(features),
        readout=Ridge(ridge),
        split=Split(
            washout=washout,
            train=train,
            test=test,
            gap=gap,
            unit=unit,
            clock=clock,
            input_name=input_name,
            samples_per_symbol=samples_per_symbol,
            frames_per_row=frames_per_row,
        ),
        input_column=input_column,
        missing=missing,
    )


def _feature(name: str) -> Any:
    from openprc.hooks.faults import owned_by  # noqa: PLC0415 - only when one is named
    from openprc.hooks.registry import default_registry  # noqa: PLC0415

    registry = default_registry()
    item = registry.find("openprc_features", name)
    with owned_by(item.qualified_name, "being set up"):
        return registry.load(item)()
