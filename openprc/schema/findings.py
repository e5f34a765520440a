"""A finding: one thing worth telling about a file or a scene, with a stable code."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

Level = Literal["error", "warning", "hint"]
LEVELS: tuple[Level, ...] = ("error", "warning", "hint")


@dataclass(frozen=True, slots=True)
class Finding:
    """What was found, where, what was expected, and what to do about it.

    ``error`` refuses, ``warning`` allows, ``hint`` suggests. `code` is stable: scripts and
    issues may quote it.
    """

    code: str
    level: Level
    path: str
    found: str
    expected: str = ""
    fix: str = ""

    def as_dict(self) -> dict[str, str]:
        """Return the fields as plain strings, for JSON output."""
        return asdict(self)
