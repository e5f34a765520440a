"""Kinds of options that click does not have."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from openprc.errors import ConfigError

F = TypeVar("F", bound=Callable[..., Any])


class FiniteFloat(click.ParamType):
    """A number; ``nan`` and ``inf``, which `float` takes, would pass every comparison."""

    name = "float"

    def __init__(self, *, least: float = -math.inf) -> None:
        self.least = least

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number, or fail as click's own types do."""
        number: float = click.FLOAT.convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        if number < self.least:
            self.fail(f"{value!r} is less than {self.least:g}.", param, ctx)
        return number


FINITE = FiniteFloat()
NOT_NEGATIVE = FiniteFloat(least=0.0)


def pairs_option(owner: str) -> Callable[[F], F]:
    """Return the option KEY=VALUE for what a record of `owner` accepts."""
    return click.option(
        "-o",
        "--option",
        "options",
        multiple=True,
        metavar="KEY=VALUE",
        help=f"Option of the {owner}; repeat it for several.",
    )


def parse_pairs(pairs: tuple[str, ...]) -> dict[str, Any]:
    """Return the options given as KEY=VALUE; a repeated key gives a list."""
    found: dict[str, Any] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key.strip():
            raise click.UsageError(f"--option takes KEY=VALUE, got {pair!r}")
        key = key.strip()
        if key in found:
            earlier = found[key]
            found[key] = [*earlier, value] if isinstance(earlier, list) else [earlier, value]
        else:
            found[key] = value
    return found


def refuse_file(folder: Path) -> None:
    """Refuse a file where a folder is to be made.

    Raises
    ------
    ConfigError
    """
    for place in (folder, *folder.parents):
        if place.exists():
            if place.is_dir():
                return
            raise ConfigError(
                f"{place} is a file",
                expected="a folder, or a name that is free",
                fix="give another --out",
                key="--out",
            )
