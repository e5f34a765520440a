"""Reading KEY=VALUE pairs."""

from __future__ import annotations

from typing import Any

import click


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
