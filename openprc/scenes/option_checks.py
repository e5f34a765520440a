"""Checks of the options of scenes that a kind alone does not make."""

from __future__ import annotations

import math
from collections.abc import Mapping

from openprc.errors import ConfigError


def check_range(
    scene: str,
    values: Mapping[str, float],
    *,
    above: float = -math.inf,
    below: float = math.inf,
    least: float = -math.inf,
    most: float = math.inf,
) -> None:
    """Refuse options that are out of range.

    Parameters
    ----------
    scene : str
    values : mapping of str to float
        Options by name.
    above, below : float
        Open ends.
    least, most : float
        Closed ends.

    Raises
    ------
    ConfigError
        For the first option that is.
    """
    for name, value in values.items():
        if above < value < below and least <= value <= most:
            continue
        ends = (
            ("above", above), ("below", below), ("at least", least), ("at most", most),
        )  # fmt: skip
        raise ConfigError(
            f"option {name} of the scene {scene!r} is {value:g}",
            expected=", ".join(f"{word} {end:g}" for word, end in ends if math.isfinite(end)),
            fix=f"say -o {name}=... with such a value",
            key=name,
        )
