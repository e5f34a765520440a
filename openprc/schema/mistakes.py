"""Collecting every mistake of one file, to report them together."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

SHOWN = 5


@dataclass
class Mistakes:
    """Collects mistakes of one file and raises them together."""

    file: str | Path | None = None
    found: list[tuple[str, str, str, str]] = field(default_factory=list)

    def add(self, key: str, found: str, *, expected: str, fix: str = "") -> None:
        """Remember one mistake."""
        self.found.append((key, found, expected, fix))

    def raise_if_any(self) -> None:
        """Raise one `ConfigError` for everything that was added."""
        if not self.found:
            return
        if len(self.found) == 1:
            key, found, expected, fix = self.found[0]
            raise ConfigError(found, expected=expected, fix=fix, file=self.file, key=key)
        lines = "".join(
            f"\n  - {key}: {found}; expected {expected}" + (f" ({fix})" if fix else "")
            for key, found, expected, fix in self.found
        )
        raise ConfigError(
            f"{len(self.found)} mistakes{lines}",
            expected="none",
            fix="correct every one named above",
            file=self.file,
            key=", ".join(dict.fromkeys(key for key, *_ in self.found)),
        )


def list_some(numbers: NDArray[np.integer] | list[int]) -> str:
    """Return the first few of `numbers` as text."""
    shown = ", ".join(str(int(number)) for number in numbers[:SHOWN])
    return shown + (f", ... ({len(numbers)} in all)" if len(numbers) > SHOWN else "")
