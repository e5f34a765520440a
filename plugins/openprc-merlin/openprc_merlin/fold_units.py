"""Units of length in FOLD files and in trajectories."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

#: Unit of the trajectory for a `frame_unit`, and what a coordinate is multiplied by.
STORED: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        "m": ("m", 1.0),
        "cm": ("cm", 1.0),
        "mm": ("mm", 1.0),
        "um": ("um", 1.0),
        "nm": ("um", 1e-3),
        "in": ("mm", 25.4),
        "pt": ("mm", 25.4 / 72),
    }
)
NO_UNIT = "unit"


def frame_unit(unit: str) -> str:
    """Return the `frame_unit` of positions in `unit`; "unit" where FOLD has no name for it."""
    return unit if unit in ("m", "cm", "mm", "um") else NO_UNIT
