"""Checks of the numbers that generators are given."""

from __future__ import annotations

import math
import operator
from typing import Any

from openprc.errors import ConfigError

#: More elements than this is a typing error, and would fill the memory before anyone notices.
MAX_NODES = 5_000_000


def count(value: Any, key: str, *, least: int = 1) -> int:
    """Return `value` as an int that is at least `least`."""
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if isinstance(value, bool) or not least <= number <= MAX_NODES:
        raise ConfigError(
            f"found {value!r}", expected=f"a whole number from {least} to {MAX_NODES}", key=key
        )
    return number


def check_size(n_nodes: int, key: str) -> None:
    """Refuse meshes beyond `MAX_NODES`."""
    if n_nodes > MAX_NODES:
        raise ConfigError(f"{n_nodes} nodes", expected=f"at most {MAX_NODES}", key=key)


def length(value: Any, key: str, *, zero: bool = False) -> float:
    """Return `value` [m] as a positive (or not negative) finite float."""
    return between(value, key, low=0.0, high=math.inf, unit="m", closed=zero)


def between(
    value: Any, key: str, *, low: float, high: float, unit: str = "rad", closed: bool = False
) -> float:
    """Return `value` as a finite float in (low, high), or in [low, high] when `closed`."""
    number = _number(value)
    inside = low <= number <= high if closed else low < number < high
    if not (inside and math.isfinite(number)):
        span = f"from {low:g} to {high:g}" if closed else f"between {low:g} and {high:g}"
        if math.isinf(high):
            span = f"{'at least' if closed else 'above'} {low:g}"
        raise ConfigError(f"found {value!r}", expected=f"a number {span} {unit}", key=key)
    return number


def _number(value: Any) -> float:
    try:
        return math.nan if isinstance(value, str | bool) else float(value)
    except (TypeError, ValueError):
        return math.nan
