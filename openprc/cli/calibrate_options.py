"""Options of ``openprc calibrate``: points, lengths with a unit, and boards."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from openprc.vision.calibration.boards import Board

F = TypeVar("F", bound=Callable[..., Any])

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


class Point(click.ParamType):
    """Two numbers with a comma between: x,y in pixels."""

    name = "x,y"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        """Return the two numbers."""
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(rf"\s*({_NUMBER})\s*[,;]\s*({_NUMBER})\s*", str(value))
        if match is None or not all(math.isfinite(float(part)) for part in match.groups()):
            self.fail(f"{value!r} is no point; write it as 120.5,88", param, ctx)
        return float(match[1]), float(match[2])


class Length(click.ParamType):
    """A length above 0 with its unit, such as 25mm."""

    name = "length"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, str]:
        """Return the number and the unit."""
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(rf"\s*({_NUMBER})\s*(m|cm|mm|um)\s*", str(value))
        if match is None or not 0.0 < float(match[1]) < math.inf:
            self.fail(f"{value!r} is no length; write it with its unit, as in 25mm", param, ctx)
        return float(match[1]), match[2]


class Counts(click.ParamType):
    """Two whole numbers, columns x rows."""

    name = "CxR"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return the two numbers."""
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"\s*(\d{1,5})\s*[xX×]\s*(\d{1,5})\s*", str(value))
        if match is None or min(int(match[1]), int(match[2])) < 1:
            self.fail(f"{value!r} are no two counts; write them as 9x6", param, ctx)
        return int(match[1]), int(match[2])


POINT, LENGTH, COUNTS = Point(), Length(), Counts()


def board_options(command: F) -> F:
    """Add the options that describe a board."""
    options = (
        click.option("--chessboard", type=COUNTS, help="Inner corners of a chessboard, as in 9x6."),
        click.option("--charuco", type=COUNTS, help="Squares of a ChArUco board, as in 10x7."),
        click.option("--circles", type=COUNTS, help="Circles of a grid, as in 9x6."),
        click.option("--asymmetric", is_flag=True, help="The circles' rows are staggered."),
        click.option("--square", type=LENGTH, help="Side of a square, as in 25mm."),
        click.option("--marker", type=LENGTH, help="Side of a ChArUco marker, as in 18mm."),
        click.option(
            "--dictionary",
            default="DICT_5X5_100",
            show_default=True,
            help="Set of the ChArUco markers.",
        ),
    )
    for option in reversed(options):
        command = option(command)
    return command


def make_board(options: dict[str, Any]) -> Board | None:
    """Return the board that was described, None where there is none.

    Raises
    ------
    click.UsageError
        When the description is contradictory or incomplete.
    """
    named = [name for name in ("chessboard", "charuco", "circles") if options[name] is not None]
    if not named:
        return None
    if len(named) > 1:
        raise click.UsageError(f"--{named[0]} and --{named[1]} are two boards; give one")
    if options["square"] is None:
        raise click.UsageError(f"--{named[0]} needs --square, the side of a square, as in 25mm")
    # OpenCV is imported by what uses the board, not here.
    from openprc.vision.calibration.boards import (  # noqa: PLC0415 - only this command needs it
        Charuco,
        Chessboard,
        CircleGrid,
    )

    columns, rows = options[named[0]]
    size, units = options["square"]
    if named[0] == "chessboard":
        return Chessboard(columns, rows, size, units)
    if named[0] == "circles":
        return CircleGrid(columns, rows, size, units, asymmetric=options["asymmetric"])
    if options["marker"] is None:
        raise click.UsageError("--charuco needs --marker, the side of a marker, as in 18mm")
    from openprc.schema.units import conversion_factor  # noqa: PLC0415 - beside its only use

    marker, marker_units = options["marker"]
    return Charuco(
        columns,
        rows,
        size,
        units,
        marker=marker * conversion_factor(marker_units, units),
        dictionary=options["dictionary"],
    )


def needed_board(options: dict[str, Any]) -> Board:
    """Return the board that was described; raises click.UsageError without one."""
    board = make_board(options)
    if board is None:
        raise click.UsageError("say which board: --chessboard, --charuco or --circles")
    return board
