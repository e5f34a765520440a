"""The check of /extensions/openprc-pyelastica."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.schema import Finding
from openprc_pyelastica.extras import DISTRIBUTION
from openprc_pyelastica.long_runs import is_finite

if TYPE_CHECKING:
    from openprc.schema import Trajectory


def check(trajectory: Trajectory) -> Iterator[Finding]:
    """Yield a finding for every quantity that is not finite throughout.

    Positions are refused then; what PyElastica computes besides, such as strains of a rod that
    is pulled apart, is kept as it was saved.
    """
    for name in trajectory.extension_names(DISTRIBUTION):
        values = trajectory.extension(DISTRIBUTION, name)
        if values.dtype.kind != "f" or is_finite(values):
            continue
        first = int(np.argwhere(~np.isfinite(values))[0][0])
        yield Finding(
            code="PYELASTICA-01",
            level="warning",
            path=f"/extensions/{DISTRIBUTION}/{name}",
            found=f"not finite from row {first} on",
            expected="numbers",
            fix="check the time step of the simulation",
        )
