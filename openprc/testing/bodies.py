"""Bodies from lists: the records make arrays of them, and their annotations speak of arrays."""

from __future__ import annotations

from typing import Any

from openprc.schema.geometry import Bars, Bends, Geometry, Hinges


def bars(**columns: Any) -> Bars:
    """Return bars; see `openprc.schema.geometry.Bars`."""
    return Bars(**columns)


def hinges(**columns: Any) -> Hinges:
    """Return hinges; see `openprc.schema.geometry.Hinges`."""
    return Hinges(**columns)


def bends(**columns: Any) -> Bends:
    """Return bends; see `openprc.schema.geometry.Bends`."""
    return Bends(**columns)


def body(**columns: Any) -> Geometry:
    """Return a body; see `openprc.schema.geometry.Geometry`."""
    return Geometry(**columns)


__all__ = ["bars", "bends", "body", "hinges"]
