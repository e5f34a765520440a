"""The check of /extensions/openprc-prcpy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from openprc.schema import Finding

if TYPE_CHECKING:
    from openprc.schema import Trajectory

DISTRIBUTION = "openprc-prcpy"


def check(trajectory: Trajectory) -> Iterator[Finding]:
    """Yield a finding when the sweep axis has no value for each column, or one too many."""
    if "xs" not in trajectory.extension_names(DISTRIBUTION):
        return
    n_values = len(trajectory.extension(DISTRIBUTION, "xs"))
    wanted = {len(trajectory.channel_columns(name)) for name in trajectory.channels}
    if n_values not in wanted:
        yield Finding(
            code="PRCPY-01",
            level="warning",
            path=f"/extensions/{DISTRIBUTION}/xs",
            found=f"{n_values} values of the sweep axis",
            expected=f"one for each column: {', '.join(map(str, sorted(wanted))) or 'none'}",
            fix="import the folder again",
        )
